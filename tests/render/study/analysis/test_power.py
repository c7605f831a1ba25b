"""Power by simulation against exact enumeration and noncentral t; what cannot be asked is refused with its bound."""

import math
from dataclasses import replace

import numpy as np
import pytest
from answered_tables import PAPER, QUESTION, plan_of, stimulus_text
from scipy import stats

from palpate.render.errors import StrategyError
from palpate.render.study.analysis.measure_tests import compare_pairs
from palpate.render.study.analysis.power import (
    power_of,
    power_question,
    simulate_measure,
)

pytestmark = pytest.mark.exhaustive

OPTIONS = {
    "measure": None, "mean": 0.7, "mean_other": None, "factor": None, "spread": None, "opposite": None, "noise": None,
    "tables": 1000, "seed": 1,
}  # fmt: skip
SCALE = '[[block.question_after]]\nname = "ease"\ntext = "?"\nkind = "scale"\n'
ONE_PAIR = f'[[block]]\nname = "x"\ndesign = "2ifc"\npairs = [["a", "b"]]\n{QUESTION}\n{SCALE}'
TWO_BLOCKS = (
    '[[block]]\nfor = { light = ["dim", "lit"] }\nname = "{light}"\ndesign = "2ifc"\npairs = [["a", "b"]]\n'
    f"repetitions = 5\n{QUESTION}\n{SCALE}"
)
HOLM = ", Holm-corrected"
BELIEVED = 3.3  # standard deviations between which a share of simulations lies, but for 1 of 1000 seeds


@pytest.fixture(scope="module")
def paper():
    return plan_of(PAPER)


def asked(plan, tables=1000, **options):
    """A question, of fewer simulated studies than the command simulates."""
    return replace(power_question(plan, OPTIONS | {"spread": 0.0} | options), tables=tables)


@pytest.mark.parametrize(
    ("levels", "pairs", "correction"), [(None, 0, ""), (["dim", "lit"], 1, ""), (["dim", "lit", "red"], 3, HOLM)]
)
def test_a_correction_is_assumed_where_the_analysis_makes_one(levels, pairs, correction):
    """A single pair of levels is no family: its p is compared with 0.05 as it is."""
    blocks = TWO_BLOCKS.replace('["dim", "lit"]', str(levels or ["dim", "lit"]))
    more = {} if levels is None else {"factor": "light", "mean_other": 0.5}
    own = asked(plan_of(stimulus_text("a", "b"), blocks, participants=12), **more)
    assert own.assumed["test"] == f"Wilcoxon, two-sided, 0.05{correction}"
    if levels is not None:
        tests = compare_pairs(simulate_measure(own, 12, np.random.default_rng(1)), "light")
        assert [test.p_holm is not None for test in tests] == [pairs > 1] * pairs


def require_share(found, expected, tables):
    deviation = math.sqrt(expected * (1.0 - expected) / tables)
    assert abs(found - expected) <= BELIEVED * deviation, (found, expected)


def normal_p(successes, count):
    """p of Wilcoxon's test of `successes` values +0.5 and all others -0.5: all sizes are tied, so V = k (n + 1) / 2."""
    value, mean = successes * (count + 1) / 2, count * (count + 1) / 4
    variance = count * (count + 1) * (2 * count + 1) / 24 - (count**3 - count) / 48
    return math.erfc(max(0.0, abs(value - mean) - 0.5) / math.sqrt(2.0 * variance))


def exact_power(people, mean):
    """Power of one answer of each participant: a sum over all numbers of answers of one kind."""
    found = (k for k in range(people + 1) if normal_p(k, people) < 0.05 and (2 * k > people) == (mean > 0.5))
    return sum(stats.binom.pmf(k, people, mean) for k in found)


@pytest.mark.parametrize(("people", "mean"), [(8, 0.9), (7, 0.8), (12, 0.2)])
def test_the_power_of_single_answers_is_that_of_exact_enumeration(people, mean):
    question = asked(plan_of(stimulus_text("a", "b"), ONE_PAIR), mean=mean, tables=200)
    found = power_of(replace(question, trials=(1,)), people)
    require_share(found.power, exact_power(people, mean), 200)


