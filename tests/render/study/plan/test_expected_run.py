"""Times of a whole run against sums by hand, and rests that keep an array's limits."""

from pathlib import Path

import pytest

from palpate.device import Limits
from palpate.render.study.plan.duty_account import EmissionInterval
from palpate.render.study.plan.study_judgement import expected_run
from palpate.render.study.plan.study_plan import PlannedBlock, Question, StudyPlan

WHICH = Question(name="which", text="Which one?", kind="choice", options=("first", "second"))
SURE = Question(name="sure", text="How sure?", kind="scale")


def block_of(name="b", **fields):
    given = {"design": "2ifc", "question": WHICH, "questions": (WHICH,), "sets": (("a", "b"),)}
    return PlannedBlock(name=name, **(given | fields))


def plan_of(*blocks, **fields):
    given = {"path": Path("STUDY.toml"), "text": "", "title": "t", "codes": ("P01", "P02"), "seed": 1, "stimuli": ()}
    return StudyPlan(blocks=blocks, answer_seconds=4.0, **(given | fields))


def emissions(seconds=2.0, duty=1.0, names="ab"):
    return {name: EmissionInterval(stimulus=name, seconds=seconds, duty=duty) for name in names}


def test_onsets_and_seconds_are_the_sums_of_the_plan_s_times():
    plan = plan_of(
        block_of(questions_after=(SURE,), gap=0.5, rest=1.5),
        welcome="w", consent="c", questions_before=(SURE, SURE), questions_after=(SURE,),
    )  # fmt: skip
    run = expected_run(plan, 0, emissions())
    # Welcome, consent, two questions and the block's instruction: 20 s; then 1.5 s of rest and 1 s until it is begun.
    assert [trial.onsets for trial in run.trials] == [(22.5, 25.0), (33.5, 36.0)]
    assert run.block_seconds == {"b": 4 + 2 * (2.5 + 4.5 + 4) + 4}
    assert run.seconds == 16 + 30 + 4
    assert (run.on_time_worst, run.pause_seconds, run.faults) == (pytest.approx(4.5), 0.0, [])
    assert run.duty_worst == pytest.approx(8 / 600)
    assert repr(run) == "ExpectedRun(P01, 2 trials, 0.8 min)"


def test_a_staircase_has_its_most_trials_or_the_mean_at_the_level_that_drives_most():
    block = block_of(
        design="staircase", sets=(("a",), ("b",)), correct_option=1, reversals=3, trials_max=20, tracks=2, practice=1
    )
    given = emissions() | emissions(3.0, names="b")
    longest = expected_run(plan_of(block), 0, given, is_longest=True)
    assert [trial.stimuli for trial in longest.trials] == [("a",)] + [None] * 40
    usual = expected_run(plan_of(block), 0, given)
    assert len(usual.trials) == 1 + (2 * 6 + 40) / 2  # each track: up, two down, up, two down
    assert longest.block_seconds["b"] - usual.block_seconds["b"] == pytest.approx(14 * (1 + 1 + 3 + 4))


def test_rests_keep_the_duty_within_its_bound():
    limits = Limits(duty_max=0.3, duty_window=60.0)
    run = expected_run(plan_of(block_of(repetitions=10), limits=limits), 0, emissions(5.0))
    assert 0.25 < run.duty_worst <= 0.3
    assert run.pause_seconds == pytest.approx(sum(trial.rest for trial in run.trials) - 20 * 1.0)
    # 200 s of emission at a duty of at most 0.3 take 600 s at least, but for the last window.
    assert run.seconds > 600
    free = expected_run(plan_of(block_of(repetitions=10), limits=Limits(duty_max=None)), 0, emissions(5.0))
    assert free.pause_seconds == 0.0
    assert run.seconds - free.seconds == pytest.approx(run.pause_seconds)
