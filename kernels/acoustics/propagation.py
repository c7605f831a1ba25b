"""Complex signals of transducers -> signals at other places: one real matrix product."""

import numpy as np
import warp as wp

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
