"""The link to a UCL/OpenMPD board: frames through an FT232H; the board never answers (docs/guide/boards.md)."""

from __future__ import annotations

from array import array
from collections.abc import Callable
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ...array import ArrayModel
from ...array_kind import LinkRequest
from ...clock import Clock
from ...codec import off_frame
from ...errors import CalibrationError, DeviceTimeoutError, UpdateRateError
from ...link import never
from ...transports.bulk import open_transport, usb_backend
from ...transports.lookup import emulated_clock
from ...transports.stream import StreamLink
from ...transports.transport import Transport
from .ftdi import BULK_OUT, FtdiPort

_MARK = 0x80
_DIVIDER_BYTE, _LOAD_BYTE = 26, 34  # the layout is a table in `kind`

_LATENCY_MS = 2
_SLOWEST = 255
_HOLD_DIVIDER = _SLOWEST  # 6.4 ms: the chip passes a burst of 28 frames in 2 ms

# The board clears its FIFO once it has held fewer than 512 bytes for a second, and then each further second.
_QUIET_MOST_NS = 800_000_000  # without bytes for no longer, no clear can fall into what is written next
_CLEAR_NS = 1_050_000_000  # without bytes for as long, the FIFO has been cleared
_NEXT_CLEAR_NS = 1_950_000_000  # after the first byte of a realignment: what is written later may meet a second clear
_SLOWEST_BLOCK = 256  # carrier periods: what the board makes of divider 0, which a torn frame may have loaded
_REALIGN_ATTEMPTS = 3


def with_divider(frames: NDArray[np.uint8], divider: int) -> NDArray[np.uint8]:
    """Frames of a pat16, shape [..., 512], that also set its update rate to 40 kHz / divider, 1..255.

    Raises `UpdateRateError` for another divider.
    """
    if not 1 <= divider <= 255:
        raise UpdateRateError(f"divider {divider} is outside 1..255 of array pat16")
    marked = frames.copy()
    bits = marked[..., _DIVIDER_BYTE:_LOAD_BYTE]
    bits &= 0xFF ^ _MARK
    bits |= ((divider >> np.arange(8) & 1) * _MARK).astype(np.uint8)
    marked[..., _LOAD_BYTE] |= _MARK
    return marked


