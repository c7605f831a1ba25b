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
from collections.abc import Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from ....datasets.known_names import likely_name
from ...validation import value_text
from .axes import KEYS, value_of
from .line_search import Place
from .values import Check, NumberCheck, refuse, swept, within

BOUNDS = ("at_least", "at_most")


@dataclass(frozen=True)
class ConstraintEntry:
    """One `axis.key = value` of a constraint."""

    key: str
    accepted: tuple[Any, ...] = ()
    """Values, any of which matches."""
    at_least: float | None = None
    at_most: float | None = None
    folder: Path = Path()
    """From which patterns of sources start."""

    def matches(self, axis: str, content: Mapping[str, Any]) -> bool:
        """Whether a part of a recipe matches."""
        value = value_of(axis, self.key, content)
        if self.key in ("source", "alignment"):
            named = content if self.key == "source" else value
            return named is not None and any(self._names(named, text) for text in self.accepted)
        if value is None:
            return False
        if self.accepted:
            return value in self.accepted
        return (self.at_least is None or value >= self.at_least) and (self.at_most is None or value <= self.at_most)

    def _names(self, content: Mapping[str, Any], text: str) -> bool:
        """Whether a text is a source's name, its path from the plan's folder on, or a pattern of these."""
        known = (content["name"], content["source"])
        if text in known or str(self.folder / text) in known:  # names may have brackets
            return True
        patterns = (text, str(Path(glob.escape(str(self.folder))) / text))
        return any(fnmatchcase(name, pattern) for name in known for pattern in patterns)


@dataclass(frozen=True, eq=False)
class Constraint:
    """One table of a plan: entries by axis."""

    entries: Mapping[str, tuple[ConstraintEntry, ...]]

    def matches(self, axis: str, content: Mapping[str, Any]) -> bool:
        """Whether a part matches all entries of its axis."""
        return all(entry.matches(axis, content) for entry in self.entries.get(axis, ()))


def constraint_of(table: object, folder: Path) -> Constraint:
    """The constraint of a plan's table; raises PlanFault."""
    if not isinstance(table, dict) or not table:
        refuse(f"must be a table of at least one axis.key = value, not {value_text(table)}")
    entries: dict[str, tuple[ConstraintEntry, ...]] = {}
    for path, value in _flat(table):
        place: Place = path
        axis, _, key = ".".join(path).partition(".")
        if axis not in KEYS or key not in ("source", *KEYS[axis]):
            known = [f"{name}.{one}" for name, keys in KEYS.items() for one in ("source", *keys)]
            meant = likely_name(f"{axis}.{key}", known)
            refuse(f"unknown key {'.'.join(path)!r}{meant}; it must be axis.key, such as strategy.source", place)
        check = None if key == "source" else KEYS[axis][key].check
        entries[axis] = (*entries.get(axis, ()), _entry(key, check, value, folder, place))
    return Constraint(entries)


def _flat(table: Mapping[str, Any]) -> list[tuple[tuple[str, ...], Any]]:
    """Entries by their path; `strategy.source` with and without quotes is the same."""
    out: list[tuple[tuple[str, ...], Any]] = []
    for name, value in table.items():
        if name in KEYS and isinstance(value, dict):
            out += [((name, key), inner) for key, inner in value.items()]
        else:
            out.append(((name,), value))
    return out


def _entry(key: str, check: Check | None, value: object, folder: Path, place: Place) -> ConstraintEntry:
    if isinstance(value, dict):
        if not isinstance(check, NumberCheck):
            refuse(f"must be a value or a list of them, not {value_text(value)}: it is no number", place)
        if not value or set(value) - set(BOUNDS):
            refuse(f"must have at_least, at_most or both, not {value_text(value)}", place)
        for name, bound in value.items():
            if isinstance(bound, bool) or not isinstance(bound, int | float) or bound != bound:
                refuse(f"{name} must be a number in {check.span}, not {value_text(bound)}", place)
        return ConstraintEntry(key, at_least=value.get("at_least"), at_most=value.get("at_most"))
    if check is None:
        texts = value if isinstance(value, list) else [value]
        if not texts or not all(isinstance(text, str) and text for text in texts):
            refuse(f"must be a name, or a list of names, not {value_text(value)}", place)
        return ConstraintEntry(key, tuple(texts), folder=folder)
    with within(*place):
        return ConstraintEntry(key, tuple(swept(check)(value)))
