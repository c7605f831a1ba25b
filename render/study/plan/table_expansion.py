"""Tables of STUDY.toml that stand for several: `for = { object = ["cube", "tube"] }` and `{object}` in other values."""

import re
from collections.abc import Callable
from itertools import product
from typing import Any

from ....datasets.known_names import likely_name
from ...sweeps.plan.line_search import Place
from ...validation import is_number, value_text

TABLES_MOST = 1000
"""That all tables of one kind stand for."""
NUMBER_MOST = 1e12
"""Of the values of `for`; a nan is none of them."""
_PLACEHOLDER = re.compile(r"\{\{|\}\}|\{([A-Za-z_]\w*)\}")
_KEY = re.compile(r"[A-Za-z_]\w*")
Note = Callable[[Place, str], None]
"""Notes a fault: its place within the table, and the sentence."""


def expand_table(table: dict[str, Any], note: Note) -> list[dict[str, Any]]:
    """The tables that a table stands for, one for each combination of the values of its `for`, the last key fastest.

    A text that is exactly `{key}` becomes the value itself, so that a number stays one; within a longer text the value
    is put in, and `{{` and `}}` are braces. A table without `for` stands for itself, and its braces stay. Returns none,
    with the fault noted, for a `for` that cannot be used and for placeholders that it does not know.
    """
    if "for" not in table:
        return [table]
    choices = table["for"]
    if not _can_be_used(choices, note):
        return []
    rest = {key: value for key, value in table.items() if key != "for"}
    filler = _Filler(note)
    filled = [filler.fill(rest, values, ()) for values in factor_values(table)]
    for key in choices:
        if key not in filler.used:
            note(("for", key), f"is not used: no other value of the table contains {{{key}}}")
    return filled if filler.is_fine else []


def factor_values(table: dict[str, Any]) -> list[dict[str, Any]]:
    """The values of `for`, by key, of each of the tables that `expand_table` gives; one without any for no `for`."""
    choices = table.get("for", {})
    return [dict(zip(choices, values, strict=True)) for values in product(*choices.values())]


def _can_be_used(choices: object, note: Note) -> bool:
    """Whether `for` is a table of keys with lists of different values; faults are noted."""
    if not isinstance(choices, dict) or not choices:
        note(("for",), f'must be a table of lists, such as {{ object = ["cube", "tube"] }}, not {value_text(choices)}')
        return False
    fine, count = True, 1
    for key, values in choices.items():
        what = None
        if not _KEY.fullmatch(key):
            what = f"must be called by letters, digits and _, not {value_text(key)}"
        elif not isinstance(values, list) or not values:
            what = f"must be a list of at least one value, not {value_text(values)}"
        elif not all(isinstance(value, str) or (is_number(value) and abs(value) <= NUMBER_MOST) for value in values):
            what = f"must be a list of texts, or of numbers in +-{NUMBER_MOST:g}, not {value_text(values)}"
        elif len(set(map(str, values))) < len(values):
            what = f"must be a list of different values, not {value_text(values)}"
        else:
            count *= len(values)
        if what:
            note(("for", key), what)
            fine = False
    if fine and count > TABLES_MOST:
        note(("for",), f"must stand for at most {TABLES_MOST} combinations, not more")
        return False
    return fine


class _Filler:
    """Puts values into the texts of a table, and remembers which were used."""

    def __init__(self, note: Note) -> None:
        self.note = note
        self.used: set[str] = set()
        self.is_fine = True

    def fill(self, value: Any, values: dict[str, Any], place: Place) -> Any:
        """A copy of a value with all placeholders filled in; keys stay as they are."""
        if isinstance(value, dict):
            return {key: self.fill(own, values, (*place, key)) for key, own in value.items()}
        if isinstance(value, list):
            return [self.fill(own, values, (*place, k)) for k, own in enumerate(value)]
        if not isinstance(value, str):
            return value
        alone = _PLACEHOLDER.fullmatch(value)
        if alone and alone[1] in values:
            self.used.add(alone[1])
            return values[alone[1]]

        def put(found: re.Match[str]) -> str:
            key = found[1]
            if key is None:
                return found[0][0]  # a brace that was written twice
            if key not in values:
                meant, self.is_fine = likely_name(key, values), False
                self.note(place, f"{found[0]} is no key of this table's `for`{meant}; known: {', '.join(values)}")
                return found[0]
            self.used.add(key)
            return str(values[key])

        return _PLACEHOLDER.sub(put, value)
