"""Measures of answers against counts by hand: who chose what, in whichever order, with what missing."""

from dataclasses import replace

import numpy as np
import pytest
from answered_tables import (
    BLOCKS,
    PAPER,
    QUESTION,
    chosen,
    levels_text,
    paper_answers,
    paper_block,
    plan_of,
    point,
    stimulus_text,
    table_of,
)

from palpate.render.study.analysis.answer_measures import (
    block_factors,
    choice_measures,
    counted,
    ratio_measures,
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


def test_other_codes_and_other_names_of_blocks_change_names_only(paper):
    renamed = plan_of(
        PAPER.replace("participants = 3", 'codes = ["zz", "aa"]').replace(
            '"{object}-{opacity}"', '"x {object} {opacity}"'
        )
    )
    given = paper_answers("P01", ROWS) + paper_answers("P02", ROWS[::-1])
    moved = [
        own._replace(code={"P01": "zz", "P02": "aa"}[own.code], block="x " + own.block.replace("-", " "))
        for own in given
    ]
    (one,), (other,) = choice_measures(table_of(paper, given)), choice_measures(table_of(renamed, moved))
    assert other.codes == ("zz", "aa")  # the plan's order, not the alphabet's
    np.testing.assert_array_equal(one.values, other.values)
    assert other.factors == one.factors


def test_practice_counts_for_nothing(paper):
    answers = chosen("P01", "cube-1.0", ("cube-oc", "cube-cc"), "0001110", practice=3)
    table = table_of(paper, answers, point("P01", "cube-1.0", "confidence", 2, trial=0, is_practice=True))
    (own,) = choice_measures(table)
    assert (own.successes[0, 0], own.counts[0, 0]) == (3, 4)
    assert len(list(counted(table))) == 4


def test_cells_without_answers_are_missing_and_not_zero(paper):
    (own,) = choice_measures(table_of(paper, paper_block("P01", "tube-0.7", "1101")))
    assert np.isnan(own.values[0]).tolist() == [True, True, True, False, True, True]
    assert own.values[0, 3] == 0.75
    assert own.counts[0].tolist() == [0, 0, 0, 4, 0, 0]


def test_nobody_has_measures_without_values(paper):
    empty = table_of(paper)
    assert [own.values.shape for own in (*choice_measures(empty), *scale_measures(empty))] == [(0, 6)] * 3
    assert choice_measures(empty)[0].counts.shape == (0, 6)
    assert ratio_measures(empty) == []


def test_a_plan_without_pairs_and_scales_has_no_measures():
    plan = plan_of(levels_text([1, 2]), f'[[block]]\nname = "a"\ndesign = "magnitude"\nstimuli = ["s1"]\n{QUESTION}\n')
    table = table_of(plan)
    assert choice_measures(table) == scale_measures(table) == ratio_measures(table) == []


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


def test_pairs_that_the_plan_writes_in_either_order_count_the_same_stimulus():
    stimuli = strategy_stimuli("cube", "tube")
    plan = plan_of(stimuli, pairs_text(("one", '[["cube-oc", "cube-cc"]]'), ("two", '[["tube-cc", "tube-oc"]]')))
    answers = chosen("P01", "one", ("cube-oc", "cube-cc"), "1110") + chosen(
        "P01", "two", ("tube-cc", "tube-oc"), "0001"
    )
    (own,) = choice_measures(table_of(plan, answers))
    assert own.name == "p_cc"
    assert own.values.tolist() == [[0.75, 0.75]]  # 3 of 4 for cc in both blocks


def test_pairs_of_stimuli_without_factors_are_called_after_the_stimulus_that_all_have():
    stimuli = stimulus_text("soft", "hard", "none")
    plan = plan_of(stimuli, pairs_text(("one", '[["none", "soft"]]'), ("two", '[["soft", "hard"]]')))
    answers = chosen("P01", "one", ("none", "soft"), "1110") + chosen("P01", "two", ("soft", "hard"), "1110")
    (own,) = choice_measures(table_of(plan, answers))
    assert own.name == "p_soft"
    assert own.values.tolist() == [[0.75, 0.25]]
    plan = plan_of(stimuli, pairs_text(("one", '[["none", "soft"]]'), ("two", '[["none", "hard"]]')))
    assert choice_measures(table_of(plan))[0].name == "p_second"


def test_levels_become_words_of_columns():
    text = '[[stimulus]]\nfor = { s = [0.5, "a b"] }\nname = "n{s}"\nobject = "cube"\nduration = 1.0\n'
    for pair, name in (('["n0.5", "na b"]', "p_a_b"), ('["na b", "n0.5"]', "p_0_5")):
        assert choice_measures(table_of(plan_of(text, pairs_text(("one", f"[{pair}]")))))[0].name == name


def test_each_pair_of_a_block_with_several_is_a_cell():
    plan = plan_of(
        strategy_stimuli("cube", "tube"), pairs_text(("one", '[["cube-oc", "cube-cc"], ["tube-oc", "tube-cc"]]'))
    )
    answers = chosen("P01", "one", ("cube-oc", "cube-cc"), "11") + chosen(
        "P01", "one", ("tube-oc", "tube-cc"), "0001", first=2
    )
    (own,) = choice_measures(table_of(plan, answers))
    assert [cell.name for cell in own.cells] == ["one: cube-cc over cube-oc", "one: tube-cc over tube-oc"]
    assert own.factors == {"pair": ("cube-cc over cube-oc", "tube-cc over tube-oc")}
    assert own.values.tolist() == [[1.0, 0.25]]
    assert own.counts.tolist() == [[2, 4]]


def test_blocks_that_stand_alone_are_levels_of_a_factor_block():
    plan = plan_of(strategy_stimuli("cube"), pairs_text(*((own, '[["cube-oc", "cube-cc"]]') for own in ("dim", "lit"))))
    assert choice_measures(table_of(plan))[0].factors == {"block": ("dim", "lit")}
    assert block_factors(plan.blocks[0]) == {"block": "dim"}
    assert block_factors(replace(plan.blocks[0], factors={"light": 0.1})) == {"light": 0.1}


def test_scales_after_blocks_have_a_value_for_each_block(paper):
    confidence, difficulty = scale_measures(table_of(paper, paper_answers("P01", ROWS)))
    assert (confidence.name, confidence.low, confidence.high, confidence.chance) == ("confidence", 1.0, 7.0, None)
    assert confidence.values.tolist() == [[7, 4, 2, 1, 5, 3]]
    assert difficulty.values.tolist() == [[1, 4, 6, 7, 3, 3]]
    assert confidence.successes is None


RATED = """
[[block]]
name = "rated"
design = "rating"
stimuli = ["cube-oc", "cube-cc", "tube-oc", "tube-cc"]
repetitions = 2
[[block.question]]
name = "filled"
text = "How filled?"
kind = "scale"
points = 9
[[block.question_after]]
name = "ease"
text = "How easy?"
kind = "scale"
points = 5
"""


def test_a_rating_is_the_mean_of_its_repetitions_by_the_factors_of_the_stimuli():
    plan = plan_of(strategy_stimuli("cube", "tube"), RATED)
    answers = [
        point("P01", "rated", "filled", value, trial=trial, stimuli=(name,))
        for trial, (name, value) in enumerate([("cube-cc", 9), ("cube-oc", 1), ("cube-cc", 6), ("tube-cc", 4)])
    ]
    filled, ease = scale_measures(table_of(plan, answers, point("P01", "rated", "ease", 5)))
    assert filled.factors == {"object": ("cube", "tube"), "strategy": ("oc", "cc")}
    np.testing.assert_array_equal(filled.values, [[1, 7.5, np.nan, 4]])  # (9 + 6) / 2
    assert (filled.high, ease.high, ease.values.tolist()) == (9.0, 5.0, [[5]])


def test_scales_of_one_name_with_other_points_are_measures_of_their_own():
    plan = plan_of(
        strategy_stimuli("cube", "tube"), RATED, RATED.replace('"rated"', '"short"').replace("points = 9", "points = 3")
    )
    answers = [
        point("P01", block, "filled", value, trial=0, stimuli=("cube-cc",))
        for block, value in (("rated", 9), ("short", 3))
    ]
    measures = {own.name: own for own in scale_measures(table_of(plan, answers))}
    assert list(measures) == ["filled_9", "ease", "filled_3"]
    assert measures["filled_9"].values.tolist()[0][1] == 9
    assert measures["filled_3"].values.tolist()[0][1] == 3
    assert measures["ease"].factors == {"block": ("rated", "short")}


def test_a_scale_of_trials_is_another_measure_than_one_of_its_name_after_blocks():
    after = pairs_text(("pairs", '[["cube-oc", "cube-cc"]]')) + "[[block.question_after]]\n"
    plan = plan_of(
        strategy_stimuli("cube", "tube"), RATED, after + 'name = "filled"\ntext = "?"\nkind = "scale"\npoints = 9\n'
    )
    answers = [
        point("P01", "rated", "filled", 9, trial=0, stimuli=("cube-cc",)), point("P01", "pairs", "filled", 2),
    ]  # fmt: skip
    measures = {own.name: own.values for own in scale_measures(table_of(plan, answers))}
    assert list(measures) == ["filled_trial", "ease", "filled"]
    assert measures["filled"].tolist() == [[2]]
    assert measures["filled_trial"][0, 1] == 9


def test_an_exploration_has_a_cell_for_each_set_in_its_order():
    block = (
        '[[block]]\nname = "look"\ndesign = "exploration"\nsets = [["cube-oc", "cube-cc"], ["cube-cc", "cube-oc"]]\n'
        '[[block.question]]\nname = "alike"\ntext = "?"\nkind = "scale"\n'
    )
    plan = plan_of(strategy_stimuli("cube"), block)
    (own,) = scale_measures(table_of(plan, point("P01", "look", "alike", 6, trial=0, stimuli=("cube-cc", "cube-oc"))))
    assert own.factors == {"stimulus": ("cube-oc, cube-cc", "cube-cc, cube-oc")}
    np.testing.assert_array_equal(own.values, [[np.nan, 6]])


def test_r_is_the_mean_of_a_block_and_blocks_that_nobody_felt_live_are_no_cells(paper):
    ratios = [
        ("P01", "cube-1.0", 0, "cube-cc", 1.5),
        ("P01", "cube-1.0", 1, "cube-cc", 2.0),
        ("P02", "dog-0.7", 0, "dog-cc", 1.1),
    ]
    table = table_of(paper, paper_answers("P01", ROWS), paper_answers("P02", ROWS), ratios=ratios)
    (own,) = ratio_measures(table)
    assert [cell.name for cell in own.cells] == ["cube-1.0", "dog-0.7"]
    np.testing.assert_array_equal(own.values, [[1.75, np.nan], [np.nan, 1.1]])


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
