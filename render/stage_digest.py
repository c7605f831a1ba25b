"""What tells a user's function from others: its name, the whole file that defines it, and what was bound to it.

| of                                  | counts                                                            |
|-------------------------------------|-------------------------------------------------------------------|
| a function, a Warp function         | name, file, defaults, what it encloses                            |
| a partial, a method                 | function, positional and named arguments; object                  |
| a class; an object that is called   | name and file; its class and its attributes                       |
| any of them without a file          | the text of its notebook cell, else its byte code                 |
| any of them from this package       | its name: who makes results tells the rest                        |
| an array, lists, dicts              | type, shape and bytes; their items                                |
| anything else                       | how Python writes it, without addresses in memory                 |
"""

import hashlib
import inspect
import linecache
import re
from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path
from types import CodeType
from typing import Any

import numpy as np

PACKAGE = __name__.rpartition(".")[0].rpartition(".")[0]
ADDRESS = re.compile(r" at 0x[0-9a-fA-F]+")
DEEP = 8  # bound to what is bound to ...: further down, how Python writes it


def digest_of(function: Any) -> str:
    """SHA-256 of a function as the table says, its file as it is now; where the file lies does not count."""
    return hashlib.sha256("\0".join(_Reader().told(function, 0)).encode()).hexdigest()


def place_of(function: Any) -> str:
    """The file that defines a function, through partials and Warp functions, or what it is called."""
    while isinstance(function, partial):
        function = function.args[0] if function.args else function.func
    function = getattr(function, "func", None) or function
    return _file_of(function) or _file_of(type(function)) or repr(function)


class _Reader:
    """Reads what a function consists of, each thing once."""

    def __init__(self) -> None:
        self._seen: set[int] = set()

    def told(self, value: Any, depth: int) -> list[str]:
        """Texts that it is told by."""
        value = getattr(value, "func", None) or value if not isinstance(value, partial) else value  # Warp's hold one
        if isinstance(value, np.ndarray):
            return [f"{value.dtype.str} {value.shape}", hashlib.sha256(np.ascontiguousarray(value)).hexdigest()]
        if depth >= DEEP:
            return [ADDRESS.sub("", repr(value))]
        if isinstance(value, list | tuple):
            return [f"{len(value)}", *self._each(value, depth)]
        if isinstance(value, Mapping):
            return [f"{len(value)}", *self._named(value, depth)]
        return self._callable(value, depth) if callable(value) else [ADDRESS.sub("", repr(value))]

    def _callable(self, value: Any, depth: int) -> list[str]:
        if id(value) in self._seen:
            return ["again"]
        self._seen.add(id(value))
        if isinstance(value, partial):
            return [*self._each((value.func, *value.args), depth), *self._named(value.keywords, depth)]
        if inspect.ismethod(value):
            return self._each((value.__func__, value.__self__), depth)
        name = f"{getattr(value, '__qualname__', '')}"
        if str(getattr(value, "__module__", "")).startswith(f"{PACKAGE}."):
            return [f"{value.__module__} {name}"]
        if inspect.isfunction(value):
            bound = (*(value.__defaults__ or ()), value.__kwdefaults__ or {}, *_enclosed(value))
            return [name, _text_of(value), *self._each(bound, depth)]
        if inspect.isclass(value) or inspect.isbuiltin(value):
            return [name, _text_of(value)]
        return self._each((type(value), getattr(value, "__dict__", {})), depth)

    def _each(self, values: Iterable[Any], depth: int) -> list[str]:
        return [text for value in values for text in self.told(value, depth + 1)]

    def _named(self, values: Mapping[Any, Any], depth: int) -> list[str]:
        return [text for name in sorted(values, key=str) for text in (str(name), *self.told(values[name], depth + 1))]


def _enclosed(function: Any) -> list[Any]:
    """What a function's cells hold; an empty one is left out."""
    out: list[Any] = []
    for cell in function.__closure__ or ():
        try:
            out.append(cell.cell_contents)
        except ValueError:  # not set yet
            continue
    return out


def _file_of(value: Any) -> str:
    try:
        return inspect.getsourcefile(value) or ""
    except TypeError:
        return ""


def _text_of(value: Any) -> str:
    """What defines a function or a class, as it is now: its file, its notebook cell, its byte code."""
    file = _file_of(value)
    if file and Path(file).is_file():
        return hashlib.sha256(Path(file).read_bytes()).hexdigest()
    code: CodeType | None = getattr(value, "__code__", None)
    return "".join(linecache.getlines(file)) or (_code_text(code) if code else ADDRESS.sub("", repr(value)))


def _code_text(code: CodeType) -> str:
    constants = [_code_text(item) if isinstance(item, CodeType) else repr(item) for item in code.co_consts]
    return repr((code.co_code, code.co_names, constants))
