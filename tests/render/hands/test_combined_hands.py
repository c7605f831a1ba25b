"""Several hands as one: each draws what it would draw alone, at the times it is there."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate.datasets.motions.hand_motion import HandMotion
from palpate.render import MeshObject, Palm, closed_contour, open_contour, render
from palpate.render.errors import PoseError, StrategyError
from palpate.render.hands.combined_hands import together
from palpate.render.hands.mesh_hand import MeshHand
from palpate.render.hands.plane_hand import HandPatch, PlaneHand, flat_hand


def motion_of(count, seed, *, rate=90.0, start=0.0, time=True):
    """A palm that turns and drifts smoothly around the objects."""
    rng = np.random.default_rng(seed)
    t = np.arange(count) / rate
    axis = rng.normal(size=3)
    turn = Rotation.from_rotvec((0.4 + t)[:, None] * axis) * Rotation.random(random_state=seed)
    position = rng.uniform(-0.02, 0.02, 3) + np.array([0, 0, 0.2]) + 0.01 * np.sin(t)[:, None] * rng.normal(size=3)
    return HandMotion(t + start if time else None, np.hstack([position, turn.as_quat()]))


def test_two_hands_of_the_same_times_draw_what_each_draws_alone():
    thing, one, two = MeshObject.load("tube"), motion_of(40, 1), motion_of(40, 2)
    fingers = flat_hand(is_left=True)
    hand, motion = together([(Palm(0.08, 0.09), one), (fingers, two)], names=("right", "left"))
    assert motion is one
    assert hand.patch_count == 16
    assert [patch.name for patch in hand.patches[:3]] == ["right-palm", "left-palm", "left-index-proximal"]
    assert hand.joints[0].patch.startswith("left-")
    both = render(thing, hand, motion, open_contour())
    alone = [render(thing, h, m, open_contour()) for h, m in ((Palm(0.08, 0.09), one), (fingers, two))]
    np.testing.assert_allclose(both.length(), alone[0].length() + alone[1].length(), atol=2e-5)
    line_pose = np.repeat(np.arange(40), np.diff(both.pose_start))
    first = np.concatenate(
        [both.polylines_of(i)[k] for i in range(40) for k in np.flatnonzero(both.polyline_patch[line_pose == i] == 0)]
    )
    assert first.tobytes() == alone[0].points.tobytes()  # the first hand is where it is, to the bit
    assert (alone[1].length() > 0).sum() > 20
    closed = render(thing, hand, motion, closed_contour())
    np.testing.assert_allclose(
        closed.length(),
        sum(render(thing, h, m, closed_contour()).length() for h, m in ((Palm(0.08, 0.09), one), (fingers, two))),
        atol=3e-5,
    )


def test_one_hand_together_is_itself():
    motion = motion_of(30, 3)
    hand, same = together([(Palm(), motion)])
    assert hand.patches[0].name == "1-palm"
    thing = MeshObject.load("cube")
    one, two = render(thing, Palm(), motion, closed_contour()), render(thing, hand, same, closed_contour())
    for name, array in one.arrays().items():
        assert array.tobytes() == two.arrays()[name].tobytes()


def test_another_clock_is_resampled_and_outside_it_there_is_no_hand():
    base = motion_of(91, 4)
    coarse = motion_of(16, 4, rate=30.0)
    late = HandMotion(coarse.time + 0.2, coarse.pose)  # 0.2..0.7 s of the same clock
    assert late.offset == pytest.approx(0.2)
    hand, _ = together([(Palm(), base), (Palm(), late)])
    there = (base.time >= 0.2 - 1e-9) & (base.time <= 0.7 + 1e-9)
    np.testing.assert_array_equal(hand.absent[:, 1], ~there)
    assert not hand.absent[:, 0].any()
    began, _ = together([(Palm(), base), (Palm(), late)], same_clock=False)
    np.testing.assert_array_equal(began.absent[:, 1], base.time > 0.5 + 1e-9)
    section = began.section_poses(base.pose)[:46, 1]  # the same motion, sampled three times as densely
    np.testing.assert_allclose(section[:, :3], base.pose[:46, :3], atol=2e-5)
    turn = Rotation.from_quat(section[:, 3:]).inv() * Rotation.from_quat(base.pose[:46, 3:])
    assert turn.magnitude().max() < 1e-4
    np.testing.assert_allclose(section[::3], coarse.pose, atol=1e-6)


def test_no_hand_is_invented_in_a_gap():
    base = motion_of(90, 5)
    whole = motion_of(90, 6)
    kept = np.r_[0:30, 60:90]
    gappy = HandMotion(whole.time[kept], whole.pose[kept])
    hand, _ = together([(Palm(), base), (Palm(), gappy)])
    np.testing.assert_array_equal(np.flatnonzero(hand.absent[:, 1]), np.arange(30, 60))
    bridged, _ = together([(Palm(), base), (Palm(), gappy)], gap=0.5)
    assert not bridged.absent.any()
    slow = motion_of(6, 7, rate=5.0)  # farther apart than a gap, but always so
    assert not together([(Palm(), base), (Palm(), slow)])[0].absent[:, 1].any()


def skin(width, length):
    """A flat palm of two triangles, facing -Y."""
    x, z = width / 2, length / 2
    vertices = np.array([[-x, 0, z], [x, 0, z], [x, 0, -z], [-x, 0, -z]], np.float32)
    return MeshHand(vertices, np.array([[0, 2, 1], [0, 3, 2]]), name="flat")


def test_two_hand_meshes_lie_where_each_does():
    base, motion = motion_of(10, 16, rate=30.0), motion_of(40, 17, rate=90.0)
    one, two = skin(0.08, 0.1), skin(0.06, 0.07)
    moving = MeshHand(two.vertices * np.linspace(1, 1.2, 40)[:, None, None], two.faces)
    hand, same = together([(one, base), (moving, motion)])
    assert same is base
    assert hand.pose_count == 10
    assert hand.vertices.shape == (10, 8, 3)
    assert hand.glabrous.tolist() == [True] * 4
    for k, (own, at) in enumerate(
        ((np.repeat(one.vertices, 10, axis=0), base.pose), (moving.vertices[::3], motion.pose[::3]))
    ):
        part = hand.vertices[:, 4 * k : 4 * k + 4].astype(np.float64)
        for i in range(10):
            mine = base.pose[i, :3] + Rotation.from_quat(base.pose[i, 3:]).apply(part[i])
            np.testing.assert_allclose(mine, at[i, :3] + Rotation.from_quat(at[i, 3:]).apply(own[i]), atol=1e-6)
    with pytest.raises(PoseError, match="hand 2 is missing in 5 of 10 poses"):
        together([(one, base), (two, motion_of(15, 17, rate=90.0))])
    with pytest.raises(StrategyError, match="hand meshes alone, not MeshHand"):
        together([(one, base), (Palm(), motion)])


def test_what_does_not_go_together_is_refused():
    timed, untimed = motion_of(7, 12), motion_of(7, 13, time=False)
    for hands, options, error, said in [
        ([], {}, StrategyError, "one hand at least"),
        ([(Palm(), timed)], {"names": ("a", "b")}, StrategyError, "a name of its own for each of 1 hands"),
        ([(Palm(), timed)] * 2, {"names": ("a", "a")}, StrategyError, "name of its own"),
        ([(Palm(), timed), (Palm(), untimed)], {}, PoseError, "hand 2: .* 7 poses without time, .* 7 poses over time"),
        ([(Palm(), untimed), (Palm(), motion_of(8, 14, time=False))], {}, PoseError, "8 poses without time"),
        (
            [(Palm(), timed), (Palm(), motion_of(7, 15, start=9.0))],
            {},
            PoseError,
            "at 9.00..9.07 s, .* 0.00..0.07 s: they never meet",
        ),
        ([(object(), timed)], {}, StrategyError, "hand meshes alone, not object"),
        (
            [
                (Palm(), timed),
                (PlaneHand((HandPatch("a", 0.1, 0.1),), (), np.tile([0, 0, 0, 0, 0, 0, 1.0], (3, 1, 1))), timed),
            ],
            {},
            PoseError,
            "hand 2 is articulated for 3 poses, but its motion has 7",
        ),
    ]:
        with pytest.raises(error, match=said):
            together(hands, **options)
