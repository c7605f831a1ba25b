"""Focal points, or delays -> wire bytes of boards that switch their transducers: starts of pulses, then widths."""

from typing import NamedTuple

import numpy as np
import warp as wp

from ..one_device import on_one_device
from ..patch import EXACT
from .weigh import FocalBox, weigh_points

wp.set_module_options(EXACT)

PLACES = 16  # transducers of a thread: their starts fill one store of a GPU, and so do their widths
THREADS = 128  # of a block, which writes four frames of 512 bytes, each in one go


@wp.struct
class PulseBoard:
    """Transducers in the order of the wire, as many as a multiple of PLACES."""

    position: wp.array[wp.vec3]  # [m]
    offset: wp.array[wp.float32]  # delay that each has of itself [turns]
    gain: wp.array[wp.float32]  # factor on its amplitude
    order: wp.array[wp.int32]  # their columns among delays
    level_least: wp.array[wp.float32]  # least amplitude of each width from 1 on
    per_metre: wp.float32  # wavelengths a metre
    turn: wp.float32  # starts in a turn
    mark: wp.int32  # bits of a frame's first byte


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
def start_of(board: PulseBoard, delay: wp.float32, place: int, width: int):
    """Start of the pulse of a transducer from its delay [turns]; the first of a frame is marked."""
    turns = delay - board.offset[place]
    turns -= wp.floor(turns)
    steps = int(board.turn * turns + (wp.float32(board.level_least.shape[0] - width) * 0.5 + 0.5))
    if steps >= int(board.turn):  # at most half a turn beyond
        steps -= int(board.turn)
    if place == 0:
        steps = steps | board.mark
    return wp.uint8(steps)


@wp.func
def width_at(board: PulseBoard, place: int, level: wp.float32, whole: int):
    """Width of a transducer's pulse; whole: that of one without a gain of its own."""
    if board.gain[place] != 1.0:
        return width_of(board, level * board.gain[place])
    return whole


