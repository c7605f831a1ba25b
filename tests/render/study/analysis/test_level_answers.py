"""Answers by level against counts by hand, and reversals of staircases that are replayed by Levitt's rule on paper."""

import numpy as np
import pytest
from answered_tables import QUESTION, levels_text, option, plan_of, point, stimulus_text, table_of

from palpate.render.study.analysis.level_answers import level_answers, replay_tracks

VALUES = [80, 70, 60, 50, 40, 30, 20, 10]
NAMES = ", ".join(f'"s{number}"' for number in range(1, 9))
STANDARD = stimulus_text("none")
CONSTANT = f'[[block]]\nname = "c"\ndesign = "constant"\ncomparisons = [{NAMES}]\n{QUESTION}\n'
STAIRCASE = f'[[block]]\nname = "st"\ndesign = "staircase"\nlevels = [{NAMES}]\n{QUESTION}\n'
WITH_STANDARD = 'standard = "none"\n'
YES = 'options = ["no", "yes"]\n'


def staircase_answers(marks, *, code="P01", first=0):
    """Answers to a staircase with a standard. marks: (level, whether it was correct, track) of each trial."""
    records = []
    for trial, (level, is_correct, *track) in enumerate(marks, first):
        place = trial % 2
        stimuli = ("none", f"s{level + 1}") if place else (f"s{level + 1}", "none")
        value = place if is_correct else 1 - place
        records.append(
            option(
                code,
                "st",
                trial,
                value,
                ("First", "Second"),
                stimuli,
                comparison=place,
                level=level,
                track=track[0] if track else 0,
            )
        )
    return records


def staircase_plan(lines="steps = [2, 1]\n", values=VALUES):
    return plan_of(levels_text(values), STANDARD, STAIRCASE + WITH_STANDARD + lines)


# down = 2, steps = [2, 1]: after two correct answers two levels harder, until the first wrong answer; then one level.
LEVITT = [
    (0, True), (0, True),  # harder by 2
    (2, True), (2, True),  # harder by 2
    (4, True), (4, False),  # easier: reversal 1 at level 4, by 1 from here on
    (3, True), (3, True),  # harder: reversal 2 at level 3
    (4, False),  # easier: reversal 3 at level 4
    (3, False),  # easier again: none
    (2, True), (2, True),  # harder: reversal 4 at level 2
    (3, True), (3, False),  # easier: reversal 5 at level 3
]  # fmt: skip


def test_reversals_are_those_of_levitts_rule_by_hand():
    plan = staircase_plan()
    (track,) = replay_tracks(plan.blocks[0], staircase_answers(LEVITT))
    assert track.turns == [4, 3, 4, 2, 3]
    assert track.levels == [level for level, _ in LEVITT]
    assert track.state.level == 2  # of the next trial


def test_the_mean_of_reversals_leaves_out_the_larger_steps_and_takes_an_even_number():
    (own,) = level_answers(table_of(staircase_plan(), staircase_answers(LEVITT)))
    assert own.reversals == ((50, 40, 60, 50),)  # levels 3, 4, 2, 3: that of the steps of 2 is left out
    assert own.reversal_mean == 50
    (own,) = level_answers(table_of(staircase_plan(), staircase_answers(LEVITT[:-2])))
    assert own.reversals == ((40, 60),)  # 3, 4, 2 are odd: the first one is left out
    (own,) = level_answers(table_of(staircase_plan(), staircase_answers(LEVITT[:8])))
    assert own.reversals == ((),)
    assert own.reversal_mean is None


def test_answers_of_a_staircase_are_counted_by_value_with_a_guess_rate():
    (own,) = level_answers(table_of(staircase_plan(), staircase_answers(LEVITT)))
    assert own.x.tolist() == [40, 50, 60, 80]
    assert own.counts.tolist() == [3, 5, 4, 2]  # at levels 4, 3, 2, 0
    assert own.successes.tolist() == [1, 3, 4, 2]
    assert (own.guess, own.lapses_both_ways, own.counted, own.reason) == (0.5, False, "correct answers", "")
    assert own.track_levels == ((80, 80, 60, 60, 40, 40, 50, 50, 40, 50, 60, 60, 50, 50),)


