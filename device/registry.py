"""The kinds of arrays that are known, by their names. `boards/built_in.py` lists those that palpate has."""

from __future__ import annotations

import difflib
import functools
import re
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Final, cast

from .array import ArrayModel
from .array_kind import ArrayKind, Emulation, EmulationRequest
from .clock import Clock
from .errors import ArrayKindError, CalibrationError, UnknownArrayError, UpdateRateError
from .wire_layout import FocusLayout, Layout

_NAME: Final = re.compile(r"[a-z][a-z0-9-]*")
_BUILT_IN: Final = ".boards.built_in"  # by name, since it is imported only when an array is asked for


@functools.cache
def _kinds() -> dict[str, ArrayKind]:
    """Kinds of arrays by their names: built-in ones, then others as they are registered."""
    return {kind.name: kind for kind in import_module(_BUILT_IN, __package__).BUILT_IN}


def register_array(kind: ArrayKind) -> None:
    """Make a kind of array known: its names then work wherever a built-in array's do, in this process.

    Raises ArrayKindError, with the value: it is no `ArrayKind`, a field has a wrong type, or a name is taken.

    >>> from palpate.device import array_names, register_array, remove_array
    >>> from palpate.device.boards.autd3.kind import KIND  # or one of your own
    >>> remove_array("autd3")
    >>> register_array(KIND)
    >>> array_names()
    ('emulator', 'pat16', 'sonicsurface', 'stratos', 'autd3')
    """
    _require_types(kind)
    for called in (kind.name, *kind.aliases):
        if (owner := _owner(called)) is not None:
            raise ArrayKindError(f"array {kind.name} cannot be registered: {called!r} is a name of array {owner}")
    _kinds()[kind.name] = kind


def remove_array(name: str) -> None:
    """Forget a kind of array, by any of its names. Raises UnknownArrayError.

    >>> from palpate.device import array_model, array_names, register_array, remove_array
    >>> from palpate.device.boards.autd3.kind import KIND
    >>> remove_array("autd")  # what it is also called
    >>> array_names()
    ('emulator', 'pat16', 'sonicsurface', 'stratos')
    >>> register_array(KIND)  # known again
    >>> array_model("autd")
    ArrayModel('autd3', 249 transducers)
    """
    del _kinds()[canonical_name(name)]


def array_kinds() -> tuple[ArrayKind, ...]:
    """Every kind of array: built-in ones, then others as they were registered."""
    return tuple(_kinds().values())


def array_names() -> tuple[str, ...]:
    """Names of all arrays: built-in ones, then others as they were registered.

    >>> from palpate.device import array_names
    >>> array_names()
    ('emulator', 'pat16', 'sonicsurface', 'autd3', 'stratos')
    """
    return tuple(_kinds())


def canonical_name(name: str) -> str:
    """The array's own name, from that or an alias in any case, with or without `-`, `_` and blanks.

    Raises UnknownArrayError, with all names and aliases.
    """
    if (owner := _owner(name)) is not None:
        return owner
    known = ", ".join(
        f"{kind.name} ({', '.join(kind.aliases)})" if kind.aliases else kind.name for kind in _kinds().values()
    )
    called = [other for kind in _kinds().values() for other in (kind.name, *kind.aliases)]
    close = difflib.get_close_matches(str(name).casefold(), called, 1)
    meant = f" (did you mean {close[0]!r}?)" if close else ""
    raise UnknownArrayError(f"unknown array {name!r}{meant}; known: {known}")


def kind_of(model: ArrayModel) -> ArrayKind:
    """The kind of a model; raises UnknownArrayError for a model of a name that is not registered."""
    try:
        return _kinds()[model.name]
    except KeyError:
        raise UnknownArrayError(f"array {model.name!r} has no wire format; known: {', '.join(_kinds())}") from None


