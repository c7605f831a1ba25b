"""A volume as a field against interpolation by hand: any grid, its border, beyond it, roots, balls, both devices."""

import itertools

import numpy as np
import pytest
import warp as wp
from field_points import roots_between, values_at

from palpate.kernels.fields.bricked_grid import (
    BRICK,
    Bricked,
    brick_reach,
    bricked_ball,
    bricked_field,
    bricked_inside,
    pad_outside,
)
from palpate.kernels.patch import EXACT

wp.set_module_options(EXACT)

TURNED = np.array([[0.0, -0.8, 0.6], [1.0, 0.0, 0.0], [0.0, 0.6, 0.8]])
GRIDS = {
    "even": np.diag([0.002, 0.002, 0.002]),
    "anisotropic": np.diag([0.001, 0.004, 0.0025]),
    "turned": TURNED * [0.001, 0.004, 0.0025],
    "mirrored": TURNED * [-0.001, 0.004, 0.0025],
    "sheared": np.diag([0.002, 0.002, 0.003]) + np.triu(np.full((3, 3), 0.0005), 1),
}


@wp.kernel(module="unique", module_options=EXACT)
def _ask(data: Bricked, x: wp.array[wp.vec3d], radius: wp.array[wp.float64], sides: wp.array2d[int]):
    i = wp.tid()
    sides[i, 0] = bricked_ball(data, x[i], radius[i])
    sides[i, 1] = int(bricked_inside(data, x[i]))


def sides_of(field, x, radius, device):
    """`Field.ball` and `Field.inside` at points, int, shape [point, 2]."""
    sides = wp.empty((len(x), 2), dtype=int, device=device)
    inputs = [field.data, wp.array(x, dtype=wp.vec3d, device=device), wp.array(radius, dtype=wp.float64, device=device)]
    wp.launch(_ask, len(x), inputs=inputs, outputs=[sides], device=device)
    return sides.numpy()


def blobs(shape, rng, level=0.4):
    """Smooth values with several pieces and cavities."""
    at = np.stack(np.meshgrid(*[np.linspace(0, 1, n) for n in shape], indexing="ij"), axis=-1)
    total = sum(np.sin(at @ rng.normal(0, 9, 3) + rng.uniform(0, 6)) for _ in range(4))
    return (total + level).astype(np.float32)


def affine_with(matrix):
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = matrix, [0.03, -0.02, 0.2]
    return out


def placed(affine, index):
    return np.asarray(index, float) @ affine[:3, :3].T + affine[:3, 3]


def interpolated(values, index):
    """Trilinear, one point at a time, indices clamped to a layer around the volume that is outside (the oracle)."""
    out = []
    last = np.array(values.shape) - 1

    def at(corner):
        inside = np.clip(corner, 0, last)
        value = float(values[tuple(inside)])
        return abs(value) if (inside != corner).any() else value

    for x in np.clip(index, -1.0, last + 1.0):
        base = np.minimum(np.floor(x).astype(int), last)
        t = x - base
        weights = [(1 - t) if step == 0 else t for step in (0, 1)]
        out.append(
            sum(
                np.prod([weights[s][axis] for axis, s in enumerate(steps)]) * at(base + steps)
                for steps in itertools.product((0, 1), repeat=3)
            )
        )
    return np.array(out)


@pytest.mark.exhaustive
@pytest.mark.parametrize(("grid", "shape"), [*((grid, (4, 6, 5)) for grid in GRIDS), ("turned", (30, 17, 33))])
def test_values_are_those_of_interpolation_by_hand(grid, shape, rng, device):
    values = rng.normal(size=shape).astype(np.float32)
    affine = affine_with(GRIDS[grid])
    index = np.concatenate([rng.uniform(-3, np.array(shape) + 4, (400, 3)), rng.integers(-1, 7, (100, 3))])
    field = bricked_field(pad_outside(values), affine, device)
    found = values_at(field, placed(affine, index), device)
    np.testing.assert_allclose(found, interpolated(values, index), atol=1e-9)
    inside = sides_of(field, placed(affine, index), np.zeros(len(index)), device)[:, 1]
    np.testing.assert_array_equal(inside > 0, found < 0)


