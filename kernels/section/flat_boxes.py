"""Boxes and faces of a surface in 16 bytes each: a flat search reads thousands of them for each section.

A box is given by its centre and half extents in whole steps of a grid over the surface, 15 bits each, rounded outwards
(but for the rounding of float32, for which every test has a margin). A face is given by whole parts of its leaf's box,
10 bits for each coordinate. What is decided by them is certain; a face that lies too near the plane for that is looked
at itself. Units here are steps of the grid, counted from its corner.
"""

from typing import Any

import numpy as np
import warp as wp

from ..offsets import BLOCK
from ..patch import EXACT, Coarse, Frame, coarse_frame, to_float64
from .half_edges import LEAF, LEAF_BITS, OPEN, Surface
from .tree import Window, down_half
from .walk import load_vec4, vertex_of

wp.set_module_options(EXACT)

STEPS = 32700  # of the grid along the longest side of the surface; of 32768, so that boxes are rounded outwards
MOST = wp.constant(32767)  # steps of a centre or a half extent
OUTWARDS = 0.125  # steps added to a half extent: more than the rounding of float32
PARTS = wp.constant(1023)  # of a leaf's box along each side
UNSURE = wp.constant(0x4444)  # in `crossed_halves`
BIAS = wp.constant(32768.0)  # that unpacked steps have too much
ROUNDING = 0.25  # steps: bound of the rounding of sums with it

# A GPU moves whole numbers to where they are the bits of a float, which then has 2^15 too much (steps of boxes) or 2^10
# (parts of faces): that is faster than to convert them. The sums take it off again. What is computed here has margins
# for its rounding, so fused products do no harm.
UNPACK = """
#ifdef __CUDA_ARCH__
#define PALPATE_FUSED(a, b, c) fmaf(a, b, c)
#define PALPATE_CENTRE(word) __int_as_float(__byte_perm(word, 0x47, 0x4105))
#define PALPATE_HALF(word) __int_as_float(__byte_perm(word, 0x47, 0x4325))
#define PALPATE_PART(word, k) \\
    __int_as_float((k == 0 ? (word) : k == 1 ? (word) << 10 : __funnelshift_r(word, word, 10)) & bits | 0x44800000)
#define PALPATE_BELOW(x) (__float_as_uint(x) >> 31)
#define PALPATE_WORDS int4
#define PALPATE_LOAD(words, i) __ldg(reinterpret_cast<const int4*>(words) + (i))  // one load, not four
#else
#define PALPATE_FUSED(a, b, c) ((a) * (b) + (c))
#define PALPATE_CENTRE(word) (static_cast<float>((word) & 0x7fff) + 32768.0f)
#define PALPATE_HALF(word) (static_cast<float>((word) >> 16) + 32768.0f)
#define PALPATE_TURNED(word) ((word) >> 23 & 511 | ((word) & 1) << 9)
#define PALPATE_PART(word, k) \\
    (static_cast<float>((k == 0 ? (word) >> 13 : k == 1 ? (word) >> 3 : PALPATE_TURNED(word)) & 1023) + 1024.0f)
#define PALPATE_BELOW(x) ((x) < 0.0f ? 1u : 0u)
    struct PALPATE_WORDS { int x, y, z, w; };
#define PALPATE_LOAD(words, i) PALPATE_WORDS{(words)[i][0], (words)[i][1], (words)[i][2], (words)[i][3]}
#endif
#define PALPATE_SUM(a, x, c) \\
    PALPATE_FUSED((a)[0], (x)[0], PALPATE_FUSED((a)[1], (x)[1], PALPATE_FUSED((a)[2], (x)[2], c)))
#define PALPATE_REACH(a, x, c) \\
    PALPATE_FUSED(wp::abs((a)[0]), (x)[0], \\
    PALPATE_FUSED(wp::abs((a)[1]), (x)[1], PALPATE_FUSED(wp::abs((a)[2]), (x)[2], c)))
"""


@wp.struct
class PackedFrame:
    """A patch's frame and the window that is searched, in units of packed boxes."""

    n: wp.vec3
    u: wp.vec3
    v: wp.vec3
    middle: wp.vec3  # added to the sums of n, u and v with an unpacked centre: then they count from the window's middle
    reach: wp.vec3  # added to the sums of |n|, |u| and |v| with an unpacked half extent: the window's, and margins
    height: wp.float32  # of the grid's corner above the plane
    unsure: wp.float32  # rounding of a height


