"""Points that frames of several aim at, and their pressure ratios, against a loop over frames."""

import numpy as np
import pytest
import warp as wp

from palpate.kernels.driving.weigh import TARGET_STEPS, FocalBox, hold_points

SIZE = 4


def box_of(*, force):
    box = FocalBox()
    box.turn, box.middle = wp.mat33d(np.eye(3)), wp.vec3d()
    box.lateral, box.low, box.high = 0.1, 0.05, 0.5
    box.intensity_most, box.level_most, box.is_force = 1.0, 0.8, int(force)
    return box


def held_by_loop(points, intensity, held, *, force):
    """The same, frame by frame in float64."""
    aim, target = (np.array(own, float) for own in held)
    out = []
    for frame, strengths in zip(points, intensity, strict=True):
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
    arrays = wp.array(points, dtype=wp.vec3, device=device), wp.array(intensity, device=device)
    start = wp.array(held[0], dtype=wp.vec3, device=device), wp.array(held[1], device=device)
    found = hold_points(*arrays, box_of(force=force), start, size=SIZE)
    aim, target, level = held_by_loop(points, intensity, held, force=force)
    np.testing.assert_array_equal(found.point.numpy()[:, :3], aim.astype(np.float32))
    np.testing.assert_array_equal(found.point.numpy()[:, 3], found.point.numpy()[:, 0])
    np.testing.assert_allclose(found.target.numpy()[:, :3], target, atol=1 / TARGET_STEPS)
    assert (found.target.numpy()[:, 3] == 0).all()
    np.testing.assert_allclose(found.level.numpy(), level, rtol=1e-6)
    with np.errstate(invalid="ignore"):
        near = (np.abs(points[..., :2]) <= np.float32(0.1)).all(axis=2) & (points[..., 2] >= np.float32(0.05))
        usable = near & (points[..., 2] <= 0.5) & (intensity >= 0) & (intensity <= 1)
    assert found.refused == np.count_nonzero(~usable & (intensity != 0)) > 0
