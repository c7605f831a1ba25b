"""Focal points -> frames of an array that takes focal points: float32 x, y, z [m] of its own frame, and intensity."""

from typing import Any

import numpy as np
import warp as wp

from ..one_device import on_one_device
from ..patch import EXACT

wp.set_module_options(EXACT)

POINT_BYTES = 16
THREADS = 128  # of a block of a GPU


@wp.struct
class FocusBoard:
    """Place of an array, and how many focal points a frame of it holds."""

    turn: wp.mat33d  # common frame -> its own
    middle: wp.vec3d  # of its face, common frame [m]
    count: wp.int32
    frame_bytes: wp.int32


@wp.func
def write_number(value: wp.float32, first: int, row: wp.array[wp.uint8]):
    """The four bytes of a number, the least first."""
    bits = wp.cast(value, wp.uint32)
    for k in range(4):
        row[first + k] = wp.uint8(bits >> wp.uint32(8 * k))


@wp.kernel
def _pack_foci(
    # In:
    point: wp.array2d[wp.vec3],  # [m], shape [frame, focus or more]
    target: wp.array2d[wp.float32],  # pressures relative to the greatest of a frame
    amplitude: wp.array[wp.float32],  # of each frame
    board: FocusBoard,
    # Out:
    frame: wp.array2d[wp.uint8],
):
    """A focal point of a frame; those that a frame has beyond its focal points repeat the first, silent."""
    i, m = wp.tid()
    x = point[i, 0]
    intensity = float(0.0)
    if m < point.shape[1]:
        x = point[i, m]
        intensity = amplitude[i] * target[i, m]
    own = board.turn * (wp.vec3d(wp.float64(x[0]), wp.float64(x[1]), wp.float64(x[2])) - board.middle)
    for axis in range(3):
        write_number(wp.float32(own[axis]), m * POINT_BYTES + 4 * axis, frame[i])
    write_number(intensity, m * POINT_BYTES + 12, frame[i])


@on_one_device
def pack_foci(point: wp.array, target: wp.array, amplitude: wp.array, board: FocusBoard, *, out: wp.array) -> None:
    """Write frames of focal points as they are held: vec3 [m] and targets, shape [frame, focus or more], all finite.

    amplitude: 0..1 of each frame, float32. out: uint8, shape [frame, 16 * count]. An intensity is the frame's amplitude
    times the point's target, which is a multiple of 2^-16 where a frame has several points. A position is rounded to
    float32 once; it stays as it is for an array at rest in the origin.
    """
    size = len(out), board.count
    wp.launch(_pack_foci, size, [point, target, amplitude, board], [out], device=out.device, block_dim=THREADS)


def focus_board(pose: np.ndarray, matrix: np.ndarray, count: int) -> Any:
    """An array at a pose, [7], whose frames hold `count` points; matrix: common frame -> its own, shape [3, 3]."""
    board = FocusBoard()
    board.turn, board.middle = wp.mat33d(*np.asarray(matrix, np.float64).ravel().tolist()), wp.vec3d(*pose[:3])
    board.count, board.frame_bytes = count, POINT_BYTES * count
    return board
