"""Focal points, or delays -> wire bytes of a board whose frames a table describes; and back to what they play.

A delay is made in float32 in one order, ((dx^2 + dy^2) + dz^2) and so on, by additions, products, a root and `floor`
alone, which IEEE 754 rounds in one way, and is rounded to the nearest step, half up. So a focal point has the same
bytes on every processor and GPU: nothing here may be fused or approximated (EXACT; a test reads the code for a GPU).
"""

from typing import Any, NamedTuple

import numpy as np
import warp as wp

from ..one_device import on_one_device
from ..patch import EXACT

wp.set_module_options(EXACT)

PLACES = 16  # transducers of a thread: vectors of a CPU, and a store of a GPU
THREADS = 128  # of a block of a GPU, which writes four frames of 512 bytes, each in one go
Sixteen = wp.types.vector(length=PLACES, dtype=wp.float32)


@wp.struct
class WireBoard:
    """Transducers in the order of the wire, and the bytes of a frame."""

    position: wp.array[wp.vec3]  # [m]; as many as a multiple of PLACES
    offset: wp.array[wp.float32]  # delay that each has of itself [turns], as many
    gain: wp.array[wp.float32]  # factor on its amplitude, as many; empty where all are 1
    column: wp.array[wp.int32]  # of each transducer among delays
    level_least: wp.array[wp.float32]  # least amplitude of each level from 1 on
    level_amplitude: wp.array[wp.float32]  # of each level from 0 on
    delay_bits: wp.array[wp.uint8]  # fixed bits of the byte of each delay, as many as transducers
    level_bits: wp.array[wp.uint8]  # and of each level
    other: wp.array[wp.int32]  # bytes that belong to no transducer
    other_bits: wp.array[wp.uint8]  # what they are
    count: wp.int32  # transducers
    frame_bytes: wp.int32
    delay_begin: wp.int32  # byte of the first delay
    delay_step: wp.int32  # bytes from one to the next
    level_begin: wp.int32
    level_step: wp.int32  # 0: there are none, and at level 0 the delay's byte is `turn`
    per_metre: wp.float32  # wavelengths a metre
    turn: wp.float32  # steps of delay in a turn
    later: wp.float32  # steps by which a pulse starts later for each level that it lacks


@wp.func_native("""
    const wp::vec_t<3, wp::float32>* t = position.data + first;
    wp::vec_t<16, wp::float32> delay;
    for (int k = 0; k < 16; ++k) {  // no call, no branch: in vectors on a CPU
        const float x = point.c[0] - t[k].c[0], y = point.c[1] - t[k].c[1], z = point.c[2] - t[k].c[2];
        const float turns = -(wp::sqrt((x * x + y * y) + z * z) * per_metre);
        delay.c[k] = turns - wp::floor(turns);
    }
    return delay;
""")
def delays_to(point: wp.vec3, position: wp.array[wp.vec3], first: int, per_metre: float) -> Sixteen:
    """Delays [turns], 0..1, with which the waves of 16 transducers from `first` on meet at a point [m]."""


@wp.func_native("""
    wp::vec_t<16, wp::float32> step;
    for (int k = 0; k < 16; ++k) {
        float turns = delay.c[k] - offset.data[first + k];
        turns -= wp::floor(turns);
        const float nearest = wp::floor(turn * turns + (lacks.c[k] * later + 0.5f));
        step.c[k] = nearest < turn ? nearest : nearest - turn;  // at most half a turn beyond
    }
    return step;
""")
def nearest_steps(
    delay: Sixteen, offset: wp.array[wp.float32], first: int, lacks: Sixteen, turn: float, later: float
) -> Sixteen:
    """Steps of 16 delays [turns]; lacks: levels that each transducer lacks to the last one."""


@wp.func
def level_of(board: WireBoard, amplitude: wp.float32):
    """The level that an amplitude gets: how many are reached."""
    low = int(0)
    high = board.level_least.shape[0]
    while low < high:
        middle = (low + high) // 2
        if amplitude >= board.level_least[middle]:
            low = middle + 1
        else:
            high = middle
    return low


@wp.func_native("""
    unsigned char byte[16];
    for (int k = 0; k < 16; ++k)
        byte[k] = (unsigned char)((int)value.c[k] | (int)bits.data[first + k]);
    unsigned char* to = row.data + begin + step * first;
    const int stop = count - first < 16 ? count - first : 16;
    for (int k = 0; k < stop; ++k)
        to[k * step] = byte[k];
""")
def write_bytes(
    value: Sixteen,
    bits: wp.array[wp.uint8],
    begin: int,
    step: int,
    first: int,
    count: int,
    row: wp.array[wp.uint8],
):
    """Write a byte for each of 16 transducers from `first` on, of `count` in all, `step` bytes apart."""


