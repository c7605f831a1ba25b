"""A volume in pages and bricks: the values of the plain one, and nothing settled that is not so."""

import numpy as np
import pytest
import warp as wp

from palpate.kernels.fields.bricked_grid import (
    BRICK,
    Bricked,
    brick_reach,
    bricked_ball,
    bricked_field,
    bricked_inside,
    bricked_root,
    bricked_value,
)
from palpate.kernels.fields.dense_grid import Dense, dense_field, dense_value, pad_outside
from palpate.kernels.fields.field import root_of
from palpate.kernels.patch import EXACT

wp.set_module_options(EXACT)

AFFINES = {
    "plain": np.diag([0.002, 0.002, 0.002, 1.0]),
    "flat": np.diag([0.001, 0.004, 0.0023, 1.0]),
    "sheared": np.array([[0.002, 0.0007, 0, 0.01], [0, -0.002, 0.0004, 0.05], [0.0003, 0, 0.003, -0.02], [0, 0, 0, 1]]),
}


def blobs(shape, rng, level=0.4):
    """Smooth values with several pieces and cavities."""
    at = np.stack(np.meshgrid(*[np.linspace(0, 1, n) for n in shape], indexing="ij"), axis=-1)
    total = sum(np.sin(at @ rng.normal(0, 9, 3) + rng.uniform(0, 6)) for _ in range(4))
    return (total + level).astype(np.float32)


ROOT = root_of(dense_value)


@wp.kernel(module="unique", module_options=EXACT)
def _ask(
    dense: Dense,
    data: Bricked,
    x: wp.array[wp.vec3d],
    radius: wp.array[wp.float64],
    values: wp.array2d[wp.float64],
    sides: wp.array2d[int],
):
    i = wp.tid()
    values[i, 0] = dense_value(dense, x[i])
    values[i, 1] = bricked_value(data, x[i])
    sides[i, 0] = bricked_ball(data, x[i], radius[i])
    sides[i, 1] = int(bricked_inside(data, x[i]))


@wp.kernel(module="unique", module_options=EXACT)
def _cross(dense: Dense, data: Bricked, a: wp.array[wp.vec3d], b: wp.array[wp.vec3d], out: wp.array2d[wp.vec3d]):
    i = wp.tid()
    out[i, 0] = ROOT(dense, a[i], b[i])
    out[i, 1] = bricked_root(data, a[i], b[i])
    out[i, 2] = bricked_root(data, b[i], a[i])


def ask(padded, affine, x, radius, device):
    fields = [make(padded, affine, device).data for make in (dense_field, bricked_field)]
    values = wp.empty((len(x), 2), dtype=wp.float64, device=device)
    sides = wp.empty((len(x), 2), dtype=int, device=device)
    inputs = [*fields, wp.array(x, dtype=wp.vec3d, device=device), wp.array(radius, dtype=wp.float64, device=device)]
    wp.launch(_ask, len(x), inputs=inputs, outputs=[values, sides], device=device)
    return values.numpy(), sides.numpy()


@pytest.mark.exhaustive
@pytest.mark.parametrize("affine", AFFINES)
@pytest.mark.parametrize("shape", [(1, 1, 1), (7, 8, 15), (30, 17, 33)])
def test_values_are_those_of_the_plain_volume_to_the_bit(affine, shape, device, rng):
    padded = pad_outside(blobs(shape, rng))
    affine = AFFINES[affine]
    x = rng.uniform(-4, np.array(shape) + 3, (3000, 3)) @ affine[:3, :3].T + affine[:3, 3]
    values, sides = ask(padded, affine, x, np.zeros(len(x)), device)
    np.testing.assert_array_equal(values[:, 0], values[:, 1])
    np.testing.assert_array_equal(sides[:, 1], values[:, 0] < 0)


@pytest.mark.exhaustive
@pytest.mark.parametrize("affine", AFFINES)
def test_a_ball_that_is_settled_has_one_side_only(affine, device, rng):
    affine = AFFINES[affine]
    shape = (40, 37, 45)
    padded = pad_outside(blobs(shape, rng, level=-0.5))
    x = rng.uniform(-6, np.array(shape) + 5, (1500, 3)) @ affine[:3, :3].T + affine[:3, 3]
    radius = rng.uniform(0, 0.012, len(x)) ** 2 / 0.012
    sides = ask(padded, affine, x, radius, device)[1][:, 0]
    assert (np.bincount(sides + 1, minlength=3) > 20).all()  # inside, unknown, outside
    near = rng.normal(size=(1500, 60, 3))
    near *= (radius[:, None] * rng.uniform(0, 1, (1500, 60)) ** 0.2 / np.linalg.norm(near, axis=2))[..., None]
    rows = np.linalg.inv(affine[:3, :3])
    rows /= np.linalg.norm(rows, axis=1, keepdims=True)  # where a ball reaches farthest along an index
    near[:, :6] = radius[:, None, None] * np.concatenate([rows, -rows])
    around = (x[:, None] + near).reshape(-1, 3)
    inside = ask(padded, affine, around, np.zeros(len(around)), device)[0][:, 0].reshape(1500, 60) < 0
    assert inside[sides == -1].all()
    assert not inside[sides == 1].any()


@pytest.mark.exhaustive
def test_a_reach_is_how_far_a_side_goes_on(rng):
    padded = pad_outside(blobs((21, 18, 26), rng))
    reach = brick_reach(padded)
    bricks = {}
    for place in np.ndindex(reach.shape):
        part = padded[tuple(slice(BRICK * p, BRICK * p + BRICK + 1) for p in place)] < 0
        bricks[place] = -1 if part.all() else int(not part.any())
    for place, side in bricks.items():
        others = [np.abs(np.subtract(place, p)).max() for p, s in bricks.items() if s != side]
        assert reach[place] == side * min(others, default=100)


@pytest.mark.exhaustive
def test_roots_are_on_the_surface_from_either_end(device, rng):
    affine, padded = AFFINES["sheared"], pad_outside(blobs((30, 17, 33), rng))
    ends = rng.uniform(0, [30, 17, 33], (4000, 3)) @ affine[:3, :3].T + affine[:3, 3]
    others = ends + rng.normal(0, 0.002, ends.shape)
    inside = [ask(padded, affine, x, np.zeros(len(x)), device)[1][:, 1] for x in (ends, others)]
    cut = inside[0] != inside[1]
    a, b = (wp.array(x[cut], dtype=wp.vec3d, device=device) for x in (ends, others))
    out = wp.empty((int(cut.sum()), 3), dtype=wp.vec3d, device=device)
    fields = [make(padded, affine, device).data for make in (dense_field, bricked_field)]
    wp.launch(_cross, out.shape[0], inputs=[*fields, a, b], outputs=[out], device=device)
    roots = out.numpy()
    assert len(roots) > 100
    np.testing.assert_array_equal(roots[:, 1], roots[:, 2])
    assert np.median(np.linalg.norm(roots[:, 0] - roots[:, 1], axis=1)) < 1e-9
    on = ask(padded, affine, roots[:, 1], np.zeros(len(roots)), device)[0][:, 0]
    assert np.abs(on).max() < 2e-4 * np.abs(padded).max()  # of values that change by about 1 in 5 mm
