"""Faults that an emulated bus can be told to have."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class FaultKind(Enum):
    """What can be made to go wrong.

    >>> from palpate.device import EmulatorBackend, Fault, FaultKind, VirtualClock, array_model, open_link
    >>> bus = EmulatorBackend(clock=VirtualClock())
    >>> bus.inject(Fault(FaultKind.BUSY))
    >>> open_link(array_model("emulator"), backend=bus)
    Traceback (most recent call last):
        ...
    palpate.device.errors.DeviceBusyError: array emulator EMU0001 is in use: stop the other player, or ...
    """

    UNPLUG = "unplug"
    """ENODEV from then on; the board loses its power, and with it everything queued."""
    STALL = "stall"
    """EPIPE; on the bulk endpoint until its halt is cleared."""
    TIMEOUT = "timeout"
    """NAK until the timeout: a short count if a part was taken, else ETIMEDOUT."""
    SHORT = "short"
    """The write returns at once with what was taken."""
    BUSY = "busy"
    """EBUSY on claiming."""
    DENIED = "denied"
    """EACCES on opening."""


@dataclass(frozen=True)
class Fault:
    """One fault and where it strikes.

    Args:
        kind: what happens. BUSY and DENIED need no place.
        byte: offset in the stream of bulk bytes since power-up, before which everything is taken.
        request: vendor request that it strikes instead.
        count: how many times, from then on if None.

    >>> from palpate.device import EmulatorBackend, Fault, FaultKind, Player, VirtualClock, array_model, open_link
    >>> bus = EmulatorBackend(clock=VirtualClock())
    >>> bus.inject(Fault(FaultKind.SHORT, byte=700))  # a write ends amid the second frame, and is continued
    >>> with open_link(array_model("emulator"), backend=bus) as link:
    ...     report = Player(link).play([bytes([255] * 512) * 100], update_rate=10e3)
    >>> report.short_writes, report.frames
    (1, 100)
    """

    kind: FaultKind
    byte: int | None = None
    request: int | None = None
    count: int | None = 1

    def __post_init__(self) -> None:
        places = [place for place in (self.byte, self.request) if place is not None]
        if len(places) != (self.kind not in (FaultKind.BUSY, FaultKind.DENIED)):
            raise ValueError(f"fault {self.kind.value} takes a byte or a request, or none if busy or denied: {places}")
        if self.kind is FaultKind.SHORT and self.byte is None:
            raise ValueError("fault short is one of bulk writes: it takes a byte, not a request")


class FaultList:
    """Faults that may still strike."""

    def __init__(self) -> None:
        self._left: list[tuple[Fault, int | None]] = []

    def add(self, fault: Fault) -> None:
        """Let a fault happen."""
        self._left.append((fault, fault.count))

    def on(self, kind: FaultKind) -> bool:
        """Does a fault of this kind strike now?"""
        return self._strike(next((fault for fault, _ in self._left if fault.kind is kind), None))

    def on_request(self, request: int) -> FaultKind | None:
        """The kind of fault that strikes this request now."""
        fault = next((fault for fault, _ in self._left if fault.request == request), None)
        return fault.kind if fault and self._strike(fault) else None

    def before_byte(self, end: int) -> Fault | None:
        """First fault in the stream before byte `end`; it strikes once the bytes before it are taken."""
        ahead = [fault for fault, _ in self._left if fault.byte is not None and fault.byte < end]
        return min(ahead, key=lambda fault: fault.byte or 0, default=None)

    def strike(self, fault: Fault) -> FaultKind:
        """Count one blow."""
        self._strike(fault)
        return fault.kind

    def _strike(self, fault: Fault | None) -> bool:
        for place, (candidate, left) in enumerate(self._left):
            if candidate is fault:
                if left is None:
                    return True
                self._left[place : place + 1] = [(candidate, left - 1)] if left > 1 else []
                return True
        return False
