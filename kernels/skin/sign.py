"""Signs of skin vertices (inside a solid or not), and crossings of the surface with skin edges."""

from functools import cache
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from ..fields.field import MODULE, Field, ball_unknown, root_function
from ..offsets import launch
from ..patch import rotate, to_float32, to_float64
from .edges import Skin

WORD = 32  # vertices whose signs share a word
ALL = wp.constant(wp.uint32(2**32 - 1))  # of a word; those beyond the last vertex are never read
MARGIN = 1e-6  # [m]; bounds are widened by it, and vertices beyond them not asked about


@wp.struct
class Turn:
    """A pose as a rotation by columns, and a translation [m]."""

    x: wp.vec3d
    y: wp.vec3d
    z: wp.vec3d
    origin: wp.vec3d


@wp.func
def turn_of(pose: wp.transform):
    """Hand frame -> array frame."""
    q = wp.transform_get_rotation(pose)
    a = to_float64(wp.vec3(q[0], q[1], q[2]))
    w = wp.float64(q[3])
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    t = Turn()
    t.x = rotate(a, w, wp.vec3d(one, zero, zero))
    t.y = rotate(a, w, wp.vec3d(zero, one, zero))
    t.z = rotate(a, w, wp.vec3d(zero, zero, one))
    t.origin = to_float64(wp.transform_get_translation(pose))
    return t


@wp.func
def vertex_in_hand(skin: Skin, vertex: wp.array2d[wp.vec3], row: int, k: int):
    """Vertex k of the skin in the hand's frame [m]; row: of `vertex`."""
    if skin.source.shape[0] == 0:
        return to_float64(vertex[row, k])
    s = skin.source[k]
    w = to_float64(skin.weight[k])
    x = w[0] * to_float64(vertex[row, s[0]])
    if s[1] >= 0:
        x += w[1] * to_float64(vertex[row, s[1]])
    if s[2] >= 0:
        x += w[2] * to_float64(vertex[row, s[2]])
    return x


@wp.func
def vertex_at(skin: Skin, vertex: wp.array2d[wp.vec3], row: int, t: Turn, k: int):
    """Vertex k of the skin in the array's frame [m]."""
    x = vertex_in_hand(skin, vertex, row, k)
    return t.origin + (x[0] * t.x + x[1] * t.y + x[2] * t.z)


