"""JSON that a file or an attribute holds, read with bounds; a refusal is a ValueError that names value and bound."""

from __future__ import annotations

import json
import math
from collections import Counter
from typing import Any, cast

TEXT_MOST = 1 << 24
"""[byte] of a JSON text; a strategy of hundreds of spheres takes 140 kB."""
DEPTH_MOST = 256
"""Lists and objects in each other; an implicit object of 100 operators above one another has about 200."""


def parse_json(text: str | bytes, *, allow_nan: bool = False, text_most: int = TEXT_MOST) -> Any:
    """The value of a JSON text of bounded size and depth, whose objects name each key once.

    allow_nan: whether NaN, Infinity and numbers beyond float64 may stand in it.

    Raises:
        ValueError: The text is no JSON, or refused; the message is fit to follow "is not JSON: ".
    """
    if len(text) > text_most:
        raise ValueError(f"{len(text)} bytes, expected at most {text_most}")
    try:
        if isinstance(text, bytes):
            text = text.decode()  # json would guess UTF-16 and UTF-32, too
        value: Any = json.loads(text, object_pairs_hook=_object_of)
    except RecursionError:
        raise ValueError(f"lists or objects lie more than {DEPTH_MOST} deep in each other") from None
    _require_bounded(value, allow_nan)
    return value


def _object_of(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    values = dict(pairs)
    if len(values) != len(pairs):
        twice = next(name for name, count in Counter(name for name, _ in pairs).items() if count > 1)
        raise ValueError(f"an object has the key {twice[:80]!r} more than once")
    return values


def _require_bounded(value: Any, allow_nan: bool) -> None:
    """Refuse depth and numbers that what comes after could not hold; without recursion, whose depth has a limit."""
    level: list[Any] = [value]
    for _ in range(DEPTH_MOST + 1):
        below: list[Any] = []
        for item in level:
            if isinstance(item, dict):
                below += [part for pair in cast("dict[str, Any]", item).items() for part in pair]
            elif isinstance(item, list):
                below += cast("list[Any]", item)
            elif isinstance(item, float) and not allow_nan and not math.isfinite(item):
                raise ValueError(f"{item!r} is not a finite number")
            elif isinstance(item, str) and not item.isascii():
                item.encode()  # half a surrogate pair is text that can be neither shown nor written
        level = below
        if not level:
            return
    raise ValueError(f"lists or objects lie more than {DEPTH_MOST} deep in each other")
