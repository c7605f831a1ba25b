"""The link to a board with the protocol of docs/formats/emulator.md, over pyusb."""

from __future__ import annotations

import struct
from typing import Self

from ...array import ArrayModel
from ...array_kind import LinkRequest
from ...clock import Clock
from ...codec import off_frame
from ...errors import DeviceTimeoutError, LinkError, link_error
from ...link import BoardStatus
from ...silence import wait_silent
from ...transports.bulk import open_bulk
from ...transports.pyusb import UsbDevice, UsbError
from ...transports.stream import StreamLink
from ...transports.transport import Transport

_BULK_OUT = 0x01
_VENDOR_OUT, _VENDOR_IN = 0x40, 0xC0
_SET_DIVIDER, _GET_STATUS, _CLEAR = 0x01, 0x02, 0x03
_STATUS = struct.Struct("<QQQIHBB")

_CONTROL_TIMEOUT_MS = 500


class UsbLink(StreamLink):
    """An opened `emulator`; a context manager that closes it. `open_link` opens it.

    >>> from palpate.device import VirtualClock, array_model, open_link
    >>> with open_link(array_model("emulator"), clock=VirtualClock()) as link:
    ...     link.start(8)  # 40 kHz / 8: 5 kHz
    ...     link, link.status().divider, link.status().level  # silent
    (UsbLink('emulator', serial='EMU0001'), 8, 0)
    """

    @classmethod
    def open(cls, model: ArrayModel, request: LinkRequest) -> Self:
        """Find, open, configure and claim an array; raises as `open_link` does."""
        opened = open_bulk(model, request, endpoint=_BULK_OUT)
        return cls(model, opened.transport, opened.device, opened.who, serial=opened.serial, clock=opened.clock)

    def __init__(
        self, model: ArrayModel, transport: Transport, device: UsbDevice, who: str, *, serial: str | None, clock: Clock
    ) -> None:
        super().__init__(model, transport, off_frame(array=model).tobytes(), serial=serial, clock=clock, device=device)
        self._bus_device = device
        self._who = who

    def start(self, divider: int) -> None:
        """Set the update rate to that of a divider, and silence what a killed player left behind.

        Raises `UpdateRateError` for a divider that the array lacks, `DeviceTimeoutError` if it does not fall silent.
        """
        self.array.update_rate(divider)
        self._request(_VENDOR_OUT, _SET_DIVIDER, value=divider)
        status = self.status()
        if status.fifo_frames or status.torn_bytes or status.level:
            self.clear()
            self.note_torn_bytes(status.torn_bytes)
            self.send_off()
            if not wait_silent(self, divider):
                raise DeviceTimeoutError(f"array {self._who} does not fall silent: switch it off and on")
        self.expect_frames(divider)

    def status(self) -> BoardStatus:
        """Ask the board for its counts, its FIFO and what is playing."""
        reply = self._request(_VENDOR_IN, _GET_STATUS, length=_STATUS.size)
        if len(reply) != _STATUS.size:
            raise LinkError(f"array {self._who} answered a status of {len(reply)} bytes instead of {_STATUS.size}")
        return BoardStatus(*_STATUS.unpack(reply))

    def clear(self) -> bool:
        """Drop the whole frames that are queued: True. A torn one stays and waits for its rest."""
        self._request(_VENDOR_OUT, _CLEAR)
        return True

    def _request(self, kind: int, request: int, *, value: int = 0, length: int | None = None) -> bytes:
        try:
            reply = self._bus_device.ctrl_transfer(kind, request, value, 0, length, _CONTROL_TIMEOUT_MS)
        except UsbError as error:
            raise link_error(self._who, error.errno, error) from error
        return b"" if isinstance(reply, int) else reply.tobytes()
