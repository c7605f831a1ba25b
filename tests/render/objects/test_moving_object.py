"""Objects that move: the same contours, seen by the object and from the array."""

import numpy as np
import pytest
from mesh_cases import generic_poses
from scipy.spatial.transform import Rotation, Slerp

from palpate.datasets.contour_file.check import check_file
from palpate.datasets.contour_file.reader import ContourFile
from palpate.datasets.motions.hand_motion import HandMotion
from palpate.render import MeshObject, Palm, closed_contour, record, render
from palpate.render.errors import PoseError
from palpate.render.intersection.scene import Scene
from palpate.render.objects.moving_object import back_to, between, object_poses, seen_from

TUBE, PALM = MeshObject.load("tube"), Palm()
MIDDLE = TUBE.bounds.mean(axis=0)


def object_motion(count, seed=3):
    poses = generic_poses(count, seed)
    poses[:, :3] += (0.01, -0.02, 0.03)
    return poses


def moved_points(points, place):
    turn = Rotation.from_quat(place[3:].astype(np.float64))
    return turn.apply(points.astype(np.float64) - MIDDLE) + place[:3]


@pytest.mark.exhaustive
def test_contours_of_a_moved_object_are_those_of_the_object_made_where_it_is():
    hands, places = generic_poses(60, 5), object_motion(60)
    batch = render(TUBE, PALM, hands, closed_contour(), object_pose=places)
    length = batch.length()
    for row in range(60):
        there = MeshObject(moved_points(TUBE.vertices, places[row]), TUBE.faces)
        expected = render(there, PALM, hands[row : row + 1], closed_contour())
        assert length[row] == pytest.approx(expected.length()[0], abs=2e-5)
        assert batch.pose_start[row + 1] - batch.pose_start[row] == expected.polyline_count
        if expected.point_count:  # the order of triangles, and so of points, is another in a mesh that is turned
            points = np.concatenate(batch.polylines_of(row))
            apart = np.linalg.norm(points[:, None] - expected.points[None], axis=2)
            assert max(apart.min(axis=0).max(), apart.min(axis=1).max()) < 1e-5


def test_seen_from_and_back_undo_the_motion():
    places, hands = object_motion(30), generic_poses(30, 8)
    seen = seen_from(places, MIDDLE, hands)
    for row in range(30):
        turn = Rotation.from_quat(places[row, 3:])
        again = turn.apply(seen[row, :3] - MIDDLE) + places[row, :3]
        np.testing.assert_allclose(again, hands[row, :3], atol=1e-7)
        both = turn * Rotation.from_quat(seen[row, 3:])
        assert (both.inv() * Rotation.from_quat(hands[row, 3:])).magnitude() < 1e-6
    points = np.random.default_rng(1).normal(size=(30, 3))
    there = np.stack([moved_points(p, place) for p, place in zip(points, places, strict=True)])
    np.testing.assert_allclose(back_to(places, MIDDLE, there), points, atol=1e-6)


def test_between_its_own_times_an_object_moves_evenly():
    own, places = np.array([0.0, 0.5, 2.0]), object_motion(3).astype(np.float64)
    time = np.array([0.0, 0.2, 0.5, 1.9, 2.0])
    got = between(own, places, time)
    turn = Slerp(own, Rotation.from_quat(places[:, 3:]))(time)
    assert ((turn.inv() * Rotation.from_quat(got[:, 3:])).magnitude() < 1e-6).all()
    for axis in range(3):
        np.testing.assert_allclose(got[:, axis], np.interp(time, own, places[:, axis]), atol=1e-7)


def test_a_clock_is_shared_and_what_does_not_fit_is_refused():
    hands = HandMotion(np.arange(10) / 10, generic_poses(10, 1), offset=100.0)
    early = HandMotion(np.arange(20) / 10, object_motion(20), offset=99.5)
    got, want = object_poses(early, hands), object_motion(20)[5:15]
    np.testing.assert_allclose(got[:, :3], want[:, :3], atol=1e-6)
    np.testing.assert_allclose(np.abs((got[:, 3:] * want[:, 3:]).sum(axis=1)), 1.0, atol=1e-6)  # q and -q turn alike
    late = HandMotion(np.arange(20) / 10, object_motion(20), offset=100.5)
    with pytest.raises(PoseError, match=r"from 0.5 to 2.4 s of the hand's time, the hand's from 0 to 0.9 s"):
        object_poses(late, hands)
    with pytest.raises(PoseError, match="the object has 7 poses, the hand 10"):
        object_poses(object_motion(7), hands)
    assert len(object_poses(object_motion(1), hands)) == 10
    keyframes = HandMotion(np.array([0.0, 10.0]), object_motion(2))
    ends = (object_poses(keyframes, HandMotion(np.array([0.0, end]), generic_poses(2, 1))) for end in (10.1, 10.2))
    assert len(next(ends)) == 2
    with pytest.raises(PoseError, match=r"from 0 to 10 s of the hand's time, the hand's from 0 to 10.2 s"):
        next(ends)  # not held for an interval of 10 s
    with pytest.raises(PoseError, match="the object has 3 poses, the motion 10"):
        Scene.of(TUBE, PALM, closed_contour(), object_pose=object_motion(3)).require_poses(10)


def test_a_file_keeps_where_the_object_was_and_resumes_only_with_the_same(tmp_path):
    hands, path = HandMotion(np.arange(12) / 90, generic_poses(12, 2)), tmp_path / "moved.h5"
    record(path, TUBE, PALM, hands, closed_contour(), object_pose=object_motion(12))
    assert check_file(path) == []
    with ContourFile(path) as file:
        np.testing.assert_array_equal(file.object()["moved"], object_motion(12))
        expected = render(TUBE, PALM, hands, closed_contour(), object_pose=object_motion(12))
        np.testing.assert_array_equal(file.contours()["points"], expected.points)
    with pytest.raises(Exception, match="object motion was"):
        record(path, TUBE, PALM, hands, closed_contour(), object_pose=object_motion(12, seed=4), mode="resume")
