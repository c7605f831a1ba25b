"""Complex pressure of transducers at points: one drive of all of them, or many drives at the same points.

p(x) = sum_n q_n D(theta_n) / r_n exp(-j k r_n) with the time factor exp(+j w t), in units of a transducer's pressure at
1 m on its axis. D is that of a piston, by the polynomial of driving/wave.py. The error is within 3e-5 of the sum of
all waves' amplitudes.
"""

from typing import NamedTuple

import numpy as np
import warp as wp

from ..driving.wave import WAVE, piston_polynomial
from ..offsets import BLOCK
from ..one_device import on_one_device
from ..patch import EXACT

wp.set_module_options(EXACT)

LANES = 16  # transducers that a thread takes at once on the CPU, in vectors
FIELDS = 8  # of a transducer: position, normal, drive
TOGETHER = 4  # points of a thread on CUDA: each transducer is loaded once for all of them


class Sources(NamedTuple):
    """Transducers on one device, with a drive for each."""

    table: wp.array
    """float32; on CUDA [transducer, FIELDS], on the CPU [group, FIELDS, LANES]; those added to fill up are silent."""
    count: int
    """Transducers."""
    per_metre: float
    """Wavelengths a metre."""
    directivity: wp.vec4
    """See `driving.wave.Transducers`."""


@wp.func_native(
    WAVE
    + """
#ifdef __CUDA_ARCH__
    const int together = 4;
    float x[together], y[together], z[together], re[together], im[together];
    for (int i = 0; i < together; ++i) {
        const int m = first + i * stride < count ? first + i * stride : first;
        x[i] = points.data[m].c[0]; y[i] = points.data[m].c[1]; z[i] = points.data[m].c[2];
        re[i] = im[i] = 0.0f;
    }
    const float4* row = reinterpret_cast<const float4*>(table.data);
    const int sources = table.shape[0] / 8;
    for (int n = 0; n < sources; ++n) {
        const float4 a = __ldg(row + 2 * n), b = __ldg(row + 2 * n + 1);
        for (int i = 0; i < together; ++i) {
            float u, v;
            wave_at(x[i] - a.x, y[i] - a.y, z[i] - a.z, a.w, b.x, b.y, u, v);
            re[i] = fmaf(u, b.z, fmaf(-v, b.w, re[i]));
            im[i] = fmaf(u, b.w, fmaf(v, b.z, im[i]));
        }
    }
    for (int i = 0; i < together; ++i)
        if (first + i * stride < count) out.data[first + i * stride] = wp::vec_t<2, wp::float32>(re[i], im[i]);
#else
    const float* p = points.data[first].c;
    float sum_re = 0.0f, sum_im = 0.0f;
    for (int k = 0; k < table.shape[0]; k += 8 * 16) {
        const float* t = table.data + k;
        float re[16], im[16];
        for (int n = 0; n < 16; ++n) {  // in vectors
            float u, v;
            wave_at(p[0] - t[n], p[1] - t[16 + n], p[2] - t[32 + n], t[48 + n], t[64 + n], t[80 + n], u, v);
            re[n] = u * t[96 + n] - v * t[112 + n];
            im[n] = u * t[112 + n] + v * t[96 + n];
        }
        for (int n = 0; n < 16; ++n) { sum_re += re[n]; sum_im += im[n]; }
    }
    out.data[first] = wp::vec_t<2, wp::float32>(sum_re, sum_im);
#endif
"""
)
def add_waves(
    points: wp.array[wp.vec3],
    table: wp.array[wp.float32],
    per_metre: float,
    directivity: wp.vec4,
    first: int,
    stride: int,
    count: int,
    out: wp.array[wp.vec2],
):
    """Write the sum of all waves at point `first`; on CUDA also at those 1, 2 and 3 strides after it."""