@wp.kernel
def _pack_pulses(
    point: wp.array[wp.vec3],  # [m]
    level: wp.array[wp.float32],
    board: PulseBoard,
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
        width = width_at(board, place, level[i], whole)
        d = x - board.position[place]
        turns = -(wp.sqrt((d[0] * d[0] + d[1] * d[1]) + d[2] * d[2]) * board.per_metre)
        frame[i, place] = start_of(board, turns - wp.floor(turns), place, width)
        frame[i, places + place] = wp.uint8(width)


@wp.kernel
def _pack_delays(
    delay: wp.array2d[wp.float32],  # [turns], 0..1, shape [frame, transducer]
    level: wp.array[wp.float32],
    board: PulseBoard,
    frame: wp.array2d[wp.uint8],  # shape [frame, 2 places]
):
    """Start and width of the pulses of 16 transducers of a frame."""
    i, group = wp.tid()
    places = board.position.shape[0]
    whole = width_of(board, level[i])
    for k in range(PLACES):
        place = group * PLACES + k
        width = width_at(board, place, level[i], whole)
        frame[i, place] = start_of(board, delay[i, board.order[place]], place, width)
        frame[i, places + place] = wp.uint8(width)


@wp.kernel
def _unpack_pulses(
    frame: wp.array2d[wp.uint8],  # of a board without calibration and mark, shape [frame, 2 places]
    board: PulseBoard,
    delay: wp.array2d[wp.uint8],  # [turn / 256], shape [frame, transducer]
    level: wp.array[wp.float32],
):
    """Middle of each pulse, and the amplitude of a frame, all of whose pulses are as wide."""
    i, group = wp.tid()
    places, half = board.position.shape[0], board.level_least.shape[0]
    width = int(frame[i, places])
    for k in range(PLACES):
        place = group * PLACES + k
        middle = (2 * int(frame[i, place]) - (half - width)) * 128 / int(board.turn)
        delay[i, board.order[place]] = wp.uint8(middle & 255)
    if group == 0:
        level[i] = wp.sin(wp.float32(width) * wp.float32(wp.PI) / wp.float32(2 * half))


class RoundedFrames(NamedTuple):
    """Frames as a board plays them, its calibration aside."""

    delay: wp.array
    """[turn / 256], uint8, shape [frame, transducer]."""
    level: wp.array
    """Amplitude 0..1, float32, shape [frame]."""
    refused: int
    """Focal points that are silenced."""


class PackedFrames(NamedTuple):
    """Wire bytes."""

    frame: wp.array
    """uint8, shape [frame, frame_bytes]."""
    refused: int
    """Focal points that are silenced."""


@on_one_device
def pack_pulses(point: wp.array, intensity: wp.array, board: PulseBoard, box: FocalBox) -> PackedFrames:
    """Frames that focus at points, vec3 [m], with intensities, float32; all on one device, shape [frame].

    Starts are the nearest to the exact ones, within 1e-4 turns for points up to 1 m away. Points out of reach, and
    those with intensities below 0, above `box.intensity_most` or not finite, are silenced and counted.
    Raises ValueError for a number of transducers that is no multiple of PLACES.
    """
    level, refused = weigh_points(point, intensity, box)
    return PackedFrames(_packed(_pack_pulses, point, level, board), refused)


@on_one_device
def pack_delays(delay: wp.array, level: wp.array, board: PulseBoard) -> wp.array:
    """Frames, uint8, shape [frame, frame_bytes], of delays and amplitudes on one device.

    delay: [turns], 0..1, float32, shape [frame, transducer]; level: 0..1, float32, shape [frame]. Starts are the
    nearest to the delays. Raises ValueError for a number of transducers that is no multiple of PLACES.
    """
    return _packed(_pack_delays, delay, level, board)


def unpack_pulses(packed: PackedFrames, board: PulseBoard) -> RoundedFrames:
    """What frames of a board without offsets, gains and mark play: delays in the order of `board.order`."""
    count, places = packed.frame.shape[0], board.position.shape[0]
    delay = wp.empty((count, places), dtype=wp.uint8, device=packed.frame.device)
    level = wp.empty(count, dtype=wp.float32, device=packed.frame.device)
    groups, inputs = (count, places // PLACES), [packed.frame, board]
    wp.launch(_unpack_pulses, groups, inputs=inputs, outputs=[delay, level], device=delay.device, block_dim=THREADS)
    return RoundedFrames(delay, level, packed.refused)


def _packed(kernel: wp.Kernel, source: wp.array, level: wp.array, board: PulseBoard) -> wp.array:
    """Frames by a kernel that takes points or delays."""
    count, places = level.shape[0], board.position.shape[0]
    if places % PLACES:
        raise ValueError(f"transducers must be a multiple of {PLACES}, not {places}")
    frame = wp.empty((count, 2 * places), dtype=wp.uint8, device=level.device)
    groups, inputs = places // PLACES, [source, level, board]
    wp.launch(kernel, (count, groups), inputs=inputs, outputs=[frame], device=level.device, block_dim=THREADS)
    return frame


def board_on(values: dict[str, np.ndarray], *, per_metre: float, turn: int, mark: int, device: str) -> PulseBoard:
    """A board on a device; values: the arrays of PulseBoard by name; without `order` that of the wire."""
    board = PulseBoard()
    board.position = wp.array(values["position"].astype(np.float32), dtype=wp.vec3, device=device)
    for name in ("offset", "gain", "level_least"):
        setattr(board, name, wp.array(values[name].astype(np.float32), dtype=wp.float32, device=device))
    order = values.get("order", np.arange(len(values["offset"])))
    board.order = wp.array(order.astype(np.int32), dtype=wp.int32, device=device)
    board.per_metre, board.turn, board.mark = per_metre, float(turn), mark
    return board
