"""The link to a SonicSurface: frames over a UART behind an FTDI chip. The board never answers (docs/boards.md)."""

from __future__ import annotations

from array import array
from typing import Self

from .array import SONICSURFACE_BAUD, ArrayModel
from .clock import Clock
from .codec import off_frame
from .ftdi import BULK_OUT, FtdiPort
from .lookup import emulated_clock
from .pyusb import Backend
from .stream import StreamLink
from .transport import Transport, TransportKind, open_transport

_LATENCY_MS = 2
_PRIMARY_BOARD, _CLOCKS_ON = 0xC0, 0x97


class SonicLink(StreamLink):
    """An opened SonicSurface; a context manager that closes it. Made by `SonicLink.open`.

    Its UART is the clock: frames are played as they arrive, one after the other, at one rate only. The board has two
    buffers, and a swap that it reads out of noise on the line shows the other one: a content ends with two off frames.
    """

    off_frames = 2

    def __init__(self, model: ArrayModel, transport: Transport, port: FtdiPort, *, clock: Clock | None = None) -> None:
        super().__init__(model, transport, off_frame(array=model).tobytes(), serial=port.serial, clock=clock)
        self._port = port

    @classmethod
    def open(
        cls,
        model: ArrayModel,
        *,
        serial: str | None = None,
        backend: Backend | None = None,
        clock: Clock | None = None,
        transport: TransportKind = "auto",
    ) -> Self:
        """Find, open, configure and claim a board; a driver of the operating system is detached until `close`.

        Args:
            model: the array, with the baud rate that its firmware was compiled for.
            serial: which one; None takes the first.
            backend: pyusb's; None is libusb's.
            clock: clock that the board runs by; None takes an emulated bus's own, else the monotonic one.
            transport: "queued", "sync", or "auto": queued where the backend is libusb's.

        Raises:
            DeviceNotFoundError, DeviceBusyError, DevicePermissionError, NoBackendError: as their names say.
            LinkError: queued was asked for, and cannot be had.
        """
        port = FtdiPort.open(model, serial=serial, backend=backend)
        try:
            clock = clock or emulated_clock(backend)
            way = open_transport(port.device, BULK_OUT, kind=transport, who=port.who, clock=clock)
        except BaseException:
            port.close()
            raise
        return cls(model, way, port, clock=clock)

    def start(self, divider: int) -> None:
        """Set the UART up, resynchronise, silence what a killed player left; no frame is torn afterwards.

        Raises `UpdateRateError` for another divider than 1, or a baud rate that the chip does not have.
        """
        self.begin(divider)
        self._port.reset()
        self._port.reset_bitmode()
        self._port.set_latency(_LATENCY_MS)
        self._port.set_line_8n1()
        self._port.set_baud(self.array.baud or SONICSURFACE_BAUD)
        self._port.purge()
        self._transport.submit(array("B", [_PRIMARY_BOARD, _CLOCKS_ON]))
        self.note_boundary()
        self.send_off()
        period_ns = round(1e9 / self.array.update_rate(divider))
        self.clock.sleep_until_ns(self.clock.now_ns() + (self.array.fifo_frames + self.off_frames) * period_ns)

    def rest_unknown(self) -> bytes:
        """Nothing: the first byte of a frame makes the board start anew, wherever it was."""
        return b""

    def close(self) -> None:
        """Let go of the board and give its chip back; nothing happens if it is gone. It goes on playing."""
        super().close()
        self._port.close()
