"""The benchmark of simulated studies runs, small, and its page says what was planted and what was found."""

import json
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[3] / "benchmarks"))
import simulated_study
from study_observers import Observer

from palpate.render.study.analysis.hypothesis_tests import bound_proportion


def test_planted_shares_are_those_of_the_observers_noise():
    strengths = {"cube-cc": 1.0, "cube-oc": 0.0}
    own = Observer(seed=1, strengths=strengths, sensitivity=1.2, lapse=0.1, opacity_effect=0.5)
    # Of two feelings with a deviation of 1 the difference has sqrt(2); 1.2 (1 + 0.25) / sqrt(2) = 1.0607, Phi = 0.8556.
    assert simulated_study.closed_share(own, "cube", 1.0) == pytest.approx(0.05 + 0.9 * 0.8556, abs=1e-4)
    assert simulated_study.closed_share(own, "cube", 0.7) == pytest.approx(0.05 + 0.9 * 0.7377, abs=1e-4)  # Phi(0.6364)
    against = Observer(seed=1, strengths=strengths, sign=-1, lapse=0.0)
    assert simulated_study.closed_share(against, "cube", 1.0) == pytest.approx(0.2398, abs=1e-4)  # Phi(-1 / sqrt(2))
    nothing = Observer(seed=1, strengths=strengths, sign=0, lapse=0.0)
    assert simulated_study.closed_share(nothing, "cube", 1.0) == 0.5


@pytest.mark.exhaustive
def test_the_page_has_every_number(tmp_path, capsys):
    page = tmp_path / "page.md"
    assert simulated_study.main(["--studies", "1", "--tables", "4", "--workers", "1", "--page", str(page)]) == 0
    figures = json.loads(capsys.readouterr().out)
    (study,) = figures["studies"]
    assert study["answers"] == 18 * (1 + 5 + 6 * 12 + 1)
    assert set(study["planted"]) == set(study["recovered"])
    for name in ("p_cc", "p_cc cube", "p_cc tube", "p_cc dog"):
        assert study["recovered"][name] == pytest.approx(study["planted"][name], abs=0.06)
    text = page.read_text()
    assert all(name in text for name in (*study["planted"], *study["found"], *simulated_study.PEOPLE))


@pytest.mark.exhaustive
@pytest.mark.parametrize("people", ["nothing is felt", "two groups"])
def test_the_analysis_finds_no_more_than_5_percent_where_nothing_is(people):
    count = 150
    rates = simulated_study.table_rates(people, count, 1)
    names = [
        "p_cc against chance, participants", "p_cc against chance, t-test", "p_cc by opacity, any pair",
        "p_cc by object, any pair", "p_cc by object, Friedman",
    ]  # fmt: skip
    if people == "two groups":
        names = [own for own in names if "object" not in own]
        assert rates["found"]["p_cc against chance, cells as observations"] > 0.1 * count
    for name in names:
        assert bound_proportion(rates["found"].get(name, 0), count).low <= 0.05, name


@pytest.mark.exhaustive
def test_the_analysis_finds_what_is_planted_as_often_as_its_power_says():
    for own in simulated_study.compare_power(400):
        assert own["rate_low"] <= own["power_high"], own
        assert own["power_low"] <= own["rate_high"], own
