"""Points that frames of several aim at, and their pressure ratios, against a loop over frames."""

import numpy as np
import pytest
import warp as wp

from palpate.kernels.driving.hold import TARGET_STEPS, FocalBox, IntensityRule, hold_points

SIZE = 4
REST = (0.0, 0.0, 0.2)


def box_at(x=0.0):
    box = FocalBox()
    box.turn, box.middle = wp.mat33d(np.eye(3)), wp.vec3d(x, 0.0, 0.0)
    box.lateral, box.low, box.high = 0.1, 0.05, 0.5
    return box


def rule_of(*, force):
    rule = IntensityRule()
    rule.intensity_most, rule.amplitude_most, rule.is_force = 1.0, 0.8, int(force)
    return rule


def hold(points, intensity, held, device, *, force=False, boxes=None, rest_start=()):
    return hold_points(
        wp.array(points, dtype=wp.vec3, device=device),
        wp.array(intensity, dtype=wp.float32, device=device),
        wp.array(boxes or [box_at()], dtype=FocalBox, device=device),
        rule_of(force=force),
        (wp.array(held[0], dtype=wp.vec3, device=device), wp.array(held[1], dtype=wp.float32, device=device)),
        size=SIZE,
        rest_start=wp.array(np.array(rest_start, np.int32), dtype=wp.int32, device=device),
        rest=REST,
    )


def held_by_loop(points, intensity, held, *, force=False, rest_start=()):
    """The same, frame by frame in float64."""
    aim, target = (np.array(own, float) for own in held)
    out = []
    for number, (frame, strengths) in enumerate(zip(points, intensity, strict=True)):
        if number in rest_start:
            aim[:], target[:] = REST, 1
        pressure = np.zeros(len(aim))
        for m, (x, value) in enumerate(zip(frame, strengths, strict=True)):
            if (np.abs(x[:2]) <= np.float32(0.1)).all() and np.float32(0.05) <= x[2] <= 0.5 and 0 <= value <= 1:
                aim[m] = x
                pressure[m] = np.sqrt(value) if force else value
        if pressure.max() > 0:
            target = pressure / pressure.max()
        out.append((aim.copy(), target.copy(), 0.8 * pressure.max()))
    return [np.array(column) for column in zip(*out, strict=True)]


def random_frames(rng, count):
    points = np.stack([*rng.uniform(-0.13, 0.13, (2, count, 3)), rng.uniform(0.03, 0.55, (count, 3))], axis=-1)
    intensity = rng.uniform(0, 1, (count, 3))
    odd = rng.random((count, 3)) < 0.15
    intensity[odd] = rng.choice([0, -1, 2, np.nan, np.inf], odd.sum())
    points[rng.random((count, 3)) < 0.05] = np.nan
    for first in (0, count // 2):  # silent frames
        intensity[first : first + 5] = 0
    return points.astype(np.float32), intensity.astype(np.float32)


@pytest.mark.parametrize("force", [False, True])
def test_points_and_ratios_are_held_as_a_loop_holds_them(force, device, rng):
    points, intensity = random_frames(rng, 300)
    held = rng.uniform(0.1, 0.2, (3, 3)).astype(np.float32), np.float32([1, 0.5, 0])
    starts = [7, 100, 148, 149, 299]  # within silence, too
    found = hold(points, intensity, held, device, force=force, rest_start=starts)
    aim, target, level = held_by_loop(points, intensity, held, force=force, rest_start=starts)
    np.testing.assert_array_equal(found.point.numpy()[:, :3], aim.astype(np.float32))
    np.testing.assert_array_equal(found.point.numpy()[:, 3], found.point.numpy()[:, 0])
    np.testing.assert_allclose(found.target.numpy()[:, :3], target, atol=1 / TARGET_STEPS)
    assert (found.target.numpy()[:, 3] == 0).all()
    np.testing.assert_allclose(found.amplitude.numpy(), level, rtol=1e-6)
    with np.errstate(invalid="ignore"):
        near = (np.abs(points[..., :2]) <= np.float32(0.1)).all(axis=2) & (points[..., 2] >= np.float32(0.05))
        usable = near & (points[..., 2] <= 0.5) & (intensity >= 0) & (intensity <= 1)
    assert found.refused == np.count_nonzero(~usable & (intensity != 0)) > 0


def test_points_out_of_reach_and_odd_intensities_are_silent_and_counted(device):
    good = (0.1, -0.1, 0.5)
    cases = [
        (good, 1.0, True), ((0.1001, 0, 0.2), 1.0, False), ((0, -0.1001, 0.2), 1.0, False),
        ((0, 0, 0.0499), 1.0, False), ((0, 0, 0.5001), 1.0, False),
        ((np.nan, 0, 0.2), 1.0, False), (good, 1.001, False), (good, -0.1, False),
        (good, np.nan, False), (good, np.inf, False), (good, 0.0, None), ((9, 9, 9), 0.0, None),
    ]  # fmt: skip
    points, intensity, drawn = zip(*cases, strict=True)
    held = np.float32([REST]), np.ones(1, np.float32)
    found = hold(np.float32(points)[:, None], np.float32(intensity)[:, None], held, device)
    assert (found.amplitude.numpy() > 0).tolist() == [one is True for one in drawn]
    assert found.refused == sum(one is False for one in drawn)


def test_a_point_is_in_reach_if_one_of_the_arrays_reaches_it(device):
    points = np.float32([[[0.0, 0, 0.2]], [[0.15, 0, 0.2]], [[0.35, 0, 0.2]], [[-0.15, 0, 0.2]]])
    held = np.float32([REST]), np.ones(1, np.float32)
    found = hold(points, np.ones((4, 1), np.float32), held, device, boxes=[box_at(), box_at(0.2)])
    assert (found.amplitude.numpy() > 0).tolist() == [True, True, False, False]
    assert found.refused == 2
    np.testing.assert_array_equal(found.point.numpy()[:, 0, 0], np.float32([0, 0.15, 0.15, 0.15]))
