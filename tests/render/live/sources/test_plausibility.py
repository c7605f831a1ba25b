"""What cannot be a hand over an array is refused with value and bound: NaN, millimetres, left for right, bad norms."""

import numpy as np
import pytest
from live_senders import joint_frames, palm_at

from palpate.datasets.errors import RecordingError
from palpate.datasets.hand_model.joints import Joint
from palpate.datasets.recordings.recording import HandRecording
from palpate.datasets.rigid import quaternion_product
from palpate.render.live.sources import plausibility
from palpate.render.live.sources.plausibility import (
    Implausible,
    require_hand,
    require_near,
    unit_joints,
    unit_pose,
)

RIGHT = [frame.joints for frame in joint_frames(10.0, 1.0)]
LEFT = [frame.joints for frame in joint_frames(10.0, 1.0, is_left=True)]


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({1: np.nan}, r"pose\[1\]: must be finite, not nan; a hand not seen has no pose"),
        ({6: np.inf}, r"pose\[6\]: must be finite, not inf"),
        ({3: 0.9}, r"pose: the quaternion's norm must be 1 within 0\.01, not 1\.144"),
        ({3: 0.0, 6: 0.0}, r"must be 1 within 0\.01, not 0"),
    ],
)
def test_a_pose_that_is_none_is_refused(change, reason):
    pose = palm_at(0.0)
    for k, value in change.items():
        pose[k] = value
    with pytest.raises(Implausible, match=reason):
        unit_pose(pose)


def test_joints_that_are_not_known_stay_unknown_and_others_are_normalised():
    joints = RIGHT[0].copy()
    joints[Joint.THUMB_TIP] = np.nan
    joints[:, 3:] *= 1.004
    found, radius = unit_joints(joints, None)
    assert np.isnan(found[Joint.THUMB_TIP]).all()
    assert np.allclose(found, np.where(np.isnan(joints), np.nan, RIGHT[0]), atol=1e-12, equal_nan=True)
    assert np.isnan(radius).all()


@pytest.mark.parametrize(
    ("joint", "column", "value", "reason"),
    [
        (Joint.INDEX_TIP, 2, np.inf, "joints: index_tip must be finite, or NaN where it is not known"),
        (Joint.WRIST, 4, 2.0, r"joints: the norm of wrist's quaternion must be 1 within 0\.01, not 2"),
    ],
)
def test_joints_that_are_none_are_refused(joint, column, value, reason):
    joints = RIGHT[0].copy()
    joints[joint, column] = value
    with pytest.raises(Implausible, match=reason):
        unit_joints(joints, None)


@pytest.mark.parametrize(("value", "hint"), [(0.0, "$"), (-0.01, "$"), (9.0, ": is it in millimetres\\?$")])
def test_a_radius_that_no_finger_has_is_refused(value, hint):
    radius = np.full(26, 0.01)
    radius[Joint.RING_TIP] = value
    with pytest.raises(Implausible, match=rf"radius: ring_tip must lie in 0\.\.0\.07 m, not {value:.6g}{hint}"):
        unit_joints(RIGHT[0], radius)


def test_a_hand_in_millimetres_is_refused():
    joints = RIGHT[0] * [1e3, 1e3, 1e3, 1, 1, 1, 1]
    reason = r"the hand measures 8\d\.\d+ m across the palm, and must measure 0\.04 to 0\.14 m: is it in millimetres\?"
    with pytest.raises(Implausible, match=reason) as refused:
        require_hand(joints, "right")
    assert refused.value.fault.kind == "size"


def test_a_left_hand_that_is_said_to_be_right_is_refused():
    with pytest.raises(Implausible, match=r"side: said to be a right hand, but its joints are those of a left one"):
        require_hand(LEFT[0], "right")


def test_quaternions_of_another_convention_are_refused_with_the_likely_cause():
    joints = RIGHT[0].copy()
    joints[:, 3:] = quaternion_product(joints[:, 3:], np.array([0.0, 1.0, 0.0, 0.0]))  # -Z runs to the wrist
    with pytest.raises(Implausible, match="orientations contradict positions"):
        require_hand(joints, None)


@pytest.mark.exhaustive
def test_the_quick_look_accepts_nothing_that_a_recording_refuses():
    """The oracle is `HandRecording`, which checks size, side and axes of files by other code."""
    rng = np.random.default_rng(2)
    accepted = 0
    for k in range(60):
        joints = (RIGHT, LEFT)[k % 2][k % 10].copy()
        joints[:, :3] *= rng.choice([1.0, 0.4, 0.6, 1.5, 2.0])
        turn = rng.normal(0.0, rng.choice([0.0, 0.2, 0.5]), 3)
        joints[:, 3:] = quaternion_product(joints[:, 3:], np.array([*turn, 1.0]) / np.sqrt(1.0 + turn @ turn))
        stated = rng.choice(["left", "right"])
        try:
            HandRecording(None, joints[None], np.full(26, 0.01), is_left=stated == "left")
        except RecordingError:
            assert not plausibility._is_hand(joints, stated)
        else:
            accepted += plausibility._is_hand(joints, stated)
            require_hand(joints, stated)
    assert accepted > 5


@pytest.mark.parametrize("place", [(0.0, 0.0, 200.0), (0.0, 3.5, 0.2)])
def test_a_hand_that_is_nowhere_near_is_refused(place):
    distance = f"{float(np.linalg.norm(place)):.4g}"
    with pytest.raises(
        Implausible, match=f"is {distance} m from the array's centre, and must be within 3 m"
    ) as refused:
        require_near(np.array(place))
    assert "in millimetres" in str(refused.value)
    require_near(np.array([0.0, 1.0, 2.0]))
