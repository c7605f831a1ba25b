"""Measures of answers against counts by hand: who chose what, in whichever order, with what missing."""

import numpy as np
import pytest
from answered_tables import (
    BLOCKS,
    PAPER,
    QUESTION,
    chosen,
    paper_answers,
    plan_of,
    point,
    stimulus_text,
    table_of,
)

from palpate.render.study.analysis.answer_measures import (
    choice_measures,
    counted,
    scale_measures,
)

ROWS = ["1111111111 7 1", "1111100000 4 4", "1100000000 2 6", "0000000000 1 7", "1110111011 5 3", "1010101010 3 3"]


@pytest.fixture(scope="module")
def paper():
    return plan_of(PAPER)


def pairs_text(*blocks):
    """Blocks of pairs: (name, pairs as TOML, further lines)."""
    return "\n".join(
        f'[[block]]\nname = "{name}"\ndesign = "2ifc"\npairs = {pairs}\n{QUESTION}\n' for name, pairs in blocks
    )


def strategy_stimuli(*names):
    """Live stimuli `oc` and `cc` by `for`, of each object."""
    listed = ", ".join(f'"{own}"' for own in names)
    return (
        f'[[stimulus]]\nfor = {{ object = [{listed}], strategy = ["oc", "cc"] }}\nname = "{{object}}-{{strategy}}"\n'
        'object = "{object}"\nstrategy = "{strategy}"\nduration = 1.0\n'
    )


def test_p_is_the_share_of_answers_for_the_stimulus_with_closed_contours(paper):
    (own,) = choice_measures(table_of(paper, paper_answers("P01", ROWS)))
    assert (own.name, own.title, own.chance) == ("p_cc", "proportion of answers for cc", 0.5)
    assert own.values.tolist() == [[1.0, 0.5, 0.2, 0.0, 0.8, 0.5]]
    assert own.successes.tolist() == [[10, 5, 2, 0, 8, 5]]
    assert own.counts.tolist() == [[10] * 6]
    assert [cell.name for cell in own.cells] == list(BLOCKS)
    assert own.factors == {"object": ("cube", "tube", "dog"), "opacity": (1.0, 0.7)}


def test_the_order_of_answers_and_participants_changes_nothing(paper):
    answers = [own for code in ("P01", "P02") for own in paper_answers(code, ROWS if code == "P01" else ROWS[::-1])]
    shuffled = [answers[place] for place in np.random.default_rng(1).permutation(len(answers))]
    for measures in (choice_measures, scale_measures):
        for one, other in zip(measures(table_of(paper, answers)), measures(table_of(paper, shuffled)), strict=True):
            assert one.codes == other.codes
            np.testing.assert_array_equal(one.values, other.values)


def test_practice_counts_for_nothing(paper):
    answers = chosen("P01", "cube-1.0", ("cube-oc", "cube-cc"), "0001110", practice=3)
    table = table_of(paper, answers, point("P01", "cube-1.0", "confidence", 2, trial=0, is_practice=True))
    (own,) = choice_measures(table)
    assert (own.successes[0, 0], own.counts[0, 0]) == (3, 4)
    assert len(list(counted(table))) == 4


@pytest.mark.parametrize(
    ("pairs", "name", "expected"),
    [
        ('[["cube-oc", "cube-cc"]]', "p_cc", [0.75]),
        ('[["cube-cc", "cube-oc"]]', "p_oc", [0.25]),  # the same answers, but asked the other way round
        ('[["cube-oc", "tube-oc"]]', "p_tube", None),  # the strategy is the same, the object differs
        ('[["cube-oc", "tube-cc"]]', "p_tube", None),  # both differ: the first factor of the plan names the measure
        ('[["cube-oc", "cube-cc"], ["tube-oc", "tube-cc"]]', "p_cc", None),
        ('[["cube-oc", "cube-cc"], ["tube-cc", "tube-oc"]]', "p_cc", None),
        ('[["cube-oc", "cube-cc"], ["cube-oc", "tube-oc"]]', "p_second", None),  # nothing is common to the seconds
    ],
)  # fmt: skip
def test_a_measure_is_called_after_what_one_stimulus_of_each_pair_has(pairs, name, expected):
    plan = plan_of(strategy_stimuli("cube", "tube"), pairs_text(("one", pairs)))
    (own,) = choice_measures(table_of(plan, chosen("P01", "one", ("cube-oc", "cube-cc"), "1110")))
    assert own.name == name
    assert expected is None or own.values.tolist() == [expected]


def test_pairs_of_different_targets_are_a_measure_for_each_question():
    def block(name, pair, question):
        return f'[[block]]\nname = "{name}"\ndesign = "2ifc"\npairs = {pair}\nquestion = "{question}"\n'

    parts = [block("x", '[["oc", "cc"]]', "Denser?"), block("y", '[["small", "large"]]', "Larger?")]
    plan = plan_of(stimulus_text("oc", "cc", "small", "large"), *parts)
    answers = chosen("P01", "x", ("oc", "cc"), "11"), chosen("P01", "y", ("small", "large"), "10")
    found = choice_measures(table_of(plan, *answers))
    assert [(own.name, own.values.tolist()) for own in found] == [("p_cc", [[1.0]]), ("p_large", [[0.5]])]
    rounds = '[["oc", "cc"], ["cc", "small"], ["oc", "small"]]'
    plan = plan_of(
        stimulus_text("oc", "cc", "small", "large"), block("x", rounds, "Denser?"), block("y", rounds, "Larger?")
    )
    first, second = choice_measures(table_of(plan))
    assert (first.name, second.name) == ("p_second_1", "p_second_2")
    assert first.title == "proportion of answers for cc over oc, small over cc, small over oc"
