"""Stimuli of a plan for an array that takes focal points: as many a sample as any of them has, and their duty."""

from pathlib import Path

import numpy as np
import pytest

from palpate.datasets.focus_files.ptlist import write_ptlist
from palpate.device import array_model
from palpate.render import SamplingStrategy, prepare_frames, render, static_pose
from palpate.render.study.plan.stimulus_judgement import judge_stimuli
from palpate.render.study.plan.study_plan import PlannedStimulus, StudyPlan

STRATOS = array_model("stratos")
FOUR = SamplingStrategy(foci=4, update_rate=10e3)


def judged(*stimuli, array=STRATOS, **fields):
    plan = StudyPlan(
        path=Path("STUDY.toml"), text="", title="t", codes=("P01",), seed=1, stimuli=stimuli, blocks=(), **fields
    )
    return judge_stimuli(plan, array)


def test_the_array_is_opened_for_the_most_points_of_any_stimulus(tmp_path):
    contours = render("cube", "palm", static_pose([0, 0, 0.2]), "cc").save(tmp_path / "cube.h5")
    half = tmp_path / "half.PTLIST"
    write_ptlist(half, np.tile(np.float32([0, 0, 0.2]), (400, 1)), np.full(400, 0.5, np.float32), 10e3)
    prepare_frames(contours, tmp_path / "frames.h5", array="stratos", sampling=FOUR, duration=0.05)
    one = PlannedStimulus(name="half", duration=0.04, file=half)
    four = PlannedStimulus(name="four", duration=0.05, file=contours, sampling=FOUR)
    frames = PlannedStimulus(name="frames", duration=0.05, file=tmp_path / "frames.h5")
    for stimuli, most in (((one,), 1), ((one, four), 4), ((frames, one), 4)):
        found = judged(*stimuli)
        assert (found.faults, found.foci, found.update_rate) == ([], most, 10e3)
    (own,) = judged(one).stimuli
    assert own.duty == pytest.approx(1 / 3, abs=1e-3)  # 2 / pi asin(1/2), by hand
    first, second = judged(four, frames).stimuli
    assert first.duty == pytest.approx(second.duty, abs=1e-6)


def test_frames_of_another_array_are_a_fault(tmp_path):
    contours = render("cube", "palm", static_pose([0, 0, 0.2]), "cc").save(tmp_path / "cube.h5")
    prepare_frames(contours, tmp_path / "frames.h5", array="emulator", duration=0.05)
    (fault,) = judged(PlannedStimulus(name="frames", duration=0.05, file=tmp_path / "frames.h5")).faults
    assert "holds frames for emulator" in fault
    assert "not for stratos" in fault


def test_prepared_frames_of_fewer_points_than_another_stimulus_are_a_fault_of_the_plan(tmp_path):
    """A session opens the array once, for one number of focal points a frame."""
    contours = render("cube", "palm", static_pose([0, 0, 0.2]), "cc").save(tmp_path / "cube.h5")
    prepare_frames(contours, tmp_path / "frames.h5", array="stratos", duration=0.05)
    one = PlannedStimulus(name="one", duration=0.05, file=tmp_path / "frames.h5")
    four = PlannedStimulus(name="four", duration=0.05, file=contours, sampling=FOUR)
    (fault,) = judged(one, four).faults
    assert fault.startswith(
        "stimulus one: its prepared frames have 1 focal points each, but array stratos is opened for 4"
    )
