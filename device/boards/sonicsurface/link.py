"""The link to a SonicSurface: frames over a serial line, behind any adapter. The board never answers."""

from __future__ import annotations

from array import array
from collections.abc import Callable
from contextlib import suppress
from typing import Self

from ...array import ArrayModel
from ...array_kind import LinkRequest
from ...clock import Clock
from ...codec import off_frame
from ...errors import LinkError
from ...link import never
from ...transports.lookup import choose_port, open_port
from ...transports.serial_line import SerialPorts, SystemPorts
from ...transports.stream import StreamLink
from .swaps import SwapTransport

_PRIMARY_BOARD, _SECONDARY_BOARD, _CLOCKS_ON = 0xC0, 0xC1, 0x97


class SonicLink(StreamLink):
    """An opened SonicSurface; a context manager that closes it. `open_link` opens it.

    Its UART is the clock: frames are played as they arrive, one after the other, at one rate; one pattern and off, in
    turns, at any rate that `SwapTransport` makes of it. The board has two buffers, and a swap that it reads out of
    noise on the line shows the other one, so off is sent for both. It is sent to both boards of a line, too: a
    secondary board that is not selected takes no data, but emits from its power-up on, and swaps with the primary.
    """

    off_frames = 4
    _transport: SwapTransport

    def __init__(
        self, model: ArrayModel, transport: SwapTransport, *, serial: str | None, clock: Clock | None = None
    ) -> None:
        super().__init__(model, transport, off_frame(array=model).tobytes(), serial=serial, clock=clock)
        self._byte_ns = 1e9 / model.frame_clock

    @property
    def off_bytes(self) -> bytes:
        """Off for both buffers of both boards of a line; the primary board is selected afterwards.

        The primary board is off after the first swap, and has off in both buffers before the second one, since each
        swap is for both boards.
        """
        off_twice = self._off + self._off[:-1]
        primary, secondary = bytes([_PRIMARY_BOARD]), bytes([_SECONDARY_BOARD])
        return primary + off_twice + secondary + off_twice + primary

    @property
    def hold_ns(self) -> int:
        """How long the board takes to load the pattern that it then shows and hides [ns]; 0 for whole frames."""
        is_loaded = self._transport.slot_bytes < self.array.frame_bytes
        return round((self.array.frame_bytes - 1) * self._byte_ns) if is_loaded else 0

    @classmethod
    def open(cls, model: ArrayModel, request: LinkRequest) -> Self:
        """Open the serial port of a board, which no other program can open until `close`, and switch the board off.

        `serial` is that of its adapter, or the path of its port; None takes the only adapter. Raises, beside what
        `open_link` does, NoBackendError without pyserial, and LinkError for a port that lacks the baud rate.
        """
        ports = request.backend if isinstance(request.backend, SerialPorts) else SystemPorts()
        baud = model.baud or 0  # a model of this kind has one
        info = choose_port(model, request.serial, ports)
        port = open_port(model, info, ports, baud=baud)
        clock = request.clock or ports.clock
        who = f"{model.name} at {info.path}"
        transport = SwapTransport(port, baud, frame_bytes=model.frame_bytes, who=who, clock=clock)
        link = cls(model, transport, serial=info.serial or info.path, clock=clock)
        with suppress(LinkError):  # `start` meets it again
            link.send_off()  # a board that was just switched on emits
        return link

    def start(self, divider: int) -> None:
        """Resynchronise, and silence what a killed player or the power-up left; no frame is torn afterwards.

        The clocks, which another program may have switched off, run only once both boards are off. Raises
        `UpdateRateError` for a divider that the array lacks.
        """
        self._transport.slot_bytes = self.array.frame_bytes
        self.array.update_rate(divider)
        self.expect_frames(self.array.divider_default)
        self.send_off()
        self._transport.submit(array("B", [_CLOCKS_ON]))
        self._transport.drain()
        self.clock.sleep_until_ns(
            self.clock.now_ns() + round(self.array.fifo_frames * self.array.frame_bytes * self._byte_ns)
        )
        self._transport.slot_bytes = divider
        self.expect_frames(divider)

    def write(self, data: array[int], *, abandon: Callable[[], bool] = never) -> None:
        """As `StreamLink.write`; the bytes of `off_bytes` go out in one piece."""
        if len(data) % self.array.frame_bytes:
            self._transport.submit(data, abandon=abandon)
        else:
            super().write(data, abandon=abandon)

    def send_off(self) -> None:
        """Off now, as soon as what is under way has left: a start byte ends a torn frame, which is never shown."""
        self._transport.cancel()
        self._transport.submit(array("B", self.off_bytes))
        self._transport.drain()
        self.note_torn_bytes()
