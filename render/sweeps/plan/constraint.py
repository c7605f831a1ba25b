"""Constraints of a plan: which combinations of its axes are left out.

| in the plan | leaves out |
|---|---|
| `[[exclude]]` | recipes that match all entries of the table |
| `[[only]]` | recipes that match all entries of none of these tables |

| entry | matches |
|---|---|
| `"strategy.source" = "hatch"` | this value; a pattern with `*` matches names and paths relative to the plan |
| `"hand.source" = ["skin", "planes"]` | any of them; of a key that is a list itself: of a list of lists |
| `"object.fit" = { at_least = 0.1 }` | numbers from this on; also `at_most`, or both |
"""

import glob
import math
from collections import defaultdict
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from ....datasets.known_names import likely_name
from ...validation import value_text
from .axes import KEYS, value_of
from .values import NumberCheck, read_values, refuse, within

BOUNDS = ("at_least", "at_most")
Matches = Callable[[Mapping[str, Any]], bool]
"""Whether the content of a recipe's part matches an entry."""


@dataclass(frozen=True, eq=False)
class Constraint:
    """One table of a plan: entries by axis."""

    entries: Mapping[str, Sequence[Matches]]

    def matches(self, axis: str, content: Mapping[str, Any]) -> bool:
        """Whether a part matches all entries of its axis."""
        return all(matches(content) for matches in self.entries.get(axis, ()))


def constraint_of(table: object, folder: Path) -> Constraint:
    """The constraint of a plan's table; raises PlanFault."""
    if not isinstance(table, dict) or not table:
        refuse(f"must be a table of at least one axis.key = value, not {value_text(table)}")
    entries: dict[str, list[Matches]] = defaultdict(list)
    for path, value in _flat(table):
        axis, _, key = ".".join(path).partition(".")
        if axis not in KEYS or key not in ("source", *KEYS[axis]):
            known = [f"{name}.{one}" for name, keys in KEYS.items() for one in ("source", *keys)]
            meant = likely_name(f"{axis}.{key}", known)
            refuse(f"unknown key {'.'.join(path)!r}{meant}; it must be axis.key, such as strategy.source", path)
        with within(*path):
            entries[axis].append(_entry(axis, key, value, folder))
    return Constraint(dict(entries))


def _flat(table: Mapping[str, Any]) -> list[tuple[tuple[str, ...], Any]]:
    """Entries by their path; `strategy.source` with and without quotes is the same."""
    out: list[tuple[tuple[str, ...], Any]] = []
    for name, value in table.items():
        if name in KEYS and isinstance(value, dict):
            out += [((name, key), inner) for key, inner in value.items()]
        else:
            out.append(((name,), value))
    return out


def _entry(axis: str, key: str, given: object, folder: Path) -> Matches:
    """The entry of a key; folder: from which patterns of sources start. Raises PlanFault."""
    check = None if key == "source" else KEYS[axis][key].check
    if isinstance(given, dict):
        if not isinstance(check, NumberCheck):
            refuse(f"must be a value or a list of them, not {value_text(given)}: it is no number")
        return _bounds(axis, key, given, check)
    if check is None:
        listed = given if isinstance(given, list) else [given]
        texts = [text for text in listed if isinstance(text, str) and text]
        if not texts or len(texts) < len(listed):
            refuse(f"must be a name, or a list of names, not {value_text(given)}")
        exact = {*texts, *(str(folder / text) for text in texts)}  # a name with brackets is no pattern of itself
        patterns = (*texts, *(str(Path(glob.escape(str(folder))) / text) for text in texts))
        return lambda content: _is_named(value_of(axis, key, content), exact, patterns)
    accepted = list(read_values(given, check))
    return lambda content: value_of(axis, key, content) in accepted


def _bounds(axis: str, key: str, given: Mapping[str, Any], check: NumberCheck) -> Matches:
    """The entry of a table of at_least, at_most or both."""
    if not given or set(given) - set(BOUNDS):
        refuse(f"must have at_least, at_most or both, not {value_text(given)}")
    for name, bound in given.items():
        if isinstance(bound, bool) or not isinstance(bound, int | float) or bound != bound:
            refuse(f"{name} must be a number in {check.span}, not {value_text(bound)}")
    low, high = (given.get(name, default) for name, default in zip(BOUNDS, (-math.inf, math.inf), strict=True))
    return lambda content: (value := value_of(axis, key, content)) is not None and low <= value <= high


def _is_named(named: Mapping[str, Any] | None, exact: Collection[str], patterns: Sequence[str]) -> bool:
    """Whether the name or the path of a source or an alignment is one of `exact`, or matches a pattern."""
    known = (named["name"], named["source"]) if named else ()
    return any(name in exact or any(fnmatchcase(name, pattern) for pattern in patterns) for name in known)
