"""A field asked at points and at the nodes of a lattice."""

from typing import Any

import numpy as np
import warp as wp

from ..offsets import launch
from ..patch import EXACT
from .field import MODULE, Field, made_once

wp.set_module_options(EXACT)


@wp.struct
class Lattice:
    """Points at equal steps along the axes."""

    low: wp.vec3d  # the first [m]
    step: wp.vec3d  # [m]


@wp.func
def node_at(lattice: Lattice, i: int, j: int, k: int):
    """A node's place [m]."""
    offset = wp.cw_mul(lattice.step, wp.vec3d(wp.float64(i), wp.float64(j), wp.float64(k)))
    return lattice.low + offset


def lattice_of(low: np.ndarray, step: np.ndarray | float) -> Lattice:
    """A lattice from its first point and its steps [m]."""
    out = Lattice()
    out.low, out.step = wp.vec3d(*low), wp.vec3d(*np.broadcast_to(step, 3))
    return out


@made_once
def probing_kernels(value: Any, data_type: Any) -> tuple[Any, Any]:
    """The kernels that ask one kind of field: at points, and at nodes."""

    @wp.kernel(**MODULE)
    def _probe_points(data: data_type, point: wp.array[wp.vec3d], out: wp.array[wp.float64]):
        """One value a point."""
        i = wp.tid()
        out[i] = wp.float64(value(data, point[i]))

    @wp.kernel(**MODULE)
    def _probe_nodes(data: data_type, lattice: Lattice, out: wp.array3d[wp.float64]):
        """One value a node."""
        i, j, k = wp.tid()
        out[i, j, k] = wp.float64(value(data, node_at(lattice, i, j, k)))

    return _probe_points, _probe_nodes


def probe_points(field: Field, points: np.ndarray, *, device: str) -> np.ndarray:
    """A field's values at points.

    points: [m], shape [point, 3]; device: where the field's data lie. Returns float64, shape [point].
    """
    kernel = probing_kernels(field.value, field.data_type)[0]
    point = wp.array(np.ascontiguousarray(points, np.float64), dtype=wp.vec3d, device=device)
    out = wp.empty(len(points), dtype=wp.float64, device=device)
    launch(kernel, len(points), [field.data, point], [out])
    return out.numpy()


def probe_nodes(field: Field, lattice: Lattice, shape: tuple[int, int, int], *, device: str) -> np.ndarray:
    """A field's values at the nodes of a lattice, float64, of the given shape."""
    kernel = probing_kernels(field.value, field.data_type)[1]
    out = wp.empty(shape, dtype=wp.float64, device=device)
    launch(kernel, shape, [field.data, lattice], [out])
    return out.numpy()
