"""A dense volume as a field: trilinear between voxel centres, in any spacing and orientation.

Values stand in pages of 8 x 8 x 16 (4 KiB, what addresses are looked up by), and there in lines of 2 x 2 x 4 (64 bytes,
what memory is read by): a tilted plane meets a tenth of the lines that it meets in rows along one axis. Cells are
gathered into bricks: one whose values all have one sign has no surface in it, for between voxels no value lies beyond
its neighbours'. Each brick knows how far around it, in bricks, that goes on.
"""

import math
from collections.abc import Sequence

import numpy as np
import warp as wp

from .field import ROOT_WIDTH, Field, share_of

SHIFT = 1
BRICK = 1 << SHIFT  # cells each way
WIDE = wp.constant(wp.float64(BRICK))
FAR = 100  # largest stored distance [brick]
PAGE = (8, 8, 16)  # voxels
LINE = (2, 2, 4)
VALUES_MOST = (1 << 31) - 1  # what an int can count
NEAR_ZERO = 1e-6  # of the smallest other value: what a 0 is replaced by, so that no part of space is at 0


@wp.struct
class Bricked:
    """A volume and its bricks on a device. Voxel centres lie at whole indices."""

    values: wp.array[wp.float32]  # page by page; below 0 inside; a layer of outside around it
    to_index: wp.mat33d  # from the array's frame to indices [voxel/m]
    origin: wp.vec3d  # where index (0, 0, 0) is, array frame [m]
    last: wp.vec3d  # largest index along each axis
    cells: wp.vec3i  # largest index of a cell
    stride: wp.vec2i  # values from page to page along the first two axes
    reach: wp.array[wp.int8]  # bricks from each to the nearest of another side, below 0 inside, 0 if mixed
    brick_stride: wp.vec2i  # the like of `stride` for bricks
    spread: wp.vec3d  # how far a ball of 1 m reaches along each axis [voxel]


def pad_outside(values: np.ndarray) -> np.ndarray:
    """Values with a layer around them that is outside, so that the surface closes half a voxel beyond the border.

    values: float32, finite, below 0 inside, shape [i, j, k]. A 0 becomes a little more than 0: where values are 0 over
    a stretch, the surface is at its inner end. Returns float32, shape [i + 2, j + 2, k + 2].
    """
    if values.ndim != 3 or min(values.shape) < 1:
        raise ValueError(f"a volume must be [i, j, k] with at least one voxel, not {values.shape}")
    out = np.pad(values.astype(np.float32, copy=False), 1, mode="edge")
    for axis in range(3):
        for end in (0, -1):
            layer = np.moveaxis(out, axis, 0)[end]
            np.abs(layer, out=layer)
    smallest = min(float(np.abs(x, out=x).min(where=x > 0, initial=np.inf)) for x in map(np.array, values))
    lift = NEAR_ZERO * smallest if np.isfinite(smallest) else 1.0
    out[out == 0] = max(lift, float(np.finfo(np.float32).tiny))
    return out


def brick_reach(padded: np.ndarray) -> np.ndarray:
    """`Bricked.reach` of each brick, from values of `pad_outside`; int8 [brick, brick, brick]."""
    from scipy.ndimage import distance_transform_cdt  # a tenth of a second that meshes do without

    inside = padded < 0
    every, some = inside, inside
    for axis, size in enumerate(padded.shape):
        first = np.arange(0, size - 1, BRICK)
        last = np.minimum(first + BRICK, size - 1)  # the next brick's first layer is this one's last
        every, end = np.logical_and.reduceat(every, first, axis), np.take(every, last, axis)
        every &= end
        some, end = np.logical_or.reduceat(some, first, axis), np.take(some, last, axis)
        some |= end
    out = np.zeros(every.shape, np.int8)
    for side, uniform in ((-1, every), (1, ~some)):
        far = np.full(uniform.shape, FAR) if uniform.all() else distance_transform_cdt(uniform, metric="chessboard")
        out += (side * np.minimum(far, FAR)).astype(np.int8)
    return out


