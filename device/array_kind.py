"""What palpate knows of one kind of array, as a value: its names, model, wire layout, link and emulation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from .array import ArrayModel
from .clock import Clock
from .link import Link, TransportKind
from .wire_layout import FocusLayout, Layout


@dataclass(frozen=True, kw_only=True)
class LinkRequest:
    """How a link is asked for: the arguments of `open_link`, as `ArrayKind.open_link` gets them.

    >>> from palpate.device import LinkRequest, VirtualClock, array_model
    >>> from palpate.device.boards.emulator.kind import KIND
    >>> KIND.open_link(array_model("emulator"), LinkRequest(clock=VirtualClock()))
    UsbLink('emulator', serial='EMU0001')
    """

    serial: str | None = None
    """Which array; None: that of the calibration, or the first, or the only one."""
    backend: object = None
    """pyusb's backend, or serial ports; None: the system's."""
    clock: Clock | None = None
    """Clock that the board runs by; None: an emulated bus's own, else the monotonic one."""
    transport: TransportKind = "auto"
    """Of arrays on USB."""
    uncalibrated: bool = False
    """Play on a real board without the calibration that it needs."""
    emulated: bool = False
    """Open a new emulated array; only set where `ArrayKind.emulates_itself`."""


@dataclass(frozen=True, kw_only=True)
class EmulationRequest:
    """How an emulated bus is asked for: the arguments of `emulated_backend`, as `ArrayKind.emulate` gets them.

    >>> from palpate.device import EmulationRequest, VirtualClock, find_arrays
    >>> from palpate.device.boards.emulator.kind import KIND
    >>> bus = KIND.emulate(EmulationRequest(serials=("left", "right"), clock=VirtualClock()))
    >>> [info.serial for info in find_arrays(bus)]
    ['left', 'right']
    """

    serials: tuple[str, ...] | None = None
    """Serial number of each board; None: one board."""
    clock: Clock | None = None
    """Clock of all boards; None: the monotonic one."""
    record: int = 0
    """How many of its last played frames each board keeps."""
    baud: float | None = None
    """Rate of the boards' UART [Bd]; None: the kind's own."""


class Emulation(Protocol):
    """An emulated bus: what `open_link` takes as its backend."""

    @property
    def clock(self) -> Clock:
        """Clock of all boards."""
        ...

    def unplug(self, *, index: int = 0) -> None:
        """Pull the plug of a board: it falls silent and is gone."""
        ...

    def replug(self, *, index: int = 0) -> None:
        """Plug it in again, fresh from power-up."""
        ...


@dataclass(frozen=True, kw_only=True)
class ArrayKind:
    """One kind of array. `register_array` makes it known; everything that depends on an array's name asks it.

    >>> import numpy as np
    >>> from palpate.device import ArrayKind, flat_array, flat_grid
    >>> from palpate.device.boards.emulator.kind import KIND  # a board that takes the same frames and requests
    >>> model = flat_array("tiny", flat_grid(4, 4, 10e-3), np.arange(16), frame_bytes=32, fifo_frames=64)
    >>> tiny = ArrayKind(name="tiny", build=lambda: model, layout=KIND.layout, open_link=KIND.open_link)
    >>> tiny.build(), tiny.is_emulated  # as no `emulate` was given
    (ArrayModel('tiny', 16 transducers), False)
    """

    name: str
    """Name in files, in results and on the command line: small letters, digits and `-`."""
    aliases: tuple[str, ...] = ()
    """What else people call it."""
    build: Callable[..., ArrayModel]
    """Makes the model, whose name is `name`. It takes `calibration=` (a path) where there is a `calibration_serial`,
    and `baud=` where `takes_baud`; without them it makes the usual model, the same each time."""
    layout: Layout | FocusLayout
    """How a frame lies on the wire, and so what the array takes: delays and levels of its transducers, or focal points,
    from which its own driver finds them."""
    open_link: Callable[[ArrayModel, LinkRequest], Link]
    """Finds, opens and claims an array of a model of this kind."""
    calibration_serial: Callable[[Path], str | None] | None = None
    """Serial number of the board that a calibration file describes; raises CalibrationError for a wrong file. None: the
    kind has no such files."""
    takes_baud: bool = False
    """Whether a baud rate can be asked for. Kinds whose model has one are looked for at serial ports; kinds whose model
    has a `usb`, on USB."""
    emulate: Callable[[EmulationRequest], Emulation] | None = None
    """Makes a bus with emulated boards; None: there is none."""
    emulates_itself: bool = False
    """Whether its link opens an emulated array by itself (`LinkRequest.emulated`), without such a bus."""
    not_listed: str | None = None
    """Sentence without its end on why `palpate devices` cannot list it, and how it is named instead; None: it can."""
    supposed: str | None = None
    """Sentence without its end on what predictions suppose of it because its maker has not published it; None:
    nothing."""
    watches_itself: str | None = None
    """Sentence without its end on what silences it when its player is gone, so that it needs no watchdog; None: nothing
    does."""
    not_live: str | None = None
    """Sentence without its end on why it cannot follow a hand that moves now; None: a frame plays as
    soon as it has been written and those before it have been played."""

    @property
    def takes_points(self) -> bool:
        """Whether it takes focal points, and finds the phases of its transducers by itself."""
        return isinstance(self.layout, FocusLayout)

    def __repr__(self) -> str:
        """One line."""
        called = f", also called {', '.join(self.aliases)}" if self.aliases else ""
        return f"ArrayKind({self.name!r}{called}, {'emulated' if self.is_emulated else 'not emulated'})"

    @property
    def is_emulated(self) -> bool:
        """Whether one can be played to without any hardware."""
        return self.emulate is not None or self.emulates_itself
