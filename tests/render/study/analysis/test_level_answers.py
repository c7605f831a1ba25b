"""Answers by level against counts by hand, and reversals of staircases that are replayed by Levitt's rule on paper."""

from answered_tables import QUESTION, levels_text, option, plan_of, stimulus_text, table_of

from palpate.render.study.analysis.level_answers import level_answers, replay_tracks

VALUES = [80, 70, 60, 50, 40, 30, 20, 10]
NAMES = ", ".join(f'"s{number}"' for number in range(1, 9))
STANDARD = stimulus_text("none")
CONSTANT = f'[[block]]\nname = "c"\ndesign = "constant"\ncomparisons = [{NAMES}]\n{QUESTION}\n'
STAIRCASE = f'[[block]]\nname = "st"\ndesign = "staircase"\nlevels = [{NAMES}]\n{QUESTION}\n'
WITH_STANDARD = 'standard = "none"\n'


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


def test_interleaved_tracks_are_replayed_apart_in_the_order_of_their_numbers():
    marks = [(*LEVITT[k // 2], k % 2) for k in range(2 * len(LEVITT))]
    marks[1::2] = [(*own[:2], 1) for own in marks[1::2]]
    late = [own for own in marks if own[2] == 1] + [own for own in marks if own[2] == 0][:4]
    (own,) = level_answers(table_of(staircase_plan("steps = [2, 1]\ntracks = 2\n"), staircase_answers(late)))
    assert own.reversals == ((), (50, 40, 60, 50))
    assert own.reversal_mean == 50  # of the track that has some


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
