"""TOML of plans, read within bounds; and the line of a key, for error messages.

tomllib keeps no positions, and no maintained library does. The text is cut into statements: the shortest runs of
whole lines that tomllib accepts by themselves.
"""

import re
import tomllib
from collections.abc import Iterator, Sequence
from itertools import takewhile
from typing import Any

TOML_MOST = 1 << 24
"""Most characters of one TOML text, a hundred times the longest sweep plan."""
KEY_PARTS_MOST = 32
"""Most parts of one dotted key."""

# One bare or quoted part of a key and its dot; possessive quantifiers never backtrack, so matching takes linear time.
_PART = r"""(?>(?<![A-Za-z0-9_-])[A-Za-z0-9_-]++|(?<!\\)"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+"""
_LONG_KEY = re.compile(f"(?:{_PART}){{{KEY_PARTS_MOST}}}")


def parse_toml(text: str) -> dict[str, Any]:
    """The table of a TOML text.

    Raises ValueError (tomllib.TOMLDecodeError) if it is not TOML, is nested too deeply, has more than TOML_MOST
    characters, or more than KEY_PARTS_MOST parts joined by dots, also in a text or a comment. The reason: memory of
    Python's parser grows with the square of a key's parts, to 4 GB for a key of 60 kB.
    """
    if len(text) > TOML_MOST:
        raise ValueError(f"it holds {len(text)} characters, more than {TOML_MOST}")
    if found := _LONG_KEY.search(text):
        line = text.count("\n", 0, found.start()) + 1
        raise ValueError(f"a key has more than {KEY_PARTS_MOST} parts (at line {line})")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("nested too deeply") from None


# ---- the line of a key

Place = tuple[str | int, ...]
"""Path of keys and, in arrays, of indices from 0: `("object", 1, "fit", 0)`."""
FAILURES_MOST = 200  # of parsing; bounds the time that a hostile text takes
_BEGIN = re.compile(r"\s*(?:\[.*\]\s*(?:#.*)?$|[^\s#\[\]{},][^=]*=)")  # a line that may begin a statement


def line_of(text: str, place: Sequence[str | int]) -> int | None:
    """Line, from 1, of a place in a valid TOML text, or of the nearest table or key around it; None if there is none.

    An array element has its own line if it begins on a later line than its key and nothing else is possible.
    """
    table, best, line = (), 0, None
    indices: dict[Place, int] = {}  # of the last table of each array of tables
    for number, statement in _statements(text.replace("\r\n", "\n")):
        content, offset = tomllib.loads(statement), 0
        if statement.lstrip().startswith("["):
            table = _table(content, indices)
            depth = sum(1 for _ in takewhile(lambda steps: steps[0] == steps[1], zip(table, place, strict=False)))
        elif tuple(place[: len(table)]) == table:
            depth = len(table) + _depth(content, place[len(table) :])
            offset = _element_offset(statement, place[len(table) : depth]) if depth > best else 0
        else:
            continue
        if depth > best:
            best, line = depth, number + offset
    return line


def _statements(text: str) -> Iterator[tuple[int, str]]:
    """Every header and pair, with the number of its first line; ends early after too many failures."""
    lines, failures, first = [*text.split("\n"), "_ ="], 0, 0  # the last one only ends the one before
    for stop in range(1, len(lines)):
        if not _BEGIN.match(lines[first]):
            first = stop
        elif _BEGIN.match(lines[stop]) or not lines[stop].strip():
            if _parsed(statement := "\n".join(lines[first:stop])) is not None:
                yield first + 1, statement
                first = stop
            elif (failures := failures + 1) > FAILURES_MOST:
                return


def _parsed(text: str) -> dict[str, Any] | None:
    try:
        return tomllib.loads(text)
    except ValueError:
        return None


def _table(content: Any, indices: dict[Place, int]) -> Place:
    """The place of a header's table, by what tomllib makes of the header alone."""
    place: Place = ()
    while isinstance(content, dict) and content:
        ((key, content),) = content.items()
        place = (*place, key)
        if isinstance(content, list):  # [[key]]
            indices[place] = indices.get(place, -1) + 1
        if place in indices:
            place = (*place, indices[place])
    return place


def _depth(value: Any, path: Sequence[str | int]) -> int:
    """How many steps of a path lead to something in a value."""
    for depth, step in enumerate(path):
        try:
            value = value[step]
        except (KeyError, IndexError, TypeError):
            return depth
    return len(path)


def _element_offset(statement: str, path: Sequence[str | int]) -> int:
    """Lines between a pair's key and the element of its array that a path leads to; 0 in doubt."""
    lines = statement.split("\n")
    index = next((step for step in path if isinstance(step, int)), None)
    if index is None or len(lines) == 1:
        return 0
    count, first, begin = 0, 0, ""
    keys: Sequence[str | int] = path[: path.index(index)]
    for stop in range(1, len(lines) + 1):
        elements: Any = _parsed(begin + "\n".join(lines[first:stop]) + ("" if stop == len(lines) else "\n]"))
        if elements is None and stop - first < FAILURES_MOST:
            continue
        if elements is None:
            return 0
        for key in keys:
            elements = elements[key]
        if index < count + len(elements):
            return first if index == count or stop == first + 1 else 0
        count, first, keys, begin = count + len(elements), stop, ("_",), "_ = ["
    return 0