@wp.func
def write_places(
    board: WireBoard, delay: Sixteen, amplitude: wp.float32, whole: wp.float32, first: int, row: wp.array[wp.uint8]
):
    """Write the bytes of 16 transducers; whole: level of one whose gain is 1."""
    most = wp.float32(board.level_least.shape[0])
    level = Sixteen(whole)
    if board.gain.shape[0] > 0:
        for k in range(PLACES):
            level[k] = wp.float32(level_of(board, amplitude * board.gain[first + k]))
    value = nearest_steps(delay, board.offset, first, Sixteen(most) - level, board.turn, board.later)
    if board.level_step == 0:
        for k in range(PLACES):
            if level[k] == 0.0:
                value[k] = board.turn
    else:
        write_bytes(level, board.level_bits, board.level_begin, board.level_step, first, board.count, row)
    write_bytes(value, board.delay_bits, board.delay_begin, board.delay_step, first, board.count, row)


@wp.func
def begin_frame(board: WireBoard, amplitude: wp.float32, group: int, row: wp.array[wp.uint8]):
    """The level of a frame; the thread of its first transducers writes the bytes that belong to none."""
    if group == 0:
        for n in range(board.other.shape[0]):
            row[board.other[n]] = board.other_bits[n]
    return wp.float32(level_of(board, amplitude))


@wp.kernel
def _pack_points(
    point: wp.array[wp.vec3],  # [m]
    amplitude: wp.array[wp.float32],
    board: WireBoard,
    step: int,  # transducers from one sixteen of a thread to the next
    frame: wp.array2d[wp.uint8],
):
    """Bytes of a frame that focuses at a point."""
    i, group = wp.tid()
    whole = begin_frame(board, amplitude[i], group, frame[i])
    for first in range(group * PLACES, board.position.shape[0], step):
        delay = delays_to(point[i], board.position, first, board.per_metre)
        write_places(board, delay, amplitude[i], whole, first, frame[i])


@wp.kernel
def _pack_delays(
    delay: wp.array2d[wp.float32],  # [turns], 0..1, shape [frame, transducer]
    amplitude: wp.array[wp.float32],
    board: WireBoard,
    step: int,  # transducers from one sixteen of a thread to the next
    frame: wp.array2d[wp.uint8],
):
    """Bytes of a frame of these delays."""
    i, group = wp.tid()
    whole = begin_frame(board, amplitude[i], group, frame[i])
    for first in range(group * PLACES, board.position.shape[0], step):
        own = Sixteen()
        for k in range(PLACES):
            own[k] = delay[i, board.column[first + k]]
        write_places(board, own, amplitude[i], whole, first, frame[i])


@wp.kernel
def _focus_delays(
    point: wp.array[wp.vec3],  # [m]
    board: WireBoard,
    step: int,  # transducers from one sixteen of a thread to the next
    delay: wp.array2d[wp.float32],  # [turns], shape [frame, transducer]
):
    """Delays of a frame that focuses at a point."""
    i, group = wp.tid()
    for first in range(group * PLACES, board.position.shape[0], step):
        own = delays_to(point[i], board.position, first, board.per_metre)
        for k in range(PLACES):
            delay[i, board.column[first + k]] = own[k]  # spare transducers repeat the last one


@wp.kernel
def _unpack_frames(
    # In:
    frame: wp.array2d[wp.uint8],  # of a board without offsets, gains and fixed bits
    board: WireBoard,
    # Out:
    delay: wp.array2d[wp.uint8],  # [turn / 256], shape [frame, transducer]
    amplitude: wp.array[wp.float32],
):
    """Middle of each pulse, and the amplitude of a frame, all of whose transducers have one level."""
    i, n = wp.tid()
    most = board.level_least.shape[0]
    step = int(frame[i, board.delay_begin + n * board.delay_step])
    level = int(0)
    if board.level_step > 0:
        level = int(frame[i, board.level_begin + n * board.level_step])
    elif step < int(board.turn):
        level = most
    middle = (wp.float32(step) - wp.float32(most - level) * board.later) * (256.0 / board.turn)
    delay[i, board.column[n]] = wp.uint8(int(wp.floor(middle + 0.5)) & 255)
    if n == 0:
        amplitude[i] = board.level_amplitude[level]


class RoundedFrames(NamedTuple):
    """Frames as boards play them, their calibration aside."""

    delay: wp.array
    """[turn / 256], uint8, shape [frame, transducer]."""
    amplitude: wp.array
    """0..1, float32, shape [frame]."""
    refused: int
    """Focal points that are silenced."""


@on_one_device
def pack_points(point: wp.array, amplitude: wp.array, board: WireBoard, *, out: wp.array) -> None:
    """Write the frames that focus at points, vec3 [m], with amplitudes 0..1, float32; all on one device, shape [frame].

    out: uint8, shape [frame, frame_bytes]. Delays are within 1e-4 turns of exact for points up to 1 m away.
    """
    _launch(_pack_points, [point, amplitude, board], out, board)


