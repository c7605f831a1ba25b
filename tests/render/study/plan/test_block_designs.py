"""Orders of blocks and trials of each design, by counting and by replaying."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from palpate.render.study.plan.block_designs import balanced_square, block_numbers, rng_of, trial_counts, trials_of
from palpate.render.study.plan.study_plan import PlannedBlock, Question, StudyPlan

DENSER = Question(name="denser", text="Which one?", kind="choice", options=("first", "second"), has_random_keys=True)
FELT = Question(name="felt", text="Did you feel it?", kind="choice", options=("no", "yes"))
ROUGH = Question(name="rough", text="How rough?", kind="scale")


def block_of(design, sets, question=DENSER, **fields):
    questions = fields.pop("questions", (question,))
    return PlannedBlock(name="b", design=design, question=question, questions=questions, sets=sets, **fields)


def plan_of(*blocks, **fields):
    return StudyPlan(
        path=Path("STUDY.toml"), text="", title="t", codes=("P01", "P02"), seed=7, stimuli=(), blocks=blocks, **fields
    )


def run(block, seed=0, answer=lambda trial: 0):
    """All trials of a block, each answered by a function of it."""
    trials, running = [], trials_of(block, np.random.default_rng(seed))
    try:
        trial = next(running)
        while True:
            trials.append(trial)
            trial = running.send({question.name: answer(trial) for question in trial.questions})
    except StopIteration:
        return trials


def test_forced_choice_plays_each_pair_in_both_orders_equally_often():
    block = block_of("2ifc", (("oc", "cc"), ("oc", "none")), repetitions=5)
    counted = Counter(trial.stimuli for trial in run(block))
    assert counted == {("oc", "cc"): 5, ("cc", "oc"): 5, ("oc", "none"): 5, ("none", "oc"): 5}
    assert trial_counts(block) == (0, 20, 20)


def test_constant_stimuli_come_with_the_standard_in_both_orders_or_alone():
    block = block_of("constant", (("std", "a"), ("std", "b")), repetitions=3)
    assert Counter(trial.stimuli for trial in run(block)) == {
        ("std", "a"): 3,
        ("a", "std"): 3,
        ("std", "b"): 3,
        ("b", "std"): 3,
    }
    alone = block_of("constant", (("a",), ("b",)), FELT, repetitions=4)
    assert Counter(trial.stimuli for trial in run(alone)) == {("a",): 4, ("b",): 4}
    assert trial_counts(alone) == (0, 8, 8)


def test_practice_comes_first_and_repeats_no_trial_before_all_have_come():
    block = block_of("2ifc", (("a", "b"), ("a", "c")), repetitions=2, practice=6)
    trials = run(block)
    assert [trial.is_practice for trial in trials] == [True] * 6 + [False] * 8
    practised = [trial.stimuli for trial in trials[:6]]
    assert len(set(practised[:4])) == 4
    assert len(set(practised[4:])) == 2
    assert Counter(trial.stimuli for trial in trials[6:]) == Counter(2 * practised[:4])
    assert trial_counts(block) == (6, 8, 8)


@pytest.mark.parametrize("seed", range(5))
def test_keys_are_mapped_at_random_where_the_question_says_so(seed):
    block = block_of("2ifc", (("a", "b"),), repetitions=100)
    orders = Counter(trial.key_orders for trial in run(block, seed))
    assert orders.keys() == {((0, 1),), ((1, 0),)}
    assert min(orders.values()) > 60  # of 200; in all but 1 of 10^7 runs
    assert {trial.key_orders for trial in run(block_of("2ifc", (("a", "b"),), FELT))} == {((),)}


def test_orders_are_uniformly_random():
    # 24 orders of four trials in 2400 blocks: chi-square of 23 degrees of freedom is below 60 in all but 1 of 27,000
    block = block_of("rating", (("a",), ("b",), ("c",), ("d",)), ROUGH)
    counts = Counter("".join(trial.stimuli[0] for trial in run(block, seed)) for seed in range(2400))
    assert len(counts) == 24
    assert sum((count - 100) ** 2 / 100 for count in counts.values()) < 60


def staircase_block(**fields):
    return block_of("staircase", tuple((f"l{number}",) for number in range(8)), FELT, correct_option=1, **fields)


def test_a_staircase_with_a_standard_takes_the_interval_of_the_level_as_correct():
    block = block_of("staircase", tuple(("std", f"l{n}") for n in range(8)), down=2, trials_max=10, reversals=9)
    right = run(block, answer=lambda trial: trial.stimuli.index(f"l{trial.level}"))
    assert [trial.level for trial in right] == [0, 0, 1, 1, 2, 2, 3, 3, 4, 4]
    assert {trial.stimuli.index("std") for trial in right} == {0, 1}
    wrong = run(block, answer=lambda trial: trial.stimuli.index("std"))
    assert {trial.level for trial in wrong} == {0}
    assert [trial.clipped for trial in wrong] == list(range(10))


@pytest.mark.parametrize("down", [1, 2, 3])
@pytest.mark.parametrize("reversals", [1, 2, 3, 4])
def test_the_fewest_trials_of_a_staircase_are_those_of_all_answers_tried(down, reversals):
    block = staircase_block(down=down, reversals=reversals, trials_max=12, start_level=4)
    fewest = trial_counts(block).least
    lengths = set()
    for bits in range(1 << min(fewest, 10)):
        answers = iter([bits >> place & 1 for place in range(12)] + [0] * 12)
        lengths.add(len(run(block, answer=lambda trial, answers=answers: next(answers))))
    assert min(lengths) == fewest


@pytest.mark.parametrize("seed", range(3))
def test_replayed_answers_give_the_same_trials(seed):
    block = staircase_block(tracks=2, practice=3, trials_max=30)
    answers = iter(np.random.default_rng(seed).integers(2, size=100).tolist())
    given = []

    def answer(trial):
        given.append(next(answers))
        return given[-1]

    trials = run(block, seed, answer)
    stored = iter(given)
    assert run(block, seed, lambda trial: next(stored)) == trials
    changed = iter([*given[:4], 1 - given[4], *given[5:], *[0] * 100])
    other = run(block, seed, lambda trial: next(changed))
    assert other[:5] == trials[:5]
    assert other != trials


def test_random_numbers_differ_by_plan_participant_and_block():
    plan, other = plan_of(), plan_of()
    assert rng_of(plan, 1, 2).random() == rng_of(other, 1, 2).random()
    seen = {rng_of(plan, participant, block).random() for participant in range(20) for block in range(20)}
    assert len(seen) == 400


def blocks(count):
    return [block_of("rating", (("a",),), ROUGH)] * count


@pytest.mark.parametrize("count", [1, 3, 6])
def test_latin_orders_are_the_square_s_rows_over_and_over(count):
    square = balanced_square(count).tolist()
    plan = plan_of(*blocks(count))
    orders = [list(block_numbers(plan, participant)) for participant in range(2 * len(square))]
    assert orders == square + square
