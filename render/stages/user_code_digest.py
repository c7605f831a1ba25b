"""What tells a user's function from others: its name, the whole file that defines it, and what was bound to it.

| of                                  | counts                                                            |
|-------------------------------------|-------------------------------------------------------------------|
| a function, a Warp function         | name, file, defaults, what it encloses                            |
| a partial, a method                 | function, positional and named arguments; object                  |
| a class                             | name and file                                                     |
| any of them without a file          | the text of its notebook cell, else its byte code                 |
| any of them from this package       | its name: who makes results tells the rest                        |
| an array, lists, dicts, sets        | type, shape and values; their items                               |
| an object of a class of somebody's  | the class and the object's attributes                             |
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
import warp as wp

PACKAGE = __name__.partition(".")[0]  # palpate
ADDRESS = re.compile(r" at 0x[0-9a-fA-F]+")
DEEP = 8  # bound to what is bound to ...: further down, how Python writes it


def digest_of(function: Any) -> str:
    """SHA-256 of a function as the table says, its file as it is now; where the file lies does not count."""
    return hashlib.sha256("\0".join(_Reader().describe(function, 0)).encode()).hexdigest()


def place_of(function: Any) -> str:
    """The file that defines a function, through partials and Warp functions, or what it is called."""
    function = innermost(function)
    return _file_of(function) or _file_of(type(function)) or repr(function)


def innermost(function: Any) -> Any:
    """What a partial was made of, or the function that it hands on; through Warp functions."""
    while isinstance(function, partial):
        handed = function.args and (callable(function.args[0]) or isinstance(function.args[0], wp.Function))
        function = function.args[0] if handed else function.func
    return _bare(function)


def caller_file() -> str:
    """The file outside this package that is calling into it; empty without one."""
    frame = inspect.currentframe()
    while frame is not None and str(frame.f_globals.get("__name__", "")).startswith(f"{PACKAGE}."):
        frame = frame.f_back
    return "" if frame is None else frame.f_code.co_filename


def file_digests(files: Iterable[str]) -> dict[str, str]:
    """SHA-256 of each file that is there, as it is now."""
    there = [file for file in dict.fromkeys(files) if file and Path(file).is_file()]
    return {file: hashlib.sha256(Path(file).read_bytes()).hexdigest() for file in there}


class _Reader:
    """Reads what a function consists of, each object once."""

    def __init__(self) -> None:
        self._seen: dict[int, tuple[int, Any]] = {}  # number, and the object itself: else another may get its id

    def describe(self, value: Any, depth: int) -> list[str]:
        """Texts that describe a value, for the digest."""
        value = _bare(value)
        value = value.numpy() if isinstance(value, wp.array) else value
        if isinstance(value, np.ndarray):
            kind = f"{value.dtype.str} {value.shape}"
            if value.dtype.hasobject:
                return [kind, *self._each(value.ravel().tolist(), depth)]
            return [kind, hashlib.sha256(np.ascontiguousarray(value)).hexdigest()]
        if depth >= DEEP:
            return [_written(value)]
        if isinstance(value, list | tuple):
            return [f"{len(value)}", *self._each(value, depth)]
        if isinstance(value, set | frozenset):
            return [f"{len(value)}", *sorted("\0".join(_Reader().describe(item, depth + 1)) for item in value)]
        if isinstance(value, Mapping):
            return [f"{len(value)}", *self._named(value, depth)]
        has_state = hasattr(value, "__dict__") or hasattr(type(value), "__slots__")
        return self._made(value, depth) if callable(value) or has_state else [_written(value)]

    def _made(self, value: Any, depth: int) -> list[str]:
        """What somebody wrote: a function, a class, an object of one."""
        if id(value) in self._seen:
            return [f"again {self._seen[id(value)][0]}"]
        self._seen[id(value)] = len(self._seen), value
        if isinstance(value, partial):
            return [*self._each((value.func, *value.args), depth), *self._named(value.keywords, depth)]
        if inspect.ismethod(value):
            return self._each((value.__func__, value.__self__), depth)
        name = f"{getattr(value, '__qualname__', '')}"
        if name and str(getattr(value, "__module__", "")).startswith(f"{PACKAGE}."):
            return [f"{value.__module__} {name}"]
        if inspect.isfunction(value):
            bound = (*(value.__defaults__ or ()), value.__kwdefaults__ or {}, *_enclosed(value))
            return [name, _text_of(value), *self._each(bound, depth)]
        if inspect.isclass(value) or inspect.isbuiltin(value):
            return [name, _text_of(value)]
        slots = [
            name for kind in type(value).__mro__ for name in np.atleast_1d(getattr(kind, "__slots__", [])).tolist()
        ]
        held = {str(name): getattr(value, str(name)) for name in slots if hasattr(value, str(name))}
        held.pop("__dict__", None)
        held.pop("__weakref__", None)
        return self._each((type(value), held | dict(getattr(value, "__dict__", {}))), depth)

    def _each(self, values: Iterable[Any], depth: int) -> list[str]:
        return [text for value in values for text in self.describe(value, depth + 1)]

    def _named(self, values: Mapping[Any, Any], depth: int) -> list[str]:
        return [
            text for name in sorted(values, key=str) for text in (str(name), *self.describe(values[name], depth + 1))
        ]


def _bare(value: Any) -> Any:
    """The Python function that a Warp function holds; anything else as it is."""
    return value.func if isinstance(value, wp.Function) and value.func is not None else value


def _written(value: Any) -> str:
    """How Python writes it, without addresses."""
    return f"{type(value).__qualname__} {ADDRESS.sub('', repr(value))}"


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
