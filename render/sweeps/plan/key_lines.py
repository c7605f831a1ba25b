"""Lines of keys in a TOML text, which its reader does not tell: for messages that name the place of a fault.

The text must be valid TOML. A place is a path of keys and, in arrays, of numbers from 0: `("object", 1, "fit", 0)`.
"""

import re
from collections.abc import Mapping, Sequence

Place = tuple[str | int, ...]

_BARE = re.compile(r"[A-Za-z0-9_-]+")
_BLANK = re.compile(r"[ \t]*")
_VOID = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_SCALAR = re.compile(r"[^,\]}#\r\n]+")  # blanks too: a date may have one before its time
_STRING = re.compile(
    r'"""(?:[^\\]|\\.)*?"{3,5}(?!")' + r"|'''.*?'{3,5}(?!')" + r'|"(?:[^"\\]|\\.)*"' + r"|'[^']*'",
    re.DOTALL,
)
_ESCAPE = re.compile(r'\\(?:u([0-9A-Fa-f]{4})|U([0-9A-Fa-f]{8})|([btnfr"\\]))')
_CONTROL = {"b": "\b", "t": "\t", "n": "\n", "f": "\f", "r": "\r", '"': '"', "\\": "\\"}


def key_lines(text: str) -> dict[Place, int]:
    """Line, from 1, of every table, key and array element of a valid TOML text."""
    return _Scan(text).lines


def line_of(lines: Mapping[Place, int], place: Sequence[str | int]) -> int | None:
    """Line of a place, or of the nearest thing around it; None if there is nothing."""
    for stop in range(len(place), 0, -1):
        line = lines.get(tuple(place[:stop]))
        if line is not None:
            return line
    return None


class _Scan:
    """Goes once through a text and notes where things begin."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.at = 0
        self.lines: dict[Place, int] = {}
        self._line, self._counted = 1, 0
        self._tables: dict[Place, int] = {}  # arrays of tables: index of the last
        self._skip(_VOID)
        table: Place = ()
        while self.at < len(text):
            table = self._statement(table)
            self._skip(_VOID)

    def _statement(self, table: Place) -> Place:
        """A header, which begins another table, or a key and its value."""
        start = self.at
        brackets = 2 if self.text.startswith("[[", start) else 1 if self.text.startswith("[", start) else 0
        if not brackets:
            self._pair(table)
            return table
        self.at += brackets
        keys = self._keys()
        self.at += brackets
        table = (*self._resolved(keys[:-1]), keys[-1])
        if brackets == 2:
            self._note(table, start)
            self._tables[table] = self._tables.get(table, -1) + 1
            table = (*table, self._tables[table])
        self._note(table, start)
        return table

    def _resolved(self, keys: Sequence[str]) -> Place:
        """A header's keys with the number of the last table wherever one names an array of tables."""
        place: Place = ()
        for key in keys:
            place = (*place, key)
            if place in self._tables:
                place = (*place, self._tables[place])
        return place

    def _pair(self, table: Place) -> None:
        start, place = self.at, table
        for key in self._keys():
            place = (*place, key)
            self._note(place, start)
        self.at += 1  # the =
        self._skip(_BLANK)
        self._value(place)

    def _keys(self) -> tuple[str, ...]:
        """Keys with dots between them; stops at what follows."""
        keys: list[str] = []
        while True:
            self._skip(_BLANK)
            quoted = self.text[self.at] in "\"'"
            found = self._skip(_STRING if quoted else _BARE)
            keys.append(_unquoted(found) if quoted else found)
            self._skip(_BLANK)
            if not self.text.startswith(".", self.at):
                return tuple(keys)
            self.at += 1

    def _value(self, place: Place) -> None:
        """Skip a value, noting what is in it."""
        first = self.text[self.at]
        if first in "\"'":
            self._skip(_STRING)
        elif first == "[":
            self._items(place)
        elif first == "{":
            self._inline(place)
        else:
            self._skip(_SCALAR)

    def _items(self, place: Place) -> None:
        """An array."""
        self.at += 1
        number = 0
        while True:
            self._skip(_VOID)
            if self.text[self.at] == "]":
                break
            if self.text[self.at] == ",":
                self.at += 1
                number += 1
                continue
            self._note((*place, number), self.at)
            self._value((*place, number))
        self.at += 1

    def _inline(self, place: Place) -> None:
        """An inline table."""
        self.at += 1
        while True:
            self._skip(_VOID)
            if self.text[self.at] == "}":
                break
            if self.text[self.at] == ",":
                self.at += 1
                continue
            self._pair(place)
        self.at += 1

    def _skip(self, pattern: re.Pattern[str]) -> str:
        found = pattern.match(self.text, self.at)
        if found is None:
            raise ValueError(f"not TOML at character {self.at}: {self.text[self.at : self.at + 20]!r}")
        self.at = found.end()
        return found[0]

    def _note(self, place: Place, at: int) -> None:
        """Keep the first line of a place; positions only grow, but for a pair's keys, which share one."""
        if at > self._counted:
            self._line += self.text.count("\n", self._counted, at)
            self._counted = at
        self.lines.setdefault(place, self._line)


def _unquoted(text: str) -> str:
    """A quoted key's name."""
    if text[0] == "'":
        return text[1:-1]
    return _ESCAPE.sub(lambda m: _CONTROL[m[3]] if m[3] else chr(int(m[1] or m[2], 16)), text[1:-1])
