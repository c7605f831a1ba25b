"""A dense volume of signed values as a field: trilinear between voxel centres, in any spacing and orientation."""

import numpy as np
import warp as wp

from .field import Field

NEAR_ZERO = 1e-6  # of the smallest other value: what a 0 is replaced by, so that no part of space is at 0


@wp.struct
class Dense:
    """A volume on a device. Voxel centres lie at whole indices."""

    values: wp.array3d[wp.float32]  # below 0 inside; a layer of outside around it
    to_index: wp.mat33d  # from the array's frame to indices [voxel/m]
    origin: wp.vec3d  # where index (0, 0, 0) of `values` is, array frame [m]
    last: wp.vec3d  # largest index along each axis


@wp.func
def interpolate(a: wp.float64, b: wp.float64, t: wp.float64):
    """Between a (t = 0) and b (t = 1), never beyond either: two values below 0 stay below 0."""
    return (wp.float64(1.0) - t) * a + t * b


@wp.func
def along_last(values: wp.array3d[wp.float32], i: int, j: int, k: int, t: wp.float64):
    """Between two neighbours along the last axis."""
    return interpolate(wp.float64(values[i, j, k]), wp.float64(values[i, j, k + 1]), t)


@wp.func
def clamp_index(x: wp.float64, last: wp.float64):
    """An index clamped to the volume."""
    return wp.min(wp.max(x, wp.float64(0.0)), last)


@wp.func
def dense_value(data: Dense, x: wp.vec3d):
    """Value at a point; beyond the volume that of its nearest point, which is outside the solid."""
    at = data.to_index * (x - data.origin)
    p = clamp_index(at[0], data.last[0])
    q = clamp_index(at[1], data.last[1])
    r = clamp_index(at[2], data.last[2])
    i = wp.min(int(p), int(data.last[0]) - 1)
    j = wp.min(int(q), int(data.last[1]) - 1)
    k = wp.min(int(r), int(data.last[2]) - 1)
    p = p - wp.float64(i)
    q = q - wp.float64(j)
    r = r - wp.float64(k)
    low = interpolate(along_last(data.values, i, j, k, r), along_last(data.values, i, j + 1, k, r), q)
    high = interpolate(along_last(data.values, i + 1, j, k, r), along_last(data.values, i + 1, j + 1, k, r), q)
    return interpolate(low, high, p)


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


def upload_dense(padded: np.ndarray, affine: np.ndarray, device: str) -> Dense:
    """A volume on a Warp device.

    padded: as `pad_outside` gives it; affine: from the indices of what was padded to the array's frame [m], float64,
    shape [4, 4], of any orientation, sheared or mirrored too.
    """
    affine = np.asarray(affine, np.float64)
    data = Dense()
    data.values = wp.array(padded, dtype=wp.float32, device=device)
    data.to_index = wp.mat33d(*np.linalg.inv(affine[:3, :3]).ravel())
    data.origin = wp.vec3d(*(affine[:3, 3] - affine[:3, :3].sum(axis=1)))  # where the layer starts: index -1
    data.last = wp.vec3d(*(np.array(padded.shape, np.float64) - 1.0))
    return data


def grain_of(affine: np.ndarray) -> float:
    """Spacing of voxels along the axis where it is widest [m]."""
    return float(np.linalg.norm(np.asarray(affine, np.float64)[:3, :3], axis=0).max())


def dense_field(padded: np.ndarray, affine: np.ndarray, device: str) -> Field:
    """The same as a field; see `upload_dense`."""
    return Field(dense_value, Dense, upload_dense(padded, affine, device), grain=grain_of(affine))
