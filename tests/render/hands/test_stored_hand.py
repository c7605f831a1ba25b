"""The look of a hand is that of the hand that was rendered, at every pose, whichever kind it is of."""

import numpy as np
import pytest

from palpate.datasets import ContourFile, load_recording, write_sample
from palpate.render import Palm, PlaneHand, exploration, flat_hand, render
from palpate.render.hands.stored_hand import HandLooks, hand_from


def save(tmp_path, hand, motion):
    render("tube", hand, motion, "oc").save(tmp_path / "a.h5")
    return ContourFile(tmp_path / "a.h5")


@pytest.mark.parametrize("hand", [Palm(0.07, 0.09), flat_hand()], ids=["palm", "planes"])
def test_patches_of_rigid_hands(tmp_path, hand):
    motion = exploration("tube", duration=0.2, seed=2)
    with save(tmp_path, hand, motion) as file:
        looks = HandLooks(file)
        assert looks.is_rigid
        for index in (0, 9, 17):
            look = looks.at(index, motion.pose[index])
            np.testing.assert_allclose(look.patches, hand.corners(motion.pose[index : index + 1])[0], atol=1e-7)
            assert not look.is_rendered


def test_articulated_planes_lack_patches_where_the_hand_was_not_seen(tmp_path):
    recording = load_recording(write_sample("openxr", tmp_path / "hand.json"))
    joints = recording.joints_in_hand().copy()
    joints[5, 7:11] = np.nan  # the index finger, at one pose
    hand = PlaneHand.from_joints(joints, recording.radii(), is_left=recording.is_left)
    motion = exploration("tube", duration=1.0, rate=30.0)
    with save(tmp_path, hand, motion) as file:
        looks = HandLooks(file)
        assert not looks.is_rigid
        for index in (4, 5):
            corners = hand.corners(motion.pose[index : index + 1], index)[0]
            there = np.isfinite(corners).all(axis=(1, 2))
            np.testing.assert_allclose(looks.at(index, motion.pose[index]).patches, corners[there], atol=1e-6)
        assert len(looks.at(5, motion.pose[5]).patches) < len(looks.at(4, motion.pose[4]).patches)


def test_a_hand_mesh_is_the_skin_that_was_rendered(tmp_path):
    motion = exploration("tube", duration=0.1, seed=2)
    with save(tmp_path, "skin", motion) as file:
        hand = hand_from(file.hand, file.hand_arrays())
        looks = HandLooks(file)
        look = looks.at(3, motion.pose[3])
    assert look.is_rendered
    triangles = look.vertices[looks.faces[looks.glabrous]]
    np.testing.assert_allclose(triangles, hand.triangles(motion.pose[3:4])[0], atol=1e-6)
