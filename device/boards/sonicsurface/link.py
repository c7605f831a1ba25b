"""The link to a SonicSurface: frames over a serial line, behind any adapter. The board never answers."""

from __future__ import annotations

from array import array
from typing import Self

from ...array import ArrayModel
from ...clock import Clock
from ...codec import off_frame
from ...transports.pyserial import SystemPorts
from ...transports.serial_line import SerialPorts
from ...transports.serial_lookup import choose_port, open_port
from ...transports.serial_transport import SerialTransport
from ...transports.stream import StreamLink
from .geometry import BAUD_PUBLISHED

_PRIMARY_BOARD, _CLOCKS_ON = 0xC0, 0x97


class SonicLink(StreamLink):
    """An opened SonicSurface; a context manager that closes it. Made by `SonicLink.open`.

    Its UART is the clock: frames are played as they arrive, one after the other, at one rate only. The board has two
    buffers, and a swap that it reads out of noise on the line shows the other one: a content ends with two off frames.
    """

    off_frames = 2

    def __init__(
        self, model: ArrayModel, transport: SerialTransport, *, serial: str | None, clock: Clock | None = None
    ) -> None:
        super().__init__(model, transport, off_frame(array=model).tobytes(), serial=serial, clock=clock)

    @classmethod
    def open(
        cls,
        model: ArrayModel,
        *,
        serial: str | None = None,
        ports: SerialPorts | None = None,
        clock: Clock | None = None,
    ) -> Self:
        """Open the serial port of a board, which no other program can open until `close`.

        Args:
            model: the array, with the baud rate that its firmware was compiled for.
            serial: serial number of its adapter, or path of its port; None takes the only adapter.
            ports: where to look for it; None is the system's, through pyserial.
            clock: clock that the board runs by; None takes that of emulated ports, else the monotonic one.

        Raises:
            DeviceNotFoundError, DeviceBusyError, DevicePermissionError: as their names say.
            NoBackendError: pyserial is not installed.
            LinkError: it is no serial port, or it lacks the baud rate.
        """
        ports = ports or SystemPorts()
        baud = model.baud or BAUD_PUBLISHED
        info = choose_port(model, serial, ports)
        port = open_port(model, info, ports, baud=baud)
        clock = clock or ports.clock
        transport = SerialTransport(port, baud, who=f"{model.name} at {info.path}", clock=clock)
        return cls(model, transport, serial=info.serial or info.path, clock=clock)

    def start(self, divider: int) -> None:
        """Resynchronise, and silence what a killed player left; no frame is torn afterwards.

        Raises `UpdateRateError` for another divider than 1.
        """
        self.begin(divider)
        self._transport.submit(array("B", [_PRIMARY_BOARD, _CLOCKS_ON]))
        self._transport.drain()
        self.note_boundary()
        self.send_off()
        period_ns = round(1e9 / self.array.update_rate(divider))
        self.clock.sleep_until_ns(self.clock.now_ns() + (self.array.fifo_frames + self.off_frames) * period_ns)

    def rest_unknown(self) -> bytes:
        """Nothing: the first byte of a frame makes the board start anew, wherever it was."""
        return b""
