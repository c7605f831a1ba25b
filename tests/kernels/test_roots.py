"""Where a field turns from inside to outside along an edge: to 1e-8 m, however flat or steep its function is there."""

import numpy as np
import pytest
import warp as wp
from march_cases import Shape, ball_value, box_of, box_value, shape_field, step_value

from palpate.kernels.fields.field import root_of
from palpate.kernels.patch import EXACT

wp.set_module_options(EXACT)


@wp.func
def bent_value(d: Shape, x: wp.vec3d):
    """Flat on one side of its root, steep on the other."""
    t = ball_value(d, x)
    if t < wp.float64(0.0):
        return wp.float64(1e-3) * t
    return wp.float64(1e3) * t


@wp.func
def fifth_value(d: Shape, x: wp.vec3d):
    t = ball_value(d, x)
    return t * t * t * t * t


@wp.func
def no_slope_value(d: Shape, x: wp.vec3d):
    """0 all outside."""
    return wp.min(ball_value(d, x), wp.float64(0.0))


@wp.func
def rising_value(d: Shape, x: wp.vec3d):
    return wp.exp(wp.float64(3000.0) * ball_value(d, x)) - wp.float64(1.0)


BALLS = (
    ball_value,
    bent_value,
    fifth_value,
    no_slope_value,
    rising_value,
)
ROOTS = {value: root_of(value) for value in (*BALLS, box_value, step_value)}


def make_root_kernel(root):
    @wp.kernel(module="unique", module_options=EXACT)
    def _roots(d: Shape, a: wp.array[wp.vec3d], b: wp.array[wp.vec3d], out: wp.array[wp.vec3d]):
        out[wp.tid()] = root(d, a[wp.tid()], b[wp.tid()])

    return _roots


def roots_between(value, a, b, size, device):
    d = shape_field(value, [0, 0, 0], size).data
    ends = [wp.array(np.ascontiguousarray(x), dtype=wp.vec3d, device=device) for x in (a, b)]
    out = wp.empty(len(a), dtype=wp.vec3d, device=device)
    wp.launch(make_root_kernel(ROOTS[value]), len(a), inputs=[d, *ends], outputs=[out], device=device)
    return out.numpy()


@pytest.mark.exhaustive
@pytest.mark.parametrize("value", [*BALLS, step_value], ids=lambda value: value.key)
def test_roots_are_found_whatever_the_slope_and_the_same_from_either_end(value, device, rng):
    inner, outer = rng.uniform(-0.003, 0.003, (300, 3)), rng.normal(size=(300, 3))
    outer *= rng.uniform(0.018, 0.03, (300, 1)) / np.linalg.norm(outer, axis=1, keepdims=True)
    near = rng.uniform(0, 1, 300) < 0.5  # edges of a fine grid too
    at = inner + rng.uniform(0, 1, (300, 1)) * (outer - inner)
    if value is not step_value:
        at = 0.01 * at / np.linalg.norm(at, axis=1, keepdims=True)
        way = rng.uniform(1e-5, 1e-3, (300, 1)) * at / 0.01
        inner, outer = (np.where(near[:, None], x, y) for x, y in ((at - way, inner), (at + 0.7 * way, outer)))
    one, two = (roots_between(value, *ends, (0.01,) * 3, device) for ends in ((inner, outer), (outer, inner)))
    np.testing.assert_array_equal(one, two)
    if value is step_value:
        assert np.abs(box_of(one, np.zeros(3), np.full(3, 0.01))).max() < 2e-8
    else:
        assert np.abs(np.linalg.norm(one, axis=1) - 0.01).max() < 2e-8


@pytest.mark.exhaustive
def test_an_outer_end_on_the_surface_is_met_exactly(device):
    """2 and 2^-7 m: what is exact in binary."""
    outer = np.array([[2.0**-7, 0, 0], [0, -(2.0**-7), 0.001]])
    found = roots_between(box_value, outer * [[0.5], [0.25]], outer, (2.0**-7,) * 3, device)
    np.testing.assert_array_equal(found, outer)
