"""Bytes to one bulk endpoint, in order, and never lost count of."""

from __future__ import annotations

from array import array
from collections.abc import Callable
from typing import Protocol, get_args

from ..clock import Clock
from ..errors import LinkError
from ..link import TransportKind, never
from .libusb import is_queueable
from .pyusb import UsbDevice
from .queued import QUEUE_DEPTH, QueuedTransport
from .sync import SyncTransport


class Transport(Protocol):
    """A way to one endpoint. Errors are `LinkError`s; every call ends within a bounded time. One thread uses it.

    After an error, `cancel` ends what is still under way.
    """

    window_bytes: int | None
    """Most bytes to have under way, one transfer excepted; None: as many as the transport can. Its owner sets it."""

    @property
    def name(self) -> str:
        """Name for reports: "sync" or "queued"."""
        ...

    @property
    def bytes_taken(self) -> int:
        """Bytes that the device is known to have taken since the transport was made.

        Exact whenever nothing is under way and `is_exact`.
        """
        ...

    @property
    def bytes_under_way(self) -> int:
        """Bytes submitted whose fate is not known yet; looks for what has arrived in the meantime."""
        ...

    @property
    def is_exact(self) -> bool:
        """False after a blocking write that failed: pyusb does not say how much of it the device took."""
        ...

    @property
    def short_writes(self) -> int:
        """Transfers that took less than was offered, or nothing, and were continued."""
        ...

    def submit(self, data: array[int], *, abandon: Callable[[], bool] = never) -> None:
        """Hand over bytes: return once they are under way (queued) or taken (sync).

        Waits while there is no room, in slices of at most 50 ms; after each it asks `abandon`, and if that holds it
        returns without having handed over (all of) them. The bytes must not change until they are taken. If an error
        has told of a stall, the halt of the endpoint is ended first.

        Raises `DeviceTimeoutError` if the device takes nothing for about a second, or whatever else went wrong with
        these or earlier bytes.
        """
        ...

    def drain(self, *, abandon: Callable[[], bool] = never) -> bool:
        """Wait until nothing is under way; False if abandoned. Raises as `submit` does."""
        ...

    def cancel(self) -> None:
        """End what is under way, the last first, so that only one write can be torn. Raises if that does not end."""
        ...

    def forget_doubt(self) -> None:
        """Count as exact again: somebody who knows has told how much the device took. `bytes_taken` stays."""
        ...

    def clear_halt(self) -> None:
        """End the halt of the endpoint after a stall."""
        ...

    def close(self) -> None:
        """Cancel, and give back what the transport holds; the device stays open. Raises nothing."""
        ...


def open_transport(
    device: UsbDevice,
    endpoint: int,
    *,
    kind: TransportKind = "auto",
    who: str = "",
    clock: Clock | None = None,
    depth: int = QUEUE_DEPTH,
) -> Transport:
    """A transport to an endpoint of an opened, claimed device.

    Args:
        device: pyusb's device.
        endpoint: address of the bulk OUT endpoint.
        kind: "queued" submits transfers on pyusb's own libusb handle, so that the kernel has the next bytes while
            Python does something else; "sync" works with any backend of pyusb, one blocking write at a time; "auto"
            is queued where the backend is libusb's, else sync.
        who: name and serial number of the array, for messages.
        clock: clock of time limits, by which the device runs; None is real time. Queued is always in real time.
        depth: how many transfers are under way at most, if queued.

    Raises:
        LinkError: there is no such kind; or queued was asked for, and the backend is not libusb's, or this pyusb
            hides what is needed.
    """
    if kind not in get_args(TransportKind):
        raise LinkError(f"unknown transport {kind!r}; known: {', '.join(get_args(TransportKind))}")
    if kind == "queued" or (kind == "auto" and is_queueable(device)):
        return QueuedTransport(device, endpoint, depth=depth, who=who)
    return SyncTransport(device, endpoint, who=who, clock=clock)
