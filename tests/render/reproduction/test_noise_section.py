"""Noise of OC beside CC: levels that can be worked by hand, and the paper's own spectra as recordings."""

import numpy as np
import pytest

from palpate.render import NoiseSpectrum, StrategyError
from palpate.render.reproduction.noise_section import compare_noise, paper_above
from palpate.render.reproduction.paper_numbers import BIN, paper_spectra

FREQUENCY = BIN * np.arange(1, 511)


def recording(level, peak=1.0):
    return NoiseSpectrum(FREQUENCY, np.broadcast_to(10 ** (np.asarray(level, float) / 10), FREQUENCY.shape), peak)


def paper_recordings():
    at, closed, opened = paper_spectra()
    return recording(np.interp(FREQUENCY, at, opened)), recording(np.interp(FREQUENCY, at, closed))


def test_differences_are_those_of_pairs():
    opened = [recording(3.0, peak=2.0), recording(5.0, peak=0.5)]
    closed = [recording(0.0), recording(0.0)]
    found = compare_noise(opened, closed)
    assert found.difference["db_300_10k"] == pytest.approx([3.0, 5.0])
    assert found.values() == pytest.approx({"db_300_10k": 4.0, "db_40_300": 4.0, "dba": 4.0, "rms": 4.0, "peak": 0.0})
    assert found.open == pytest.approx(np.full(510, 10 * np.log10((10**0.3 + 10**0.5) / 2)))
    assert found.tests()["rms"]["t_test_p"] == pytest.approx(2 * np.arctan(1 / 4) / np.pi)  # t = 4 with 1 degree


def test_the_papers_own_curves_give_its_bands():
    opened, closed = paper_recordings()
    found = compare_noise([opened], [closed])
    # All 510 bins give 5.9, 0.0 and 5.6 dB; 30 of them, joined by lines, are near.
    assert found.values()["db_300_10k"] == pytest.approx(5.9, abs=0.3)
    assert found.values()["db_40_300"] == pytest.approx(0.0, abs=0.1)
    assert found.values()["dba"] == pytest.approx(5.6, abs=0.6)
    assert found.shape_error == pytest.approx(0.0, abs=1e-9)


def test_the_papers_background_hides_what_is_below_it():
    opened, closed = paper_recordings()
    at, paper, _ = paper_spectra()
    room = 10 * np.log10(np.mean(10 ** (paper[at >= 3000] / 10)))
    assert compare_noise([opened], [closed]).above(False) == pytest.approx(paper_above(), abs=0.1)
    silent = compare_noise([opened], [recording(-300.0)])
    assert silent.above(False) > 200
    inside = (FREQUENCY >= 1000) & (FREQUENCY < 10_000)
    expected = 10 * np.log10(1 + opened.power[inside].mean() / 10 ** (room / 10))
    assert silent.above(True) == pytest.approx(expected, abs=0.1)
    louder = compare_noise([recording(opened.level + 40)], [recording(-300.0)])
    assert louder.above(True) == pytest.approx(expected, abs=0.1)  # the reference is nothing


@pytest.mark.parametrize(
    ("opened", "closed", "message"),
    [
        ([], [], "not 0 and 0"),
        ([recording(0.0)], [], "not 1 and 0"),
        ([recording(0.0)], [NoiseSpectrum(2 * FREQUENCY, np.ones(510), 1.0)], "same bins: 510 to 21963.9 Hz"),
    ],
)
def test_recordings_that_are_no_pairs_are_refused(opened, closed, message):
    with pytest.raises(StrategyError, match=message):
        compare_noise(opened, closed)
