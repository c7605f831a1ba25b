"""Code that data name is found without running any of it, and then run from the very bytes that were judged.

| name | place where it is looked for | runs as |
|---|---|---|
| a module of a strategy | as `NAME.py` beside the JSON file | a module of a private name |
| one that is not there, or has dots | on Python's path | the module |
| `file.py` of a function | at that path | a module of a private name |

No folder of data enters `sys.path`, so a file beside another is not found by `import`: code in several files is a
package on Python's path. Only for such packages is Python's cache of compiled files used.
"""

import hashlib
import importlib
import importlib.util
import linecache
import os
import re
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from importlib.machinery import EXTENSION_SUFFIXES, BuiltinImporter, FrozenImporter, ModuleSpec, NamespaceLoader
from itertools import accumulate
from pathlib import Path
from threading import RLock
from types import ModuleType
from typing import Any

from ...datasets.bounded_file import read_content
from .permission import AllowCode, Code, Namer, require_permission

CODE_MOST = 16_000_000
"""Largest file of source code [byte], a hundred times the longest that people write."""
_LOCK = RLock()  # a module may load a strategy while it is imported


@dataclass(frozen=True)
class CodeSource:
    """Code that was found, and what is needed to run it."""

    code: Code
    module: str
    """Name in `sys.modules`, once it has run."""
    path: Path | None = None
    """File that is run under a private name; None: imported from Python's path."""
    content: bytes = field(default=b"", repr=False)
    """Bytes of that file."""


def find_module(name: str, folder: Path | None, namer: Namer) -> CodeSource:
    """A module that a strategy names, beside its file or on Python's path; raises ImportError if there is none, and
    OSError for one that cannot be read."""
    beside = None if folder is None or "." in name else folder / f"{name}.py"
    if beside is not None and beside.is_file():
        return find_file(beside, namer, name)
    return find_installed(name, namer)


def find_file(path: Path, namer: Namer, name: str = "") -> CodeSource:
    """A Python file; raises ImportError if there is none, and OSError for one that cannot be read.

    name: as the data have it, by default the file's. A file that was edited becomes another module.
    """
    if not path.is_file():
        raise ImportError("no such file")
    content, name = read_content(path, CODE_MOST), name or path.name
    place = path.resolve()
    file = getattr(sys.modules.get(name), "__file__", None)
    if file is not None and Path(file).resolve() == place:  # the user has imported it, under its own name
        module = name
    else:
        stem = re.sub(r"[^0-9A-Za-z]", "_", path.stem)  # a dot would be a package
        module = f"palpate_code_{stem}_{_sha256(os.fsencode(place) + bytes(1) + content)[:16]}"
    code = Code(name, ((str(place), _sha256(content)),), namer, is_loaded=module in sys.modules)
    return CodeSource(code, module, path, content)


def find_installed(name: str, namer: Namer) -> CodeSource:
    """A module on Python's path, found without importing the packages that it is in; raises ImportError, OSError."""
    is_loaded = name in sys.modules
    if is_loaded:
        module = sys.modules[name]
        found = [(getattr(module, "__file__", None), getattr(module.__spec__, "loader", None))]
    else:
        found = [_origin(spec) for spec in _specs(name)]
    contents = [(origin, _read_installed(Path(origin), loader)) for origin, loader in found if origin]
    if not is_loaded and (unread := [origin for origin, content in contents if content is None]):
        raise ImportError(f"{name!r} comes from {unread[0]}, which cannot be read, so nobody can judge it")
    digests = tuple((origin, _sha256(content)) for origin, content in contents if content is not None)
    return CodeSource(Code(name, digests, namer, is_loaded), name)


def run_all(sources: Iterable[CodeSource], allow_code: AllowCode) -> list[ModuleType]:
    """Run code, unless this process has: raises UntrustedCodeError before any of it, and whatever the code raises."""
    sources = list(sources)
    require_permission([source.code for source in sources], allow_code)
    return [_run(source) for source in sources]


def _run(source: CodeSource) -> ModuleType:
    if source.path is None:
        return importlib.import_module(source.module)
    with _LOCK:
        if source.module in sys.modules:
            return sys.modules[source.module]
        spec = importlib.util.spec_from_file_location(source.module, source.path)
        if spec is None:
            raise ImportError("no Python file")
        module = importlib.util.module_from_spec(spec)
        file, text = str(source.path), importlib.util.decode_source(source.content)
        # Warp and `inspect` read a function's text from here: what was judged, whatever the file has become since.
        linecache.cache[file] = (len(text), None, text.splitlines(keepends=True), file)
        sys.modules[source.module] = module
        try:
            exec(compile(source.content, file, "exec", dont_inherit=True), vars(module))
        except BaseException:
            del sys.modules[source.module]
            raise
        return module


def _read_installed(path: Path, loader: Any) -> bytes | None:
    """The bytes that a module is made of, also within a ZIP; None where its loader does not give them."""
    if path.is_file():  # a compiled one may be larger than source code
        return read_content(path, None if path.name.endswith(tuple(EXTENSION_SUFFIXES)) else CODE_MOST)
    try:
        return loader.get_data(str(path))
    except (AttributeError, OSError):
        return None


def _origin(spec: ModuleSpec) -> tuple[str | None, Any]:
    """Path of a module's bytes, or None for a module of Python itself and for a folder; and its loader."""
    is_pythons = spec.loader in (BuiltinImporter, FrozenImporter)
    is_folder = spec.loader is None or isinstance(spec.loader, NamespaceLoader)
    return None if is_pythons or is_folder else spec.origin or "no file", spec.loader


def _specs(name: str) -> Iterator[ModuleSpec]:
    """Specs of the packages that a module is in, from outside inwards, and its own; none of them is imported."""
    within: list[str] | None = None
    for full in accumulate(name.split("."), "{}.{}".format):
        if full in sys.modules:
            spec = sys.modules[full].__spec__
        else:
            try:
                spec = next(filter(None, (finder.find_spec(full, within) for finder in sys.meta_path)), None)
            except (KeyError, AttributeError, ValueError) as error:  # a namespace package in one that is not imported
                raise ImportError(
                    f"{full!r} cannot be found before what it is in is imported: import it first"
                ) from error
        if spec is None:
            raise ModuleNotFoundError(f"there is no module {full!r} on Python's path")
        yield spec
        within = list(spec.submodule_search_locations or ())


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
