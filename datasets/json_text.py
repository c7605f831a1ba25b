"""JSON that another program may have written, read within bounds; every refusal is a ValueError.

| refused                                                 | found                                               |
|---------------------------------------------------------|-----------------------------------------------------|
| a text that is too long, or could take too much memory  | before parsing, by its length, brackets and commas  |
| lists and objects too deep in each other                | before parsing, by its brackets                     |
| a key twice in an object, NaN, Infinity, 1e999          | while parsing, by hooks                             |
| half a surrogate pair, which cannot be shown or written | after parsing, only if the text escapes such a half |
"""

import json
import math
import os
from collections import Counter
from typing import Any, Never

import numpy as np

from .bounded_file import ANY_SIZE, FileBoundError, read_text, require_bytes, require_parsable

TEXT_MOST = 1 << 24
"""Longest JSON text that is no file of its own [byte]; a strategy of hundreds of spheres takes 140 kB."""
DEPTH_MOST = 256
"""Most levels of lists and objects; an implicit object of 100 operators above one another has about 200."""

_MARKS = b'[{]}"'
_UNMARKED = bytes(set(range(256)) - set(_MARKS))
_STEP = np.zeros(256, np.int8)
_STEP[list(_MARKS)] = (1, 1, -1, -1, 0)
_MARK_BYTES = 12  # that `_depth` takes for each mark


def parse_json(
    text: str | bytes, *, allow_nan: bool = False, allow_halves: bool = False, text_most: int = TEXT_MOST
) -> Any:
    """The value of a JSON text; bytes are UTF-8.

    allow_nan: whether NaN, Infinity and numbers beyond float64 may stand in it.
    allow_halves: whether texts may hold half a surrogate pair, which the caller must replace before it writes them.
    text_most: most characters or bytes; the budget of memory holds besides.

    Raises ValueError, whose message may follow "not JSON: "; it is a json.JSONDecodeError where the grammar is broken.
    """
    if len(text) > text_most:
        raise ValueError(f"{len(text)} bytes, expected at most {text_most}")
    content, text = (text, text.decode()) if isinstance(text, bytes) else (text.encode(), text)
    try:
        require_parsable(content)
        depth = content.count(b"[") + content.count(b"{")
        if depth > DEPTH_MOST:  # most texts have fewer brackets, and need no more than that
            depth = _depth(content)
    except FileBoundError as error:
        raise ValueError(str(error)) from None
    if depth > DEPTH_MOST:
        raise ValueError(f"lists or objects lie {depth} deep in each other, more than {DEPTH_MOST}")
    value: Any = (_LENIENT if allow_nan else _FINITE).decode(text)
    if not allow_halves and (rb"\ud" in content or rb"\uD" in content):
        json.dumps(value, ensure_ascii=False).encode()  # raises UnicodeEncodeError, a ValueError, for half a pair
    return value


def read_json(path: str | os.PathLike[str], *, allow_nan: bool = False) -> Any:
    """The value of a JSON file; raises ValueError as `parse_json`, and as `read_text`."""
    return parse_json(read_text(path), allow_nan=allow_nan, text_most=ANY_SIZE)


def _depth(content: bytes) -> int:
    """Most levels of lists and objects, exact for JSON, and up to the first fault of what is not."""
    plain = content.replace(rb"\\", b"").replace(rb"\"", b"")
    marks = np.frombuffer(plain.translate(None, _UNMARKED).replace(b'""', b""), np.uint8)
    require_bytes(_MARK_BYTES * len(marks), "what its text holds")
    is_outside = np.cumsum(marks == ord('"'), dtype=np.int32) % 2 == 0  # of texts, where brackets mean nothing
    return int(np.cumsum(_STEP[marks] * is_outside, dtype=np.int32).max(initial=0))


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    values = dict(pairs)
    if len(values) != len(pairs):
        twice = next(name for name, count in Counter(name for name, _ in pairs).items() if count > 1)
        raise ValueError(f"an object has the key {twice[:80]!r} more than once")
    return values


def _finite(text: str) -> float:
    value = float(text)
    if math.isinf(value):
        raise ValueError(f"{text[:80]} is not a finite number")
    return value


def _refuse(constant: str) -> Never:
    raise ValueError(f"{constant} is not a finite number")


_LENIENT = json.JSONDecoder(object_pairs_hook=_object)
_FINITE = json.JSONDecoder(object_pairs_hook=_object, parse_float=_finite, parse_constant=_refuse)