@wp.func
def is_inside(inside: wp.array2d[wp.uint32], pose: int, k: int):
    """Whether vertex k lies inside the solid."""
    return ((inside[pose, k // WORD] >> wp.uint32(k % WORD)) & wp.uint32(1)) != wp.uint32(0)


@wp.struct
class Box:
    """Bounds of the vertices of a word [m]."""

    low: wp.vec3d
    high: wp.vec3d


@wp.func
def box_of(skin: Skin, vertex: wp.array2d[wp.vec3], row: int, t: Turn, first: int, count: int):
    """The box around some vertices in a row."""
    b = Box()
    b.low = vertex_at(skin, vertex, row, t, first)
    b.high = b.low
    for i in range(1, count):
        x = vertex_at(skin, vertex, row, t, first + i)
        b.low = wp.min(b.low, x)
        b.high = wp.max(b.high, x)
    return b


@cache
def sign_kernel(value: Any, ball: Any, data_type: Any) -> Any:
    """Kernel that asks a field about every vertex, by words where its `ball` classifies them."""

    @wp.kernel(**MODULE)
    def _sign_vertices(
        # In:
        data: data_type,
        pose: wp.array2d[wp.transform],
        skin: Skin,
        vertex: wp.array2d[wp.vec3],
        low: wp.vec3d,  # beyond these bounds nothing is inside [m]
        high: wp.vec3d,
        # Out:
        inside: wp.array2d[wp.uint32],  # a bit a vertex, shape [pose, word]
    ):
        """Set a word of signs."""
        row, word = wp.tid()
        t = turn_of(pose[row, 0])
        own = wp.min(row, vertex.shape[0] - 1)
        count = wp.min(WORD, skin.vertex_count - WORD * word)
        box = box_of(skin, vertex, own, t, WORD * word, count)
        bits = wp.uint32(0)
        if wp.min(wp.min(box.high - low), wp.min(high - box.low)) >= wp.float64(0.0):
            half = wp.float64(0.5)
            side = ball(data, half * (box.low + box.high), half * wp.length(box.high - box.low))
            if side < 0:
                bits = ALL
            if side == 0:
                for i in range(count):
                    if value(data, vertex_at(skin, vertex, own, t, WORD * word + i)) < wp.float64(0.0):
                        bits = bits | (wp.uint32(1) << wp.uint32(i))
        inside[row, word] = bits

    return _sign_vertices


@wp.func_native("""
#ifdef __CUDA_ARCH__
    return __ballot_sync(0xffffffffu, bit != 0);
#else
    return bit != 0 ? 1u : 0u;
#endif
""")
def ballot(bit: int) -> wp.uint32:
    """Bits of the 32 threads of a warp, as a word; all of them must ask."""


@cache
def ballot_kernel(value: Any, data_type: Any) -> Any:
    """The same for a GPU: a thread a vertex, a warp a word, since what lies side by side takes the same way there."""

    @wp.kernel(**MODULE)
    def _ballot_vertices(
        # In:
        data: data_type,
        pose: wp.array2d[wp.transform],
        skin: Skin,
        vertex: wp.array2d[wp.vec3],
        low: wp.vec3d,  # beyond these bounds nothing is inside [m]
        high: wp.vec3d,
        # Out:
        inside: wp.array2d[wp.uint32],  # a bit a vertex, shape [pose, word]
    ):
        """Ask about a vertex; the first thread of a word writes it."""
        row, k = wp.tid()
        bit = int(0)
        if k < skin.vertex_count:
            x = vertex_at(skin, vertex, wp.min(row, vertex.shape[0] - 1), turn_of(pose[row, 0]), k)
            if wp.min(wp.min(x - low), wp.min(high - x)) >= wp.float64(0.0):
                if value(data, x) < wp.float64(0.0):
                    bit = 1
        bits = ballot(bit)
        if k % WORD == 0:
            inside[row, k // WORD] = bits

    return _ballot_vertices


@cache
def place_kernel(root: Any, data_type: Any) -> Any:
    """Kernel that finds where a field's surface crosses edges of the skin."""

    @wp.kernel(**MODULE)
    def _place_points(
        # In:
        data: data_type,
        pose: wp.array2d[wp.transform],
        skin: Skin,
        vertex: wp.array2d[wp.vec3],
        spot: wp.array[wp.vec2i],  # pose, and 2 half-edge, plus 1 for the vertex where it starts
        # Out:
        point: wp.array[wp.vec3],  # [m]
    ):
        """Place a point on its edge, or at its vertex."""
        i = wp.tid()
        row = spot[i][0]
        half = spot[i][1] // 2
        t = turn_of(pose[row, 0])
        own = wp.min(row, vertex.shape[0] - 1)
        x = vertex_at(skin, vertex, own, t, skin.half[half][0])
        if spot[i][1] % 2 == 0:
            after = half + 1
            if half % 3 == 2:
                after = half - 2
            x = root(data, x, vertex_at(skin, vertex, own, t, skin.half[after][0]))
        point[i] = to_float32(x)

    return _place_points


class Posed(NamedTuple):
    """Skin at poses on a device."""

    pose: wp.array
    """transform, shape [pose, 1]."""
    skin: Any
    """A Skin, see `upload_skin`."""
    vertex: wp.array
    """vec3 [m], hand frame, shape [1 or pose, vertex]."""


def sign_vertices(field: Field, posed: Posed, bounds: np.ndarray | None = None) -> wp.array:
    """Signs of all vertices of the skin, packed, uint32, shape [pose, word].

    bounds: lowest and highest coordinates of the solid [m], shape [2, 3]; vertices beyond them are not asked about.
    """
    pose_count, device = posed.pose.shape[0], posed.pose.device
    word_count = -(-posed.skin.vertex_count // WORD)
    inside = wp.empty((pose_count, word_count), dtype=wp.uint32, device=device)
    far = np.array([[-np.inf] * 3, [np.inf] * 3]) if bounds is None else np.asarray(bounds, np.float64)
    low, high = wp.vec3d(*(far[0] - MARGIN)), wp.vec3d(*(far[1] + MARGIN))
    inputs = [field.data, *posed, low, high]
    if wp.get_device(device).is_cuda:
        kernel, size = ballot_kernel(field.value, field.data_type), (pose_count, word_count * WORD)
    else:
        kernel = sign_kernel(field.value, field.ball or ball_unknown, field.data_type)
        size = (pose_count, word_count)
    launch(kernel, size, inputs, [inside])
    return inside


def place_points(field: Field, posed: Posed, spot: wp.array) -> wp.array:
    """Position of each spot, vec3 [m], array frame, shape [point]."""
    point = wp.empty(spot.shape[0], dtype=wp.vec3, device=spot.device)
    inputs = [field.data, *posed, spot]
    kernel = place_kernel(root_function(field), field.data_type)
    launch(kernel, spot.shape[0], inputs, [point])
    return point
