"""Rows of one pose are those of the whole arrays."""

import numpy as np
import pytest

from palpate.datasets import HandMotion, load_recording, write_sample
from palpate.datasets.contour_file.pose_rows import hand_at, object_pose_at
from palpate.datasets.contour_file.reader import ContourFile
from palpate.datasets.errors import ContourFileError
from palpate.render import MeshObject, PlaneHand, exploration, record, render


@pytest.fixture
def motion():
    return exploration("tube", duration=0.2, seed=3)


def test_rows_of_articulated_planes_are_those_of_their_pose(tmp_path):
    recording = load_recording(write_sample("openxr", tmp_path / "hand.json"))
    hand = PlaneHand.from_joints(recording.joints_in_hand(), recording.radii(), is_left=recording.is_left)
    render("cube", hand, exploration("cube", duration=1.0, rate=30.0)).save(tmp_path / "a.h5")
    with ContourFile(tmp_path / "a.h5") as file:
        for index in (0, 7, file.pose_count - 1):
            described, arrays = hand_at(file, index)
            assert described["poses"] == 1
            assert "sha256" not in described
            np.testing.assert_array_equal(arrays["patch_pose"], hand.patch_pose[index])


def test_a_rigid_hand_is_the_same_at_every_pose(tmp_path, motion):
    render("tube", "skin", motion).save(tmp_path / "a.h5")
    with ContourFile(tmp_path / "a.h5") as file:
        whole = file.hand_arrays()
        for index in (0, 5):
            described, arrays = hand_at(file, index)
            assert described["kind"] == "mesh"
            assert set(arrays) == set(whole)
            assert all((arrays[name] == whole[name]).all() for name in whole)


def test_places_of_a_moving_object(tmp_path, motion):
    moved = HandMotion(motion.time, motion.pose[::-1].copy())
    record(tmp_path / "a.h5", MeshObject.load("cube"), "palm", motion, "oc", object_pose=moved)
    render("tube", "palm", motion, "oc").save(tmp_path / "b.h5")
    with ContourFile(tmp_path / "a.h5") as file:
        np.testing.assert_array_equal(object_pose_at(file, 4), file.object()["moved"][4])
    with ContourFile(tmp_path / "b.h5") as file:
        assert object_pose_at(file, 4) is None


@pytest.mark.parametrize("index", [-1, 18])
def test_a_pose_that_is_not_there_is_refused(tmp_path, motion, index):
    render("tube", "palm", motion, "oc").save(tmp_path / "a.h5")
    with ContourFile(tmp_path / "a.h5") as file:
        for read in (hand_at, object_pose_at):
            with pytest.raises(ContourFileError, match=rf"pose must lie in 0\.\.17, not {index}"):
                read(file, index)