@pytest.mark.parametrize(("mean", "spread"), [(0.7, 0.0), (0.7, 1.5), (0.2, 3.0), (0.5, 1.0), (0.97, 0.7)])
def test_simulated_proportions_have_the_mean_and_spread_that_were_asked_for(paper, mean, spread):
    question = asked(paper, mean=mean, spread=spread) if mean != 0.5 else replace(asked(paper, spread=spread), mean=0.5)
    question = replace(question, trials=(2000,) * 6)
    own = simulate_measure(question, 4000, np.random.default_rng(1))
    people = own.values.mean(axis=1)
    assert people.mean() == pytest.approx(mean, abs=BELIEVED * people.std() / math.sqrt(4000) + 1e-3)
    inner = people[(people > 0.0) & (people < 1.0)]
    assert np.log(inner / (1.0 - inner)).std() == pytest.approx(spread, abs=0.05 + 0.06 * spread)
    assert own.counts.tolist()[0] == [2000] * 6
    np.testing.assert_array_equal(own.values, own.successes / own.counts)


def test_the_pair_is_corrected_for_the_family_of_the_analysis(paper):
    question = asked(paper, mean=0.62, mean_other=0.5, factor="object", tables=60)
    hits, rng = 0, np.random.default_rng([1, 14])
    for _ in range(60):
        values = simulate_measure(question, 14, rng).values
        objects = [values[:, place : place + 2].mean(axis=1) for place in (0, 2, 4)]
        p, sums = [], []
        for one, other in ((0, 1), (0, 2), (1, 2)):
            found = (objects[one] - objects[other]).round(9)
            found = found[found != 0.0]
            is_exact = len(found) == 14 and len(np.unique(abs(found))) == 14
            p.append(stats.wilcoxon(found, method="exact" if is_exact else "approx", correction=True).pvalue)
            sums.append((stats.rankdata(abs(found)) * np.sign(found)).sum())
        order = sorted(range(3), key=lambda place: p[place])
        corrected, least = [0.0] * 3, 0.0
        for k, place in enumerate(order):
            least = corrected[place] = max(least, min(1.0, p[place] * (3 - k)))
        hits += corrected[1] < 0.05 and sums[1] > 0  # cube - dog
    assert power_of(question, 14).power == hits / 60
    assert 0 < hits < 60


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"mean": None}, "--power needs --mean, the proportion of answers for cc that you expect, 0 to 1"),
        ({"mean": 1.2}, "--mean must be 0 to 1, not 1.2"),
        ({"mean": float("nan")}, "--mean must be 0 to 1, not nan"),
        ({"mean": 0.5}, "--mean must differ from 0.5, with which it is compared: else there is no effect"),
        ({"mean": 0.6, "mean_other": 0.6}, "--mean must differ from 0.6, with which it is compared"),
        ({"mean_other": -0.1}, "--mean-other must be 0 to 1, not -0.1"),
        (
            {"factor": "object"},
            "--factor object needs --mean-other: the proportion of answers for cc at its last level",
        ),
        ({"factor": "colour", "mean_other": 0.5}, "--factor must be one of object, opacity"),
        ({"measure": "p_oc"}, "--measure must be one of p_cc, confidence, difficulty, not 'p_oc'"),
        ({"measure": "confidence", "mean": 8.0}, "--mean must be 1 to 7, not 8"),
        ({"measure": "confidence", "mean": 5.0}, "confidence has no chance level: --mean-other and --factor say what"),
        ({"spread": -1.0}, "--spread must be 0 to 10, not -1"),
        ({"spread": float("inf")}, "--spread must be 0 to 10, not inf"),
        ({"opposite": 1.5}, "--opposite must be 0 to 1, not 1.5"),
        ({"opposite": 0.5}, "--opposite must be below 0.5, not 0.5: else no effect is left in the direction sought"),
        ({"noise": 2.0}, "--noise is of scales, and p_cc is a proportion"),
        (
            {"measure": "confidence", "mean": 5.0, "mean_other": 4.0, "opposite": 0.2},
            "--opposite is of proportions, and confidence is a scale",
        ),
        ({"measure": "confidence", "mean": 5.0, "mean_other": 4.0, "noise": 11.0}, "--noise must be 0 to 10, not 11"),
        ({"tables": 99}, "--tables must be 100 to 100000, not 99"),
        ({"tables": 100_001}, "--tables must be 100 to 100000, not 100001"),
        ({"seed": -1}, "--seed must be 0 or more, not -1"),
    ],
)
def test_what_cannot_be_asked_is_refused_with_its_bound(paper, options, message):
    with pytest.raises(StrategyError) as caught:
        power_question(paper, OPTIONS | options)
    assert message in str(caught.value)
