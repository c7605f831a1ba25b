"""Drives to wire bytes: pure, vectorised, one layout a board. The layout of `emulator` is told in docs/emulator.md."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import FrameError, UnknownArrayError

CHUNK_FRAMES = 1024  # 1 MiB of float32 at 256 transducers: temporaries stay in the cache


def encode_frames(delay: ArrayLike, amplitude: ArrayLike, *, array: str = "emulator") -> NDArray[np.uint8]:
    """Encode drives as the frames that a board takes.

    Args:
        delay: delay of each transducer [turns of the carrier], shape [frame, transducer], 0..1 (1 is 0 again:
            float32 arithmetic rounds up to it). The focus at distance r needs frac(-r / wavelength): the farther
            transducer has the smaller delay.
        amplitude: relative pressure amplitude 0..1, shape [frame] or [frame, transducer]; 0 is off.
        array: name of the array.

    Returns:
        The wire bytes, shape [frame, frame_bytes].

    Raises:
        FrameError: another shape, or a value that is NaN or out of range, with its index.
        UnknownArrayError: no codec for that array.
    """
    pack, transducer_count, frame_bytes = _layout(array)
    turns = np.asarray(delay, np.float32)
    level = np.asarray(amplitude, np.float32)
    if turns.ndim != 2 or turns.shape[1] != transducer_count:
        raise FrameError(f"delay has shape {turns.shape}, but array {array} takes [frame, {transducer_count}]")
    if level.shape not in (turns.shape[:1], turns.shape):
        raise FrameError(
            f"amplitude has shape {level.shape}, but delay {turns.shape} takes {turns.shape[:1]} or the same"
        )
    _require_unit_range("delay", turns, "turns")
    _require_unit_range("amplitude", level, "of full pressure")
    per_frame = level[:, None] if level.ndim == 1 else level
    frame = np.zeros((len(turns), frame_bytes), np.uint8)
    for start in range(0, len(turns), CHUNK_FRAMES):
        rows = slice(start, start + CHUNK_FRAMES)
        pack(turns[rows], per_frame[rows], frame[rows])
    return frame


def off_frame(*, array: str = "emulator") -> NDArray[np.uint8]:
    """The frame that silences every transducer, shape [frame_bytes]."""
    _, transducer_count, _ = _layout(array)
    return encode_frames(np.zeros((1, transducer_count)), np.zeros(1), array=array)[0]


def _layout(array: str) -> tuple[_Pack, int, int]:
    try:
        return _LAYOUTS[array]
    except KeyError:
        raise UnknownArrayError(f"unknown array {array!r}; known: {', '.join(_LAYOUTS)}") from None


def _require_unit_range(name: str, value: NDArray[np.float32], unit: str) -> None:
    # NaN fails both comparisons of the extremes, so one test finds it too.
    if value.size == 0 or (value.min() >= 0 and value.max() <= 1):
        return
    index = tuple(int(i) for i in np.argwhere(~((value >= 0) & (value <= 1)))[0])
    raise FrameError(f"{name}[{', '.join(map(str, index))}] is {value[index]:g}, outside 0..1 {unit}")


def _serpentine(count: int) -> NDArray[np.intp]:
    """Transducer at each place of the wire: columns from +x to -x, the first from +y down, the next up, in turn."""
    place = np.arange(count * count)
    column, step = place // count, place % count
    row = np.where(column % 2 == 0, count - 1 - step, step)
    return row * count + (count - 1 - column)


def _pack_emulator(delay: NDArray[np.float32], level: NDArray[np.float32], out: NDArray[np.uint8]) -> None:
    # Rounding before the wrap: 255.6 / 256 turns is nearest to a full turn, which is 0.
    out[:, 0::2] = np.rint(delay * 256).astype(np.uint16)[:, _EMULATOR_ORDER] & 0xFF
    full = np.rint(level * 255).astype(np.uint8)
    out[:, 1::2] = full if full.shape[1] == 1 else full[:, _EMULATOR_ORDER]


_EMULATOR_ORDER = _serpentine(16)

_Pack = Callable[[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8]], None]
_LAYOUTS: dict[str, tuple[_Pack, int, int]] = {"emulator": (_pack_emulator, 256, 512)}
