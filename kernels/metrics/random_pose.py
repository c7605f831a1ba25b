"""Random poses by number: pose k of a seed is the same on every device, whichever poses are made with it."""

import warp as wp

from ..offsets import launch
from ..patch import EXACT, to_float32

wp.set_module_options(EXACT)

GOLDEN = wp.constant(wp.uint64(0x9E3779B97F4A7C15))  # 2^64 / golden ratio, odd
ULP = wp.constant(wp.float64(2.0**-53))
ONE = wp.constant(wp.float64(1.0))
TWO = wp.constant(wp.float64(2.0))
HALF = wp.constant(wp.float64(0.5))


@wp.func
def mix_bits(x: wp.uint64):
    """A bijection of 64-bit integers in which every bit depends on every bit (SplitMix64, Steele et al. 2014)."""
    z = x
    z = (z ^ (z >> wp.uint64(30))) * wp.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> wp.uint64(27))) * wp.uint64(0x94D049BB133111EB)
    return z ^ (z >> wp.uint64(31))


@wp.func
def uniform(stream: wp.uint64, draw: int):
    """Number `draw` of a stream, counted from 1: a multiple of 2^-53 in 0..1, 1 left out."""
    return wp.float64(mix_bits(stream + wp.uint64(draw) * GOLDEN) >> wp.uint64(11)) * ULP


@wp.kernel
def _place_poses(
    # In:
    seed: wp.uint64,
    first: wp.int64,
    size: wp.float64,  # of the cube [m]
    at: wp.vec3d,  # its middle [m]
    # Out:
    pose: wp.array[wp.transform],
):
    """One pose: uniform in the cube; a quaternion uniform on the sphere (Marsaglia 1972), by products and one root."""
    row = wp.tid()
    number = wp.uint64(first + wp.int64(row))
    stream = mix_bits(mix_bits(seed + GOLDEN) ^ mix_bits(number + GOLDEN))
    x = at[0] + size * (uniform(stream, 1) - HALF)
    y = at[1] + size * (uniform(stream, 2) - HALF)
    z = at[2] + size * (uniform(stream, 3) - HALF)
    draw = int(4)
    a = wp.float64(1.0)
    b = wp.float64(1.0)
    while a * a + b * b >= ONE:
        a = TWO * uniform(stream, draw) - ONE
        b = TWO * uniform(stream, draw + 1) - ONE
        draw += 2
    c = wp.float64(1.0)
    d = wp.float64(1.0)
    while c * c + d * d >= ONE or c * c + d * d == wp.float64(0.0):
        c = TWO * uniform(stream, draw) - ONE
        d = TWO * uniform(stream, draw + 1) - ONE
        draw += 2
    share = wp.sqrt((ONE - (a * a + b * b)) / (c * c + d * d))
    turn = wp.quat(wp.float32(a), wp.float32(b), wp.float32(share * c), wp.float32(share * d))
    pose[row] = wp.transform(to_float32(wp.vec3d(x, y, z)), turn)


def random_poses(
    first: int,
    stop: int,
    *,
    seed: int,
    size: float,
    at: tuple[float, float, float],
    device: str,
    out: wp.array | None = None,
) -> wp.array:
    """Poses first..stop of a seed, wp.transform, shape [pose]: independent, uniform in a cube and on SO(3).

    size: side of the cube [m], at least 0; at: its middle [m]. seed, first, stop: 0..2^63 - 1. out: takes the poses, as
    many as there are, for instance a range of a larger array. Raises ValueError for arguments out of these bounds.
    """
    if not (0 <= first <= stop < 2**63 and 0 <= seed < 2**63):
        raise ValueError(f"poses {first}..{stop} of seed {seed}: all must lie in 0..2^63 - 1, in this order")
    if not 0 <= size < float("inf"):
        raise ValueError(f"the cube's side must be finite and not negative, not {size} m")
    pose = wp.empty(stop - first, dtype=wp.transform, device=device) if out is None else out
    if pose.shape != (stop - first,) or pose.dtype is not wp.transform:
        raise ValueError(f"room for poses must be wp.transform, shape [{stop - first}], not {list(pose.shape)}")
    inputs = [wp.uint64(seed), wp.int64(first), wp.float64(size), wp.vec3d(*at)]
    launch(_place_poses, stop - first, inputs, [pose])
    return pose
