"""Checks of values that users write (strategies in JSON, ranges, choices); errors name field, value and bounds."""

import sys
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeGuard, TypeVar

from ..datasets.bounded_file import read_text
from ..datasets.known_names import find_name, likely_file, likely_name, unknown_name
from .errors import StrategyError
from .file_kinds import described_file

if TYPE_CHECKING:
    import numpy as np

T = TypeVar("T")
OTHER_UNITS = {
    "m": ("mm", 1e-3, "lengths are in metres"),
    "m/s": ("mm/s", 1e-3, "speeds are in metres a second"),
    "Hz": ("kHz", 1e3, "rates are in hertz"),
    "s": ("ms", 1e-3, "times are in seconds"),
}
"""By SI unit: the unit in which people give such a quantity by mistake, its factor, words."""


def is_number(value: object) -> "TypeGuard[int | float | np.integer | np.floating]":
    """Whether a value is a number of Python or NumPy; True and False are none."""
    if isinstance(value, int | float):
        return not isinstance(value, bool)
    numpy = sys.modules.get("numpy")  # a command that must fail does without its import
    return numpy is not None and isinstance(value, (numpy.integer, numpy.floating))


def require_choice(name: str, value: object, known: tuple[str, ...]) -> None:
    """Raise StrategyError unless a value is one of the known names."""
    if not isinstance(value, str) or value not in known:
        given = number_text(value) if isinstance(value, int) else repr(value)
        raise StrategyError(f"{name} must be one of {', '.join(known)}, not {given}{likely_name(value, known)}")


def choose(name: str, value: str, known: tuple[str, ...]) -> str:
    """The known name that a user wrote in any case; raises StrategyError for what is none."""
    found = find_name(value, known)
    require_choice(name, value if found is None else found, known)
    return found or value


def require_number(name: str, value: object, low: float, high: float, *, unit: str = "", whole: bool = False) -> None:
    """Raise StrategyError unless a value is a finite number in low..high, and of type int if `whole`."""
    span = f"{low:g}..{high:g} {unit}".rstrip()
    if not is_number(value) or (whole and not isinstance(value, int)):
        raise StrategyError(f"{name} must be {'a whole number' if whole else 'a number'} in {span}, not {value!r}")
    if not low <= value <= high:  # a NaN compares false; an int may be too large for a float
        raise StrategyError(f"{name} must lie in {span}, not {number_text(value)}{unit_hint(value, low, high, unit)}")


def unit_hint(value: float, low: float, high: float, unit: str) -> str:
    """The number in the SI unit, as part of a sentence, if it is in bounds when taken as one in a usual other unit."""
    other, factor, what = OTHER_UNITS.get(unit.split(" ")[0], ("", 0.0, ""))
    if not other:
        return ""
    if abs(value) > 1e12 or value < 0 <= low:  # of no unit; an int may be too large for a float
        return ""
    is_wrong = abs(value) >= max(high, 1.0) if factor < 1.0 else value < low
    if not is_wrong or not low <= abs(value) * factor <= high:
        return ""
    return f"; {what}, {value:g} {other} are {value * factor:g}"


def number_text(value: object) -> str:
    """A refused number for an error message."""
    huge = isinstance(value, int) and abs(value) >= 10**15  # Python refuses to print the largest
    return "a number that large" if huge else str(value)


def value_text(value: object) -> str:
    """A refused value of any type for an error message: one line of at most 80 characters."""
    try:
        text = number_text(value) if isinstance(value, int) else repr(value)
    except ValueError:  # it contains a number that Python refuses to print
        text = f"a {type(value).__name__} with too large a number"
    text = " ".join(text.split())
    return text if len(text) <= 80 else f"{text[:77]}..."


def read_fields(text: str, known: Collection[str], name: str) -> dict[str, Any]:
    """Fields of a JSON object; name: what the object describes, for errors.

    Raises StrategyError for a text that is not a JSON object, and for unknown fields.
    """
    from ..datasets.json_text import parse_json  # it imports NumPy

    try:
        values = parse_json(text, allow_nan=True)
    except ValueError as error:
        raise StrategyError(f"{name}: not JSON ({error})") from error
    return known_fields(values, known, name)


def known_fields(values: object, known: Collection[str], name: str) -> dict[str, Any]:
    """Fields of a parsed JSON object; arguments and errors as for `read_fields`."""
    if not isinstance(values, Mapping):
        raise StrategyError(f"{name}: must be a JSON object, not {type(values).__name__}")
    for key in values:
        if key not in known:
            raise StrategyError(f"{name}: " + unknown_name("field", key, known))
    return dict(values)


def load_by_name(
    source: str,
    presets: Mapping[str, Callable[[], T]],
    read: Callable[[str], T],
    name: str,
    words: Collection[str] = (),
    others: str = "",
) -> T:
    """The preset called `source`, or the JSON file at that path, parsed by `read`; name: its kind, for errors;
    words: others that stand for presets; others: a phrase on what has other names, and where it belongs.

    Raises StrategyError for a source that is neither, and for a file that cannot be read.
    """
    if not isinstance(source, str | Path):  # pyright: ignore[reportUnnecessaryIsInstance]  # scripts give others
        raise StrategyError(f"{name} must be the name of a preset or of a JSON file, not {value_text(source)}")
    source = str(source)
    found = find_name(source, presets)
    if found is not None:
        return presets[found]()
    path = Path(source)
    try:
        is_there = bool(source.strip()) and path.exists() and not path.is_dir()
    except (OSError, ValueError):  # no name that a file could have
        is_there = False
    if not is_there:
        meant = likely_name(source, [*presets, *words]) or likely_file(path)
        raise StrategyError(
            f"unknown {name} {value_text(source)}{meant}: neither a preset ({', '.join(presets)}) nor a JSON file"
            f"{'' if meant else others}"
        )
    try:
        return read(read_text(path))
    except UnicodeDecodeError as error:
        raise StrategyError(f"{path}: not JSON, which is text in UTF-8") from error
    except (StrategyError, OSError) as error:
        raise StrategyError(f"{path}: {error}") from error


def require_path(path: object, what: str) -> Path:
    """A path as Path; raises StrategyError, which names what the path is for, for what is none."""
    if not isinstance(path, str | Path):
        raise StrategyError(f"{what} must be a path, not {value_text(path)}")
    return Path(path)


def refuse_object(path: Path) -> None:
    """Raise StrategyError, with what a file is and what takes it, where a file of contours is wanted."""
    if path.is_file() and (what := described_file(path)) is not None:
        raise StrategyError(f"{path} is no contour file but {what}")
    from ..datasets.shapes.built_in import shape_name  # it imports NumPy

    if not path.exists() and shape_name(str(path)) is not None:
        raise StrategyError(
            f"{path} is an object, not a file: palpate render {path} exploration -o {path}.h5 makes one"
        )
