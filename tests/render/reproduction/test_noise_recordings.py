"""Noise of OC beside CC: levels that can be worked by hand, and the paper's own spectra as recordings."""

import numpy as np
import pytest

from palpate.render import NoiseSpectrum, StrategyError
from palpate.render.reproduction.noise_recordings import compare_noise, paper_above
from palpate.render.reproduction.noise_section import NAMES, noise_section
from palpate.render.reproduction.paper_spectra import BIN, POINTS, paper_spectra

FREQUENCY = BIN * np.arange(1, 511)


def recording(level, peak=1.0):
    return NoiseSpectrum(FREQUENCY, np.broadcast_to(10 ** (np.asarray(level, float) / 10), FREQUENCY.shape), peak)


def paper_recordings():
    at, closed, opened = paper_spectra()
    return recording(np.interp(FREQUENCY, at, opened)), recording(np.interp(FREQUENCY, at, closed))


def test_the_papers_points_are_few_and_cover_both_bands():
    at, closed, opened = paper_spectra()
    assert len(POINTS) <= 30
    assert (np.diff(at) > 0).all()
    assert at[0] == pytest.approx(43.07, abs=0.01)
    assert (at < 300).sum() >= 5
    assert ((at > 300) & (at < 4000)).sum() >= 15
    assert 9900 < at[-1] < 10_000
    assert (opened - closed)[(at > 800) & (at < 1300)].min() > 10  # louder by over 10 dB there


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


def test_the_shape_does_not_depend_on_the_reference():
    opened, closed = paper_recordings()
    louder = recording(opened.level + 70.0)
    tilted = recording(opened.level + 3.0 * np.log2(FREQUENCY))
    assert compare_noise([louder], [closed]).shape_error == pytest.approx(0.0, abs=1e-9)
    assert compare_noise([tilted], [closed]).shape_error > 2.0


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


def test_the_section_has_a_row_a_quantity_and_both_spectra():
    opened, closed = paper_recordings()
    pairs = [(recording(opened.level + k), closed) for k in range(4)]
    found = compare_noise(*(list(part) for part in zip(*pairs, strict=True)))
    section, values = noise_section(found, "Made by hand.", dict.fromkeys((*NAMES, "above", "shape"), "no reason"))
    assert [row.what for row in section.rows[:3]] == [
        "OC - CC, 300 Hz to 10 kHz", "OC - CC, 40 to 300 Hz", "OC - CC, A-weighted",
    ]  # fmt: skip
    assert section.rows[0].paper == "+5.9 dB"
    assert section.rows[3].what == "OC - CC, RMS"
    assert values["noise"]["rms"] == pytest.approx(found.difference["rms"].mean())
    assert {"db_300_10k", "db_40_300", "dba", "rms"} <= set(values["noise"])
    assert section.pictures[0].uri.startswith("data:image/svg+xml;base64,")