@wp.func_native(
    UNPACK
    + """
    const PALPATE_WORDS box = PALPATE_LOAD(boxes.data, node);
    const int words[3] = {box.x, box.y, box.z};
    float centre[3], half[3];
    for (int k = 0; k < 3; ++k) {
        centre[k] = PALPATE_CENTRE(words[k]);
        half[k] = PALPATE_HALF(words[k]);
    }
    const bool n = wp::abs(PALPATE_SUM(p.n, centre, p.middle[0])) <= PALPATE_REACH(p.n, half, p.reach[0]);
    const bool u = wp::abs(PALPATE_SUM(p.u, centre, p.middle[1])) <= PALPATE_REACH(p.u, half, p.reach[1]);
    const bool v = wp::abs(PALPATE_SUM(p.v, centre, p.middle[2])) <= PALPATE_REACH(p.v, half, p.reach[2]);
    return (box.w != 0) & n & u & v;  // all at once: few warps have no lane that needs all
"""
)
def meets_packed(boxes: wp.array[wp.vec4i], p: PackedFrame, node: int) -> wp.bool:
    """Whether a box may meet the window: separating axes n, u and v, as `tree_search.meets`."""


@wp.func_native(
    UNPACK
    + """
    const PALPATE_WORDS box = PALPATE_LOAD(boxes.data, node);
    const int words[3] = {box.x, box.y, box.z};
    float a[3], low[3];  // heights of a part of the box along each axis, the box's low corner
    for (int k = 0; k < 3; ++k) {
        const float centre = PALPATE_CENTRE(words[k]), half = PALPATE_HALF(words[k]);
        low[k] = centre - half;
        a[k] = p.n[k] * (half - 32768.0f) * (2.0f / 1023.0f);
    }
    const float base = PALPATE_FUSED(-1024.0f, a[0] + a[1] + a[2], PALPATE_SUM(p.n, low, p.height));
    // rounded coordinates, and the rounding of all this
    const float unsure = PALPATE_FUSED(wp::abs(a[0]) + wp::abs(a[1]) + wp::abs(a[2]), 0.5001f, p.unsure);
    int codes = 0;
#ifdef __CUDA_ARCH__
    int bits = 0x7fe000;  // of a part
    asm("" : "+r"(bits));  // stays in a register
#endif
    for (int i = 0; i < 4; ++i) {
        const PALPATE_WORDS face = PALPATE_LOAD(faces.data, first + i);
        const int corner[3] = {face.x, face.y, face.z};
        float h[3];
        for (int k = 0; k < 3; ++k) {
            const float x[3] = {
                PALPATE_PART(corner[k], 0), PALPATE_PART(corner[k], 1), PALPATE_PART(corner[k], 2)};
            h[k] = PALPATE_SUM(a, x, base);
        }
        const unsigned below = PALPATE_BELOW(h[0]) | PALPATE_BELOW(h[1]) << 1 | PALPATE_BELOW(h[2]) << 2;
        const bool sure = wp::min(wp::abs(h[0]), wp::min(wp::abs(h[1]), wp::abs(h[2]))) > unsure;
        codes |= (sure ? 0x01223130 >> (4 * below) & 15 : 4) << (4 * i);  // a digit for each set of corners below
    }
    return codes;
"""
)
def packed_crossings(
    boxes: wp.array[wp.vec4i], faces: wp.array[wp.vec4i], p: PackedFrame, node: int, first: int
) -> int:
    """Half-edge of each of a leaf's faces that runs down through the plane: four bits for each, its corner plus 1, 0
    for none, 4 where it is not certain; first: the leaf's first face. Where there is no face, it is 0 or 4."""


@wp.func
def middle_of(a: wp.vec3, origin: wp.vec3, low: float, high: float):
    """An axis's part of `PackedFrame.middle` for a window from low to high."""
    return -(wp.dot(a, origin) + BIAS * (a[0] + a[1] + a[2])) - 0.5 * (low + high)


@wp.func
def reach_of(a: wp.vec3, margin: float, low: float, high: float):
    """An axis's part of `PackedFrame.reach`."""
    return 0.5 * (high - low) + margin - BIAS * (wp.abs(a[0]) + wp.abs(a[1]) + wp.abs(a[2]))


@wp.func
def packed_frame(surface: Surface, g: Coarse, w: Window):
    """The frame and window for a surface's packed boxes."""
    scale = surface.box_scale
    origin = scale * (g.origin - surface.box_low)
    far = 262144.0 + 2.0 * (wp.abs(origin[0]) + wp.abs(origin[1]) + wp.abs(origin[2]))  # all boxes are nearer
    low = wp.vec2(wp.max(scale * w.low[0], -far), wp.max(scale * w.low[1], -far))
    high = wp.vec2(wp.min(scale * w.high[0], far), wp.min(scale * w.high[1], far))
    unsure = scale * 2.0 * g.unsure
    margin = 2.0 * unsure + ROUNDING
    p = PackedFrame()
    p.n = g.n
    p.u = g.u
    p.v = g.v
    p.middle = wp.vec3(
        middle_of(g.n, origin, 0.0, 0.0),
        middle_of(g.u, origin, low[0], high[0]),
        middle_of(g.v, origin, low[1], high[1]),
    )
    p.reach = wp.vec3(
        reach_of(g.n, margin, 0.0, 0.0),
        reach_of(g.u, margin, low[0], high[0]),
        reach_of(g.v, margin, low[1], high[1]),
    )
    p.height = -wp.dot(g.n, origin)
    p.unsure = unsure + 0.25 * ROUNDING
    return p


