"""Played frames -> the complex amplitude that each resonant transducer emits, period by period of its carrier.

A transducer is a one-pole low-pass of the envelope: a <- d + z (a - d) once a period, d its drive. Complex numbers have
the time factor exp(+j w t), as in driving/wave.py, so a delay of u turns is the drive exp(-2 pi j u).
Real and imaginary parts are the upper and lower half of one array with time along its rows, so that what follows is
one real matrix product, or a sum along time.
"""

from typing import NamedTuple

import warp as wp

from ..offsets import BLOCK
from ..one_device import on_one_device
from ..patch import EXACT

wp.set_module_options(EXACT)

LANES = 16  # transducers of a thread on the CPU, in vectors; on CUDA, one
CHUNK = wp.constant(512)  # periods that a thread makes; counted from period 0, so that blocks change no bit
SETTLED = 16.0  # nepers by which the past has died away where a thread begins: 1e-7


class DeviceFrames(NamedTuple):
    """Frames as a board plays them, on one device."""

    delay: wp.array  # uint8, shape [frame, transducer], in 1/256 turn
    level: wp.array  # float32, shape [frame]: amplitude 0..1


@wp.func_native("""
    const int count = delay.shape[1], frames = delay.shape[0];
#ifdef __CUDA_ARCH__
    const int lanes = 1;
#else
    const int lanes = 16;
    const auto sine_of = [](float u) {  // sin(2 pi u) for |u| <= 1/4 within 3e-7
        const float v = u * u;
        return u * (6.2831853f + v * (-41.341702f + v * (81.605249f + v * (-76.705860f + v * (42.058696f
            + v * -15.094643f)))));
    };
#endif
    const int base = group * lanes;
    float re[lanes], im[lanes];
    for (int k = 0; k < lanes; ++k) re[k] = im[k] = 0.0f;
    long long start = begin - warm;
    if (start < 0) start = 0;
    const size_t pitch = out.strides[0] / sizeof(float);
    float* real = out.data + size_t(base) * pitch;
    float* imaginary = out.data + size_t(count + base) * pitch;
    for (long long t = start; t < end; ++t) {
        // The frame that is played in this period.
        long long f = static_cast<long long>(static_cast<double>(t) * rate + 1e-6);
        if (f >= frames) f = frames - 1;
        const unsigned char* row = delay.data + size_t(f) * delay.strides[0] + base;
        const float a = level.data[f];
#ifdef __CUDA_ARCH__
        float s, c;
        __sincosf(0.0245436926f * static_cast<float>(static_cast<signed char>(row[0])), &s, &c);
        const float dr = a * c - re[0], di = -a * s - im[0];
        const float r = fmaf(zr, -dr, fmaf(zi, di, a * c)), i = fmaf(zr, -di, fmaf(-zi, dr, -a * s));
        re[0] = r; im[0] = i;
        if (t >= begin) { real[t - origin] = r; imaginary[t - origin] = i; }
#else
        float turns[16];
        const int some = count - base < 16 ? count - base : 16;
        for (int k = 0; k < some; ++k) turns[k] = static_cast<float>(static_cast<signed char>(row[k])) * 0.00390625f;
        for (int k = some; k < 16; ++k) turns[k] = 0.0f;
        for (int k = 0; k < 16; ++k) {  // in vectors
            const float u = turns[k], size = u < 0.0f ? -u : u, folded = size > 0.25f ? 0.5f - size : size;
            const float c = a * sine_of(0.25f - size), s = a * sine_of(u < 0.0f ? folded : -folded);
            const float dr = c - re[k], di = s - im[k];
            re[k] = c - (zr * dr - zi * di);
            im[k] = s - (zr * di + zi * dr);
        }
        if (t >= begin)
            for (int k = 0; k < some; ++k) {
                real[size_t(k) * pitch + (t - origin)] = re[k];
                imaginary[size_t(k) * pitch + (t - origin)] = im[k];
            }
#endif
    }
""")
def respond(
    delay: wp.array2d[wp.uint8],
    level: wp.array[wp.float32],
    rate: wp.float64,
    zr: float,
    zi: float,
    group: int,
    begin: wp.int64,
    end: wp.int64,
    warm: wp.int64,
    origin: wp.int64,
    out: wp.array2d[wp.float32],
):
    """Write the amplitudes of the periods begin..end to out, from rest `warm` periods before."""


@wp.kernel
def _emit_frames(
    delay: wp.array2d[wp.uint8],  # [turn / 256], shape [frame, transducer]
    level: wp.array[wp.float32],  # shape [frame]
    rate: wp.float64,  # frames a period
    pole: wp.vec2,  # z
    begin: wp.int64,  # periods that are wanted
    end: wp.int64,
    warm: wp.int64,  # periods that a thread begins earlier
    origin: wp.int64,  # period of out's first column
    out: wp.array2d[wp.float32],  # shape [2 transducer, period]
):
    """Each thread makes one chunk of periods of its transducers."""
    chunk, group = wp.tid()
    low = (begin / wp.int64(CHUNK) + wp.int64(chunk)) * wp.int64(CHUNK)
    start = wp.max(low, begin)
    stop = wp.min(low + wp.int64(CHUNK), end)
    # From where the chunk begins, though only a part of it may be wanted: the same bits in any block.
    settled = warm + start - low
    respond(delay, level, rate, pole[0], pole[1], group, start, stop, settled, origin, out)


def settling_periods(pole: complex) -> int:
    """Periods before a chunk from which its frames matter: their trace is SETTLED nepers down afterwards."""
    size = abs(pole)
    if size <= 0.0:
        return 0
    from math import ceil, log

    return ceil(SETTLED / -log(size))


@on_one_device
def emit_frames(
    frames: DeviceFrames, *, rate: float, pole: complex, begin: int, end: int, origin: int, out: wp.array
) -> None:
    """Write the amplitudes that transducers emit in the periods begin..end of the carrier to `out`.

    rate: frames a period, 0 < rate <= 1. pole: z, |z| < 1; 0 answers at once. origin: period of out's first column.
    out: float32, shape [2 transducer or more, period]: real parts, then imaginary ones; further rows stay as they are.
    All transducers are at rest before the first frame.
    """
    device = out.device
    group_count = frames.delay.shape[1] if device.is_cuda else -(-frames.delay.shape[1] // LANES)
    chunk_count = -(-end // CHUNK) - begin // CHUNK
    wp.launch(
        _emit_frames,
        (chunk_count, group_count),
        inputs=[
            frames.delay,
            frames.level,
            rate,
            wp.vec2(pole.real, pole.imag),
            begin,
            end,
            settling_periods(pole),
            origin,
        ],
        outputs=[out],
        device=device,
        block_dim=BLOCK,
    )
