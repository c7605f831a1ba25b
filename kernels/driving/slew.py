"""Delays of consecutive frames: their common phase locked from frame to frame, their changes limited."""

import numpy as np
import warp as wp

from ..offsets import BLOCK
from ..one_device import on_one_device
from ..patch import EXACT
from .wave import LANES, delay_of, lane_sum

wp.set_module_options(EXACT)

CHUNK = 1024  # frames that a thread limits on CUDA, supposing at first that the frame before has been reached


@wp.func
def sine_of(turns: float):
    """sin(2 pi turns) for |turns| <= 1/4 within 3e-7, by its series to the eleventh power: no library rounds it."""
    v = turns * turns
    series = -76.705860 + v * (42.058696 + v * -15.094643)
    return turns * (6.2831853 + v * (-41.341702 + v * (81.605249 + v * series)))


@wp.kernel
def _measure_turns(delay: wp.array2d[wp.float32], before: wp.array[wp.float32], lanes: int, turn: wp.array[wp.float32]):
    """Phase of each frame relative to the frame before: argument of <before, frame> [turns]."""
    frame = wp.tid() // lanes
    lane = wp.tid() % lanes
    along = wp.vec2()
    for n in range(lane, delay.shape[1], lanes):
        last = before[n]
        if frame > 0:
            last = delay[frame - 1, n]
        # exp(-2 pi j change): angles of -1/2..1/2 turn, folded to -1/4..1/4 for the series
        change = delay[frame, n] - last
        change -= wp.rint(change)
        size = wp.abs(change)
        sine = sine_of(wp.where(size > 0.25, 0.5 - size, size))
        along += wp.vec2(sine_of(0.25 - size), wp.where(change < 0.0, sine, -sine))
    along = lane_sum(along)
    if lane == 0:
        turn[frame] = -delay_of(along)


@wp.kernel
def _turn_frames(turn: wp.array[wp.float32], delay: wp.array2d[wp.float32]):
    """Add a turn to every delay of a frame."""
    frame, n = wp.tid()
    d = delay[frame, n] + turn[frame]
    delay[frame, n] = d - wp.floor(d)


@on_one_device
def lock_gauge(delay: wp.array, *, before: wp.array, turned: float) -> float:
    """Turn each frame as a whole so that it is in phase with the one before: sum |change|^2 is then least.

    delay: of each transducer [turns], float32, shape [frame, transducer]; changed in place to 0..1. before: the frame
    before the first, as it was before it was turned, shape [transducer]. turned: by how much it was turned [turns].
    Returns by how much the last one was turned. Waits for the device: turns are summed in float64 in order, so that
    frames come out the same in blocks of any size.
    """
    frame_count, device = delay.shape[0], delay.device
    if frame_count == 0:
        return turned
    lanes = 1 if device.is_cpu else LANES
    turn = wp.empty(frame_count, dtype=wp.float32, device=device)
    inputs = [delay, before, lanes]
    wp.launch(_measure_turns, frame_count * lanes, inputs, [turn], device=device, block_dim=BLOCK)
    total = np.cumsum(np.concatenate([[turned], turn.numpy()], dtype=np.float64))[1:]
    turn.assign((total % 1.0).astype(np.float32))
    wp.launch(_turn_frames, delay.shape, [turn], [delay], device=device, block_dim=BLOCK)
    return float(total[-1])


class Gauge:
    """Common phase of consecutive frames, locked block after block (`lock_gauge`).

    A frame depends on the frames before it, not on their division into blocks.
    """

    def __init__(self) -> None:
        self._before: wp.array | None = None  # last frame before it was turned [turns], shape [1, transducer]
        self._turned = 0.0  # how far it was turned [turns]

    def lock(self, delay: wp.array) -> None:
        """Turn the next frames in place: delays [turns], float32, shape [frame, transducer], one frame at least."""
        last = wp.clone(delay[-1:])
        before = wp.clone(delay[:1]) if self._before is None else self._before
        self._turned = lock_gauge(delay, before=before.flatten(), turned=self._turned)
        self._before = last


@wp.kernel
def _limit_slew(
    target: wp.array2d[wp.float32],
    before: wp.array[wp.float32],
    step: float,
    chunk: int,
    repairs: int,  # 1: chunks have been limited; take the end of the one before as it is now, and stop where they meet
    delay: wp.array2d[wp.float32],
    changed: wp.array[wp.int32],
):
    """Follow the targets of one transducer through a chunk of frames, by `step` a frame at most, the short way."""
    part, n = wp.tid()
    first = part * chunk
    now = before[n]
    if part > 0:
        now = target[first - 1, n]
        if repairs == 1:
            now = delay[first - 1, n]
    elif repairs == 1:
        return
    for frame in range(first, wp.min(first + chunk, target.shape[0])):
        wanted = target[frame, n]
        apart = wanted - now
        apart -= wp.floor(apart + 0.5)
        if wp.abs(apart) <= step:
            now = wanted
        else:
            now += wp.where(apart > 0.0, step, -step)
            now -= wp.floor(now)
        if repairs == 1:
            if now == delay[frame, n]:
                return
            changed[0] = 1
        delay[frame, n] = now


@on_one_device
def limit_slew(target: wp.array, *, before: wp.array, step: float) -> wp.array:
    """Delays that follow their targets by at most `step` [turns] a frame, the short way round.

    target: [turns], 0..1, float32, shape [frame, transducer]. before: delays of the frame before, shape [transducer].
    Returns the same shape, 0..1. A transducer that is within a step of its target takes it exactly, so whatever it did
    before is forgotten: on CUDA all chunks of frames start at once, as if the target before them had been reached, and
    those for which it had not are repaired until none changes. The result is that of one frame after the other.
    """
    frame_count, transducer_count = target.shape
    delay, device = wp.empty_like(target), target.device
    if frame_count == 0:
        return delay
    chunk = frame_count if device.is_cpu else CHUNK
    parts = -(-frame_count // chunk)
    changed = wp.zeros(1, dtype=wp.int32, device=device)
    for repairs in range(parts + 1):
        changed.zero_()
        wp.launch(
            _limit_slew,
            (parts, transducer_count),
            inputs=[target, before, step, chunk, min(repairs, 1)],
            outputs=[delay, changed],
            device=device,
            block_dim=BLOCK,
        )
        if parts == 1 or (repairs and not changed.numpy()[0]):
            break
    return delay
