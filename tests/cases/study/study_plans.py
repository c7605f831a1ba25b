"""Plans, and a player without an array, for tests of studies."""

import time
from pathlib import Path
from types import SimpleNamespace

from palpate.render.study.plan.duty_account import EmissionInterval
from palpate.render.study.plan.study_plan import PlannedBlock, PlannedStimulus, Question, StudyPlan
from palpate.render.study.run.interval_player import PLAYED, PlayedInterval

CHOICE = Question(name="answer", text="Which one?", kind="choice", options=("First", "Second"), has_random_keys=True)
CONFIDENCE = Question(name="confidence", text="How sure?", kind="scale")
TYPED = (
    Question(name="age", text="Your age?", kind="number", low=18, high=99),
    Question(name="note", text="Anything else?", kind="text", is_optional=True),
)


def stimuli(*names):
    return tuple(PlannedStimulus(name=name, duration=0.01, solid="cube", strategy=name[-2:]) for name in names)


def block(**fields):
    values = {
        "name": "cube", "design": "2ifc", "question": CHOICE, "questions": (CHOICE,), "sets": (("cube-oc", "cube-cc"),),
        "repetitions": 2, "gap": 0.0, "rest": 0.0,
    }  # fmt: skip
    return PlannedBlock(**(values | fields))


def study(**fields):
    values = {
        "path": Path("study.toml"), "text": "title = 'A study'", "title": "A study", "codes": ("P01", "P02"), "seed": 1,
        "stimuli": stimuli("cube-oc", "cube-cc"), "blocks": (block(),),
    }  # fmt: skip
    return StudyPlan(**(values | fields))


EMISSIONS = {
    name: EmissionInterval(stimulus=name, seconds=0.01, duty=1.0)
    for name in ("cube-oc", "cube-cc", "a-oc", "b-oc", "c-oc", "d-oc")
}


class SilentPlayer:
    """Plays nothing, at once; stops where the run is held. outcomes: what comes of the first intervals instead."""

    update_rate = 10e3

    def __init__(self, outcomes=()):
        self.played = []
        self.outcomes = list(outcomes)

    def broken(self, name, error, poses_file):
        return PlayedInterval(stimulus=name, outcome=f"stopped before it began: {error}")

    def save_poses(self):
        """It has drawn nothing."""

    def drawn(self, interval):
        """Nothing was."""

    def play(self, name, *, poses_file, is_held, begun, waits_for_hand):
        self.played.append(name)
        now = time.monotonic()
        outcome = self.outcomes.pop(0) if self.outcomes else PLAYED
        if callable(outcome):
            outcome = outcome()
        if is_held():
            return PlayedInterval(stimulus=name, outcome="stopped before it began")
        onset = SimpleNamespace(time=now, latency=0.001, is_estimate=False)
        begun(onset)
        return PlayedInterval(
            stimulus=name, outcome=outcome, onset=now, latency=0.001, ended=now + 0.01, seconds_on=0.01
        )
