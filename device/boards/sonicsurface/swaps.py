"""Frames to a SonicSurface faster than its line carries them: it holds one pattern and off, and a byte swaps them."""

from __future__ import annotations

from array import array
from collections import deque
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...clock import Clock
from ...errors import UpdateRateError
from ...link import never
from ...transports.serial_line import SerialPort
from ...transports.serial_transport import SerialTransport

_START, _SWAP = 0xFE, 0xFD
_OFF = 32
_FILLER: Final = _START  # a start that no data follow changes nothing, on any of the published firmwares


class _Span(NamedTuple):
    """Bytes of the line that stand for bytes of frames."""

    line: int
    """First byte on the line, counted from the transport's making."""
    line_bytes: int
    frames: int
    """First byte of frames, counted likewise."""
    frame_bytes: int


class SwapTransport(SerialTransport):
    """A transport that takes whole frames, and sends a byte that swaps the board's two buffers where they change.

    With `slot_bytes` bytes of the line for each frame, frames come at the line's byte rate / `slot_bytes`. The board's
    buffers must both be off when `slot_bytes` is set. The first frame that emits is then sent whole, which takes 257
    bytes of the line more; every later one must be the same, or off. Bytes that are no whole number of frames hide
    the pattern, then go out as they are. All counts of bytes are of frames, and so is `window_bytes`.

    Args:
        port, baud, who, clock: as for `SerialTransport`.
        frame_bytes: of a whole frame.
    """

    def __init__(
        self, port: SerialPort, baud: int, *, frame_bytes: int, who: str = "", clock: Clock | None = None
    ) -> None:
        super().__init__(port, baud, who=who, clock=clock)
        self._frame_bytes = frame_bytes
        self._slot_bytes = frame_bytes
        self._spans: deque[_Span] = deque()
        self._pattern: NDArray[np.uint8] | None = None  # the frame whose pattern one of the board's buffers holds
        self._shown = False

    @property
    def slot_bytes(self) -> int:
        """Bytes of the line for each frame; those of a frame: frames are sent as they are."""
        return self._slot_bytes

    @slot_bytes.setter
    def slot_bytes(self, value: int) -> None:
        self._slot_bytes = value
        self._pattern, self._shown = None, False

    @property
    def bytes_taken(self) -> int:
        """Bytes of frames whose bytes of the line have left."""
        taken = super().bytes_taken
        while len(self._spans) > 1 and self._spans[1].line <= taken:
            self._spans.popleft()
        return self._frame_byte(taken)

    @property
    def bytes_under_way(self) -> int:
        """Bytes of frames submitted whose bytes of the line have not left; raises nothing."""
        taken = super().bytes_taken  # first: the line's own count of what is under way shrinks between two looks
        return self._frame_byte(self._written) - self._frame_byte(taken)

    def submit(self, data: array[int], *, abandon: Callable[[], bool] = never) -> None:
        """Send whole frames as swaps, or other bytes as they are.

        Raises `UpdateRateError` for a frame that emits another pattern than the first one that did.
        """
        wire = self._as_it_is(data) if self._is_sent_as_it_is(data) else self._swaps(data)
        start = self._written
        self._spans.append(_Span(start, len(wire), self._frame_byte(start), len(data)))
        super().submit(wire, abandon=abandon)

    def _line_window(self) -> int | None:
        """Most bytes of the line to have on the way."""
        return None if self.window_bytes is None else self.window_bytes // self._frame_bytes * self._slot_bytes

    def _is_sent_as_it_is(self, data: array[int]) -> bool:
        return self._slot_bytes == self._frame_bytes or len(data) % self._frame_bytes != 0

    def _as_it_is(self, data: array[int]) -> array[int]:
        """The bytes themselves, after a swap that hides a pattern which is shown: they take longer than it."""
        hides, self._shown = self._shown, False
        return array("B", [_SWAP]) + data if hides else data

    def _frame_byte(self, line_byte: int) -> int:
        """How many bytes of frames stand before a byte of the line."""
        for span in reversed(self._spans):
            if line_byte >= span.line:
                done = min(line_byte - span.line, span.line_bytes)
                return span.frames + done * span.frame_bytes // max(span.line_bytes, 1)
        return 0

    def _swaps(self, data: array[int]) -> array[int]:
        """What makes the board show these frames, one slot each."""
        frames = np.frombuffer(data, np.uint8).reshape(-1, self._frame_bytes)
        on = np.asarray((frames[:, 1:-1] < _OFF).any(axis=1))
        wire = array("B")
        for frame in frames[on][: self._pattern is None]:
            self._pattern = frame.copy()
            wire.frombytes(frame[:-1].tobytes())
        if (frames[on] != self._pattern).any():
            raise UpdateRateError("a board that alternates between one pattern and off was sent another pattern")
        before = np.append(self._shown, on[:-1])
        slots = np.full((len(frames), self._slot_bytes), _FILLER, np.uint8)
        slots[on != before, 0] = _SWAP
        self._shown = bool(on[-1])
        wire.frombytes(slots.tobytes())
        return wire
