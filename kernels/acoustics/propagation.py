"""Complex signals of transducers -> signals at other places, and their power where each arrives with its own lag."""

import numpy as np
import warp as wp

from ..offsets import BLOCK
from ..one_device import on_one_device
from ..patch import EXACT

wp.set_module_options(EXACT)

ROWS, COLUMNS, DEPTH = 64, 64, 32  # of a tile; all shapes are padded up to them
THREADS = 128  # of a block: 29 TFLOP/s on an H200, where 256 for tiles of 64 x 128 x 16 reach 20


@wp.kernel
def _propagate_signals(
    matrix: wp.array2d[wp.float32],  # shape [row, signal]
    signal: wp.array2d[wp.float32],  # shape [signal, column]
    out: wp.array2d[wp.float32],  # shape [row, column]
):
    """A block of threads makes one tile of the product."""
    i, j = wp.tid()
    total = wp.tile_zeros(shape=(ROWS, COLUMNS), dtype=float)
    for k in range(matrix.shape[1] // DEPTH):
        left = wp.tile_load(matrix, shape=(ROWS, DEPTH), offset=(i * ROWS, k * DEPTH))
        right = wp.tile_load(signal, shape=(DEPTH, COLUMNS), offset=(k * DEPTH, j * COLUMNS))
        wp.tile_matmul(left, right, total)
    wp.tile_store(out, total, offset=(i * ROWS, j * COLUMNS))


def wave_rows(waves: np.ndarray) -> np.ndarray:
    """The real matrix of complex waves, shape [place, transducer]: float32, shape [2 place, 2 transducer].

    It takes real parts, then imaginary ones, of transducers to those of places.
    """
    return np.block([[waves.real, -waves.imag], [waves.imag, waves.real]]).astype(np.float32)


@on_one_device
def propagate_signals(matrix: wp.array, signal: wp.array, *, out: wp.array) -> None:
    """Write matrix @ signal to `out`: float32, shapes [row, signal], [signal, column], [row, column].

    On CUDA rows must be multiples of ROWS, signals of DEPTH, columns of COLUMNS. On the CPU this is NumPy's product,
    as its BLAS is made for that.
    """
    device = out.device
    if device.is_cpu:
        np.matmul(matrix.numpy(), signal.numpy(), out=out.numpy())
        return
    sizes = (out.shape[0] % ROWS, signal.shape[0] % DEPTH, out.shape[1] % COLUMNS)
    if any(sizes):
        raise ValueError(f"shapes {matrix.shape}, {signal.shape} must be multiples of {(ROWS, DEPTH, COLUMNS)}")
    wp.launch_tiled(
        _propagate_signals,
        dim=(out.shape[0] // ROWS, out.shape[1] // COLUMNS),
        inputs=[matrix, signal],
        outputs=[out],
        block_dim=THREADS,
        device=device,
    )


@wp.func_native("""
    const int count = lag.shape[0];
    const size_t pitch = signal.strides[0] / sizeof(float);
#ifdef __CUDA_ARCH__
    float sum = 0.0f;
    for (int n = 0; n < count; ++n) {
        const float* re = signal.data + size_t(n) * pitch + column - lag.data[n];
        const float* im = re + size_t(count) * pitch;
        const float near = re[0] * re[0] + im[0] * im[0], far = re[-1] * re[-1] + im[-1] * im[-1];
        sum += weight.data[n].c[0] * near + weight.data[n].c[1] * far;
    }
    out.data[column - skip] = sum;
#else
    float sum[64], power[65];
    const int some = columns - column < 64 ? columns - column : 64;
    for (int k = 0; k < 64; ++k) sum[k] = 0.0f;
    for (int n = 0; n < count; ++n) {
        const float* re = signal.data + size_t(n) * pitch + column - lag.data[n] - 1;
        const float* im = re + size_t(count) * pitch;
        for (int k = 0; k < some + 1; ++k) power[k] = re[k] * re[k] + im[k] * im[k];
        const float near = weight.data[n].c[0], far = weight.data[n].c[1];
        for (int k = 0; k < some; ++k) sum[k] += near * power[k + 1] + far * power[k];
    }
    for (int k = 0; k < some; ++k) out.data[column - skip + k] = sum[k];
#endif
""")
def add_powers(
    signal: wp.array2d[wp.float32],
    lag: wp.array[wp.int32],
    weight: wp.array[wp.vec2],
    column: int,
    columns: int,
    skip: int,
    out: wp.array[wp.float32],
):
    """Write out[column - skip], on the CPU 64 of them."""


@wp.kernel
def _sum_late_power(
    signal: wp.array2d[wp.float32],  # shape [2 source, column]
    lag: wp.array[wp.int32],  # whole periods, shape [source]
    weight: wp.array[wp.vec2],  # of the power `lag` periods ago, and one period earlier
    skip: int,  # columns that are only looked back at
    columns: int,
    stride: int,  # columns of a thread
    out: wp.array[wp.float32],  # shape [column - skip]
):
    """Each thread sums all sources for its columns."""
    add_powers(signal, lag, weight, skip + wp.tid() * stride, columns, skip, out)


def split_lags(lag: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lags >= 0 in periods as whole ones, int32, and weights of the two periods between which each lies."""
    whole = np.floor(lag)
    part = lag - whole
    return whole.astype(np.int32), np.stack([weight * (1 - part), weight * part], axis=1).astype(np.float32)


@on_one_device
def sum_late_power(signal: wp.array, lag: wp.array, weight: wp.array, *, skip: int, out: wp.array) -> None:
    """Write sum_n weight_n |signal_n(t - lag_n)|^2, linear between periods, to `out`, for columns from `skip` on.

    signal: float32, shape [2 source, column]: real parts, then imaginary ones. lag, weight: of `split_lags`, int32 and
    wp.vec2, shape [source]. skip: more than every lag. out: float32, one for each column that is wanted.
    """
    stride = 1 if signal.device.is_cuda else 64
    columns = skip + out.shape[0]
    wp.launch(
        _sum_late_power,
        -(-out.shape[0] // stride),
        inputs=[signal, lag, weight, skip, columns, stride],
        outputs=[out],
        device=signal.device,
        block_dim=BLOCK,
    )
