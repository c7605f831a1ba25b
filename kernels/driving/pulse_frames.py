"""Focal points, one a frame -> wire bytes of boards that switch their transducers: starts of pulses, then widths."""

from typing import NamedTuple

import numpy as np
import warp as wp

from ..patch import EXACT

wp.set_module_options(EXACT)

PLACES = 16  # transducers of a thread: their starts fill one store of a GPU, and so do their widths
THREADS = 128  # of a block, which writes four frames of 512 bytes, each in one go


@wp.struct
class PulseBoard:
    """Transducers in the order of the wire, as many as a multiple of PLACES."""

    position: wp.array[wp.vec3]  # [m]
    offset: wp.array[wp.float32]  # delay that each has of itself [turns]
    gain: wp.array[wp.float32]  # factor on its amplitude
    level_least: wp.array[wp.float32]  # least amplitude of each width from 1 on
    per_metre: wp.float32  # wavelengths a metre
    turn: wp.float32  # starts in a turn
    mark: wp.int32  # bits of a frame's first byte


@wp.struct
class FocalBox:
    """Where an array can focus, and what it makes of intensities."""

    turn: wp.mat33d  # common frame -> its own
    middle: wp.vec3d  # of its face, common frame [m]
    lateral: wp.float32  # bound of |x| and |y|, own frame [m]
    low: wp.float32  # bounds of z [m]
    high: wp.float32
    intensity_most: wp.float32  # larger ones are refused
    level_most: wp.float32  # amplitude of intensity 1
    is_force: wp.int32  # 1: an intensity is a force, so its root is the pressure


@wp.kernel
def _weigh_points(
    # In:
    point: wp.array[wp.vec3],  # [m]
    intensity: wp.array[wp.float32],
    box: FocalBox,
    # Out:
    level: wp.array[wp.float32],  # amplitude 0..1
    refused: wp.array[wp.int64],  # of one value: points that are silenced
):
    """Amplitude of each focal point; 0 for one that is out of reach, or whose intensity is none."""
    i = wp.tid()
    x = point[i]
    own = box.turn * (wp.vec3d(wp.float64(x[0]), wp.float64(x[1]), wp.float64(x[2])) - box.middle)
    a = wp.abs(wp.float32(own[0]))
    b = wp.abs(wp.float32(own[1]))
    z = wp.float32(own[2])
    value = intensity[i]
    # comparisons with NaN are false
    if a <= box.lateral and b <= box.lateral and z >= box.low and z <= box.high:
        if value >= 0.0 and value <= box.intensity_most:
            value = wp.min(value, 1.0)
            if box.is_force != 0:
                value = wp.sqrt(value)
            level[i] = value * box.level_most
            return
    level[i] = 0.0
    if value != 0.0:
        wp.atomic_add(refused, 0, wp.int64(1))


@wp.func
def width_of(board: PulseBoard, level: wp.float32):
    """Width of the pulse that gives an amplitude: how many are reached."""
    low = int(0)
    high = board.level_least.shape[0]
    while low < high:
        middle = (low + high) // 2
        if level >= board.level_least[middle]:
            low = middle + 1
        else:
            high = middle
    return low


@wp.func
def start_of(board: PulseBoard, point: wp.vec3, place: int, width: int):
    """Start of the pulse of a transducer that focuses at a point."""
    d = point - board.position[place]
    turns = -(wp.sqrt((d[0] * d[0] + d[1] * d[1]) + d[2] * d[2]) * board.per_metre)
    turns -= wp.floor(turns)
    turns -= board.offset[place]
    turns -= wp.floor(turns)
    steps = int(board.turn * turns + wp.float32(board.level_least.shape[0] - width) * 0.5 + 0.5)
    if steps >= int(board.turn):  # at most half a turn beyond
        steps -= int(board.turn)
    return steps


@wp.kernel
def _pack_pulses(
    # In:
    point: wp.array[wp.vec3],  # [m]
    level: wp.array[wp.float32],
    board: PulseBoard,
    # Out:
    frame: wp.array2d[wp.uint8],  # shape [frame, 2 places]
):
    """Start and width of the pulses of 16 transducers of a frame; a silent frame aims at the origin."""
    i, group = wp.tid()
    x = point[i]
    if level[i] == 0.0:  # its point may be none
        x = wp.vec3()
    places = board.position.shape[0]
    whole = width_of(board, level[i])
    for k in range(PLACES):
        place = group * PLACES + k
        width = whole
        if board.gain[place] != 1.0:
            width = width_of(board, level[i] * board.gain[place])
        start = start_of(board, x, place, width)
        if place == 0:
            start = start | board.mark
        frame[i, place] = wp.uint8(start)
        frame[i, places + place] = wp.uint8(width)


class PackedFrames(NamedTuple):
    """Wire bytes."""

    frame: wp.array
    """uint8, shape [frame, frame_bytes]."""
    refused: int
    """Focal points that are silenced."""


def pack_pulses(point: wp.array, intensity: wp.array, board: PulseBoard, box: FocalBox) -> PackedFrames:
    """Frames that focus at points, vec3 [m], with intensities, float32; all on one device, shape [frame].

    Starts are the nearest to the exact ones, within 1e-4 turns for points up to 1 m away. Points out of reach, and
    those with intensities below 0, above `box.intensity_most` or not finite, are silenced and counted.
    Raises ValueError for a number of transducers that is no multiple of PLACES.
    """
    count, places = point.shape[0], board.position.shape[0]
    if places % PLACES:
        raise ValueError(f"transducers must be a multiple of {PLACES}, not {places}")
    device = point.device
    level = wp.empty(count, dtype=wp.float32, device=device)
    refused = wp.zeros(1, dtype=wp.int64, device=device)
    wp.launch(_weigh_points, count, inputs=[point, intensity, box], outputs=[level, refused], device=device)
    frame = wp.empty((count, 2 * places), dtype=wp.uint8, device=device)
    groups = places // PLACES
    wp.launch(
        _pack_pulses, (count, groups), inputs=[point, level, board], outputs=[frame], device=device, block_dim=THREADS
    )
    return PackedFrames(frame, int(refused.numpy()[0]))


def board_on(values: dict[str, np.ndarray], *, per_metre: float, turn: int, mark: int, device: str) -> PulseBoard:
    """A board on a device; values: the arrays of PulseBoard by name."""
    board = PulseBoard()
    board.position = wp.array(values["position"].astype(np.float32), dtype=wp.vec3, device=device)
    for name in ("offset", "gain", "level_least"):
        setattr(board, name, wp.array(values[name].astype(np.float32), dtype=wp.float32, device=device))
    board.per_metre, board.turn, board.mark = per_metre, float(turn), mark
    return board
