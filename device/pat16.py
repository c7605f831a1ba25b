"""The link to a UCL/OpenMPD board: frames through an FT232H in FIFO mode. The board never answers (docs/boards.md)."""

from __future__ import annotations

from array import array
from collections.abc import Callable
from typing import Self

import numpy as np

from .array import ArrayModel
from .clock import Clock
from .codec import off_frame, with_divider
from .ftdi import BULK_OUT, FtdiPort
from .link import never
from .lookup import emulated_clock
from .pat_file import CalibrationError
from .pyusb import Backend
from .stream import StreamLink
from .transport import Transport, TransportKind, open_transport

_LATENCY_MS = 2
_SLOWEST = 255
_HOLD_DIVIDER = _SLOWEST  # 6.4 ms: the chip passes a burst of 28 frames in 2 ms


class PatLink(StreamLink):
    """An opened pat16; a context manager that closes it. Made by `PatLink.open`.

    Below `ArrayModel.divider_sustained` the board outruns its USB chip: only bursts of `burst_frames` may be played
    there, which the player sees to. An off frame that is held for 6.4 ms goes ahead of a burst, so that all of it is in
    the FIFO when its first frame, which sets the rate, is played.
    """

    def __init__(self, model: ArrayModel, transport: Transport, port: FtdiPort, *, clock: Clock | None = None) -> None:
        super().__init__(model, transport, off_frame(array=model).tobytes(), serial=port.serial, clock=clock)
        self._port = port
        self._divider = self._started_divider = _SLOWEST  # highest that the board may have now; that of `start`
        self._burst_divider: int | None = None  # of a burst that has not begun
        self._hold_start: int | None = None  # count of bytes taken before the hold of a burst that has begun
        self._holds_bytes = 0  # taken of the holds before that one
        self._hold_until_ns = 0
        self._burst_hold_ns = round(_HOLD_DIVIDER / model.frame_clock * 1e9)

    @classmethod
    def open(
        cls,
        model: ArrayModel,
        *,
        serial: str | None = None,
        backend: Backend | None = None,
        clock: Clock | None = None,
        transport: TransportKind = "auto",
        uncalibrated: bool = False,
    ) -> Self:
        """Find, open, configure, claim and silence a board; a driver of the operating system is detached until `close`.

        A killed player may have left frames in its FIFO at the slowest rate: this waits for 0.22 s, until they are
        played, so that the array is silent then.

        Args:
            model: the array, with the calibration of the board that is to be opened.
            serial: which one; None takes that of the calibration.
            backend: pyusb's; None is libusb's.
            clock: clock that the board runs by; None takes an emulated bus's own, else the monotonic one.
            transport: "queued", "sync", or "auto": queued where the backend is libusb's.
            uncalibrated: play on a real board without its board file: a focus is not one there, as transducers are
                wired either way round.

        Raises:
            CalibrationError: the model has no calibration, and the board is a real one; or it is another board's.
            DeviceNotFoundError, DeviceBusyError, DevicePermissionError, NoBackendError: as their names say.
            LinkError: queued was asked for, and cannot be had.
        """
        bus_clock = emulated_clock(backend)
        emulated = bus_clock is not None
        if not (model.calibrated or emulated or uncalibrated):
            raise CalibrationError(
                f"array {model.name} needs the board file (.pat) of its board: without the phase offsets in it about "
                "half of the transducers work against the others; only an emulated board plays without"
            )
        if not (serial is None or model.serial is None or emulated or uncalibrated) and serial != model.serial:
            raise CalibrationError(f"the board file is of {model.name} {model.serial}, not of {serial}")
        wanted = None if serial is None and emulated else serial or model.serial
        port = FtdiPort.open(model, serial=wanted, backend=backend)
        try:
            clock = clock or bus_clock
            way = open_transport(port.device, BULK_OUT, kind=transport, who=port.who, clock=clock)
        except BaseException:
            port.close()
            raise
        link = cls(model, way, port, clock=clock)
        try:
            link.start(model.divider_default)
        except BaseException:
            link.close()
            raise
        return link

    @property
    def bytes_sent(self) -> int:
        """Bytes that the array is known to have taken since the link was opened, without those of holds."""
        return self._transport.bytes_taken - self._holds_bytes - self._hold_bytes()

    @property
    def hold_ns(self) -> int:
        """How long a burst waits in the board until it plays [ns]; 0 if what is written first is none."""
        return 0 if self._burst_divider is None else self._burst_hold_ns

    def start(self, divider: int) -> None:
        """Resynchronise, silence what a killed player left, set the update rate; no frame is torn afterwards.

        The board is silent afterwards too: this waits for as long as its FIFO can last at the rate that it had.
        Raises `UpdateRateError` for a divider outside 1..255.
        """
        self.array.update_rate(divider)
        left_ns = round((self.array.fifo_frames + 1) * self._divider / self.array.frame_clock * 1e9)
        self._divider = max(self._divider, divider)  # should this fail
        self._port.reset()
        self._port.reset_bitmode()
        self._port.set_latency(_LATENCY_MS)
        self._port.purge()
        self.begin(divider)
        silent = off_frame(array=self.array)
        self._transport.submit(array("B", self.rest_unknown() + with_divider(silent, divider).tobytes()))
        self._transport.drain()
        self.note_boundary()
        self.clock.sleep_until_ns(self.clock.now_ns() + left_ns)
        self._divider = self._started_divider = divider
        self._holds_bytes += self._hold_bytes()
        self._hold_start, self._hold_until_ns = None, 0
        self._burst_divider = divider if divider < self.array.divider_sustained else None

    def write(self, data: array[int], *, abandon: Callable[[], bool] = never) -> None:
        """Send whole frames, as `StreamLink.write` does; a burst begins with its hold."""
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

    def send_off(self) -> None:
        """Off now, as `StreamLink.send_off`, once a burst that was taken has begun: it cannot be taken back."""
        if self._transport.bytes_under_way:
            self._note_hold()
        super().send_off()
        self.clock.sleep_until_ns(self._hold_until_ns)

    def rest_unknown(self) -> bytes:
        """What completes a torn frame of unknown length: all that one can lack, bytes without a start flag.

        The board takes those that belong to the torn frame and skips the others, until the next start flag.
        """
        return bytes(self.array.frame_bytes - 1)

    def close(self) -> None:
        """Let go of the board and give its chip back; nothing happens if it is gone. It goes on playing."""
        super().close()
        self._port.close()

    def _note_hold(self) -> None:
        """A burst that has begun: its hold may have reached the board now, at the latest."""
        if self._hold_start is not None:
            self._hold_until_ns = self.clock.now_ns() + self._burst_hold_ns

    def _hold_bytes(self) -> int:
        """Bytes taken of the hold of the burst that has begun."""
        if self._hold_start is None:
            return 0
        return min(self._transport.bytes_taken - self._hold_start, self.array.frame_bytes)
