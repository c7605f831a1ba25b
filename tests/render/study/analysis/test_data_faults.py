"""What is odd about data is named in a sentence, and what is usual is not."""

from dataclasses import replace

import pytest
from answered_tables import (
    BLOCKS,
    PAPER,
    QUESTION,
    chosen,
    levels_text,
    number,
    option,
    paper_answers,
    paper_block,
    plan_of,
    point,
    stimulus_text,
    table_of,
)

from palpate.render.study.analysis.data_faults import data_faults
from palpate.render.study.analysis.study_table import SessionRecord

USUAL = ["1101111011 5 3", "0111101110 4 4", "1100010110 3 5", "1110111011 5 2", "0001110100 2 6", "1101011010 4 4"]
PAIR = ("cube-oc", "cube-cc")


@pytest.fixture(scope="module")
def paper():
    return plan_of(PAPER)


def everybody(**others):
    """Usual answers of all three; others: answers instead, by code."""
    return [others.get(code, paper_answers(code, USUAL)) for code in ("P01", "P02", "P03")]


def test_complete_answers_of_usual_people_have_no_faults(paper):
    assert data_faults(table_of(paper, *everybody())) == []


def test_hands_and_arrays_that_are_nobodys_are_named(paper):
    sessions = [
        SessionRecord("P01", "pat16", "ultraleap", "0.1.0", "2026-11-28T15:00:00+00:00"),
        SessionRecord("P02", "emulator", "exploration", "0.1.0", "2026-11-28T16:00:00+00:00"),
        SessionRecord("P03", "pat16", "simulated", "0.1.0", "2026-11-28T17:00:00+00:00"),
    ]
    table = table_of(paper, *everybody())
    assert data_faults(replace(table, sessions=tuple(sessions))) == [
        "the hand of 2 of 3 sessions was synthetic: nobody felt anything",
        "1 of 3 sessions played to the emulated array: nobody felt anything",
    ]
    assert data_faults(replace(table, sessions=tuple(sessions[:1]))) == []


def test_nobody_and_some_who_have_not_begun_are_counted(paper):
    assert data_faults(table_of(paper)) == ["3 of 3 planned participants have not begun"]
    assert data_faults(table_of(paper, *everybody()[:2])) == ["1 of 3 planned participants has not begun"]


def test_missing_blocks_and_trials_and_questions_are_named_together(paper):
    shortened = [own for own in paper_answers("P02", USUAL) if own.block != "tube-0.7"]
    shortened = [own for own in shortened if not (own.block == "dog-1.0" and own.trial >= 5)]
    shortened = [own for own in shortened if (own.block, own.name) != ("cube-0.7", "difficulty")]
    (sentence,) = data_faults(table_of(paper, *everybody(P02=shortened), unfinished=["P02"]))
    assert sentence == (
        "P02 has not finished and lacks cube-0.7 (difficulty), tube-0.7, dog-1.0 (5 of 10 trials): this participant is "
        "left out of comparisons that need what lacks wholly; blocks with fewer trials count by those that were "
        "answered"
    )
    (sentence,) = data_faults(table_of(paper, *everybody(P02=shortened)))
    assert sentence.startswith("P02 has finished and lacks cube-0.7 (difficulty), tube-0.7")


def test_practice_does_not_stand_for_trials_that_are_missing():
    plan = plan_of(PAPER.replace("repetitions = 5", "repetitions = 5\npractice = 4"), participants=1)
    answers = [paper_block("P01", block, row.split()[0], 4, 4) for block, row in zip(BLOCKS, USUAL, strict=True)]
    answers[0] = chosen("P01", "cube-1.0", PAIR, "1101111011", practice=4) + answers[0][-2:]
    answers[1] = chosen("P01", "cube-0.7", PAIR, "1101", practice=4)
    sentences = data_faults(table_of(plan, *answers))
    assert any("lacks cube-1.0 (6 of 10 trials), cube-0.7: " in own for own in sentences)


def test_a_participant_who_lacks_the_last_questions_alone_is_named(paper):
    assert data_faults(table_of(paper, *everybody(), unfinished=["P03"])) == [
        "P03 has answered all blocks, but not all that the study asks after them"
    ]


def test_a_participant_who_always_presses_one_key_is_named(paper):
    left = [own._replace(key="ArrowLeft") if own.name == "answer" else own for own in paper_answers("P01", USUAL)]
    assert data_faults(table_of(paper, *everybody(P01=left))) == [
        "P01 always pressed the key 'ArrowLeft', in 60 answers"
    ]


def test_a_participant_who_always_gives_one_option_is_named_whatever_the_key(paper):
    first = [own for block in BLOCKS for own in paper_block("P02", block, "0101010101", 3, 5)]
    first = [
        own._replace(value=4 if own.block == "dog-0.7" else own.value) if own.name != "answer" else own for own in first
    ]
    assert {own.label for own in first if own.name == "answer"} == {"First"}
    mixed = [own._replace(key=("ArrowLeft", "ArrowRight")[place % 2]) for place, own in enumerate(first)]
    assert data_faults(table_of(paper, *everybody(P02=mixed))) == ["P02 always chose 'First', in 60 answers"]


def test_a_participant_who_always_chooses_one_stimulus_is_not_odd(paper):
    always = [
        own
        for block, row in zip(BLOCKS, USUAL, strict=True)
        for own in paper_block("P02", block, "1" * 10, *map(int, row.split()[1:]))
    ]
    assert data_faults(table_of(paper, *everybody(P02=always))) == []


