"""A dense volume as a field against interpolation by hand: any grid, its border, beyond it, roots, both devices."""

import itertools

import numpy as np
import pytest
import warp as wp
from field_points import roots_between, values_at

from palpate.kernels.fields.dense_grid import dense_field, pad_outside

TURNED = np.array([[0.0, -0.8, 0.6], [1.0, 0.0, 0.0], [0.0, 0.6, 0.8]])
GRIDS = {
    "even": np.diag([0.002, 0.002, 0.002]),
    "anisotropic": np.diag([0.001, 0.004, 0.0025]),
    "turned": TURNED * [0.001, 0.004, 0.0025],
    "mirrored": TURNED * [-0.001, 0.004, 0.0025],
    "sheared": np.diag([0.002, 0.002, 0.003]) + np.triu(np.full((3, 3), 0.0005), 1),
}


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
@pytest.mark.parametrize("grid", GRIDS)
def test_values_are_those_of_interpolation_by_hand(grid, rng, device):
    values = rng.normal(size=(4, 6, 5)).astype(np.float32)
    affine = affine_with(GRIDS[grid])
    index = np.concatenate([rng.uniform(-3, 9, (400, 3)), rng.integers(-1, 7, (100, 3))])
    field = dense_field(pad_outside(values), affine, device)
    found = values_at(field, placed(affine, index), device)
    np.testing.assert_allclose(found, interpolated(values, index), atol=1e-9)


def test_a_gpu_gives_the_same_bits(rng, device):
    values = rng.normal(size=(9, 8, 7)).astype(np.float32)
    affine = affine_with(GRIDS["turned"])
    points = placed(affine, rng.uniform(-2, 10, (5000, 3)))
    one, two = (dense_field(pad_outside(values), affine, on) for on in ("cpu", device))
    np.testing.assert_array_equal(values_at(one, points, "cpu"), values_at(two, points, device))


def test_the_surface_closes_half_a_voxel_beyond_the_border(device):
    affine = affine_with(GRIDS["anisotropic"])
    field = dense_field(pad_outside(np.full((3, 3, 3), -1.0, np.float32)), affine, device)
    for axis in range(3):
        beyond = np.tile(1.0, (4, 3))
        beyond[:, axis] = [-0.51, -0.49, 2.49, 2.51]
        np.testing.assert_array_equal(values_at(field, placed(affine, beyond), device) < 0, [False, True, True, False])


def test_far_away_is_outside_and_finite(rng, device):
    field = dense_field(pad_outside(np.full((2, 2, 2), -3.0, np.float32)), affine_with(GRIDS["turned"]), device)
    found = values_at(field, rng.normal(size=(50, 3)) * 1e7, device)
    assert np.isfinite(found).all()
    assert (found > 0).all()


def test_two_values_below_zero_never_blend_to_zero(rng, device):
    values = -(np.float32(1e-30) ** rng.uniform(0, 1, (5, 5, 5))).astype(np.float32)
    affine = affine_with(GRIDS["even"])
    field = dense_field(pad_outside(values), affine, device)
    assert (values_at(field, placed(affine, rng.uniform(0, 4, (500, 3))), device) < 0).all()


@pytest.mark.exhaustive
def test_roots_lie_on_the_surface_whichever_end_comes_first(rng, device):
    values = rng.normal(size=(6, 6, 6)).astype(np.float32)
    affine = affine_with(GRIDS["sheared"])
    field = dense_field(pad_outside(values), affine, device)
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
    field = dense_field(pad_outside(values), affine, device)
    assert (values_at(field, placed(affine, [[x, 0.5, 0.5] for x in (1, 4, 7)]), device) > 0).all()
    root = roots_between(field, placed(affine, [[0, 0.5, 0.5]]), placed(affine, [[7, 0.5, 0.5]]), device)
    np.testing.assert_allclose(root, placed(affine, [[1, 0.5, 0.5]]), atol=1e-6)


def test_what_is_no_volume_is_refused():
    with pytest.raises(ValueError, match=r"\(3, 0, 2\)"):
        pad_outside(np.zeros((3, 0, 2), np.float32))
    assert wp.types.type_size_in_bytes(wp.float32) * pad_outside(np.ones((1, 1, 1), np.float32)).size == 108