def test_a_gpu_gives_the_same_bits(rng, device):
    values = rng.normal(size=(9, 8, 7)).astype(np.float32)
    affine = affine_with(GRIDS["turned"])
    points = placed(affine, rng.uniform(-2, 10, (5000, 3)))
    one, two = (bricked_field(pad_outside(values), affine, on) for on in ("cpu", device))
    np.testing.assert_array_equal(values_at(one, points, "cpu"), values_at(two, points, device))


def test_the_surface_closes_half_a_voxel_beyond_the_border(device):
    affine = affine_with(GRIDS["anisotropic"])
    field = bricked_field(pad_outside(np.full((3, 3, 3), -1.0, np.float32)), affine, device)
    for axis in range(3):
        beyond = np.tile(1.0, (4, 3))
        beyond[:, axis] = [-0.51, -0.49, 2.49, 2.51]
        np.testing.assert_array_equal(values_at(field, placed(affine, beyond), device) < 0, [False, True, True, False])


def test_two_values_below_zero_never_blend_to_zero(rng, device):
    values = -(np.float32(1e-30) ** rng.uniform(0, 1, (5, 5, 5))).astype(np.float32)
    affine = affine_with(GRIDS["even"])
    field = bricked_field(pad_outside(values), affine, device)
    assert (values_at(field, placed(affine, rng.uniform(0, 4, (500, 3))), device) < 0).all()


@pytest.mark.exhaustive
def test_roots_lie_on_the_surface_whichever_end_comes_first(rng, device):
    values = rng.normal(size=(6, 6, 6)).astype(np.float32)
    affine = affine_with(GRIDS["sheared"])
    field = bricked_field(pad_outside(values), affine, device)
    points = placed(affine, rng.uniform(0, 5, (2000, 3)))
    inside = values_at(field, points, device) < 0
    count = min(inside.sum(), (~inside).sum())
    one, two = points[inside][:count], points[~inside][:count]
    roots = roots_between(field, one, two, device)
    np.testing.assert_array_equal(roots, roots_between(field, two, one, device))
    assert np.abs(values_at(field, roots, device)).max() < 1e-6


def test_a_stretch_of_zeros_is_outside_to_its_inner_end(device):
    values = np.zeros((8, 2, 2), np.float32)
    values[0] = -1.0
    affine = affine_with(GRIDS["even"])
    field = bricked_field(pad_outside(values), affine, device)
    assert (values_at(field, placed(affine, [[x, 0.5, 0.5] for x in (1, 4, 7)]), device) > 0).all()
    root = roots_between(field, placed(affine, [[0, 0.5, 0.5]]), placed(affine, [[7, 0.5, 0.5]]), device)
    np.testing.assert_allclose(root, placed(affine, [[1, 0.5, 0.5]]), atol=1e-6)


def test_what_is_no_volume_is_refused():
    with pytest.raises(ValueError, match=r"\(3, 0, 2\)"):
        pad_outside(np.zeros((3, 0, 2), np.float32))
    assert wp.types.type_size_in_bytes(wp.float32) * pad_outside(np.ones((1, 1, 1), np.float32)).size == 108


@pytest.mark.exhaustive
@pytest.mark.parametrize("grid", ["even", "anisotropic", "sheared"])
def test_a_ball_that_is_settled_has_one_side_only(grid, device, rng):
    affine, shape = affine_with(GRIDS[grid]), (40, 37, 45)
    field = bricked_field(pad_outside(blobs(shape, rng, level=-0.5)), affine, device)
    x = placed(affine, rng.uniform(-6, np.array(shape) + 5, (1500, 3)))
    radius = rng.uniform(0, 0.012, len(x)) ** 2 / 0.012
    sides = sides_of(field, x, radius, device)[:, 0]
    assert (np.bincount(sides + 1, minlength=3) > 20).all()  # inside, unknown, outside
    near = rng.normal(size=(1500, 60, 3))
    near *= (radius[:, None] * rng.uniform(0, 1, (1500, 60)) ** 0.2 / np.linalg.norm(near, axis=2))[..., None]
    rows = np.linalg.inv(affine[:3, :3])
    rows /= np.linalg.norm(rows, axis=1, keepdims=True)  # where a ball reaches farthest along an index
    near[:, :6] = radius[:, None, None] * np.concatenate([rows, -rows])
    inside = values_at(field, (x[:, None] + near).reshape(-1, 3), device).reshape(1500, 60) < 0
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
