"""Strategies as people write them: their fields read from JSON, checked, and refused by name, value and bound."""

from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ..datasets.bounded_file import FileBoundError, parse_json, read_text
from .errors import StrategyError

T = TypeVar("T")


def require_choice(name: str, value: object, known: tuple[str, ...]) -> None:
    """Refuse what is none of the known names."""
    if not isinstance(value, str) or value not in known:
        said = shown(value) if isinstance(value, int) else repr(value)
        raise StrategyError(f"{name} must be one of {', '.join(known)}, not {said}")


def require_number(name: str, value: object, low: float, high: float, *, unit: str = "", whole: bool = False) -> None:
    """Refuse what is no number, not finite, or outside low..high."""
    span = f"{low:g}..{high:g} {unit}".rstrip()
    if isinstance(value, bool) or not isinstance(value, int if whole else int | float | np.integer | np.floating):
        raise StrategyError(f"{name} must be {'a whole number' if whole else 'a number'} in {span}, not {value!r}")
    if not low <= value <= high:  # a NaN compares false; an int may be too large for a float
        raise StrategyError(f"{name} must lie in {span}, not {shown(value)}")


def shown(value: object) -> str:
    """A refused value, in a sentence."""
    huge = isinstance(value, int) and abs(value) >= 10**15  # Python refuses to print the largest
    return "a number that large" if huge else str(value)


def told(value: object) -> str:
    """The same of a value of any kind, on one line and not longer than a few words."""
    try:
        text = shown(value) if isinstance(value, int) else repr(value)
    except ValueError:  # of a number within it that Python refuses to print
        text = f"a {type(value).__name__} with too large a number"
    text = " ".join(text.split())
    return text if len(text) <= 80 else f"{text[:77]}..."


def read_fields(text: str, known: Collection[str], name: str) -> dict[str, Any]:
    """The fields of a JSON object, if it has no others; `name` is what it describes."""
    try:
        values = parse_json(text)
    except (ValueError, FileBoundError) as error:
        raise StrategyError(f"{name}: not JSON ({error})") from error
    return known_fields(values, known, name)


def known_fields(values: object, known: Collection[str], name: str) -> dict[str, Any]:
    """The fields of a parsed JSON object, if it has no others."""
    if not isinstance(values, Mapping):
        raise StrategyError(f"{name}: must be a JSON object, not {type(values).__name__}")
    for key in values:
        if key not in known:
            raise StrategyError(f"{name}: unknown field {key!r}; known: {', '.join(known)}")
    return dict(values)


def load_by_name(source: str, presets: Mapping[str, Callable[[], T]], read: Callable[[str], T], name: str) -> T:
    """A preset by its name, or what `read` makes of a JSON file; `name` is what it is."""
    if source.lower() in presets:
        return presets[source.lower()]()
    path = Path(source)
    if not path.exists():
        raise StrategyError(f"unknown {name} {source!r}: neither a preset ({', '.join(presets)}) nor a JSON file")
    try:
        return read(read_text(path))
    except (StrategyError, UnicodeDecodeError, OSError) as error:
        raise StrategyError(f"{path}: {error}") from error
