"""Stimuli of a plan, opened and measured without an array, against files whose drive is known."""

from pathlib import Path

import pytest

from palpate.device import array_model
from palpate.render import LiveStimulus, Stimulus, render, static_pose
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


def judged(*stimuli, array=EMULATOR, **fields):
    plan = StudyPlan(
        path=Path("STUDY.toml"), text="", title="t", codes=("P01",), seed=1, stimuli=stimuli, blocks=(), **fields
    )
    return judge_stimuli(plan, array)


def points_file(path, intensity, rate=10_000):
    """A point list, whose points all lie 20 cm above the array."""
    rows = "".join(f"0, 0, 0.2, {own}\n" for own in intensity)
    path.write_text(f"{len(intensity)}\n{rate}\n1\n{rows}")
    return path


def test_duty_is_the_mean_over_the_whole_interval(tmp_path):
    path = points_file(tmp_path / "half.PTLIST", [1] * 300 + [0] * 100)
    found = judged(PlannedStimulus(name="half", duration=0.04, file=path))
    (own,) = found.stimuli
    assert (found.faults, found.notes) == ([], [])
    assert (own.kind, own.source, own.seconds, own.update_rate) == ("stored", str(path), 0.04, 10_000.0)
    assert own.duty == pytest.approx(0.75, abs=0.01)  # full intensity drives each transducer fully
    assert own.sha256 == sha256_of(path)
    assert own.emission_seconds == 0.04


def test_another_update_rate_is_a_fault_with_both_rates(tmp_path):
    slow = points_file(tmp_path / "slow.PTLIST", [1] * 10, rate=5000)
    fast = points_file(tmp_path / "fast.PTLIST", [1] * 10)
    found = judged(
        PlannedStimulus(name="fast", duration=0.001, file=fast),
        PlannedStimulus(name="slow", duration=0.002, file=slow),
        PlannedStimulus(name="live", duration=1.0, solid="cube"),
    )
    assert found.update_rate == 5000.0
    assert found.faults == [
        f"stimulus fast: {fast} has an update rate of 10000 Hz, but all stimuli of a study must have the same, which "
        "is 5000 Hz"
    ]
    assert [own.update_rate for own in found.stimuli] == [10_000.0, 5000.0, 5000.0]


def test_a_contour_file_takes_the_rate_of_the_others_with_a_named_sampling(tmp_path):
    contours = render("cube", "palm", static_pose([0, 0, 0.2]), "cc").save(tmp_path / "cube.h5")
    slow = PlannedStimulus(name="slow", duration=0.002, file=points_file(tmp_path / "s.PTLIST", [1] * 10, rate=5000))
    found = judged(slow, PlannedStimulus(name="cube", duration=0.01, file=contours, sampling="stm"))
    assert (found.faults, found.update_rate) == ([], 5000.0)
    assert found.stimuli[1].seconds == 0.01
    assert found.stimuli[1].duty == pytest.approx(1.0, abs=0.01)


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
    assert found.stimuli[0].emission_seconds == pytest.approx(1.15)


def test_strategy_sampling_hand_and_duration_that_there_are_not_are_faults():
    found = judged(
        PlannedStimulus(name="a", duration=1.0, solid="cube", strategy="xx"),
        PlannedStimulus(name="b", duration=1.0, solid="cube", sampling="yy"),
        PlannedStimulus(name="c", duration=-1.0, solid="cube"),
    )
    assert [fault[:12] for fault in found.faults] == ["stimulus a: ", "stimulus b: ", "stimulus c: "]
    paws = (PlannedStimulus(name=name, duration=1.0, solid="cube") for name in "ab")
    (fault,) = judged(*paws, hand="paw").faults
    assert fault.startswith("hand must be")


def test_planned_stimuli_become_those_of_a_session(tmp_path):
    live = stimulus_of(PlannedStimulus(name="a", duration=7.0, solid="dog", strategy="oc", sampling="stm"), "planes")
    assert live == LiveStimulus("dog", duration=7.0, hand="planes", strategy="oc", sampling="stm")
    path = points_file(tmp_path / "a.PTLIST", [1])
    stored = stimulus_of(PlannedStimulus(name="a", duration=7.0, file=path), "palm")
    assert stored == Stimulus(path, duration=7.0)
