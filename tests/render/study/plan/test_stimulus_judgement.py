"""Stimuli of a plan, opened and measured without an array, against files whose drive is known."""

import subprocess
from pathlib import Path

import numpy as np
import pytest

from palpate.device import array_model
from palpate.render import LiveStimulus, SamplingStrategy, Stimulus, prepare_frames, render, static_pose
from palpate.render.study.plan import stimulus_judgement as module
from palpate.render.study.plan.stimulus_judgement import judge_stimuli, sha256_of, stimulus_of
from palpate.render.study.plan.study_plan import PlannedStimulus, StudyPlan

EMULATOR = array_model("emulator")
FACETS = (  # a tetrahedron of 6 cm about z = 0.2 m without its floor
    ((0.03, 0, 0.18), (-0.02, 0.03, 0.18), (0, 0, 0.23)),
    ((-0.02, 0.03, 0.18), (-0.02, -0.03, 0.18), (0, 0, 0.23)),
    ((-0.02, -0.03, 0.18), (0.03, 0, 0.18), (0, 0, 0.23)),
)


@pytest.fixture
def open_mesh(tmp_path):
    loops = ["".join(f"vertex {x} {y} {z}\n" for x, y, z in corners) for corners in FACETS]
    facets = [f"facet normal 0 0 0\nouter loop\n{own}endloop\nendfacet\n" for own in loops]
    path = tmp_path / "open.stl"
    path.write_text(f"solid s\n{''.join(facets)}endsolid s\n")
    return path


@pytest.fixture(scope="module")
def contours(tmp_path_factory):
    return render("cube", "palm", static_pose([0, 0, 0.2]), "cc").save(tmp_path_factory.mktemp("s") / "cube.h5")


def judged(*stimuli, array=EMULATOR, **fields):
    plan = StudyPlan(
        path=Path("STUDY.toml"), text="", title="t", codes=("P01",), seed=1, stimuli=stimuli, blocks=(), **fields
    )
    return judge_stimuli(plan, array)


def test_hash_is_that_of_sha256sum(tmp_path):
    path = tmp_path / "bytes"
    path.write_bytes(bytes(range(256)) * 300)
    assert sha256_of(path) == subprocess.run(["sha256sum", path], capture_output=True, check=True).stdout.decode()[:64]


def test_a_contour_file_plays_for_its_duration_at_full_drive(contours):
    found = judged(PlannedStimulus(name="cube", duration=0.05, file=contours))
    (own,) = found.stimuli
    assert (found.faults, found.notes) == ([], [])
    assert (own.kind, own.source, own.seconds, own.update_rate) == ("stored", str(contours), 0.05, 10_000.0)
    assert own.duty == pytest.approx(1.0, abs=0.01)  # the default drive always uses all transducers fully
    assert own.sha256 == sha256_of(contours)
    assert own.emission_seconds == 0.05


def test_prepared_frames_are_played_to_their_end(contours, tmp_path):
    path = tmp_path / "frames.h5"
    prepare_frames(contours, path, duration=0.02)
    assert judged(PlannedStimulus(name="cube", duration=0.02, file=path)).faults == []
    assert stimulus_of(PlannedStimulus(name="cube", duration=0.02, file=path), "palm") == Stimulus(path)
    assert judged(PlannedStimulus(name="cube", duration=0.5, file=path)).faults == [
        f"stimulus cube: {path} plays for 0.02 s, but duration is 0.5 s"
    ]


def test_prepared_frames_of_another_array_are_a_fault(contours, tmp_path):
    path = tmp_path / "frames.h5"
    prepare_frames(contours, path, duration=0.001)
    (fault,) = judged(PlannedStimulus(name="cube", duration=0.001, file=path), array=array_model("pat16")).faults
    assert fault.startswith(f"stimulus cube: {path}: holds frames for emulator")


def test_duty_is_measured_over_the_whole_interval(tmp_path):
    motion = static_pose([0, 0, 0.2])
    away = static_pose([0, 0, 0.4])  # the palm is above the cube, so nothing is drawn
    moves = type(motion)(np.array([0.0, 0.02]), np.concatenate([motion.pose, away.pose]))
    path = render("cube", "palm", moves, "cc").save(tmp_path / "half.h5")
    found = judged(PlannedStimulus(name="half", duration=0.04, file=path))
    assert found.faults == []
    assert found.stimuli[0].duty == pytest.approx(0.5, abs=0.05)
    silent = render("cube", "palm", away, "cc").save(tmp_path / "silent.h5")
    assert judged(PlannedStimulus(name="none", duration=0.01, file=silent)).notes == [
        f"stimulus none: {silent} emits nothing"
    ]