def test_few_answers_that_are_alike_are_nothing_odd():
    plan = plan_of(
        stimulus_text("a", "b"),
        f'[[block]]\nname = "x"\ndesign = "2ifc"\npairs = [["a", "b"]]\nrepetitions = 4\n{QUESTION}\n',
        participants=1,
    )
    seven = chosen("P01", "x", ("a", "b"), "0101010")
    sentences = data_faults(table_of(plan, seven))
    assert [own for own in sentences if "always" in own] == []
    sentences = data_faults(table_of(plan, chosen("P01", "x", ("a", "b"), "01010101")))
    assert sentences == [
        "P01 always pressed the key 'ArrowLeft', in 8 answers",
        "P01 always chose 'First', in 8 answers",
    ]


def test_choices_with_other_options_have_other_keys_and_are_compared_apart():
    three = (
        f'[[block]]\nname = "three"\ndesign = "constant"\ncomparisons = ["a"]\noptions = ["x", "y", "z"]\n{QUESTION}\n'
    )
    pairs = f'[[block]]\nname = "two"\ndesign = "2ifc"\npairs = [["a", "b"]]\nrepetitions = 4\n{QUESTION}\n'
    plan = plan_of(stimulus_text("a", "b"), three, pairs, participants=1)
    answers = [*chosen("P01", "two", ("a", "b"), "01010101"), option("P01", "three", 0, 2, ("x", "y", "z"), ["a"])]
    assert data_faults(table_of(plan, answers))[0] == "P01 always pressed the key 'ArrowLeft', in 8 answers"


def test_a_participant_who_always_gives_one_point_is_named(paper):
    same = [own._replace(value=4) if own.name == "difficulty" else own for own in paper_answers("P03", USUAL)]
    assert data_faults(table_of(paper, *everybody(P03=same))) == ["P03 gave difficulty the same point, 4, in 6 answers"]


def test_answers_that_came_too_fast_are_counted_but_those_of_no_clock_are_not(paper):
    answers = paper_answers("P01", USUAL)
    for place, seconds in ((0, 0.149), (1, 0.15), (2, None), (10, 0.01)):  # 10: a question after the block
        answers[place] = answers[place]._replace(seconds=seconds)
    assert data_faults(table_of(paper, *everybody(P01=answers))) == ["P01 gave 1 answer within 0.15 s of the question"]
    answers[3] = answers[3]._replace(seconds=0.0)
    assert data_faults(table_of(paper, *everybody(P01=answers))) == ["P01 gave 2 answers within 0.15 s of the question"]


def test_answers_that_were_left_empty_are_not_missing():
    text = (
        f'[[block]]\nname = "m"\ndesign = "magnitude"\nstimuli = ["s1", "s2"]\n{QUESTION}\n[[block.question_after]]\n'
    )
    plan = plan_of(
        levels_text([1, 2]), text + 'name = "why"\ntext = "?"\nkind = "number"\noptional = true\n', participants=1
    )
    answers = [number("P01", "m", trial, 3.0, [f"s{trial + 1}"]) for trial in range(2)]
    assert data_faults(table_of(plan, answers, number("P01", "m", -1, None, name="why"))) == []
    assert data_faults(table_of(plan, answers))[0].startswith("P01 has finished and lacks m (why)")


STAIRCASE = (
    '[[block]]\nname = "st"\ndesign = "staircase"\nlevels = ["s1", "s2", "s3"]\noptions = ["no", "yes"]\n'
    f'correct = "yes"\ndown = 1\nreversals = 3\n{QUESTION}\n'
)


def staircase_answers(marks, track=0, first=0):
    level, found = 0, []
    for trial, mark in enumerate(marks, first):
        found.append(option("P01", "st", trial, int(mark), ("no", "yes"), [f"s{level + 1}"], level=level, track=track))
        level = min(max(level + (1 if mark == "1" else -1), 0), 2)
    return found


@pytest.mark.parametrize(
    ("marks", "is_whole"),
    [
        ("1010", True),  # reversals after the second, third and fourth answer
        ("111111", False),  # more trials than the fewest that could end it, and no reversal
        ("101", False),
    ],
)
def test_a_staircase_that_has_not_ended_is_named_however_many_trials_it_has(marks, is_whole):
    plan = plan_of(levels_text([3, 2, 1]), STAIRCASE, participants=1)
    sentences = data_faults(table_of(plan, staircase_answers(marks)))
    expected = f"P01 has finished and lacks st (0 of 1 staircases ended, {len(marks)} trials): "
    assert sentences == [] if is_whole else sentences[0].startswith(expected)


def test_of_interleaved_staircases_those_that_never_began_have_not_ended():
    plan = plan_of(levels_text([3, 2, 1]), STAIRCASE + "tracks = 2\n", participants=1)
    (sentence,) = data_faults(table_of(plan, staircase_answers("1010", track=1)))
    assert "lacks st (1 of 2 staircases ended, 4 trials)" in sentence
    both = staircase_answers("1010", track=1) + staircase_answers("1010", first=4)
    assert [own for own in data_faults(table_of(plan, both)) if "lacks" in own] == []


def test_a_rating_lacks_trials_where_one_of_its_questions_does():
    text = '[[block]]\nname = "r"\ndesign = "rating"\nstimuli = ["a", "b"]\n' + "".join(
        f'[[block.question]]\nname = "{own}"\ntext = "?"\nkind = "scale"\n' for own in ("soft", "warm")
    )
    plan = plan_of(stimulus_text("a", "b"), text, participants=1)
    answers = [
        point("P01", "r", own, 3, trial=trial, stimuli=("ab"[trial],)) for trial in range(2) for own in ("soft", "warm")
    ]
    assert data_faults(table_of(plan, answers)) == []
    assert "lacks r (1 of 2 trials)" in data_faults(table_of(plan, answers[:-1], unfinished=["P01"]))[0]