def test_interleaved_tracks_are_replayed_apart_in_the_order_of_their_numbers():
    marks = [(*LEVITT[k // 2], k % 2) for k in range(2 * len(LEVITT))]
    marks[1::2] = [(*own[:2], 1) for own in marks[1::2]]
    late = [own for own in marks if own[2] == 1] + [own for own in marks if own[2] == 0][:4]
    (own,) = level_answers(table_of(staircase_plan("steps = [2, 1]\ntracks = 2\n"), staircase_answers(late)))
    assert own.reversals == ((), (50, 40, 60, 50))
    assert own.reversal_mean == 50  # of the track that has some


def test_moves_beyond_the_levels_are_counted_the_last_one_too():
    plan = staircase_plan("down = 1\n", VALUES)
    marks = [(0, False), (0, False), (0, True), (1, False), (0, False)]  # three times easier than the easiest
    (own,) = level_answers(table_of(plan, staircase_answers(marks)))
    assert own.clipped == 3


def test_a_staircase_of_single_intervals_counts_its_correct_option():
    plan = plan_of(levels_text(VALUES), STAIRCASE + YES + 'correct = "no"\ndown = 1\n')
    answers = [
        option("P01", "st", trial, value, ("no", "yes"), [f"s{level + 1}"], level=level)
        for trial, (level, value) in enumerate([(0, 0), (1, 1), (0, 0)])
    ]
    (own,) = level_answers(table_of(plan, answers))
    assert own.successes.tolist() == [0, 2]
    assert (own.guess, own.counted) == (0.0, "answers 'no'")
    assert own.reversals == ((70, 80),)


def test_constant_stimuli_with_a_standard_count_answers_for_the_comparison_in_either_interval():
    plan = plan_of(levels_text([5, 1, 3]), STANDARD, CONSTANT.replace(NAMES, '"s1", "s2", "s3"') + WITH_STANDARD)
    labels = ("First", "Second")
    answers = [
        option("P01", "c", 0, 1, labels, ("none", "s1"), comparison=1),
        option("P01", "c", 1, 0, labels, ("s1", "none"), comparison=0),
        option("P01", "c", 2, 1, labels, ("s2", "none"), comparison=0),
        option("P01", "c", 3, 1, labels, ("none", "s3"), comparison=1),
        option("P01", "c", 4, 0, labels, ("none", "s3"), comparison=1),
    ]
    (own,) = level_answers(table_of(plan, answers))
    assert own.x.tolist() == [1, 3, 5]
    assert own.successes.tolist() == [0, 1, 2]
    assert own.counts.tolist() == [1, 2, 2]
    assert (own.guess, own.lapses_both_ways, own.counted) == (0.0, True, "answers for the comparison")


def test_constant_stimuli_alone_count_the_last_option():
    plan = plan_of(levels_text([5, 1, 5]), CONSTANT.replace(NAMES, '"s1", "s2", "s3"') + YES)
    answers = [
        option("P01", "c", trial, value, ("no", "yes"), [name])
        for trial, (name, value) in enumerate([("s1", 1), ("s2", 0), ("s3", 0), ("s3", 1)])
    ]
    (own,) = level_answers(table_of(plan, answers))
    assert own.x.tolist() == [1, 5]  # two stimuli have the value 5
    assert (own.successes.tolist(), own.counts.tolist()) == ([0, 2], [1, 3])
    assert (own.guess, own.lapses_both_ways, own.counted) == (0.0, False, "answers 'yes'")


def test_three_options_are_no_yes_and_no():
    plan = plan_of(levels_text(VALUES), CONSTANT + 'options = ["no", "perhaps", "yes"]\n')
    (own,) = level_answers(table_of(plan, option("P01", "c", 0, 2, ("no", "perhaps", "yes"), ["s1"])))
    assert own.reason == "3 options are no yes and no"
    assert own.x.shape == own.successes.shape == own.counts.shape == (0,)


@pytest.mark.parametrize("block", [CONSTANT + YES, STAIRCASE + YES + 'correct = "yes"\n'])
def test_stimuli_without_values_are_named(block):
    plan = plan_of(stimulus_text("s1", "s2", "s3", s1=4.0), block.replace(NAMES, '"s1", "s2", "s3"'))
    name = "c" if "constant" in block else "st"
    answers = [option("P01", name, trial, 1, ("no", "yes"), [f"s{trial + 1}"], level=trial) for trial in range(3)]
    (own,) = level_answers(table_of(plan, answers))
    assert own.reason == "the plan gives no `value` to s2, s3"
    assert (len(own.x), own.reversals, own.track_levels, own.clipped) == (0, (), (), 0)


def test_practice_other_questions_and_other_designs_count_for_nothing():
    after = '[[block.question_after]]\nname = "ease"\ntext = "?"\nkind = "scale"\n'
    plan = plan_of(levels_text(VALUES), CONSTANT + YES + after)
    answers = [
        option("P01", "c", 0, 1, ("no", "yes"), ["s1"], is_practice=True),
        option("P01", "c", 1, 0, ("no", "yes"), ["s1"]),
    ]
    (own,) = level_answers(table_of(plan, answers, point("P01", "c", "ease", 7)))
    assert (own.successes.tolist(), own.counts.tolist()) == ([0], [1])


def test_participants_without_answers_to_a_block_are_not_listed_and_nobody_is_none():
    plan = plan_of(levels_text(VALUES), CONSTANT + YES, CONSTANT.replace('"c"', '"d"') + YES)
    answers = [option("P02", "c", 0, 1, ("no", "yes"), ["s1"]), option("P01", "d", 0, 1, ("no", "yes"), ["s1"])]
    found = level_answers(table_of(plan, answers))
    assert [(own.code, own.block.name) for own in found] == [("P02", "c"), ("P01", "d")]
    assert level_answers(table_of(plan)) == []


def test_the_order_of_answers_changes_no_counts():
    plan = plan_of(levels_text(VALUES), CONSTANT + YES)
    rng = np.random.default_rng(3)
    answers = [
        option("P01", "c", trial, int(rng.integers(2)), ("no", "yes"), [f"s{rng.integers(1, 9)}"])
        for trial in range(80)
    ]
    (one,), (other,) = level_answers(table_of(plan, answers)), level_answers(table_of(plan, answers[::-1]))
    for name in ("x", "successes", "counts"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    for place, value in enumerate(one.x):  # a plain loop beside the arrays
        of_value = [own for own in answers if VALUES[int(own.stimuli[0][1:]) - 1] == value]
        assert one.counts[place] == len(of_value)
        assert one.successes[place] == sum(own.value == 1 for own in of_value)
