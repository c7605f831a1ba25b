"""Boxes and faces of a surface in 16 bytes each: a flat search reads thousands of them for each section.

A box is given by whole steps of a grid over the surface, 16 bits for each end, rounded outwards (but for the rounding
of float32, for which every test has a margin). A face is given by whole parts of its leaf's box, 10 bits for each
coordinate. What is decided by them is certain; a face that lies too near the plane for that is looked at itself. Units
here are half a step of the grid, counted from its corner.
"""

from typing import Any

import numpy as np
import warp as wp

from ..offsets import BLOCK
from ..patch import EXACT, Coarse, Frame, to_float64
from ..section.edge_pairing import OPEN
from ..section.half_edges import LEAF, LEAF_BITS, Surface
from ..section.rough_scan import held_vec3
from ..section.tree_search import Window, down_half
from ..section.triangle_walk import load_vec4, vertex_of

wp.set_module_options(EXACT)

STEPS = 65500  # of the grid along the longest side of the surface; of 65536, so that ends are rounded outwards
PARTS = wp.constant(1023)  # of a leaf's box along each side
PART_BITS = wp.constant(10)
UNSURE = wp.constant(0x4444)  # in `crossed_halves`

# Whole numbers below 2^23 become floats by their bits, which is faster than a GPU's conversion; then 2^23 is too much.
# What is computed here has margins for its rounding, so fused products do no harm.
UNPACK = """
#ifdef __CUDA_ARCH__
#define PALPATE_FUSED(a, b, c) fmaf(a, b, c)
#define PALPATE_FLOAT(x) __int_as_float((x) | 0x4b000000)
#define PALPATE_WORDS int4
#define PALPATE_LOAD(words, i) __ldg(reinterpret_cast<const int4*>(words) + (i))  // one load, not four
#else
#define PALPATE_FUSED(a, b, c) ((a) * (b) + (c))
#define PALPATE_FLOAT(x) (static_cast<float>(x) + 8388608.0f)
    struct PALPATE_WORDS { int x, y, z, w; };
#define PALPATE_LOAD(words, i) PALPATE_WORDS{(words)[i][0], (words)[i][1], (words)[i][2], (words)[i][3]}
#endif
#define PALPATE_DOT(a, b) PALPATE_FUSED((a)[0], (b)[0], PALPATE_FUSED((a)[1], (b)[1], (a)[2] * (b)[2]))
#define PALPATE_REACH(a, b) \\
    PALPATE_FUSED(wp::abs((a)[0]), (b)[0], PALPATE_FUSED(wp::abs((a)[1]), (b)[1], wp::abs((a)[2]) * (b)[2]))
"""


@wp.struct
class PackedFrame:
    """A patch's frame and the window that is searched, in units of packed boxes."""

    origin: wp.vec3
    u: wp.vec3
    v: wp.vec3
    n: wp.vec3
    low: wp.vec2  # of the window
    high: wp.vec2
    unsure: wp.float32  # rounding of a height


@wp.func_native(
    UNPACK
    + """
    const PALPATE_WORDS box = PALPATE_LOAD(boxes.data, node);
    const int ends[3] = {box.x, box.y, box.z};
    float half[3], d[3];
    for (int k = 0; k < 3; ++k) {
        const float low = PALPATE_FLOAT(ends[k] & 0xffff);
        half[k] = PALPATE_FLOAT((ends[k] >> 16) & 0xffff) - low;
        d[k] = PALPATE_FUSED(2.0f, low - 8388608.0f, half[k] - p.origin[k]);
    }
    const float margin = 2.0f * p.unsure;
    if (box.w == 0 || wp::abs(PALPATE_DOT(p.n, d)) > PALPATE_REACH(p.n, half) + margin)
        return false;
    const float x = PALPATE_DOT(p.u, d), y = PALPATE_DOT(p.v, d);
    const float r = PALPATE_REACH(p.u, half) + margin, t = PALPATE_REACH(p.v, half) + margin;
    return x - r <= p.high[0] && x + r >= p.low[0] && y - t <= p.high[1] && y + t >= p.low[1];
"""
)
def meets_packed(boxes: wp.array[wp.vec4i], p: PackedFrame, node: int) -> wp.bool:
    """Whether a box may meet the window: separating axes n, u and v, as `tree_search.meets`."""


