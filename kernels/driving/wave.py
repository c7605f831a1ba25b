"""The wave of a transducer at a point, the parameters of an array for it, and sums over the lanes of a warp.

Complex numbers are wp.vec2. Time factor exp(+j w t), so a wave that has come the distance r carries exp(-j k r) / r.
Modules are compiled with EXACT, which forbids fused multiply-adds: where they are wanted, they are asked for by name.
Nothing here decides anything: a last bit that differs between devices moves a phase by a millionth of a turn.
"""

from fractions import Fraction
from math import comb, pi

import numpy as np
import warp as wp

TERMS = 30  # of the Bessel function's series: the last is 1e-47 for ka = 4
LANES = 32  # of a warp: as many threads work on one frame on CUDA; on the CPU, one
TINY = wp.constant(1e-30)


@wp.struct
class Transducers:
    """An array in the frame of the points."""

    position: wp.array[wp.vec3]  # [m]
    normal: wp.array[wp.vec3]  # unit vectors
    per_metre: float  # wavelengths a metre
    directivity: wp.vec4  # relative pressure at angle a off the normal: 1 + polynomial in sin(a)^2, without constant


def transducers_on(
    position: np.ndarray, normal: np.ndarray, *, wavelength: float, radius: float, device: object
) -> Transducers:
    """An array's transducers on a device.

    position [m] and normal (unit), shape [transducer, 3]; wavelength [m]; radius of the pistons [m], 0 for monopoles.
    """
    out = Transducers()
    out.position = wp.array(np.asarray(position, np.float32), dtype=wp.vec3, device=device)
    out.normal = wp.array(np.asarray(normal, np.float32), dtype=wp.vec3, device=device)
    out.per_metre = 1.0 / wavelength
    out.directivity = wp.vec4(*piston_polynomial(2 * pi * radius / wavelength))
    return out


def piston_polynomial(ka: float) -> tuple[float, ...]:
    """Coefficients of s, s^2, s^3, s^4 that with 1 make 2 J1(x) / x, x = ka sqrt(s), s = sin^2 of the angle in 0..1.

    Within 3e-5 for ka <= 4 (a piston of 5 mm at 40 kHz has 3.7). Least squares of the Bessel function's power series
    with Chebyshev's weight on 0..1, whose moments are binomial(2 n, n) / 4^n: in fractions, since a library's solver
    rounds by the processor.
    """
    moment = [Fraction(comb(2 * n, n), 4**n) for n in range(TERMS + 9)]
    series, term = [], Fraction(1)
    for k in range(1, TERMS):
        term *= -((Fraction(ka) / 2) ** 2) / (k * (k + 1))
        series.append(term)
    rows = [
        [moment[i + j] for j in range(1, 5)] + [sum(a * moment[i + k] for k, a in enumerate(series, 1))]
        for i in range(1, 5)
    ]
    for i in range(4):  # by Gauss and Jordan: moments are those of a weight, so no pivot is 0
        rows[i] = [value / rows[i][i] for value in rows[i]]
        for j in range(4):
            if j != i:
                rows[j] = [a - rows[j][i] * b for a, b in zip(rows[j], rows[i], strict=True)]
    return tuple(float(row[4]) for row in rows)


# One formula for both: what differs is how roots and sines are got, and that a fused product is asked for on CUDA.
WAVE = """
#ifdef __CUDA_ARCH__
    const auto fused = [](float a, float b, float c) { return fmaf(a, b, c); };
#else
    const auto fused = [](float a, float b, float c) { return a * b + c; };
    const auto sine_of = [](float u) {  // sin(2 pi u) for |u| <= 1/4 within 3e-7: Taylor to u^11, no call of libm
        const float v = u * u;
        return u * (6.2831853f + v * (-41.341702f + v * (81.605249f + v * (-76.705860f + v * (42.058696f
            + v * -15.094643f)))));
    };
#endif
    const auto wave_at = [&](float x, float y, float z, float nx, float ny, float nz, float& real, float& imaginary) {
        const float square = fused(x, x, fused(y, y, fused(z, z, 1e-12f)));  // never 0: at most 1e6 a metre
#ifdef __CUDA_ARCH__
        const float inverse = rsqrtf(square);
#else
        const float inverse = 1.0f / __builtin_sqrtf(square);
#endif
        const float cosine = fused(x, nx, fused(y, ny, z * nz)) * inverse;
        const float s = fused(-cosine, cosine, 1.0f);
        const float* e = directivity.c;
        const float level = inverse * fused(s, fused(s, fused(s, fused(s, e[3], e[2]), e[1]), e[0]), 1.0f);
        float turns = square * inverse * per_metre;
        turns -= (turns + 12582912.0f) - 12582912.0f;  // 1.5 * 2^23 has no place for a fraction: -1/2..1/2 remains
#ifdef __CUDA_ARCH__
        float sine, other;
        __sincosf(6.28318531f * turns, &sine, &other);
        real = level * other;
        imaginary = -level * sine;
#else
        const float size = turns < 0.0f ? -turns : turns;
        const float folded = size > 0.25f ? 0.5f - size : size;
        real = level * sine_of(0.25f - size);
        imaginary = level * sine_of(turns < 0.0f ? folded : -folded);
#endif
    };
"""


