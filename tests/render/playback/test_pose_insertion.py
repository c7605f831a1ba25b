"""Poses between two of a tracker's: as many as a moving contour needs, on the hand's way, none over a gap."""

import itertools

import insertion_oracle
import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from palpate.datasets.motions.hand_motion import PALM_DOWN, HandMotion
from palpate.render import (
    MeshObject,
    Palm,
    Scene,
    closed_contour,
    exploration,
    load_strategy,
    open_contour,
    render,
)
from palpate.render.errors import PoseError, StrategyError
from palpate.render.playback import pose_insertion
from palpate.render.playback.pose_insertion import ShiftTest, insert_into_all, insert_poses
from palpate.render.sampling.sampler import Sampler, sample_contours
from palpate.render.sampling.strategy import SamplingStrategy

CUBE = MeshObject.load("cube")


def palm_at(points):
    """Palm down at these places [m]."""
    return np.concatenate([np.asarray(points, float), np.tile(PALM_DOWN, (len(points), 1))], axis=1)


def sideways(steps, interval=1 / 90):
    """A palm inside the cube that goes sideways by so many metres from pose to pose."""
    x = np.concatenate([[0.0], np.cumsum(steps)])
    points = np.stack([x, np.full(len(x), 0.05), np.full(len(x), 0.2)], axis=1)
    return HandMotion(np.arange(len(x)) * interval, palm_at(points))


def test_a_contour_that_goes_with_the_palm_takes_the_next_power_of_two():
    """The palm's own side is the contour that moves, as far as the palm: halved until it is no more than 1 mm.

    An eighth of that is left for what lies between the points that are looked at; steps are scaled to be clear of it.
    """
    for step, count in ((0.9e-3, 0), (1.2e-3, 1), (1.9e-3, 1), (2.1e-3, 3), (7.9e-3, 7)):
        denser = insert_poses(CUBE, Palm(), sideways([step * 0.85]), closed_contour(), distance=1e-3)
        assert len(denser) - 2 == denser.inserted == count, step


def test_inserted_poses_lie_on_the_way_evenly_and_turn_along_the_shorter_arc():
    """Against scipy's slerp."""
    turn = Rotation.from_quat(PALM_DOWN)
    ends = [turn, Rotation.from_rotvec([0.3, -0.5, 0.2]) * turn]
    pose = np.array([[0, 0.03, 0.2, *ends[0].as_quat()], [0.02, 0.04, 0.22, *(-ends[1].as_quat())]])
    motion = HandMotion([0.0, 0.02], pose)
    denser = insert_poses(CUBE, Palm(), motion, closed_contour(), distance=2e-3)
    assert len(denser) > 8
    share = denser.time / 0.02
    np.testing.assert_array_equal(share[[0, -1]], [0, 1])
    assert (np.diff(share) > 0).all()
    along = pose[0, :3] + share[:, None] * (pose[1, :3] - pose[0, :3])
    np.testing.assert_allclose(denser.pose[:, :3], along, atol=1e-7)
    between = Slerp([0, 1], Rotation.concatenate(ends))(share)
    apart = (between.inv() * Rotation.from_quat(denser.pose[:, 3:])).magnitude()
    assert apart.max() < 2e-6
    np.testing.assert_array_equal(denser.pose[[0, -1]], motion.pose)  # the tracker's own stay to the bit


def test_a_gap_in_tracking_stays_a_gap_and_shorter_intervals_are_filled():
    """90 Hz, then 0.09 s, 0.15 s and 0.5 s without a pose, 20 mm each; above 0.1 s the hand is not known."""
    time = np.concatenate([np.arange(10) / 90, 0.1 + np.cumsum([0.09, 0.15, 0.5, 1 / 90])])
    x = np.array([0.0] * 10 + [0.02, 0.04, 0.06, 0.06])
    motion = HandMotion(time, palm_at(np.stack([x, 0 * x + 0.05, 0 * x + 0.2], axis=1)))
    denser = insert_poses(CUBE, Palm(), motion, closed_contour(), distance=2e-3)
    new = denser.time[~np.isin(denser.time, motion.time)]
    assert len(new) >= 9
    assert (new < 0.2).all()
    assert (new > 0.1).all()


def test_slow_poses_are_not_taken_for_missing_ones_once_others_are_closer():
    """Two poses a second: where the hand rests, poses are inserted all the same, or playing would fade after 0.1 s."""
    steps = np.concatenate([np.zeros(4), np.full(4, 0.01)])
    motion = sideways(steps, interval=0.5)
    denser = insert_poses(CUBE, Palm(), motion, closed_contour(), distance=1e-3)
    assert np.diff(denser.time).max() <= 0.1
    batch = render(CUBE, Palm(), denser, closed_contour())
    sampler = Sampler(SamplingStrategy())
    for _ in sample_contours([batch], denser.pose, denser.time, denser.duration, sampler):
        pass
    assert sampler.count.held == 0
    assert sampler.count.silent == 0