def page_values(padded: np.ndarray) -> np.ndarray:
    """See Bricked.values, float32, shape [value]; pages that stick out of the volume are filled up with 0."""
    (i, a, b), (j, c, d), (k, e, f) = (
        (-(-size // page), page // line, line) for size, page, line in zip(padded.shape, PAGE, LINE, strict=True)
    )
    filled = np.zeros((i * a * b, j * c * d, k * e * f), np.float32)
    filled[tuple(map(slice, padded.shape))] = padded
    return filled.reshape(i, a, b, j, c, d, k, e, f).transpose(0, 3, 6, 1, 4, 7, 2, 5, 8).ravel()


def page_reach(reach: np.ndarray) -> np.ndarray:
    """See Bricked.reach, int8, shape [brick]: in lines of 4 x 4 x 4."""
    i, j, k = (-(-size // 4) for size in reach.shape)
    filled = np.zeros((4 * i, 4 * j, 4 * k), np.int8)
    filled[tuple(map(slice, reach.shape))] = reach
    return filled.reshape(i, 4, j, 4, k, 4).transpose(0, 2, 4, 1, 3, 5).ravel()


@wp.func
def interpolate(a: wp.float64, b: wp.float64, t: wp.float64):
    """Between a (t = 0) and b (t = 1), never beyond either: two values below 0 stay below 0."""
    return (wp.float64(1.0) - t) * a + t * b


@wp.func
def clamp_index(x: wp.float64, last: wp.float64):
    """An index clamped to the volume."""
    return wp.min(wp.max(x, wp.float64(0.0)), last)


@wp.func
def place_i(data: Bricked, i: int):
    """Contribution of the first index to a value's storage index."""
    return (i >> 3) * data.stride[0] + (((i >> 1) & 3) << 8) + ((i & 1) << 3)


@wp.func
def place_j(data: Bricked, j: int):
    """Contribution of the second index to a value's storage index."""
    return (j >> 3) * data.stride[1] + (((j >> 1) & 3) << 6) + ((j & 1) << 2)


@wp.func
def place_k(k: int):
    """Contribution of the third index to a value's storage index."""
    return ((k >> 4) << 10) + (((k >> 2) & 3) << 4) + (k & 3)


@wp.func
def reach_of(data: Bricked, i: int, j: int, k: int):
    """A brick's reach."""
    line = (i >> 2) * data.brick_stride[0] + (j >> 2) * data.brick_stride[1] + ((k >> 2) << 6)
    return int(data.reach[line + ((i & 3) << 4) + ((j & 3) << 2) + (k & 3)])


@wp.func
def interpolate_entries(values: wp.array[wp.float32], one: int, two: int, t: wp.float64):
    """Between two values by their places."""
    return interpolate(wp.float64(values[one]), wp.float64(values[two]), t)


@wp.func
def value_at(data: Bricked, at: wp.vec3d):
    """Value at an index."""
    p = clamp_index(at[0], data.last[0])
    q = clamp_index(at[1], data.last[1])
    r = clamp_index(at[2], data.last[2])
    i = wp.min(int(p), data.cells[0])
    j = wp.min(int(q), data.cells[1])
    k = wp.min(int(r), data.cells[2])
    p = p - wp.float64(i)
    q = q - wp.float64(j)
    r = r - wp.float64(k)
    k_low = place_k(k)
    k_high = place_k(k + 1)
    j_low = place_j(data, j)
    j_high = place_j(data, j + 1)
    base = place_i(data, i)
    a = interpolate_entries(data.values, base + j_low + k_low, base + j_low + k_high, r)
    b = interpolate_entries(data.values, base + j_high + k_low, base + j_high + k_high, r)
    low = interpolate(a, b, q)
    base = place_i(data, i + 1)
    a = interpolate_entries(data.values, base + j_low + k_low, base + j_low + k_high, r)
    b = interpolate_entries(data.values, base + j_high + k_low, base + j_high + k_high, r)
    return interpolate(low, interpolate(a, b, q), p)


@wp.func
def index_of(data: Bricked, x: wp.vec3d):
    """Index of a point."""
    return data.to_index * (x - data.origin)


@wp.func
def bricked_value(data: Bricked, x: wp.vec3d):
    """Value at a point; beyond the volume that of its nearest point, which is outside the solid."""
    return value_at(data, index_of(data, x))


SHARE = share_of(value_at)


@wp.func
def bricked_root(data: Bricked, a: wp.vec3d, b: wp.vec3d):
    """`Field.root` of the volume, looked for in indices."""
    p = index_of(data, a)
    q = index_of(data, b)
    fp = value_at(data, p)
    fq = value_at(data, q)
    least = ROOT_WIDTH / wp.max(wp.length(b - a), ROOT_WIDTH)
    if fq < wp.float64(0.0):
        return b + SHARE(data, q, p, fq, fp, least) * (a - b)
    return a + SHARE(data, p, q, fp, fq, least) * (b - a)


@wp.func
def bricked_inside(data: Bricked, x: wp.vec3d):
    """`Field.inside` of the volume: a brick of one side need not be looked into."""
    at = index_of(data, x)
    i = wp.min(int(clamp_index(at[0], data.last[0])), data.cells[0])
    j = wp.min(int(clamp_index(at[1], data.last[1])), data.cells[1])
    k = wp.min(int(clamp_index(at[2], data.last[2])), data.cells[2])
    reach = reach_of(data, i >> SHIFT, j >> SHIFT, k >> SHIFT)
    if reach != 0:
        return reach < 0
    return value_at(data, at) < wp.float64(0.0)


@wp.func
def bricked_ball(data: Bricked, x: wp.vec3d, radius: wp.float64):
    """`Field.ball` of the volume: whether bricks of one side reach around it; beyond, the nearest ones."""
    at = index_of(data, x)
    brick = wp.vec3i()
    room = wp.float64(1.0e9)  # to where the own brick ends, less what the ball reaches [voxel]
    for k in range(3):
        p = clamp_index(at[k], data.last[k])
        own = wp.min(int(p), data.cells[k]) >> SHIFT
        brick[k] = own
        p = p - wp.float64(own) * WIDE
        room = wp.min(room, wp.min(p, WIDE - p) - radius * data.spread[k])
    reach = reach_of(data, brick[0], brick[1], brick[2])
    room += wp.float64(wp.abs(reach) - 1) * WIDE
    if reach == 0 or room <= wp.float64(0.0):
        return int(0)
    return wp.where(reach < 0, -1, 1)


def paged_count(shape: Sequence[int]) -> int:
    """Values that a volume of this shape takes in whole pages, of which there may be VALUES_MOST."""
    return math.prod(-(-size // page) * page for size, page in zip(shape, PAGE, strict=True))


def bricked_field(padded: np.ndarray, affine: np.ndarray, device: str) -> Field:
    """A volume as a field on a Warp device.

    padded: as `pad_outside` gives it; affine: from the indices of what was padded to the array's frame [m], float64,
    shape [4, 4], of any orientation, sheared or mirrored too. Raises ValueError for more values than VALUES_MOST.
    """
    if paged_count(padded.shape) > VALUES_MOST:
        raise ValueError(f"a volume must have {VALUES_MOST} values at most in whole pages, not {padded.shape}")
    affine = np.asarray(affine, np.float64)
    inverse = np.linalg.inv(affine[:3, :3])
    _, j_size, k_size = (-(-size // page) for size, page in zip(padded.shape, PAGE, strict=True))
    data = Bricked()
    data.values = wp.array(page_values(padded), dtype=wp.float32, device=device, copy=False)
    data.to_index = wp.mat33d(*inverse.ravel())
    data.origin = wp.vec3d(*(affine[:3, 3] - affine[:3, :3].sum(axis=1)))  # where the layer starts: index -1
    data.last = wp.vec3d(*(np.array(padded.shape, np.float64) - 1.0))
    data.cells = wp.vec3i(*(size - 2 for size in padded.shape))
    data.stride = wp.vec2i(1024 * j_size * k_size, 1024 * k_size)
    reach = brick_reach(padded)
    data.reach = wp.array(page_reach(reach), dtype=wp.int8, device=device)
    data.brick_stride = wp.vec2i(64 * -(-reach.shape[1] // 4) * -(-reach.shape[2] // 4), 64 * -(-reach.shape[2] // 4))
    data.spread = wp.vec3d(*np.linalg.norm(inverse, axis=1))
    grain = float(np.linalg.norm(affine[:3, :3], axis=0).max())
    return Field(bricked_value, Bricked, data, bricked_root, bricked_ball, bricked_inside, grain)