@wp.func
def crossed_halves(surface: Surface, frame: wp.array[Frame], query: int, p: PackedFrame, node: int):
    """Half-edge of each of a leaf's faces that runs down through the plane: `packed_crossings` with certainty.

    frame: of each query, of which few faces need that of theirs.
    """
    first = (node - surface.leaf_first) << LEAF_BITS
    codes = packed_crossings(surface.packed_box, surface.packed_face, p, node, first)
    if (codes & UNSURE) != 0:
        f = frame[query]
        g = coarse_frame(f, wp.vec2d(), surface.reach)
        k = int(0)
        while (codes & UNSURE) != 0:
            if (codes >> (4 * k)) & 4 != 0:
                half = down_half(surface, f, g, first + k)
                codes = codes & ~(15 << (4 * k))
                if half != OPEN:
                    codes = codes | ((half - 3 * (first + k) + 1) << (4 * k))
            k += 1
    return codes


@wp.kernel
def _pack_boxes(surface: Surface, packed: wp.array[wp.vec4i]):
    """Centre and half extents of each box in whole steps, rounded outwards; 0 as fourth word for an empty box."""
    node = wp.tid()
    half = vertex_of(load_vec4(surface.node_half, node))
    centre = vertex_of(load_vec4(surface.node_centre, node)) - surface.box_low
    out = wp.vec4i(0, 0, 0, 0)
    if half[0] >= 0.0:
        for k in range(3):
            x = surface.box_scale * centre[k]
            middle = wp.clamp(int(wp.rint(x)), 0, MOST)
            extent = int(wp.ceil(surface.box_scale * half[k] + wp.abs(x - wp.float32(middle)) + OUTWARDS))
            out[k] = middle | (wp.clamp(extent, 0, MOST) << 16)
        out[3] = 1
    packed[node] = out


@wp.func
def part_bits(part: wp.uint32, k: int):
    """Bits of a face's word that hold a part: 13 to 22, which are a float's highest; 3 to 12; 23 to 31 and 0."""
    if k == 0:
        return part << wp.uint32(13)
    if k == 1:
        return part << wp.uint32(3)
    return (part << wp.uint32(23)) | (part >> wp.uint32(9))


@wp.kernel
def _pack_faces(surface: Surface, packed_box: wp.array[wp.vec4i], packed: wp.array[wp.vec4i]):
    """Corners of each face in parts of its leaf's box; 0 as fourth word where there is no face."""
    face = wp.tid()
    out = wp.vec4i(0, 0, 0, 0)
    if 3 * face < surface.corner.shape[0]:
        box = packed_box[surface.leaf_first + (face >> LEAF_BITS)]
        for corner in range(3):
            x = to_float64(vertex_of(load_vec4(surface.corner, 3 * face + corner))) - to_float64(surface.box_low)
            x = wp.float64(surface.box_scale) * x
            word = wp.uint32(0)
            for k in range(3):
                extent = box[k] >> 16
                low = (box[k] & MOST) - extent
                part = wp.float64(2 * extent) / wp.float64(1023.0)
                place = int(wp.rint((x[k] - wp.float64(low)) / part))
                word = word | part_bits(wp.uint32(wp.clamp(place, 0, PARTS)), k)
            out[corner] = wp.int32(word)
        out[3] = 1
    packed[face] = out


def pack_boxes(surface: Any, device: Any) -> None:
    """Add packed boxes and faces to a Surface."""
    centre, half = (array[1:2].numpy()[0, :3].astype(np.float64) for array in (surface.node_centre, surface.node_half))
    step = max(2.0 * half.max() / STEPS, 1e-30)
    surface.box_scale, surface.box_low = 1.0 / step, wp.vec3(*(centre - half - 8.0 * step))
    nodes = surface.node_half.shape[0]
    box = wp.empty(nodes, dtype=wp.vec4i, device=device)
    face = wp.empty(LEAF * (nodes // 2), dtype=wp.vec4i, device=device)
    wp.launch(_pack_boxes, nodes, inputs=[surface], outputs=[box], device=device, block_dim=BLOCK)
    wp.launch(_pack_faces, len(face), inputs=[surface, box], outputs=[face], device=device, block_dim=BLOCK)
    surface.packed_box, surface.packed_face = box, face  # whole: another thread may search, or pack the same
