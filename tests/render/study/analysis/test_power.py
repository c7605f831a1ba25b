"""Power by simulation against exact enumeration and noncentral t; what cannot be asked is refused with its bound."""

import math
from dataclasses import replace

import numpy as np
import pytest
from answered_tables import PAPER, QUESTION, levels_text, plan_of, stimulus_text
from scipy import stats

from palpate.render.errors import StrategyError
from palpate.render.study.analysis import power
from palpate.render.study.analysis.measure_tests import compare_pairs
from palpate.render.study.analysis.power import (
    PARTICIPANTS,
    SPREAD,
    WANTED,
    FoundPower,
    find_power,
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


@pytest.fixture(scope="module")
def two_blocks():
    return plan_of(stimulus_text("a", "b"), TWO_BLOCKS, participants=12)


def asked(plan, tables=1000, **options):
    """A question, of fewer simulated studies than the command simulates."""
    return replace(power_question(plan, OPTIONS | {"spread": 0.0} | options), tables=tables)


def test_where_nobody_says_participants_differ_and_what_is_assumed_is_shown(paper):
    own = power_question(paper, OPTIONS | {"mean": 0.6})
    assert own.spread == SPREAD > 0.0
    # Of probabilities around 0.6 whose logits have a deviation of 1: 0.20, by the integral over the normal density.
    assert own.assumed["spread"] == "1 of the logit: participants' probabilities deviate by 0.20"
    assert own.assumed["answers"] == "10 in each of 6 cells"
    scale = power_question(paper, OPTIONS | {"measure": "confidence", "mean": 5.0, "mean_other": 4.0})
    assert scale.assumed["mean"] == "5, and 4 at dog"
    assert scale.assumed["spread"] == "1 point between participants, 1 of one answer (standard deviations)"


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


@pytest.mark.parametrize("mean", [0.3, 0.55, 0.7, 0.95])
@pytest.mark.parametrize("people", [6, 9, 16, 30])
def test_the_power_of_single_answers_is_exact_within_the_noise_of_many_studies(people, mean):
    question = asked(plan_of(stimulus_text("a", "b"), ONE_PAIR), mean=mean, tables=3000)
    found = power_of(replace(question, trials=(1,)), people)
    require_share(found.power, exact_power(people, mean), 3000)
    assert found.low <= found.power <= found.high


def test_power_of_five_participants_is_none_as_no_p_is_small_enough():
    question = asked(plan_of(stimulus_text("a", "b"), ONE_PAIR), mean=0.9, spread=0.5, tables=100)
    question = replace(question, trials=(10**6,))  # so many answers have no ties, and p is exact: 2 of 2^5 at least
    found = power_of(question, 5)
    assert (found.power, found.low) == (0.0, 0.0)
    assert found.high == pytest.approx(1.0 - 0.025 ** (1 / 100))  # Clopper and Pearson's, of 0 of 100


def test_the_power_of_points_is_about_that_of_the_paired_t_test(two_blocks):
    question = asked(two_blocks, measure="ease", mean=4.5, mean_other=3.5, tables=150, spread=1.0)
    # One answer at each level: its own noise of 1 point, and that of rounding, 1/12; the person's own part cancels.
    effect = 1.0 / math.sqrt(2.0 * (1.0 + 1.0 / 12.0))
    for people in (12, 20):
        bound = stats.t.ppf(0.975, people - 1)
        expected = stats.nct.sf(bound, people - 1, effect * math.sqrt(people))
        assert abs(power_of(question, people).power - expected) < 0.12  # ranks of ties are a little weaker


def test_more_participants_and_larger_effects_are_found_more_often(two_blocks):
    question = asked(two_blocks, mean=0.65, spread=0.5, tables=70)
    by_people = [power_of(question, people).power for people in (6, 12, 24)]
    assert by_people == sorted(by_people)
    assert by_people[0] + 0.3 < by_people[-1]
    by_effect = [power_of(asked(two_blocks, mean=mean, spread=0.5, tables=70), 8).power for mean in (0.52, 0.75)]
    assert by_effect == sorted(by_effect)
    assert by_effect[-1] - by_effect[0] > 0.5


def test_people_who_differ_and_who_answer_the_other_way_cost_power(two_blocks):
    found = [
        power_of(asked(two_blocks, mean=0.75, tables=80, **own), 10).power
        for own in ({}, {"spread": 2.0}, {"opposite": 0.3})
    ]
    assert found[0] > found[1] + 0.1
    assert found[0] > found[2] + 0.3


def test_equal_seeds_give_equal_power_whatever_was_asked_before(two_blocks):
    question = asked(two_blocks, mean=0.6, tables=100)
    one = power_of(question, 9)
    power_of(replace(question, tables=1), 7)
    assert power_of(question, 9) == one
    assert power_of(replace(question, seed=2), 9) != one


def test_no_effect_is_found_as_often_as_p_says(two_blocks):
    question = replace(asked(two_blocks, mean=0.6, tables=300), mean=0.5)
    assert power_of(question, 12).power <= 0.025 + BELIEVED * math.sqrt(0.025 * 0.975 / 300)  # one direction counts


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


def test_people_who_answer_the_other_way_have_the_opposite_proportion(paper):
    question = replace(asked(paper, mean=0.8, opposite=0.25), trials=(2000,) * 6)
    people = simulate_measure(question, 2000, np.random.default_rng(2)).values.mean(axis=1)
    assert np.unique(people.round(1)).tolist() == [0.2, 0.8]
    assert (people < 0.5).mean() == pytest.approx(0.25, abs=0.04)


@pytest.mark.parametrize(
    ("mean", "spread", "noise"), [(4.3, 0.5, 1.0), (6.5, 1.0, 1.0), (1.4, 0.0, 1.5), (4.3, 0.0, 0.1)]
)
def test_simulated_points_have_the_mean_that_was_asked_for_at_the_ends_of_the_scale_too(paper, mean, spread, noise):
    question = asked(
        paper, measure="confidence", mean=mean, mean_other=4.0, factor="opacity", spread=spread, noise=noise
    )
    own = simulate_measure(question, 4000, np.random.default_rng(3))
    assert own.values[:, ::2].mean() == pytest.approx(mean, abs=0.05)
    assert own.values[:, 1::2].mean() == pytest.approx(4.0, abs=0.05)
    assert (own.values.min() >= 1.0, own.values.max() <= 7.0) == (True, True)
    assert np.all(own.values == own.values.round())  # one answer in each cell is a point


def test_participants_differ_on_scales_by_the_spread_and_answers_by_the_noise(paper):
    question = asked(paper, measure="confidence", mean=4.0, mean_other=4.1, factor="opacity", spread=0.8, noise=0.6)
    values = simulate_measure(question, 4000, np.random.default_rng(3)).values
    within = values.std(axis=1, ddof=1)
    # Rounding adds 1/12 to the variance of an answer.
    assert np.mean(within**2) == pytest.approx(0.36 + 1 / 12, abs=0.03)
    assert values.mean(axis=1).var() == pytest.approx(0.64 + (0.36 + 1 / 12) / 6, abs=0.05)


def test_the_last_level_alone_has_the_other_mean(paper):
    question = replace(asked(paper, mean=0.8, mean_other=0.3, factor="object"), trials=(500,) * 6)
    values = simulate_measure(question, 200, np.random.default_rng(4)).values.mean(axis=0)
    assert values.round(1).tolist() == [0.8, 0.8, 0.8, 0.8, 0.3, 0.3]
    assert question.sought == "p_cc differs between cube and dog"
    assert asked(paper).sought == "p_cc differs from chance"


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


@pytest.mark.parametrize("needed", [6, 7, 12, 13, 59, 60, 65, 195, 200])
def test_the_least_number_with_the_wanted_power_is_found_by_halving(two_blocks, monkeypatch, needed):
    tried = []

    def power_of(_, people):
        tried.append(people)
        return FoundPower(participants=people, power=0.85 if people >= needed else 0.7, low=0.0, high=1.0)

    monkeypatch.setattr(power, "power_of", power_of)
    found = find_power(asked(two_blocks))
    assert min(own.participants for own in found if own.power >= WANTED) == needed
    assert 12 in [own.participants for own in found]  # the plan's own
    assert sorted(tried) == [own.participants for own in found]  # each once
    assert len(found) <= math.ceil(math.log2(len(PARTICIPANTS))) + 2


def test_a_power_that_no_number_has_is_said_of_the_largest(two_blocks, monkeypatch):
    never = lambda _, people: FoundPower(participants=people, power=0.2, low=0.1, high=0.3)  # noqa: E731
    monkeypatch.setattr(power, "power_of", never)
    found = find_power(asked(two_blocks))
    assert found[-1].participants == PARTICIPANTS[-1]
    assert all(own.power < WANTED for own in found)


def test_answers_of_each_cell_are_those_of_the_plan(paper):
    assert asked(paper).trials == (10,) * 6
    assert asked(paper, measure="difficulty", mean=3.0, mean_other=4.0).trials == (1,) * 6
    rating = (
        '[[block]]\nname = "r"\ndesign = "rating"\nstimuli = ["a", "b"]\nrepetitions = 3\n'
        '[[block.question]]\nname = "soft"\ntext = "?"\nkind = "scale"\n'
    )
    pairs = 'pairs = [["a", "b"], ["a", "c"]]\nrepetitions = 4\npractice = 5\n'
    two_pairs = f'[[block]]\nname = "p"\ndesign = "2ifc"\n{pairs}{QUESTION}\n'
    plan = plan_of(stimulus_text("a", "b", "c"), rating, two_pairs)
    assert asked(plan, measure="soft", mean=3.0, mean_other=4.0).trials == (3, 3)
    assert asked(plan).trials == (8, 8)


def test_scales_with_completed_names_have_the_answers_of_their_blocks():
    two = ONE_PAIR + ONE_PAIR.replace('"x"', '"y"').replace('kind = "scale"', 'kind = "scale"\npoints = 5')
    two += ONE_PAIR.replace('"x"', '"z"')
    plan = plan_of(stimulus_text("a", "b"), two.replace("[[block]]", "[[block]]\nrepetitions = 4"))
    question = asked(plan, measure="ease_7", mean=3.0, mean_other=4.0)
    assert question.trials == (1, 1)
    assert question.measure.factors == {"block": ("x", "z")}


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


def test_a_plan_without_pairs_and_scales_has_no_power():
    plan = plan_of(levels_text([1, 2]), f'[[block]]\nname = "m"\ndesign = "magnitude"\nstimuli = ["s1"]\n{QUESTION}\n')
    with pytest.raises(
        StrategyError, match="--power needs a plan with blocks of the design 2ifc, or with questions of"
    ):
        asked(plan)


def test_a_plan_with_one_cell_has_no_factor():
    plan = plan_of(stimulus_text("a", "b"), ONE_PAIR)
    with pytest.raises(StrategyError, match="--mean-other needs a factor with two levels, and p_b has none"):
        asked(plan, mean_other=0.6)


def test_certain_answers_need_no_finite_logit(two_blocks):
    own = simulate_measure(asked(two_blocks, mean=1.0, mean_other=0.0), 5, np.random.default_rng(1))
    assert own.values.tolist() == [[1.0, 0.0]] * 5