@wp.func_native(
    WAVE
    + """
#ifdef __CUDA_ARCH__
    const int lanes = 1;
#else
    const int lanes = 16;
#endif
    const float* p = points.data[m].c;
    const float* t = table.data + size_t(group) * 8 * lanes;
    float re[lanes], im[lanes];
    for (int n = 0; n < lanes; ++n)
        wave_at(p[0] - t[n], p[1] - t[lanes + n], p[2] - t[2 * lanes + n], t[3 * lanes + n], t[4 * lanes + n],
            t[5 * lanes + n], re[n], im[n]);
    float* row = out.data + size_t(m) * (out.strides[0] / sizeof(float)) + group * lanes;
    const int some = count - group * lanes < lanes ? count - group * lanes : lanes;
    for (int n = 0; n < some; ++n) {
        row[n] = re[n];
        row[count + n] = im[n];
    }
"""
)
def put_waves(
    points: wp.array[wp.vec3],
    table: wp.array[wp.float32],
    per_metre: float,
    directivity: wp.vec4,
    m: int,
    group: int,
    count: int,
    out: wp.array2d[wp.float32],
):
    """Write the waves of a group of transducers at point m: real parts to out[m, :count], imaginary ones after them."""


@wp.kernel
def _sum_waves(
    points: wp.array[wp.vec3],  # [m]
    table: wp.array[wp.float32],
    per_metre: float,
    directivity: wp.vec4,
    stride: int,  # between the points of a thread
    out: wp.array[wp.vec2],
):
    """Each thread sums all waves at its points."""
    add_waves(points, table, per_metre, directivity, wp.tid(), stride, points.shape[0], out)


@wp.kernel
def _write_waves(
    points: wp.array[wp.vec3],  # [m]
    table: wp.array[wp.float32],
    per_metre: float,
    directivity: wp.vec4,
    count: int,  # transducers
    out: wp.array2d[wp.float32],  # shape [point, 2 transducer or more]
):
    """Each thread makes the waves of one group of transducers at a point."""
    m, group = wp.tid()
    put_waves(points, table, per_metre, directivity, m, group, count, out)


def pack_sources(
    position: np.ndarray,
    normal: np.ndarray,
    drive: np.ndarray | None = None,
    *,
    wavelength: float,
    radius: float,
    device: object,
) -> Sources:
    """Transducers for `sum_waves` and `write_waves`, which needs no drives.

    position [m] and normal (unit), shape [transducer, 3]; drive: complex, shape [transducer]; wavelength [m]; radius of
    the pistons [m], 0 for monopoles.
    """
    lanes = LANES if wp.get_device(device).is_cpu else 1
    count = len(position)
    rows = np.zeros((-(-count // lanes) * lanes, FIELDS), np.float32)
    rows[:count, :3], rows[:count, 3:6] = position, normal
    if drive is not None:
        rows[:count, 6], rows[:count, 7] = drive.real, drive.imag
    table = np.ascontiguousarray(rows.reshape(-1, lanes, FIELDS).transpose(0, 2, 1)).ravel()
    directivity = wp.vec4(*piston_polynomial(2 * np.pi * radius / wavelength))
    return Sources(wp.array(table, device=device), count, 1 / wavelength, directivity)


@on_one_device
def sum_waves(points: wp.array, sources: Sources, *, out: wp.array) -> None:
    """Write the complex pressure of driven transducers at points to `out`, relative to that of one at 1 m.

    points: wp.vec3 [m], common frame, shape [point]. out: wp.vec2, shape [point], on the same device.
    """
    count, device = len(points), out.device
    threads = count if device.is_cpu else -(-count // TOGETHER)
    wp.launch(
        _sum_waves,
        threads,
        inputs=[points, sources.table, sources.per_metre, sources.directivity, threads],
        outputs=[out],
        device=device,
        block_dim=BLOCK,
    )


@on_one_device
def write_waves(points: wp.array, sources: Sources, *, out: wp.array) -> None:
    """Write the complex pressure that each transducer of drive 1 makes at points to `out`, relative to that at 1 m.

    points: wp.vec3 [m], shape [point]. out: float32, shape [point, 2 transducer or more], on the same device: real
    parts, then imaginary ones; what lies beyond both is left as it is.
    """
    device = out.device
    group_count = -(-sources.count // LANES) if device.is_cpu else sources.count
    wp.launch(
        _write_waves,
        (len(points), group_count),
        inputs=[points, sources.table, sources.per_metre, sources.directivity, sources.count],
        outputs=[out],
        device=device,
        block_dim=BLOCK,
    )
