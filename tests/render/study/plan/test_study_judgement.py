"""A plan judged whole, against its own numbers by hand."""

from pathlib import Path

import pytest

from palpate.device import Limits, array_model
from palpate.render.study.plan.study_judgement import judge_study
from palpate.render.study.plan.study_plan import PlannedBlock, PlannedStimulus, Question, StudyPlan

EMULATOR = array_model("emulator")
WHICH = Question(name="which", text="Which one?", kind="choice", options=("first", "second"))
STIMULI = tuple(PlannedStimulus(name=name, duration=2.0, solid="cube", strategy=name) for name in ("oc", "cc"))


def block_of(name, **fields):
    given = {"design": "2ifc", "question": WHICH, "questions": (WHICH,), "sets": (("oc", "cc"),)}
    return PlannedBlock(name=name, **(given | fields))


def plan_of(*blocks, participants=2, **fields):
    codes = tuple(f"P{number:02}" for number in range(1, participants + 1))
    given = {"path": Path("STUDY.toml"), "text": "", "title": "t", "seed": 1, "stimuli": STIMULI}
    return StudyPlan(blocks=blocks, codes=codes, **(given | fields))


def test_numbers_are_those_of_the_plan():
    plan = plan_of(block_of("a", repetitions=5, practice=1), block_of("b", repetitions=2))
    found = judge_study(plan, EMULATOR)
    assert (found.faults, found.notes, found.update_rate, found.array) == ((), (), 10_000.0, "emulator")
    assert [(own.name, own.practice, own.trials_least, own.trials_most) for own in found.blocks] == [
        ("a", 1, 10, 10), ("b", 0, 4, 4),
    ]  # fmt: skip
    assert (found.trials_least, found.trials_most, found.intervals_most) == (15, 15, 30)
    assert [own.blocks for own in found.participants] == [("a", "b"), ("b", "a")]
    assert found.seconds == found.seconds_longest == pytest.approx(sum(own.seconds for own in found.blocks))
    # Live intervals count at full drive, and 0.15 s longer than they are planned.
    assert found.on_time_worst == pytest.approx(2 * 2.15 + 1.0)
    assert found.duty_worst == pytest.approx(30 * 2.15 / 600)
    assert repr(found) == f"StudyJudgement('t', 2 participants, 2 blocks, {found.seconds / 60:.1f} min, 0 faults)"


def test_a_staircase_has_a_shortest_and_a_longest_run():
    block = block_of("s", design="staircase", sets=(("oc",), ("cc",)), correct_option=1, reversals=2, trials_max=30)
    found = judge_study(plan_of(block), EMULATOR)
    (own,) = found.blocks
    assert (own.trials_least, own.trials_most, own.intervals_most) == (4, 30, 30)
    assert (own.seconds, own.seconds_longest) == (pytest.approx(4 + 17 * 8.15), pytest.approx(4 + 30 * 8.15))
    assert found.seconds < found.seconds_longest


@pytest.mark.parametrize(
    ("count", "participants", "order", "is_balanced", "words"),
    [
        (2, 4, "latin", True, "4 participants fill the 2 rows of a balanced Latin square of 2 blocks 2 times"),
        (3, 6, "latin", True, "6 participants fill the 6 rows of a balanced Latin square of 3 blocks 1 time"),
        (3, 4, "latin", False, "the nearest that do are 6 participants"),
        (2, 2, "random", False, "drawn at random"),
        (2, 2, "fixed", False, "in the same order"),
        (1, 5, "fixed", True, "there is one block"),
    ],
)
def test_balance_is_a_sentence(count, participants, order, is_balanced, words):
    blocks = [block_of(f"b{number}", sets=(("oc",),), design="rating") for number in range(count)]
    found = judge_study(plan_of(*blocks, participants=participants, block_order=order), EMULATOR)
    assert found.is_balanced == is_balanced
    assert words in found.balance


def test_limits_make_pauses_or_faults():
    limits = Limits(duty_max=0.3, duty_window=30.0)
    found = judge_study(plan_of(block_of("a", repetitions=5), limits=limits), EMULATOR)
    assert found.faults == ()
    assert found.pause_seconds > 20.0
    assert found.duty_worst <= 0.3
    refused = judge_study(plan_of(block_of("a"), limits=Limits(on_time_max=2.0)), EMULATOR)
    assert refused.faults == (
        "block a: on_time_max: cc, oc in one trial emit for 5.4 s without a pause of 1 s, but the bound is 2 s: a gap "
        "of 1.1 s is a pause",
    )