@wp.func_native(
    UNPACK
    + """
    const PALPATE_WORDS box = PALPATE_LOAD(boxes.data, node);
    const int ends[3] = {box.x, box.y, box.z};
    float a[3], low[3], unsure = 0.0f;  // heights of a part of the box along each axis
    for (int k = 0; k < 3; ++k) {
        const float end = PALPATE_FLOAT(ends[k] & 0xffff);
        const float half = PALPATE_FLOAT((ends[k] >> 16) & 0xffff) - end;
        low[k] = PALPATE_FUSED(2.0f, end - 8388608.0f, -p.origin[k]);
        a[k] = p.n[k] * half * (2.0f / 1023.0f);
        unsure += wp::abs(a[k]);
    }
    unsure = PALPATE_FUSED(unsure, 0.5001f, p.unsure);  // rounded coordinates, and the rounding of all this
    const float base = PALPATE_DOT(p.n, low);
    int codes = 0;
    for (int i = 0; i < 4; ++i) {
        const PALPATE_WORDS face = PALPATE_LOAD(faces.data, first + i);
        const int corner[3] = {face.x, face.y, face.z};
        float h[3];
        for (int k = 0; k < 3; ++k) {
            const float x[3] = {
                PALPATE_FLOAT(corner[k] & 1023) - 8388608.0f,
                PALPATE_FLOAT((corner[k] >> 10) & 1023) - 8388608.0f,
                PALPATE_FLOAT((corner[k] >> 20) & 1023) - 8388608.0f};
            h[k] = base + PALPATE_DOT(a, x);
        }
        int code = h[0] > 0.0f && h[1] < 0.0f ? 1 : h[1] > 0.0f && h[2] < 0.0f ? 2 : h[2] > 0.0f && h[0] < 0.0f ? 3 : 0;
        if (wp::min(wp::abs(h[0]), wp::min(wp::abs(h[1]), wp::abs(h[2]))) <= unsure)
            code = 4;
        codes |= (face.w != 0 ? code : 0) << (4 * i);
    }
    return codes;
"""
)
def packed_crossings(
    boxes: wp.array[wp.vec4i], faces: wp.array[wp.vec4i], p: PackedFrame, node: int, first: int
) -> int:
    """Which half-edge of each of a leaf's faces runs down through the plane: four bits for each, its corner plus 1, 0
    for none, 4 where it is not certain; first: the leaf's first face."""


@wp.func
def packed_frame(surface: Surface, g: Coarse, w: Window):
    """The frame and window for a surface's packed boxes."""
    p = PackedFrame()
    scale = 2.0 / surface.box_step
    p.origin = held_vec3(scale * (g.origin - surface.box_low))
    p.u = held_vec3(g.u)
    p.v = held_vec3(g.v)
    p.n = held_vec3(g.n)
    p.low = scale * w.low
    p.high = scale * w.high
    p.unsure = scale * 2.0 * g.unsure
    return p


@wp.func
def crossed_halves(surface: Surface, f: Frame, g: Coarse, p: PackedFrame, node: int):
    """Which half-edge of each of a leaf's faces runs down through the plane: `packed_crossings` with certainty."""
    first = (node - surface.leaf_first) << LEAF_BITS
    codes = packed_crossings(surface.packed_box, surface.packed_face, p, node, first)
    if (codes & UNSURE) != 0:
        k = int(0)
        while k < LEAF:
            if (codes >> (4 * k)) & 4 != 0:
                half = down_half(surface, f, g, first + k)
                codes = codes & ~(15 << (4 * k))
                if half != OPEN:
                    codes = codes | ((half - 3 * (first + k) + 1) << (4 * k))
            k += 1
    return codes


@wp.kernel
def _pack_boxes(
    # In:
    surface: Surface,
    # Out:
    packed: wp.array[wp.vec4i],
):
    """Ends of each box in whole steps, rounded outwards; 0 as fourth word for an empty box."""
    node = wp.tid()
    half = vertex_of(load_vec4(surface.node_half, node))
    centre = vertex_of(load_vec4(surface.node_centre, node)) - surface.box_low
    out = wp.vec4i(0, 0, 0, 0)
    if half[0] >= 0.0:
        for k in range(3):
            low = int(wp.floor((centre[k] - half[k]) / surface.box_step)) - 1
            high = int(wp.ceil((centre[k] + half[k]) / surface.box_step)) + 1
            out[k] = wp.clamp(low, 0, 65535) | (wp.clamp(high, 0, 65535) << 16)
        out[3] = 1
    packed[node] = out


@wp.kernel
def _pack_faces(
    # In:
    surface: Surface,
    packed_box: wp.array[wp.vec4i],
    # Out:
    packed: wp.array[wp.vec4i],
):
    """Corners of each face in parts of its leaf's box; 0 as fourth word where there is no face."""
    face = wp.tid()
    out = wp.vec4i(0, 0, 0, 0)
    if 3 * face < surface.corner.shape[0]:
        box = packed_box[surface.leaf_first + (face >> LEAF_BITS)]
        for corner in range(3):
            x = to_float64(vertex_of(load_vec4(surface.corner, 3 * face + corner))) - to_float64(surface.box_low)
            x = x / wp.float64(surface.box_step)
            word = int(0)
            for k in range(3):
                low = box[k] & 0xFFFF
                part = wp.float64(((box[k] >> 16) & 0xFFFF) - low) / wp.float64(1023.0)
                place = int(wp.rint((x[k] - wp.float64(low)) / part))
                word = word | (wp.clamp(place, 0, PARTS) << (k * PART_BITS))
            out[corner] = word
        out[3] = 1
    packed[face] = out


def pack_boxes(surface: Any, device: Any) -> None:
    """Add packed boxes and faces to a Surface."""
    centre, half = (array[1:2].numpy()[0, :3].astype(np.float64) for array in (surface.node_centre, surface.node_half))
    step = max(2.0 * half.max() / STEPS, 1e-30)
    surface.box_step, surface.box_low = step, wp.vec3(*(centre - half - 8.0 * step))
    nodes = surface.node_half.shape[0]
    box = wp.empty(nodes, dtype=wp.vec4i, device=device)
    face = wp.empty(LEAF * (nodes // 2), dtype=wp.vec4i, device=device)
    wp.launch(_pack_boxes, nodes, inputs=[surface], outputs=[box], device=device, block_dim=BLOCK)
    wp.launch(_pack_faces, len(face), inputs=[surface, box], outputs=[face], device=device, block_dim=BLOCK)
    surface.packed_box, surface.packed_face = box, face  # whole: another thread may search, or pack the same
