"""A stream of frames over a transport: what links to boards on a bulk endpoint have in common."""

from __future__ import annotations

from array import array
from collections.abc import Callable

from ..array import ArrayModel
from ..clock import Clock, MonotonicClock
from ..link import Link, never
from .pyusb import UsbDevice, dispose
from .transport import Transport

PIECE_BYTES = 1 << 16
WINDOW_DURATION = 0.05  # [s] of frames under way at most: how late the host may be, and what a stop cancels
PIECE_DURATION = 0.1  # [s] of frames in one submit at most: well below the second after which a device counts as hung


class StreamLink(Link):
    """A link whose frames go through a transport.

    A board's own link derives from it and adds `start`, and `status` and `clear` if the board can. Its `start` ends
    with `expect_frames(divider)`. Not for several threads at once; a player uses it from one.

    Args:
        model: the array.
        transport: the way to its endpoint.
        off: the frame that silences it, as sent by `send_off`.
        serial: its serial number.
        clock: the clock that it runs by; None is real time.
        device: pyusb's device, which `close` disposes of.

    >>> from array import array
    >>> from palpate.device import VirtualClock, array_model, off_frame, open_link
    >>> with open_link(array_model("emulator"), clock=VirtualClock()) as link:  # a `UsbLink`, which derives from it
    ...     link.start(4)
    ...     link.write(array("B", off_frame().tobytes() * 3))
    ...     link.bytes_sent, link.torn_bytes  # whole frames of 512 bytes
    (1536, 0)
    """

    def __init__(
        self,
        model: ArrayModel,
        transport: Transport,
        off: bytes,
        *,
        serial: str | None = None,
        clock: Clock | None = None,
        device: UsbDevice | None = None,
    ) -> None:
        if len(off) != model.frame_bytes:
            raise ValueError(f"the off frame has {len(off)} bytes, but a frame of {model.name} {model.frame_bytes}")
        self.array = model
        self.serial = serial
        self.clock: Clock = clock or MonotonicClock()
        self._device = device
        self._transport = transport
        self._off = off
        self._boundary: int | None = None  # bytes taken at some boundary of frames; None: only the board knows
        self._piece_bytes = PIECE_BYTES // model.frame_bytes * model.frame_bytes

    @property
    def transport(self) -> str:
        """Name of the transport."""
        return self._transport.name

    @property
    def bytes_sent(self) -> int:
        """Bytes that the array is known to have taken since the link was opened."""
        return self._transport.bytes_taken

    @property
    def bytes_under_way(self) -> int:
        """Bytes handed over whose fate is not known yet; looks for what has arrived in the meantime."""
        return self._transport.bytes_under_way

    @property
    def short_writes(self) -> int:
        """Transfers since then that took less than was offered, or nothing, and were continued."""
        return self._transport.short_writes

    @property
    def is_exact(self) -> bool:
        """Whether `bytes_sent` is exact once nothing is under way; else a lower bound: a blocking write failed."""
        return self._transport.is_exact

    @property
    def off_bytes(self) -> bytes:
        """Wire bytes that end a content: the array is off once they have played."""
        return self._off * self.off_frames

    @property
    def torn_bytes(self) -> int | None:
        """Bytes taken of an incomplete frame, while nothing is under way; None: only the board may know."""
        if self._boundary is None or not self._transport.is_exact:
            return None
        return (self._transport.bytes_taken - self._boundary) % self.array.frame_bytes

    def expect_frames(self, divider: int) -> None:
        """The board is at a boundary of frames now, and gets whole frames at this divider from here on."""
        frames = max(1, int(PIECE_DURATION * self.array.update_rate(divider)))
        self._piece_bytes = min(frames, max(1, PIECE_BYTES // self.array.frame_bytes)) * self.array.frame_bytes
        self._transport.window_bytes = int(WINDOW_DURATION * self.array.update_rate(divider)) * self.array.frame_bytes
        self.note_torn_bytes()

    def note_torn_bytes(self, torn: int = 0) -> None:
        """Note that the board has `torn` bytes of an incomplete frame now: it said so, or was made to."""
        self._transport.is_exact = True  # whoever calls this knows how much was taken
        self._boundary = self._transport.bytes_taken - torn

    def write(self, data: array[int], *, abandon: Callable[[], bool] = never) -> None:
        """Send whole frames: return once they are under way, or taken; wait while there is no room for them.

        Args:
            data: the bytes. Only an array("B") passes through without an element-wise copy, and as it is if it has
                no more than 64 KiB and 0.1 s of frames. It must not change until it is taken.
            abandon: asked at least every 50 ms while waiting; once it holds, the rest is not sent.

        Raises:
            DeviceTimeoutError: the array took nothing for about a second.
            LinkError: whatever else happened, to these bytes or to earlier ones.
        """
        if len(data) <= self._piece_bytes:
            self._transport.submit(data, abandon=abandon)
            return
        for start in range(0, len(data), self._piece_bytes):
            self._transport.submit(data[start : start + self._piece_bytes], abandon=abandon)
            if abandon():
                return

    def drain(self, *, abandon: Callable[[], bool] = never) -> bool:
        """Wait until nothing is under way; False if abandoned."""
        return self._transport.drain(abandon=abandon)

    def cancel(self) -> None:
        """End what is under way; then `bytes_sent` is exact, and the last frame may be torn."""
        self._transport.cancel()

    def send_off(self) -> None:
        """Off now: cancel what is under way, complete a torn frame, its missing part silent, then `off_bytes`."""
        self._transport.cancel()
        torn = self.torn_bytes
        rest = self.rest_if_count_is_lost() if torn is None else self._rest(torn)
        self._transport.submit(array("B", rest + self.off_bytes))
        self._transport.drain()
        self.note_torn_bytes()

    def rest_if_count_is_lost(self) -> bytes:
        """What completes a torn frame, its missing part silent, when the host has lost count of it.

        Here the board is asked; one that cannot be is sent nothing.
        """
        status = self.status()
        return self._rest(status.torn_bytes if status else 0)

    def close(self) -> None:
        """Let go of the array; nothing happens if it is gone. What it plays, it goes on playing."""
        self._transport.close()
        if self._device is not None:
            dispose(self._device)

    def _rest(self, torn: int) -> bytes:
        return self._off[torn:] if torn else b""