def test_what_appears_and_disappears_takes_a_bounded_number_of_poses():
    """A palm that passes through the cube's top: there is no contour above it, and a whole one below."""
    motion = HandMotion([0.0, 1 / 90], palm_at([[0, 0, 0.25], [0, 0, 0.28]]))
    assert insert_poses(CUBE, Palm(), motion, closed_contour(), distance=1e-3).inserted == 0  # silence is no step
    tube = MeshObject.load("tube")
    motion = exploration(tube.bounds, duration=10.0, rate=90.0, seed=1, model="around")
    denser = insert_poses(tube, Palm(), motion, closed_contour(), distance=2e-3)
    per_interval = np.diff(np.flatnonzero(np.isin(denser.time, motion.time)))
    assert 1 < per_interval.max() <= 2**9
    assert np.diff(denser.time).min() >= 25e-6 - 1e-12


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("update_rate", "steps", "hops"), [(10_000.0, 3, True), (10_000.0, 1, False), (40_000.0, 3, True)]
)
def test_no_step_at_a_new_pose_is_longer_than_twice_two_ordinary_ones(update_rate, steps, hops):
    """The counters, and steps of the focal points at the times of poses, by subtraction."""
    tube = MeshObject.load("tube")
    motion = exploration(tube.bounds, duration=10.0, rate=90.0, seed=1, model="around")
    ordinary = 7.0 / update_rate
    before = counted(tube, motion, update_rate)[0]
    assert before.hops["pose"] > 100
    denser = insert_poses(tube, Palm(), motion, closed_contour(), distance=steps * ordinary)
    count, position, drawn = counted(tube, denser, update_rate)
    assert count.jumps["pose"] == 0
    assert (count.hops["pose"] > 0) == hops
    assert count.hops_longest["pose"] <= 4 * ordinary
    length = np.linalg.norm(np.diff(position, axis=0), axis=1)
    length[~(drawn[1:] & drawn[:-1])] = 0
    far = np.count_nonzero(length > 4 * ordinary)
    assert far == count.jumps["polyline"] + count.jumps["order"]  # only the ways between polylines are left


def counted(thing, motion, update_rate, strategy=None):
    batch = render(thing, Palm(), motion, strategy or closed_contour())
    sampler = Sampler(SamplingStrategy(update_rate=update_rate))
    blocks = list(sample_contours([batch], motion.pose, motion.time, motion.duration, sampler))
    position = np.concatenate([block.position for block in blocks]).astype(float)
    return sampler.count, position, np.concatenate([block.intensity for block in blocks]) > 0


def lines_at(scene, pose):
    """Polylines at one pose."""
    batch = scene.contours(pose[None], 0, "cpu")[0].numpy()
    return [batch.points[a:b] for a, b in itertools.pairwise(batch.polyline_start)]


@pytest.mark.parametrize(
    ("name", "strategy", "distance", "kept"),
    [
        ("dog", "oc", 2e-3, slice(22, 27)),
        pytest.param("tube", "cc", 3e-3, slice(None), marks=pytest.mark.exhaustive),
        pytest.param("dog", "oc", 2e-3, slice(None), marks=pytest.mark.exhaustive),
    ],
)
def test_the_poses_are_those_of_each_interval_halved_alone(name, strategy, distance, kept, device):
    thing = MeshObject.load(name)
    motion = exploration(thing.bounds, duration=1.5, rate=45.0, seed=2, model="around")
    motion = HandMotion(motion.time[kept], motion.pose[kept])
    scene = Scene.of(thing, Palm(), strategy)
    time, pose = insertion_oracle.insert(lambda pose: lines_at(scene, pose), motion.time, motion.pose, distance)
    denser = insert_poses(thing, Palm(), motion, load_strategy(strategy), distance=distance, device=device)
    assert denser.inserted > 10
    np.testing.assert_array_equal(denser.time, time)
    np.testing.assert_array_equal(denser.pose, pose)


def test_motions_together_have_the_poses_of_each_alone(monkeypatch, device):
    """Also in small batches, and with two poses half a turn apart, between which both arcs are as short."""
    motions = [sideways(steps) for steps in ([4e-2, 2e-3], [], [2e-4], [2e-2] * 2)]
    pose = motions[3].pose.copy()
    pose[2, 3:] = [-pose[1, 6], pose[1, 5], -pose[1, 4], pose[1, 3]]
    motions[3] = HandMotion(motions[3].time, pose)
    alone = [insert_poses(CUBE, Palm(), motion, closed_contour(), distance=2e-2) for motion in motions]
    monkeypatch.setattr(pose_insertion, "POSES_AT_ONCE", 5)
    monkeypatch.setattr(pose_insertion, "POSES_ON_GPU", 7)
    shift_test = pose_insertion.ShiftTest(Scene.of(CUBE, Palm(), "cc"), 2e-2, device)
    start = np.cumsum([0, *map(len, motions)])
    given = [np.concatenate([getattr(motion, name) for motion in motions]) for name in ("time", "pose")]
    together = pose_insertion.insert_into_all(shift_test, *given, start)
    np.testing.assert_array_equal(np.diff(together.motion_start), [len(motion) for motion in alone])
    np.testing.assert_array_equal(together.time.numpy(), np.concatenate([motion.time for motion in alone]))
    np.testing.assert_array_equal(together.pose.numpy(), np.concatenate([motion.pose for motion in alone]))
    oracle = insertion_oracle.insert(lambda pose: lines_at(shift_test.scene, pose), motions[3].time, pose, 2e-2)
    np.testing.assert_array_equal(alone[3].pose, oracle[1])