@on_one_device
def pack_delays(delay: wp.array, amplitude: wp.array, board: WireBoard, *, out: wp.array) -> None:
    """Write the frames of delays and amplitudes on one device to `out`, uint8, shape [frame, frame_bytes].

    delay: [turns], 0..1, float32, shape [frame, transducer]; amplitude: 0..1, float32, shape [frame].
    """
    _launch(_pack_delays, [delay, amplitude, board], out, board)


@on_one_device
def focus_delays(point: wp.array, board: WireBoard, *, out: wp.array) -> None:
    """Write the delays [turns], 0..1, that focus at points, vec3 [m], shape [frame], to the board's columns of `out`.

    out: float32, shape [frame, transducer]. They are the delays of `pack_points`.
    """
    _launch(_focus_delays, [point, board], out, board)


@on_one_device
def unpack_frames(frame: wp.array, board: WireBoard, *, delay: wp.array, amplitude: wp.array) -> None:
    """Write what frames play: delays [turn / 256], uint8, to the board's columns of `delay`, and amplitudes [frame].

    The board has neither offsets, gains nor fixed bits, and all transducers of a frame have one level.
    """
    size = len(frame), board.count
    wp.launch(_unpack_frames, size, [frame, board], [delay, amplitude], device=frame.device, block_dim=THREADS)


def _launch(kernel: wp.Kernel, inputs: list[Any], out: wp.array, board: WireBoard) -> None:
    # a thread of a CPU makes a whole frame, whose level it looks up once; one of a GPU 16 transducers
    groups = 1 if out.device.is_cpu else board.position.shape[0] // PLACES
    wp.launch(kernel, (len(out), groups), [*inputs, groups * PLACES], [out], device=out.device, block_dim=THREADS)


def board_on(
    position: np.ndarray,
    column: np.ndarray,
    *,
    offset: np.ndarray,
    gain: np.ndarray,
    levels: tuple[np.ndarray, np.ndarray],
    delay_at: range,
    level_at: range | None,
    fixed: np.ndarray,
    per_metre: float,
    turn: int,
    later: float,
    device: Any,
) -> WireBoard:
    """A board on a device; arrays and numbers as `WireBoard` has them, without spare transducers; gain: of each.

    levels: least amplitude of each level from 1 on, and amplitude of each from 0 on. delay_at, level_at: bytes of a
    frame, in steps of 1 or more, in the order of transducers; None: no levels. fixed: bits of all bytes, shape
    [frame_bytes]. Raises ValueError for bytes that are not as many as transducers or not in a frame, and for numbers of
    steps and levels that a byte cannot hold.
    """
    count, frame_bytes = len(position), len(fixed)
    if not 1 <= turn <= 256 or not 1 <= len(levels[0]) <= 255:
        raise ValueError(f"a turn must have 1..256 steps and 1..255 levels, not {turn} and {len(levels[0])}")
    for name, at in (("delays", delay_at), ("levels", level_at)):
        if at is not None and (len(at) != count or at.step < 1 or not 0 <= at[0] <= at[-1] < frame_bytes):
            raise ValueError(f"{name} of {count} transducers must be in a frame of {frame_bytes} bytes, not at {at}")
    if later * len(levels[0]) > turn / 2:
        raise ValueError(f"pulses that start {later:g} steps later for each of {len(levels[0])} levels leave a turn")
    spare, used = -count % PLACES, [*delay_at, *(level_at or ())]
    board, device = WireBoard(), wp.get_device(device)

    def padded(values: np.ndarray, kind: type) -> wp.array:  # spare transducers repeat the last one
        return wp.array(np.pad(values, (0, spare), "edge"), dtype=kind, device=device)

    board.position = wp.array(np.pad(position, ((0, spare), (0, 0)), "edge"), dtype=wp.vec3, device=device)
    board.column, board.offset = padded(column, wp.int32), padded(offset, wp.float32)
    if (gain != 1).any():
        board.gain = padded(gain, wp.float32)
    board.level_least, board.level_amplitude = (wp.array(own, dtype=wp.float32, device=device) for own in levels)
    board.delay_bits = padded(fixed[list(delay_at)], wp.uint8)
    board.level_bits = padded(fixed[list(delay_at if level_at is None else level_at)], wp.uint8)
    other = np.setdiff1d(np.arange(frame_bytes), used)
    board.other = wp.array(other, dtype=wp.int32, device=device)
    board.other_bits = wp.array(fixed[other], dtype=wp.uint8, device=device)
    board.count, board.frame_bytes = count, frame_bytes
    board.delay_begin, board.delay_step = delay_at.start, delay_at.step
    board.level_begin, board.level_step = (0, 0) if level_at is None else (level_at.start, level_at.step)
    board.per_metre, board.turn, board.later = per_metre, float(turn), later
    return board