def test_a_missing_file_and_one_that_is_no_stimulus_are_faults(tmp_path):
    other = tmp_path / "other.h5"
    other.write_text("no HDF5")
    missing = tmp_path / "missing.h5"
    found = judged(
        PlannedStimulus(name="a", duration=1.0, file=missing), PlannedStimulus(name="b", duration=1.0, file=other)
    )
    assert found.faults[0] == f"stimulus a: {missing} is missing"
    assert found.faults[1].startswith(f"stimulus b: {other}")
    assert len(found.faults) == 2
    assert [own.duty for own in found.stimuli] == [1.0, 1.0]  # the worst case


def test_another_update_rate_is_a_fault_with_both_rates(contours, tmp_path):
    path = tmp_path / "slow.h5"
    prepare_frames(contours, path, duration=0.02, sampling=SamplingStrategy(update_rate=5000.0))
    found = judged(
        PlannedStimulus(name="slow", duration=0.02, file=path),
        PlannedStimulus(name="fast", duration=0.02, file=contours),
        PlannedStimulus(name="named", duration=0.02, file=contours, sampling="stm"),
        PlannedStimulus(name="live", duration=1.0, solid="cube"),
    )
    assert found.update_rate == 5000.0
    assert found.faults == [
        f"stimulus fast: {contours} has an update rate of 10000 Hz, but all stimuli of a study must have the same, "
        "which is 5000 Hz"
    ]
    assert [own.update_rate for own in found.stimuli] == [5000.0, 10_000.0, 5000.0, 5000.0]


def test_a_live_object_counts_at_full_drive_and_its_file_is_hashed(open_mesh):
    found = judged(
        PlannedStimulus(name="open oc", duration=1.0, solid=str(open_mesh), strategy="oc"),
        PlannedStimulus(name="cube", duration=1.0, solid="cube"),
    )
    assert found.faults == []
    (note,) = found.notes
    assert note.startswith("stimulus open oc: open.stl: 3 open edges")
    assert [(own.kind, own.duty, own.update_rate) for own in found.stimuli] == [("live", 1.0, 10_000.0)] * 2
    assert [own.sha256 for own in found.stimuli] == [sha256_of(open_mesh), None]
    assert found.stimuli[0].emission_seconds == pytest.approx(1.1)


def test_a_strategy_that_refuses_an_object_is_a_fault(open_mesh):
    (fault,) = judged(PlannedStimulus(name="open cc", duration=1.0, solid=str(open_mesh), strategy="cc")).faults
    assert fault.startswith("stimulus open cc: ")
    assert "closed" in fault


def test_an_object_is_loaded_once_and_its_fault_is_listed_once(monkeypatch):
    loaded = []
    real = module.load_solid
    monkeypatch.setattr(module, "load_solid", lambda name, *given, **other: loaded.append(name) or real(name, *given))
    found = judged(
        PlannedStimulus(name="oc", duration=1.0, solid="cube", strategy="oc"),
        PlannedStimulus(name="cc", duration=1.0, solid="cube", shown="nowhere.stl"),
        PlannedStimulus(name="other", duration=1.0, solid="nowhere.stl"),
    )
    assert loaded == ["cube", "nowhere.stl"]
    (fault,) = found.faults
    assert fault.startswith("stimulus cc: nowhere.stl")


def test_strategy_sampling_hand_and_duration_that_there_are_not_are_faults():
    found = judged(
        PlannedStimulus(name="a", duration=1.0, solid="cube", strategy="xx"),
        PlannedStimulus(name="b", duration=1.0, solid="cube", sampling="yy"),
        PlannedStimulus(name="c", duration=-1.0, solid="cube"),
    )
    assert [fault[:12] for fault in found.faults] == ["stimulus a: ", "stimulus b: ", "stimulus c: "]
    (fault,) = judged(PlannedStimulus(name="a", duration=1.0, solid="cube"), hand="paw").faults
    assert "hand must be" in fault


def test_planned_stimuli_become_those_of_a_session(contours):
    live = stimulus_of(PlannedStimulus(name="a", duration=7.0, solid="dog", strategy="oc", sampling="stm"), "planes")
    assert live == LiveStimulus("dog", duration=7.0, hand="planes", strategy="oc", sampling="stm")
    stored = stimulus_of(PlannedStimulus(name="a", duration=7.0, file=contours), "palm")
    assert stored == Stimulus(contours, duration=7.0)