def array_model(name: str, *, calibration: Path | None = None, baud: int | None = None) -> ArrayModel:
    """The array of that name.

    Args:
        name: one of `array_names()`, or what else it is called (`openmpd`), in any case; the model has the first.
        calibration: board file (`.pat`) with the wiring and calibration of one board; of built-in arrays for pat16
            only.
        baud: rate of the UART [Bd]; of built-in arrays for sonicsurface only, 230400 unless its firmware was compiled
            for another.

    Raises:
        UnknownArrayError: no array of that name.
        CalibrationError: the board file is wrong, or none of this array's.
        UpdateRateError: no serial adapter has that baud rate.
        ArrayKindError: the kind builds something else than a model of its name.

    >>> from palpate.device import array_model
    >>> array_model("OpenMPD")
    ArrayModel('pat16', 256 transducers)
    """
    kind = _kinds()[canonical_name(name)]
    if calibration is not None and kind.calibration_serial is None:
        owners = " or ".join(other.name for other in array_kinds() if other.calibration_serial)
        raise CalibrationError(f"array {kind.name} has no board file; {calibration} is one of a {owners}")
    if baud is not None and not kind.takes_baud:
        raise UpdateRateError(f"array {kind.name} has no UART, so {baud} Bd mean nothing to it")
    given = {"calibration": calibration, "baud": baud}
    options = {option: value for option, value in given.items() if value is not None}
    model = cast("object", kind.build(**options))  # of others' code: no checker has seen it
    if not isinstance(model, ArrayModel):
        raise ArrayKindError(f"build of array {kind.name} gives {model!r}, but it must give an ArrayModel")
    if _kinds().get(model.name) is not kind:
        raise ArrayKindError(f"build of array {kind.name} gives a model named {model.name!r}")
    if model.takes_points != kind.takes_points:
        raise ArrayKindError(
            f"build of array {kind.name} gives a model with takes_points={model.takes_points}, but its layout is "
            f"{kind.layout!r}"
        )
    return model


def emulated_backend(
    name: str,
    *,
    clock: Clock | None = None,
    record: int = 0,
    serials: Sequence[str] | None = None,
    baud: float | None = None,
) -> Emulation:
    """A bus for pyusb, or serial ports, with models of a board; docs/formats/emulator.md has what they model.

    The boards have been switched on for a while; one that is plugged in again is fresh from power-up.

    Args:
        name: name of an array with an emulated bus, such as `emulator`, `pat16` or `sonicsurface`.
        clock: clock of all boards; None takes the monotonic one.
        record: how many of its last played frames each board keeps, for tests.
        serials: serial number of each board on the bus; None is one board.
        baud: bits a second of boards with a UART [Bd]; None is the rate of the published firmware.

    Raises:
        UnknownArrayError: there is no model of that board.

    >>> import usb.core
    >>> from palpate.device import VirtualClock, emulated_backend
    >>> bus = emulated_backend("emulator", clock=VirtualClock(), serials=["LEFT", "RIGHT"])
    >>> [board.serial_number for board in usb.core.find(find_all=True, backend=bus)]  # as pyusb sees them
    ['LEFT', 'RIGHT']
    """
    kind = _kinds().get(name)
    if kind is None or kind.emulate is None:
        known = ", ".join(other.name for other in array_kinds() if other.emulate)
        raise UnknownArrayError(f"no board of array {name!r} is emulated; known: {known}")
    given = None if serials is None else tuple(serials)
    return kind.emulate(EmulationRequest(serials=given, clock=clock, record=record, baud=baud))


def _owner(called: str) -> str | None:
    """Name of the array that is called so; None if none is."""
    wanted = _letters(called)
    return next((k.name for k in _kinds().values() if wanted in map(_letters, (k.name, *k.aliases))), None)


def _letters(name: str) -> str:
    return "".join(name.casefold().replace("-", "").replace("_", "").split())


def _require_types(kind: object) -> None:
    """Refuse what is no kind, or has a field of a wrong type: what comes from others is not type-checked."""
    if not isinstance(kind, ArrayKind):
        raise ArrayKindError(f"an array is registered as an ArrayKind, not as {kind!r}")

    def require(fields: str, is_right: Callable[[object], object], wanted: str) -> None:
        for field in fields.split():
            value: object = getattr(kind, field)
            if not is_right(value):
                raise ArrayKindError(f"{field} of array {kind.name!r} is {value!r}, but it must be {wanted}")

    require("name", lambda v: isinstance(v, str) and _NAME.fullmatch(v), "small letters, digits and -, a letter first")
    require("aliases", _are_aliases, "a tuple of names")
    require("build open_link", callable, "a function")
    require("layout", lambda v: isinstance(v, Layout | FocusLayout), "a Layout or a FocusLayout")
    require("calibration_serial emulate", lambda v: v is None or callable(v), "a function or None")
    require("takes_baud emulates_itself", lambda v: isinstance(v, bool), "True or False")
    sentences = "not_listed supposed watches_itself not_live"
    require(sentences, lambda v: v is None or isinstance(v, str), "a sentence or None")


def _are_aliases(value: object) -> bool:
    aliases = cast("tuple[object, ...]", value) if isinstance(value, tuple) else (None,)
    return all(isinstance(alias, str) and _letters(alias) for alias in aliases)
