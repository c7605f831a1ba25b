"""The way to a bridge: bytes there and back, over TCP or to a model in this process."""

from __future__ import annotations

import contextlib
import socket
from typing import Final, Protocol

from ...errors import DeviceLostError, DeviceNotFoundError, DeviceTimeoutError, LinkError

PORT: Final = 24040
"""Where `palpate-ultraleap` listens unless it is told otherwise."""
_CONNECT_TIMEOUT: Final = 3.0  # [s]
_SEND_TIMEOUT: Final = 1.0  # [s]; what is sent has room in the bridge, so it is read at once
_BYTES_AT_ONCE: Final = 1 << 16


class BridgeChannel(Protocol):
    """Bytes to and from one bridge. Errors are `LinkError`s, which name the bridge."""

    @property
    def name(self) -> str:
        """Of this kind of way, for reports."""
        ...

    @property
    def where(self) -> str:
        """Place of the bridge, for messages."""
        ...

    def send(self, data: bytes) -> None:
        """Hand over all of the bytes."""
        ...

    def receive(self, timeout: float) -> bytes:
        """What has come, once something has; b"" after `timeout` [s] without anything."""
        ...

    def close(self) -> None:
        """End the connection; raises nothing."""
        ...


class TcpChannel:
    """A TCP connection to a bridge.

    Args:
        address: HOST:PORT, HOST or :PORT of the bridge; None is 127.0.0.1:24040.

    Raises:
        LinkError: the address is none.
        DeviceNotFoundError: nothing listens there.
    """

    name = "tcp"

    def __init__(self, address: str | None) -> None:
        host, port = parsed_address(address)
        self.where = f"{host}:{port}"
        try:
            self._socket = socket.create_connection((host, port), _CONNECT_TIMEOUT)
        except (OSError, UnicodeError) as error:  # UnicodeError: a name of a host that can be none
            reason = getattr(error, "strerror", None) or error
            raise DeviceNotFoundError(
                f"no palpate-ultraleap listens at {self.where} ({reason}): start it there, or name its place with "
                "serial=HOST:PORT; docs/how-to/ultraleap.md says how it is built"
            ) from error
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def send(self, data: bytes) -> None:
        """Hand over all of the bytes."""
        try:
            self._socket.settimeout(_SEND_TIMEOUT)
            self._socket.sendall(data)
        except TimeoutError:
            self.close()  # a part of a message may have gone, so nothing that followed would be understood
            raise DeviceTimeoutError(
                f"the bridge at {self.where} has read nothing for {_SEND_TIMEOUT:g} s, so the connection was closed"
            ) from None
        except OSError as error:
            raise self._lost(error) from error

    def receive(self, timeout: float) -> bytes:
        """What has come, once something has; b"" after `timeout` [s] without anything."""
        try:
            self._socket.settimeout(timeout)
            data = self._socket.recv(_BYTES_AT_ONCE)
        except (TimeoutError, BlockingIOError):
            return b""
        except OSError as error:
            raise self._lost(error) from error
        if not data:
            raise self._lost("it closed the connection")
        return data

    def close(self) -> None:
        """End the connection."""
        with contextlib.suppress(OSError):
            self._socket.close()

    def _lost(self, reason: object) -> DeviceLostError:
        return DeviceLostError(f"the bridge at {self.where} is gone ({reason})")


def parsed_address(address: str | None) -> tuple[str, int]:
    """Host and port of HOST:PORT, HOST, :PORT, [IPv6]:PORT or IPv6; raises LinkError for a port outside 1..65535.

    >>> from palpate.device.boards.stratos.channel import parsed_address
    >>> parsed_address(None), parsed_address(":9000"), parsed_address("[::1]:9000")
    (('127.0.0.1', 24040), ('127.0.0.1', 9000), ('::1', 9000))
    """
    given = address or ""
    host, colon, port = given.rpartition(":")
    if not colon or given.endswith("]") or (":" in host and not host.endswith("]")):  # an IPv6 address without a port
        host, port = given, str(PORT)
    if not (port.isascii() and port.isdigit() and 1 <= int(port[:6]) <= 65535):
        raise LinkError(
            f"serial of a stratos is the HOST:PORT of its palpate-ultraleap, with a port of 1..65535, not {address!r}: "
            "which array that one plays on, its own option --device says"
        )
    return host.strip("[]") or "127.0.0.1", int(port)
