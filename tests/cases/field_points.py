"""Values and roots of a field at points, whatever field it is."""

from functools import cache

import numpy as np
import warp as wp

from palpate.kernels.fields.field import MODULE, root_function


@cache
def point_kernel(value, data_type):
    @wp.kernel(**MODULE)
    def _value_points(
        data: data_type,
        points: wp.array[wp.vec3d],
        out: wp.array[wp.float64],
    ):
        i = wp.tid()
        out[i] = value(data, points[i])

    return _value_points


@cache
def root_kernel(root, data_type):
    @wp.kernel(**MODULE)
    def _root_points(
        data: data_type,
        one: wp.array[wp.vec3d],
        two: wp.array[wp.vec3d],
        out: wp.array[wp.vec3d],
    ):
        i = wp.tid()
        out[i] = root(data, one[i], two[i])

    return _root_points


def vectors(points, device):
    return wp.array(np.ascontiguousarray(points, np.float64).reshape(-1, 3), dtype=wp.vec3d, device=device)


def values_at(field, points, device):
    """float64, shape [point]."""
    out = wp.empty(len(points), dtype=wp.float64, device=device)
    kernel = point_kernel(field.value, field.data_type)
    wp.launch(kernel, len(points), [field.data, vectors(points, device)], [out], device=device)
    return out.numpy()


def roots_between(field, one, two, device):
    """float64, shape [point, 3]."""
    out = wp.empty(len(one), dtype=wp.vec3d, device=device)
    kernel = root_kernel(root_function(field), field.data_type)
    wp.launch(kernel, len(one), [field.data, vectors(one, device), vectors(two, device)], [out], device=device)
    return out.numpy()
