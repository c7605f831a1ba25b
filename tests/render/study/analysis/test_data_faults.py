"""What is odd about data is named in a sentence, and what is usual is not."""

import pytest
from answered_tables import (
    BLOCKS,
    PAPER,
    QUESTION,
    levels_text,
    option,
    paper_answers,
    paper_block,
    plan_of,
    table_of,
)

from palpate.render.study.analysis.data_faults import data_faults

USUAL = ["1101111011 5 3", "0111101110 4 4", "1100010110 3 5", "1110111011 5 2", "0001110100 2 6", "1101011010 4 4"]


@pytest.fixture(scope="module")
def paper():
    return plan_of(PAPER)


def everybody(**others):
    """Usual answers of all three; others: answers instead, by code."""
    return [others.get(code, paper_answers(code, USUAL)) for code in ("P01", "P02", "P03")]


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
