"""What people write wrong at first in Python, and the way out that the error names, in one line."""

import re

import numpy as np
import pytest
import trimesh

import palpate.device
import palpate.render
from palpate.datasets import write_sample
from palpate.device import DeviceError
from palpate.render import (
    DatasetError,
    HandMotion,
    ImplicitObject,
    IntersectionStrategy,
    MeshObject,
    Palm,
    RenderError,
    closed_contour,
    exploration,
    load_contours,
    load_sampling,
    load_strategy,
    preset,
    render,
    sphere,
    static_pose,
    summarise,
)

TUBE = MeshObject.load("tube")
STILL = static_pose([0, 0, 0.2])
OPEN = trimesh.Trimesh([[0, 0, 0.2], [0.1, 0, 0.2], [0, 0.1, 0.2]], [[0, 1, 2]])


@pytest.fixture(scope="module")
def batch():
    return render(TUBE, "palm", exploration(TUBE, duration=0.2), "cc")


def still():
    """A batch with a contour: a file without any may be replaced."""
    return render(TUBE, "palm", STILL, "cc")


ALONE = {
    "an unknown name": (lambda: palpate.render.rendr, "has no attribute 'rendr'"),
    "an object's name": (lambda: render("tubee", "palm", STILL), "did you mean 'tube'?"),
    "object and hand exchanged": (lambda: render("palm", "tube", STILL), "hand=palm is where it belongs"),
    "a hand for an object": (lambda: render(Palm(), TUBE, STILL), "the order is object, hand, motion, strategy"),
    "hand and motion exchanged": (lambda: render(TUBE, STILL, "palm"), "the motion comes after the hand"),
    "a mesh for a hand": (lambda: render(TUBE, OPEN, STILL), "MeshHand(mesh.vertices, mesh.faces)"),
    "seconds for a motion": (lambda: render(TUBE, "palm", 30), "the motion must be a HandMotion"),
    "voxels for a mesh": (lambda: render(np.zeros((4, 4, 4)), "palm", STILL), "VoxelObject(values, spacing=METRES)"),
    "a strategy to load": (lambda: load_strategy(load_strategy("cc")), "must be the name of a preset"),
    "a strategy for a sampling": (lambda: load_sampling("cc"), "is the strategy that render takes"),
    "one pose by its number": (lambda: exploration("tube", 1.0)[0], "motion.pose has the rows"),
    "a hand's name": (lambda: render("tube", "plam", STILL), "did you mean 'palm'?"),
    "a palm in millimetres": (lambda: Palm(85, 85), "85 mm are 0.085"),
    "a position for a motion": (lambda: render("tube", "palm", [0, 0, 0.2]), "static_pose([x, y, z]) makes one"),
    "positions for a motion": (lambda: render("tube", "palm", np.zeros((9, 3))), "poses must be an array [pose, 7]"),
    "a motion's name": (lambda: render("tube", "palm", "explore.csv"), "no such motion file"),
    "one pose of a motion": (lambda: exploration("tube", 1.0)[5:5], "as in motion[0:90]"),
    "a strategy's name": (lambda: render("tube", "palm", STILL, "hacth"), "did you mean 'hatch'?"),
    "a function for a strategy": (lambda: render("tube", "palm", STILL, closed_contour), "load_strategy gives one"),
    "a stage's name": (lambda: IntersectionStrategy(transform=("hacth",)), "did you mean 'hatch'?"),
    "a device": (lambda: render("tube", "palm", STILL, device="gpu"), "GPUs are cuda:0"),
    "an argument's name": (lambda: MeshObject.load("tube", fitt=0.1), "did you mean 'fit'?"),
    "an axis": (lambda: MeshObject.load("tube", up="w"), "one of x, y, z, -x"),
    "two coordinates": (lambda: MeshObject.load("tube", at=(0, 0)), "at must be three finite numbers"),
    "a path for a mesh": (lambda: MeshObject("tube.stl"), "load a file by MeshObject.load(path)"),
    "a mesh and faces": (lambda: MeshObject(OPEN, [[0, 1, 2]]), "has faces of its own"),
    "a file to explore": (lambda: exploration("dog.stl"), "exploration(MeshObject.load('dog.stl'))"),
    "a preset's name": (lambda: preset("smt"), "did you mean 'stm'?"),
}
OF_A_BATCH = {
    "a pose too far": (lambda b: b[99], "pose 99 is outside the batch's 18 poses"),
    "focal points as a table": (lambda b: b.sample().save("points.csv"), "to_pandas().to_csv(path) writes a table"),
    "a word for a pose": (lambda b: b["a"], "a pose's number or first:stop"),
    "a kind": (lambda b: b.length("objct"), "did you mean 'object'?"),
    "a sampling": (lambda b: b.sample("smt"), "did you mean 'stm'?"),
    "a board without its file": (lambda b: b.play("pat16"), "calibration=BOARD.pat, emulate=True or uncalibrated=True"),
    "no function to watch": (lambda b: b.play(watch=3), "watch must be a function"),
    "a part of a batch to summarise": (lambda b: summarise(b[5:5]), "this batch has no poses"),
    "chosen poses": (lambda b: b[[1, 2]], "[batch[i] for i in numbers]"),
    "every other pose": (lambda b: b[::2], "[batch[i] for i in numbers]"),
    "an empty part to save": (lambda b: b[5:5].save("none.h5"), "this batch has no poses"),
    "a file's batch to save": (lambda b: load_contours(b.save("l.h5")).save("m.h5"), "read from l.h5, which holds all"),
    "a part of a file's batch": (lambda b: load_contours(b.save("n.h5"))[1:3].save("m.h5"), "a part of n.h5"),
    "no sampling": (lambda b: b.sample(None), "sampling must be a SamplingStrategy, or the name or file of one"),
    "a table": (lambda b: b.to_pandas("lines"), "of must be poses or points"),
    "a file that is there": (lambda b: b.save(still().save("a.h5")), "overwrite=True replaces it"),
}


