"""Focal points -> delays in bytes, for one focus a frame: as fast as the bytes can be written."""

from typing import NamedTuple

import numpy as np
import warp as wp

from ..offsets import BLOCK
from ..one_device import on_one_device
from ..patch import EXACT

wp.set_module_options(EXACT)

GROUP = 16  # transducers of a thread: their delays fill one store
FRAMES = 32  # of a thread, for which it keeps its transducers in registers; 8 took 1.4 times as long on an H200


class FocusTable(NamedTuple):
    """An array's transducers in 1/256 wavelengths, as `focus_phases` takes them; filled up to a multiple of GROUP."""

    row: wp.array  # wp.vec4: -2 t, |t|^2; shape [transducer, filled up]
    count: int  # transducers
    scale: float  # 1/256 wavelengths a metre


def focus_table(position: np.ndarray, *, wavelength: float, device: object) -> FocusTable:
    """Table of transducers at these positions [m], shape [transducer, 3]; wavelength [m]."""
    scale = 256.0 / wavelength
    t = np.zeros((-(-len(position) // GROUP) * GROUP, 3))
    t[: len(position)] = np.asarray(position, np.float64) * scale
    row = np.column_stack([-2 * t, (t * t).sum(axis=1)]).astype(np.float32)
    return FocusTable(wp.array(row, dtype=wp.vec4, device=device), len(position), scale)


@wp.func_native("""
    // |p - t|^2 = |p|^2 + |t|^2 - 2 p t. Adding 1.5 * 2^23 rounds to whole numbers; the low byte of the sum is mod 256.
    const float magic = 12582912.0f;
    const wp::vec_t<4, wp::float32>* t = row.data + 16 * group;
    float x[16], y[16], z[16], s[16];
    for (int k = 0; k < 16; ++k) {
#ifdef __CUDA_ARCH__
        const float4 r = __ldg(reinterpret_cast<const float4*>(t) + k);  // one load, not four
        x[k] = r.x; y[k] = r.y; z[k] = r.z; s[k] = r.w;
#else
        x[k] = t[k].c[0]; y[k] = t[k].c[1]; z[k] = t[k].c[2]; s[k] = t[k].c[3];
#endif
    }
    const size_t pitch = out.strides[0];
    for (int frame = first; frame < points.shape[0]; frame += stride) {
        const wp::vec_t<3, wp::float32> p = points.data[frame];
        const float px = p.c[0] * scale, py = p.c[1] * scale, pz = p.c[2] * scale;
        const float pp = px * px + py * py + pz * pz;
        unsigned char* to = out.data + frame * pitch + 16 * group;
#ifdef __CUDA_ARCH__
        unsigned word[4];
        #pragma unroll
        for (int w = 0; w < 4; ++w) {
            unsigned bits[4];
            #pragma unroll
            for (int b = 0; b < 4; ++b) {
                const int k = 4 * w + b;
                const float q = fmaf(x[k], px, fmaf(y[k], py, fmaf(z[k], pz, s[k] + pp)));
                float inverse;
                asm("rsqrt.approx.ftz.f32 %0, %1;" : "=f"(inverse) : "f"(q));
                bits[b] = __float_as_uint(fmaf(-q, inverse, magic));
            }
            word[w] = __byte_perm(__byte_perm(bits[0], bits[1], 0x0040), __byte_perm(bits[2], bits[3], 0x0040), 0x5410);
        }
        *reinterpret_cast<uint4*>(to) = make_uint4(word[0], word[1], word[2], word[3]);
#else
        for (int k = 0; k < 16; ++k) {
            const float q = x[k] * px + y[k] * py + (z[k] * pz + (s[k] + pp));
            const float sum = magic - __builtin_sqrtf(q);
            unsigned bits;
            __builtin_memcpy(&bits, &sum, 4);
            to[k] = static_cast<unsigned char>(bits);
        }
#endif
    }
""")
def write_phases(
    points: wp.array[wp.vec3],
    row: wp.array[wp.vec4],
    scale: float,
    group: int,
    first: int,
    stride: int,
    out: wp.array2d[wp.uint8],
):
    """Write the delays of 16 transducers for every stride-th frame."""


@wp.kernel
def _focus_phases(
    points: wp.array[wp.vec3], row: wp.array[wp.vec4], scale: float, stride: int, out: wp.array2d[wp.uint8]
):
    """Each thread writes 16 transducers of a few frames, 16 bytes at a time; neighbours write side by side."""
    first, group = wp.tid()
    write_phases(points, row, scale, group, first, stride, out)


@on_one_device
def focus_phases(points: wp.array, table: FocusTable, *, out: wp.array | None = None) -> wp.array:
    """Delays [1/256 turn] that focus each frame at its point: round(-256 r / wavelength) mod 256, uint8.

    points: wp.vec3 [m], shape [frame], on the table's device. The result has shape [frame, transducer]; its rows are
    as far apart as there are transducers in the table, so it is contiguous only if their number is a multiple of 16.
    out: where to write it, uint8, shape [frame, transducers in the table]; made anew by default.
    Within 1/256 turn of exact for |point|, |transducer| <= 1 m; where 256 r / wavelength is half-way, rounding may go
    either way. A point that is not finite, or on a transducer, gives an arbitrary byte, which the caller silences.
    """
    frame_count, padded = points.shape[0], table.row.shape[0]
    if out is None:
        out = wp.empty((frame_count, padded), dtype=wp.uint8, device=points.device)
    if out.shape != (frame_count, padded) or not out.is_contiguous:
        raise ValueError(f"out must be contiguous with shape {(frame_count, padded)}, not {out.shape}")
    stride = max(1, -(-frame_count // FRAMES))
    wp.launch(
        _focus_phases,
        (stride, padded // GROUP),
        inputs=[points, table.row, table.scale, stride],
        outputs=[out],
        device=points.device,
        block_dim=BLOCK,
    )
    return out[:, : table.count]