class PatLink(StreamLink):
    """An opened pat16; a context manager that closes it. `open_link` opens it.

    The board takes bytes in blocks of 512, counted from the last time that it cleared its FIFO, so each frame must fill
    a block exactly: else every second frame is dropped, and the last one never plays. This link keeps count. Where the
    count is not known (after opening, a fault, or a pause in which the board may have cleared its FIFO), it makes the
    board begin anew, which takes 1.3 s; the board is silent as soon as it has played what it held, and after the 1.3 s
    in any case.

    Below `ArrayModel.divider_sustained` the board outruns its USB chip: only bursts of `burst_frames` may be played
    there, which the player sees to. An off frame that is held for 6.4 ms goes ahead of a burst, so that all of it is in
    the FIFO when its first frame, which sets the rate, is played.
    """

    off_frames = 4

    def __init__(self, model: ArrayModel, transport: Transport, port: FtdiPort, *, clock: Clock | None = None) -> None:
        super().__init__(model, transport, off_frame(array=model).tobytes(), serial=port.serial, clock=clock)
        self._port = port
        self._divider = _SLOWEST  # highest that the board may have now
        self._started_divider = model.divider_default  # that of `start`
        self._burst_divider: int | None = None  # of a burst that has not begun
        self._hold_start: int | None = None  # count of bytes taken before the hold of a burst that has begun
        self._extra_bytes = 0  # taken of the holds before that one, and of realignments amid content
        self._hold_until_ns = 0
        self._burst_hold_ns = round(_HOLD_DIVIDER / model.frame_clock * 1e9)
        self._block_ns = round(_SLOWEST_BLOCK / model.frame_clock * 1e9)  # 6.4 ms
        self._drain_ns = (model.fifo_frames + 4) * self._block_ns  # for a full board, and the first blocks sent
        self._is_cut = False  # a transfer was cut short since the last alignment
        self._fed_ns = 0  # no earlier did the board take its last whole frame
        self._fed_bytes = 0  # and what it had taken in all by then
        self._looked_ns = 0  # when that was looked at

    @classmethod
    def open(cls, model: ArrayModel, request: LinkRequest) -> Self:
        """Find, open, configure and claim a board; a driver of the operating system is detached until `close`.

        Nothing is sent: what a killed player left plays on until `start`, or `send_off`. `uncalibrated` plays on a real
        board without its board file: a focus is not one there, as transducers are wired either way round.

        Raises, beside what `open_link` does, CalibrationError: the model has no calibration, and the board is a real
        one; or it is another board's.
        """
        backend, serial = usb_backend(request.backend), request.serial
        bus_clock = emulated_clock(backend)
        emulated = bus_clock is not None
        if not (model.calibrated or emulated or request.uncalibrated):
            raise CalibrationError(
                f"array {model.name} needs the board file (.pat) of its board: without the phase offsets in it about "
                "half of the transducers work against the others; only an emulated board plays without"
            )
        is_any = serial is None or model.serial is None or emulated or request.uncalibrated
        if not is_any and serial != model.serial:
            raise CalibrationError(f"the board file is of {model.name} {model.serial}, not of {serial}")
        wanted = None if serial is None and emulated else serial or model.serial
        port = FtdiPort.open(model, serial=wanted, backend=backend)
        try:
            port.require_fifo_mode()
            clock = request.clock or bus_clock
            way = open_transport(port.device, BULK_OUT, kind=request.transport, who=port.who, clock=clock)
        except BaseException:
            port.close()
            raise
        return cls(model, way, port, clock=clock)

    @property
    def bytes_sent(self) -> int:
        """Bytes that the array is known to have taken since it was opened, less those of holds and of `refresh`."""
        return self._transport.bytes_taken - self._extra_bytes - self._hold_bytes()

    @property
    def bytes_under_way(self) -> int:
        """Bytes handed over by `write` whose fate is not known yet; looks for what has arrived in the meantime."""
        under_way = super().bytes_under_way
        self._note_fed()
        return under_way

    @property
    def hold_ns(self) -> int:
        """How long a burst waits in the board until it plays [ns]; 0 if what is written first is none."""
        return 0 if self._burst_divider is None else self._burst_hold_ns

    def start(self, divider: int) -> None:
        """Silence what a killed player left, and set the update rate; each frame fills a block of the board afterwards.

        That takes 1.3 s, or a few milliseconds where this link has sent whole frames within the last 0.8 s. The board
        is silent afterwards: this waits for as long as its FIFO can last at the rate that it had.

        Raises `UpdateRateError` for a divider outside 1..255, and `DeviceTimeoutError` where this process was held up
        in each of three attempts, so that a clear of the board's FIFO may have met what was sent.
        """
        self.array.update_rate(divider)
        left_ns = round((self.array.fifo_frames + 1) * self._divider / self.array.frame_clock * 1e9)
        self._divider = max(self._divider, divider)  # should this fail
        if self._is_aligned():
            self._send(self._rest(self.torn_bytes or 0) + with_divider(off_frame(array=self.array), divider).tobytes())
            self.clock.sleep_until_ns(self.clock.now_ns() + left_ns)
        else:
            self._port.reset()
            self._port.reset_bitmode()
            self._port.set_latency(_LATENCY_MS)
            self._port.purge()
            self._realign(divider)
        self.expect_frames(divider)
        self._divider = self._started_divider = divider
        self._extra_bytes += self._hold_bytes()
        self._hold_start, self._hold_until_ns = None, 0
        self._burst_divider = divider if divider < self.array.divider_sustained else None

    def write(self, data: array[int], *, abandon: Callable[[], bool] = never) -> None:
        """Send whole frames, as `StreamLink.write` does, where needed after `refresh`; a burst begins with its hold."""
        if self.refresh() and abandon():
            return
        self._write_content(data, abandon)
        self._note_fed()

    def refresh(self) -> bool:
        """After a pause of 0.8 s, or where the count of bytes is not known: silence and realign the board, in 1.3 s.

        It is not abandoned: an alignment that is cut short would have to begin again before the array could be switched
        off for sure.
        """
        if self._is_aligned():
            return False
        self._transport.drain()  # what is under way is content
        before = self._transport.bytes_taken
        try:
            self._realign(self._started_divider)
        finally:
            self._extra_bytes += self._transport.bytes_taken - before
        return True

    def _write_content(self, data: array[int], abandon: Callable[[], bool]) -> None:
        """Send whole frames, a burst behind its hold."""
        if self._burst_divider is None:
            super().write(data, abandon=abandon)
            return
        first = np.frombuffer(data, np.uint8, self.array.frame_bytes)
        hold = with_divider(off_frame(array=self.array), _HOLD_DIVIDER).tobytes()
        ahead = hold + with_divider(first, self._burst_divider).tobytes()
        self._burst_divider = None
        self._divider = _HOLD_DIVIDER
        self._hold_start = self._transport.bytes_taken
        try:
            super().write(array("B", ahead) + data[self.array.frame_bytes :], abandon=abandon)
        finally:
            self._note_hold()

    def drain(self, *, abandon: Callable[[], bool] = never) -> bool:
        """Wait until nothing is under way, and a burst has begun; False if abandoned."""
        was_under_way = bool(self._transport.bytes_under_way)
        drained = super().drain(abandon=abandon)
        if was_under_way:
            self._note_hold()
        if drained and not abandon():
            self.clock.sleep_until_ns(self._hold_until_ns)
            self._divider = self._started_divider  # the burst's first frame has set it
        return drained

    @property
    def off_bytes(self) -> bytes:
        """What ends a content: an off frame, and three blocks that end in silence even if the host has miscounted."""
        return self._off + self._silencer(self._off)

    def send_off(self) -> None:
        """Off now, once a burst that was taken has begun, which cannot be taken back.

        Where the count of bytes is known, a torn frame is completed and `off_bytes` follow: off as soon as what the
        board holds has played. If a transfer was cut short on the way, the next `start` begins anew all the same, since
        its length may be reported wrongly. Where the count is not known, this takes 1.3 s, after which it is off.
        """
        self.cancel()
        if self._is_aligned():
            torn = self.torn_bytes or 0
            self._send(self._rest(torn) + self.off_bytes)
            if self._is_cut or torn:
                self._boundary = None
        else:
            self._realign(self._started_divider)
        self.clock.sleep_until_ns(self._hold_until_ns)

    def cancel(self) -> None:
        """End what is under way; then `bytes_sent` is exact, and the last frame may be torn."""
        if self._transport.bytes_under_way:
            self._note_hold()
            self._is_cut = True
        super().cancel()

    def close(self) -> None:
        """Let go of the board and give its chip back; nothing happens if it is gone. It goes on playing."""
        super().close()
        self._port.close()

    def _is_aligned(self) -> bool:
        """Whether the count of bytes in the board's block is known, and no clear can fall into what is sent now."""
        self._note_fed()
        return self.torn_bytes is not None and self.clock.now_ns() - self._fed_ns <= _QUIET_MOST_NS

    def _note_fed(self) -> None:
        """Note that a frame was taken since the last look, at its time at the earliest; less puts off no clear."""
        taken = self._transport.bytes_taken
        if taken - self._fed_bytes >= self.array.frame_bytes:
            self._fed_ns, self._fed_bytes = self._looked_ns, taken
        self._looked_ns = self.clock.now_ns()

    def _send(self, data: bytes) -> None:
        """Send bytes and wait until they are taken; the board is at a boundary of frames then."""
        self._note_fed()
        self._transport.submit(array("B", data))
        self._transport.drain()
        self._note_fed()
        self.note_torn_bytes()

    def _silencer(self, off: bytes) -> bytes:
        """Three blocks that end in silence on any grid, which they do not move, unless a clear falls into them.

        512 zeros complete the frame that the board may have begun, an off frame follows wherever the grid is, and 512
        zeros more fill the block that holds its end.
        """
        zeros = bytes(self.array.frame_bytes)
        return zeros + off + zeros

    def _realign(self, divider: int) -> None:
        """Silence the board, whatever it holds, and make its blocks begin where frames do.

        Only a clear of the FIFO does that. The first bytes settle when it comes: a second after the board has taken
        the last whole block of them. Then no bytes are sent until it has come, and in one write before the next one
        512 zeros, which complete what the board may still have of a frame, and an off frame, which fills a block.
        """
        off = with_divider(off_frame(array=self.array), divider).tobytes()
        for _ in range(_REALIGN_ATTEMPTS):
            self._boundary = None
            begin_ns = self.clock.now_ns()
            self._send(self._silencer(off))
            self._boundary = None
            self.clock.sleep_until_ns(self.clock.now_ns() + self._drain_ns + _CLEAR_NS)
            self._send(bytes(self.array.frame_bytes) + off)
            self._is_cut = False
            if self.clock.now_ns() - begin_ns <= _NEXT_CLEAR_NS:
                self.clock.sleep_until_ns(self.clock.now_ns() + self._block_ns * 2)  # until both have been taken
                return
        self._boundary = None
        raise DeviceTimeoutError(
            f"array {self._port.who} may not be off: {_REALIGN_ATTEMPTS} times this process was held up for more than "
            f"{(_NEXT_CLEAR_NS - self._drain_ns - _CLEAR_NS) * 1e-9:.2f} s while it was to be silenced"
        )

    def _note_hold(self) -> None:
        """A burst that has begun: its hold may have reached the board now, at the latest."""
        if self._hold_start is not None:
            self._hold_until_ns = self.clock.now_ns() + self._burst_hold_ns

    def _hold_bytes(self) -> int:
        """Bytes taken of the hold of the burst that has begun."""
        if self._hold_start is None:
            return 0
        return min(self._transport.bytes_taken - self._hold_start, self.array.frame_bytes)
