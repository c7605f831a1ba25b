"""Drives to wire bytes and back to what they do: pure, vectorised. Each board's `Layout` says how."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .array import ArrayModel
from .errors import FrameError
from .registry import array_model, kind_of
from .wire_layout import FocusLayout, Frames, Layout, Numbers

CHUNK_FRAMES = 256  # 256 KiB of float32 at 256 transducers: temporaries stay in the cache


def encode_frames(delay: ArrayLike, amplitude: ArrayLike, *, array: ArrayModel | str = "emulator") -> NDArray[np.uint8]:
    """Encode drives as the frames that a board takes, its calibration applied.

    Args:
        delay: delay of each transducer [turns of the carrier], shape [frame, transducer], 0..1 (1 is 0 again:
            float32 arithmetic rounds up to it). The focus at distance r needs frac(-r / wavelength): the farther
            transducer has the smaller delay.
        amplitude: relative pressure amplitude 0..1, shape [frame] or [frame, transducer]; 0 is off. A sonicsurface
            is on from 0.5; `switched_count` tells how many amplitudes that changes.
        array: the array, or the name of one.

    Returns:
        The wire bytes, shape [frame, frame_bytes].

    Raises:
        FrameError: another shape, or a value that is NaN or out of range, with its index; an array that takes focal
            points.
        UnknownArrayError: no codec for that array.

    >>> import numpy as np
    >>> from palpate.device import array_model, encode_frames
    >>> model = array_model("emulator")
    >>> distance = np.linalg.norm(model.position - [0, 0, 0.2], axis=1)  # [m], from a focus 20 cm above the array
    >>> frames = encode_frames([-distance * model.carrier / 343 % 1], [1.0], array=model)
    >>> frames.shape, frames[0, :2].tolist()  # delay [turns / 256] and level of the transducer that comes first
    ((1, 512), [78, 255])
    """
    model, layout = _resolve(array)
    if isinstance(layout, FocusLayout):
        raise FrameError(f"array {model.name} takes focal points, not delays of transducers: `Driver` makes its frames")
    turns = np.asarray(delay, np.float32)
    level = np.asarray(amplitude, np.float32)
    if turns.ndim != 2 or turns.shape[1] != model.transducer_count:
        raise FrameError(
            f"delay has shape {turns.shape}, but array {model.name} takes [frame, {model.transducer_count}]"
        )
    if level.shape not in (turns.shape[:1], turns.shape):
        raise FrameError(
            f"amplitude has shape {level.shape}, but delay {turns.shape} takes {turns.shape[:1]} or the same"
        )
    require_unit_range("delay", turns, "turns")
    require_unit_range("amplitude", level, "of full pressure")
    level = level[:, None] if level.ndim == 1 else level
    layout.bytes_of(model.frame_bytes, model.transducer_count)  # raises ArrayKindError
    frame = np.tile(layout.fixed_bits(model.frame_bytes), (len(turns), 1))
    for start in range(0, len(turns), CHUNK_FRAMES):
        rows = slice(start, start + CHUNK_FRAMES)
        _pack(turns[rows], level[rows], model, layout, frame[rows])
    return frame


def _pack(turns: Numbers, level: Numbers, model: ArrayModel, layout: Layout, out: Frames) -> None:
    """The same of some frames, added to their fixed bits."""
    order = model.wire_order
    if model.delay_offset.any():
        turns = turns - model.delay_offset
        turns -= np.floor(turns)
    steps = layout.levels.nearest(level if (model.gain == 1).all() else level * model.gain)
    later = (layout.levels.count - steps).astype(np.float32) * np.float32(layout.later) + np.float32(0.5)
    delay = (turns * np.float32(layout.turn) + later).astype(np.uint16)
    if layout.turn & (layout.turn - 1) == 0:
        delay &= np.uint16(layout.turn - 1)
    else:
        delay %= np.uint16(layout.turn)
    if layout.level_at is None:
        delay[np.broadcast_to(steps == 0, delay.shape)] = layout.turn
    else:
        out[:, layout.level_at] |= (steps if steps.shape[1] == 1 else steps[:, order]).astype(np.uint8)
    out[:, layout.delay_at] |= delay[:, order].astype(np.uint8)


def off_frame(*, array: ArrayModel | str = "emulator") -> NDArray[np.uint8]:
    """The frame that silences every transducer, shape [frame_bytes]; any part of it silences what it covers.

    >>> from palpate.device import off_frame
    >>> off_frame(array="emulator")[:4].tolist()  # delay 0, level 0, and so on
    [0, 0, 0, 0]
    >>> off_frame(array="sonicsurface")[:4].tolist()  # a start byte, then 32 for each transducer that is off
    [254, 32, 32, 32]
    """
    model, layout = _resolve(array)
    return layout.off_frame(model.frame_bytes)


def is_emitting(frames: NDArray[np.uint8], *, array: ArrayModel | str = "emulator") -> NDArray[np.bool_]:
    """Which frames, shape [frame, frame_bytes], make any sound; shape [frame]."""
    model, layout = _resolve(array)
    return layout.emitting(_whole(frames, model))


def duty(frames: NDArray[np.uint8], *, array: ArrayModel | str = "emulator") -> NDArray[np.float32]:
    """How hard frames, shape [frame, frame_bytes], drive the array, shape [frame]: a measure of what it heats.

    Width of the pulses in parts of half a period (full drive), mean over all transducers: 0..1. For boards that take
    an amplitude a it is that of the pulse which gives it, 2 / pi asin(a).
    """
    model, layout = _resolve(array)
    return layout.width(_whole(frames, model))


def switched_count(amplitude: ArrayLike, *, array: ArrayModel | str = "emulator") -> int:
    """How many amplitudes between 0 and 1 a board that can only switch turns into 0 or 1; 0 for boards with steps."""
    _, layout = _resolve(array)
    level = np.asarray(amplitude)
    return int(np.count_nonzero((level > 0) & (level < 1))) if layout.is_switch else 0


def _resolve(array: ArrayModel | str) -> tuple[ArrayModel, Layout | FocusLayout]:
    model = array_model(array) if isinstance(array, str) else array
    return model, kind_of(model).layout


def _whole(frames: NDArray[np.uint8], model: ArrayModel) -> NDArray[np.uint8]:
    if frames.dtype != np.uint8 or frames.ndim != 2 or frames.shape[1] != model.frame_bytes:
        raise FrameError(
            f"frames are {frames.dtype} of shape {frames.shape}, but those of array {model.name} are uint8 of "
            f"[frame, {model.frame_bytes}]"
        )
    return frames


def require_unit_range(name: str, value: NDArray[np.float32], unit: str) -> None:
    """Raise FrameError, with the index, for a value outside 0..1."""
    # NaN fails both comparisons of the extremes, so one test finds it too.
    if value.size == 0 or (value.min() >= 0 and value.max() <= 1):
        return
    index = tuple(int(i) for i in np.argwhere(~((value >= 0) & (value <= 1)))[0])
    raise FrameError(f"{name}[{', '.join(map(str, index))}] is {value[index]:g}, outside 0..1 {unit}")