@wp.func_native(
    "#ifdef __CUDA_ARCH__"
    + WAVE
    + """
    wp::vec_t<2, wp::float32> wave;
    wave_at(d.c[0], d.c[1], d.c[2], normal.c[0], normal.c[1], normal.c[2], wave.c[0], wave.c[1]);
    return wave;
#else
    return table.data[(size_t(slot) * table.shape[1] + n) * table.shape[2] + m];
#endif
"""
)
def wave(
    d: wp.vec3,
    normal: wp.vec3,
    per_metre: float,
    directivity: wp.vec4,
    table: wp.array3d[wp.vec2],
    slot: int,
    n: int,
    m: int,
) -> wp.vec2:
    """Complex pressure that a transducer of drive 1 gives at offset d [m] from it, in units of its pressure at 1 m.

    Made on CUDA; on the CPU taken from table[slot, n, m], where `fill_waves` has put it.
    """


@wp.func_native(
    "#ifndef __CUDA_ARCH__"
    + WAVE
    + """
    const int count = position.shape[0], size = table.shape[2];
    wp::vec_t<2, wp::float32>* row = table.data + size_t(slot) * count * size + m;
    for (int first = 0; first < count; first += 16) {
        const int some = count - first < 16 ? count - first : 16;
        float x[16], y[16], z[16], nx[16], ny[16], nz[16], real[16], imaginary[16];
        for (int k = 0; k < 16; ++k) {
            const int n = first + (k < some ? k : 0);
            const float *t = position.data[n].c, *u = normal.data[n].c;
            x[k] = point.c[0] - t[0]; y[k] = point.c[1] - t[1]; z[k] = point.c[2] - t[2];
            nx[k] = u[0]; ny[k] = u[1]; nz[k] = u[2];
        }
        for (int k = 0; k < 16; ++k)  // in vectors
            wave_at(x[k], y[k], z[k], nx[k], ny[k], nz[k], real[k], imaginary[k]);
        for (int k = 0; k < some; ++k)
            row[(first + k) * size] = wp::vec_t<2, wp::float32>(real[k], imaginary[k]);
    }
#endif
"""
)
def fill_waves(
    point: wp.vec3,
    position: wp.array[wp.vec3],
    normal: wp.array[wp.vec3],
    per_metre: float,
    directivity: wp.vec4,
    slot: int,
    m: int,
    table: wp.array3d[wp.vec2],
):
    """On the CPU, write the waves of all transducers at a point to table[slot, :, m]; all arrays are contiguous."""


@wp.func_native("""
#ifdef __CUDA_ARCH__
    return wp::vec_t<2, wp::float32>(
        fmaf(a.c[0], b.c[0], fmaf(-a.c[1], b.c[1], sum.c[0])), fmaf(a.c[0], b.c[1], fmaf(a.c[1], b.c[0], sum.c[1])));
#else
    return wp::vec_t<2, wp::float32>(
        sum.c[0] + (a.c[0] * b.c[0] - a.c[1] * b.c[1]), sum.c[1] + (a.c[0] * b.c[1] + a.c[1] * b.c[0]));
#endif
""")
def plus_product(sum: wp.vec2, a: wp.vec2, b: wp.vec2) -> wp.vec2:
    """The complex sum + a b."""


@wp.func
def conjugate(a: wp.vec2):
    """Complex conjugate."""
    return wp.vec2(a[0], -a[1])


@wp.func_native("""
#ifdef __CUDA_ARCH__
    return rsqrtf(x > 1e-36f ? x : 1e-36f);  // in 2 units of the last place; exact roots and quotients are calls
#else
    return 1.0f / __builtin_sqrtf(x > 1e-36f ? x : 1e-36f);
#endif
""")
def inverse_root(x: float) -> float:
    """1 / sqrt(x), 1e18 at most."""


@wp.func_native("""
#ifdef __CUDA_ARCH__
    return __fdividef(a, b);
#else
    return a / b;
#endif
""")
def quotient(a: float, b: float) -> float:
    """a / b for b < 1e37."""


@wp.func
def direction(a: wp.vec2):
    """a / |a|; 0 for 0."""
    return a * inverse_root(wp.dot(a, a))


@wp.func
def magnitude(a: wp.vec2):
    """|a|; 0 for less than 1e-18."""
    square = wp.dot(a, a)
    return square * inverse_root(square)


@wp.func_native("""
    // atan(z) / 2 pi for 0 <= z <= 1 within 4e-8 turns, an odd polynomial; libm's atan2 is most of a naive solution
    const float x = a.c[0] < 0.0f ? -a.c[0] : a.c[0], y = a.c[1] < 0.0f ? -a.c[1] : a.c[1];
    const float most = x > y ? x : y, z = (x > y ? y : x) / (most > 1e-30f ? most : 1e-30f), v = z * z;
    float turns = z * (0.159154324f + v * (-0.0530262271f + v * (0.0315250267f + v * (-0.0210611997f
        + v * (0.0126719615f + v * (-0.00534784043f + v * 0.00108399452f))))));
    turns = y > x ? 0.25f - turns : turns;
    turns = a.c[0] < 0.0f ? 0.5f - turns : turns;
    turns = a.c[1] > 0.0f ? 1.0f - turns : turns;  // the argument less a turn, with the sign of a delay
    return turns < 1.0f ? turns : 0.0f;
""")
def delay_of(a: wp.vec2) -> float:
    """Delay of the drive a [turns], 0 <= delay < 1: exp(-2 pi j delay) has its argument. 0 for 0."""


@wp.func_native("""
#ifdef __CUDA_ARCH__
    for (int step = 16; step > 0; step >>= 1) {
        x.c[0] += __shfl_xor_sync(0xffffffffu, x.c[0], step);
        x.c[1] += __shfl_xor_sync(0xffffffffu, x.c[1], step);
    }
#endif
    return x;
""")
def lane_sum(x: wp.vec2) -> wp.vec2:
    """Sum over the lanes of a warp, in each of them; on the CPU, whose only lane this is, x. Every lane must call."""