def answer(mistake):
    with pytest.raises((RenderError, DatasetError, DeviceError, TypeError, IndexError, AttributeError)) as refusal:
        mistake()
    text = str(refusal.value)
    assert "\n" not in text
    assert "--" not in re.sub("palpate voxelise .* makes", "", text)  # an option of the command line
    return text


@pytest.mark.parametrize("name", ALONE)
def test_a_mistake_is_answered_by_the_way_out(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    mistake, way_out = ALONE[name]
    assert way_out in answer(mistake)


@pytest.mark.parametrize("name", OF_A_BATCH)
def test_a_mistake_with_a_batch_is_answered_by_the_way_out(name, batch, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    mistake, way_out = OF_A_BATCH[name]
    assert way_out in answer(lambda: mistake(batch))


def test_what_is_doubtful_is_warned_of_at_the_line_that_led_to_it(tmp_path, monkeypatch):
    with pytest.warns(palpate.render.RecordingWarning):
        far = static_pose([0, 0, 200])
    doubtful = {
        lambda: MeshObject.load("tube", fit=130): "130 mm are fit=0.13",
        lambda: ImplicitObject(sphere(40)): "for millimetres use scale=0.001",
        lambda: MeshObject.load("tube", at=(0, 0, 200)): r"at=\(0, 0, 0.2\)",
        lambda: ImplicitObject(sphere(0.04), at=(0, 0, 200)): r"at=\(0, 0, 0.2\)",
        lambda: render("tube", "palm", far): "200 m; lengths are in metres, 200 mm are 0.2. There float32",
        lambda: static_pose([0, 0, 200]): "200 mm are 0.2",
        lambda: HandMotion.load("far.csv"): "far.csv: positions reach 200 m; .* 200 mm are 0.2",
        lambda: HandMotion(np.arange(20) * 11.0, STILL.pose.repeat(20, axis=0)): "11 ms are 0.011",
    }
    monkeypatch.chdir(tmp_path)
    far.save("far.csv")
    for make, way_out in doubtful.items():
        with pytest.warns((palpate.render.PalpateWarning, palpate.render.RecordingWarning), match=way_out) as told:
            make()
        assert {warning.filename for warning in told} == {__file__}


def test_a_misspelt_name_is_marked_so_that_python_suggests_the_right_one():
    with pytest.raises(AttributeError) as refusal:
        _ = palpate.render.rendr
    assert (refusal.value.name, refusal.value.obj) == ("rendr", palpate.render)


def test_a_loaded_batch_knows_the_names_that_its_file_has(batch, tmp_path):
    loaded = load_contours(batch.save(tmp_path / "other.h5"))
    assert loaded.facts() == batch.facts()


def test_a_recording_that_meets_nothing_is_warned_of_with_its_alignment(tmp_path):
    path = write_sample("leap", tmp_path / "hand.json")
    with (
        pytest.warns(palpate.render.RecordingWarning),
        pytest.warns(palpate.render.PalpateWarning, match="load_recording\\(path, alignment="),
    ):
        render(TUBE, "palm", path, "oc")


def test_a_playback_has_its_numbers(batch):
    played = batch.play(clock="virtual")
    assert (played.frames, played.underruns) == (played.played.frames, 0)
    assert played.draw_frequency == batch.sample("stm").draw_frequency
