"""Sides of planes and lines against determinants of fractions, which have no rounding."""

from fractions import Fraction

import numpy as np
import pytest
import warp as wp

from palpate.kernels.patch import EXACT
from palpate.kernels.solids.orientation import line_side, plane_side

wp.set_module_options(EXACT | {"max_unroll": 1})
COUNT = 400  # a family of cases; a fraction's determinant takes some 30 us


@wp.kernel
def _ask_planes(
    # In:
    corner: wp.array2d[wp.vec3d],  # four points, shape [case, 4]
    # Out:
    side: wp.array[wp.int32],
):
    """Ask which side of the plane through three points the fourth lies on."""
    k = wp.tid()
    side[k] = plane_side(corner[k, 0], corner[k, 1], corner[k, 2], corner[k, 3])


@wp.kernel
def _ask_lines(
    # In:
    corner: wp.array2d[wp.vec2d],  # three points, shape [case, 3]
    # Out:
    side: wp.array[wp.int32],
):
    """Ask which side of the line through two points the third lies on."""
    k = wp.tid()
    side[k] = line_side(corner[k, 0], corner[k, 1], corner[k, 2])


def asked(points, device):
    """Answers of the kernels; points: float64, shape [case, 4, 3] or [case, 3, 2]."""
    out = wp.zeros(len(points), dtype=wp.int32, device=device)
    kernel, dtype = (_ask_planes, wp.vec3d) if points.shape[1:] == (4, 3) else (_ask_lines, wp.vec2d)
    wp.launch(kernel, len(points), inputs=[wp.array(points, dtype=dtype, device=device)], outputs=[out], device=device)
    return out.numpy()


def determinant_sign(points):
    """Sign of the determinant of the first points less the last one, in fractions."""
    rows = [[Fraction(x) for x in row] for row in points.tolist()]
    m = [[x - y for x, y in zip(row, rows[-1], strict=True)] for row in rows[:-1]]
    if len(m) == 2:
        det = m[0][0] * m[1][1] - m[0][1] * m[1][0]
    else:
        (a, b, c), (d, e, f), (g, h, i) = m
        det = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    return (det > 0) - (det < 0)


def near_plane(rng, size):
    """Points of a plane through three others, up to rounding, each coordinate then moved by -2 to 2 of its steps."""
    corner = rng.normal(size=(COUNT, size, size)) * rng.choice([1e-6, 0.1, 1e3], (COUNT, 1, 1))
    corner += rng.normal(size=(COUNT, 1, size)) * rng.choice([0.0, 1.0, 1e4], (COUNT, 1, 1))
    weight = rng.dirichlet(np.ones(size), COUNT) * rng.choice([1.0, -3.0], (COUNT, size))
    weight[:, 0] += 1.0 - weight.sum(axis=1)
    last = np.einsum("ij,ijk->ik", weight, corner)
    last += np.spacing(last) * rng.integers(-2, 3, last.shape)
    return np.concatenate([corner, last[:, None]], axis=1)


def on_plane(rng, size):
    """Points with up to 52 bits, exactly on a plane; every third one is moved off by one step of its last bit."""
    direction = rng.integers(-(2**20), 2**20, (COUNT, size - 1, size)).astype(float)
    weight = rng.integers(-(2**20), 2**20, (COUNT, size + 1, size - 1)).astype(float)
    shift = rng.integers(-(2**50), 2**50, (COUNT, 1, size)).astype(float)
    out = weight @ direction + shift
    out[::3, -1, 0] += 1
    return out * 2.0 ** rng.integers(-80, 20, (COUNT, 1, 1))


def of_all_sizes(rng, size):
    """Coordinates from 1e-20 to 1e20, some of them equal."""
    out = rng.normal(size=(COUNT, size + 1, size)) * 10.0 ** rng.integers(-20, 21, (COUNT, size + 1, size))
    same = rng.random(out.shape) < 0.2
    return np.where(same, out[:, :1], out)


def of_float32(rng, size):
    """Points of a tilted plane as float32 stores them, and as they are where that plane is flat."""
    axes = np.linalg.qr(rng.normal(size=(COUNT, size, size)))[0]
    out = np.concatenate([rng.uniform(-0.1, 0.1, (COUNT, size + 1, size - 1)), np.zeros((COUNT, size + 1, 1))], axis=2)
    out[: COUNT // 2] = np.einsum("ijk,ilk->ijl", out[: COUNT // 2], axes[: COUNT // 2])
    return (out + 0.2).astype(np.float32).astype(np.float64)


def on_grid(rng, size):
    """Small integers: most cases are degenerate."""
    return rng.integers(-1, 2, (COUNT, size + 1, size)).astype(float)


def tiny(rng, size):
    """Grids with steps of 1e-30 m far from the origin of their own bits, as far as products stay above 1e-308."""
    return rng.integers(-50, 50, (COUNT, size + 1, size)) * 2.0**-100


FAMILIES = {f.__name__: f for f in (near_plane, on_plane, of_all_sizes, of_float32, on_grid, tiny)}


@pytest.mark.exhaustive
@pytest.mark.parametrize("size", [3, 2], ids=["plane", "line"])
@pytest.mark.parametrize("family", FAMILIES)
def test_sides_are_those_of_the_exact_determinant(family, size, device):
    points = FAMILIES[family](np.random.default_rng([size, len(family)]), size)
    want = np.array([determinant_sign(own) for own in points])
    assert (asked(points, device) == want).all()
    assert len(np.unique(want)) >= 2  # a family that has one answer only would prove little


def test_float64_alone_would_be_wrong(device):
    """The family of points near a plane asks for more than the filter: else the test above proves nothing."""
    points = near_plane(np.random.default_rng([3, len("near_plane")]), 3)
    want = np.array([determinant_sign(own) for own in points])
    plain = np.sign(np.linalg.det(points[:, :3] - points[:, 3:]))
    assert np.count_nonzero(plain != want) > COUNT // 20
    assert (asked(points, device) == want).all()