def test_an_object_that_moves_is_followed_too():
    """A hand at rest, and a cube that goes sideways by 4 mm from pose to pose, its face with it: halved three times."""
    still_hand = HandMotion(np.arange(3) / 90, palm_at([[0, 0.05, 0.2]] * 3))
    aside = np.array([[0, 0, 0], [0, -0.004, 0], [0, -0.008, 0]])
    places = np.concatenate([CUBE.bounds.mean(axis=0) + aside, np.tile([0, 0, 0, 1.0], (3, 1))], axis=1)
    moved = HandMotion(np.arange(3) / 90, places)
    denser = insert_poses(CUBE, Palm(), still_hand, open_contour(), distance=1e-3, object_pose=moved)
    np.testing.assert_allclose(denser.time, np.arange(17) / 8 / 90)
    assert insert_poses(CUBE, Palm(), still_hand, open_contour(), distance=1e-3).inserted == 0


def test_what_has_no_poses_in_between_is_refused():
    motion = sideways([5e-3])
    rest = {"distance": 1e-3}
    for bad in (0.0, float("nan"), 1.0):
        with pytest.raises(StrategyError, match="interpolate must lie in"):
            insert_poses(CUBE, Palm(), motion, closed_contour(), distance=bad)
    with pytest.raises(PoseError, match="this motion has none"):
        insert_poses(CUBE, Palm(), HandMotion(None, motion.pose), closed_contour(), **rest)
    with pytest.raises(PoseError, match="object's motion has none"):
        insert_poses(CUBE, Palm(), motion, closed_contour(), object_pose=HandMotion(None, motion.pose), **rest)


@pytest.mark.parametrize(
    ("times", "count", "said"),
    [
        # Intervals of 11,111,111 s are halved 27 times until they are no longer than 0.1 s: 5 x 2^27 + 1 poses.
        (11111111.0 * np.arange(6), "6.711e\\+08", "times are like a file in nanoseconds; .*ns are 0.0111"),
        ([0.0, 1e300], "1.072e\\+301", "it lasts 1e\\+300 s"),  # 2^1000 + 1
        ([0.0, 1.7e308], "inf", "it lasts 1.7e\\+308 s"),
    ],
)
def test_times_that_would_take_too_many_poses_are_refused_before_any_is_made(times, count, said):
    """Counts by exact arithmetic, no pose is made: ten gigabytes would be."""
    motion = HandMotion(None, palm_at([[0, 0.05, 0.2]] * len(times)))
    object.__setattr__(motion, "time", np.array(times))  # without the warning of times in nanoseconds
    with pytest.raises(PoseError, match=f"interpolate=0.001 makes {count} poses of a motion, at most 4000000 .*{said}"):
        insert_poses(CUBE, Palm(), motion, closed_contour(), distance=1e-3)


def test_contours_that_move_far_are_refused_once_there_are_too_many_poses(monkeypatch):
    monkeypatch.setattr(pose_insertion, "POSES_MOST", 5)
    with pytest.raises(PoseError, match=r"interpolate=0\.001 makes 9 poses .* at most 5 .* a larger distance"):
        insert_poses(CUBE, Palm(), sideways([7.9e-3 * 0.85]), closed_contour(), distance=1e-3)


@pytest.mark.parametrize("point_limit", [1, 40, 150])
def test_no_more_contours_are_rendered_at_once_than_fit(point_limit, monkeypatch, device):
    motion = exploration("tube", duration=0.4, seed=3)
    scene, start, rendered = Scene.of(MeshObject.load("tube"), Palm(), closed_contour()), np.array([0, len(motion)]), []
    contours = Scene.contours

    def noted(self, pose, first, device, **options):
        batch, removed = contours(self, pose, first, device, **options)
        rendered.append((len(pose), batch.point_count))
        return batch, removed

    monkeypatch.setattr(Scene, "contours", noted)
    whole = insert_into_all(ShiftTest(scene, 2e-3, device), motion.time, motion.pose, start)
    assert whole.motion_start[-1] > len(motion) + 5
    assert max(points for _, points in rendered) > point_limit
    rendered.clear()
    limited = ShiftTest(scene, 2e-3, device, point_limit=point_limit)
    parts = insert_into_all(limited, motion.time, motion.pose, start)
    np.testing.assert_array_equal(whole.time.numpy(), parts.time.numpy())
    np.testing.assert_array_equal(whole.pose.numpy(), parts.pose.numpy())
    assert all(count == 2 or points <= point_limit for count, points in rendered)
