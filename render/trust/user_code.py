"""Code that data name: found without running any of it, then run from the very bytes that were judged.

| name | is looked for | runs as |
|---|---|---|
| a module of a strategy | as `NAME.py` beside the JSON file | a module of a private name |
| one that is not there, or has dots | on Python's path | the module |
| `file.py` of a function | where the path says | a module of a private name |

No folder of data enters `sys.path`, so a file beside another is not found by `import`: code in several files is a
package on Python's path. Python's cache of compiled files is used for the latter only.
"""

import hashlib
import importlib
import importlib.util
import linecache
import re
import sys
from collections.abc import Iterable
from dataclasses import dataclass, field
from importlib.machinery import EXTENSION_SUFFIXES, BuiltinImporter, FrozenImporter, ModuleSpec, NamespaceLoader
from pathlib import Path
from threading import RLock
from types import ModuleType
from typing import Any

from ...datasets.bounded_file import read_content
from .permission import AllowCode, Code, Namer, require_permission

CODE_MOST = 16_000_000
"""Largest file of source code [byte], a hundred times the longest that people write."""
_LOCK = RLock()  # a module may load a strategy while it is imported
_SHA256: dict[str, str] = {}
"""Of the bytes that each module of a private name was run from."""


@dataclass(frozen=True)
class CodeSource:
    """Where code is, and how it is run."""

    code: Code
    module: str
    """Name in `sys.modules`, once it has run."""
    path: Path | None = None
    """File that is run under a private name; None: imported from Python's path."""
    content: bytes = field(default=b"", repr=False)
    """Of that file."""


def find_module(name: str, folder: Path | None, namer: Namer) -> CodeSource:
    """A module that a strategy names, beside its file or on Python's path; raises ImportError if there is none, and
    OSError for one that cannot be read."""
    beside = None if folder is None or "." in name else folder / f"{name}.py"
    if beside is not None and beside.is_file():
        return _of_file(beside, name, namer, own=_private_name(beside))
    return find_installed(name, namer)


def find_file(path: Path, namer: Namer) -> CodeSource:
    """A Python file that a function is in; one that was edited becomes another module. Raises ImportError, OSError."""
    if not path.is_file():
        raise ImportError("no such file")
    content = read_content(path, CODE_MOST)
    return _of_file(path, path.name, namer, own=_private_name(path, content), content=content)


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


def _of_file(path: Path, name: str, namer: Namer, *, own: str, content: bytes | None = None) -> CodeSource:
    content = read_content(path, CODE_MOST) if content is None else content
    imported = sys.modules.get(name)
    file = getattr(imported, "__file__", None)
    if file is not None and Path(file).resolve() == path.resolve():  # by the user, under its own name
        own = name
    is_loaded = own == name or (own in sys.modules and _SHA256.get(own) == _sha256(content))
    code = Code(name, ((str(path.resolve()), _sha256(content)),), namer, is_loaded)
    return CodeSource(code, own, path, content)


def _run(source: CodeSource) -> ModuleType:
    if source.path is None:
        return importlib.import_module(source.module)
    with _LOCK:
        digest = source.code.files[0][1]
        if source.module in sys.modules and _SHA256.get(source.module, digest) == digest:
            return sys.modules[source.module]
        spec = importlib.util.spec_from_file_location(source.module, source.path)
        if spec is None:
            raise ImportError("no Python file")
        module = importlib.util.module_from_spec(spec)
        file, text = str(source.path), importlib.util.decode_source(source.content)
        # Warp and `inspect` read a function's text from here: what was judged, whatever the file has become since.
        linecache.cache[file] = (len(text), None, text.splitlines(keepends=True), file)
        sys.modules[source.module], _SHA256[source.module] = module, digest
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
    """Where a module's bytes are, and what reads them; None for what is in Python itself, and for a mere folder."""
    is_pythons = spec.loader in (BuiltinImporter, FrozenImporter)
    is_folder = spec.loader is None or isinstance(spec.loader, NamespaceLoader)
    return None if is_pythons or is_folder else spec.origin or "no file", spec.loader


def _specs(name: str) -> list[ModuleSpec]:
    """Specs of the packages that a module is in, from outside inwards, and its own; none of them is imported."""
    found: list[ModuleSpec] = []
    within: list[str] | None = None
    parts = name.split(".")
    for k in range(len(parts)):
        full = ".".join(parts[: k + 1])
        spec = _spec(full, within)
        if spec is None:
            raise ModuleNotFoundError(f"there is no module {full!r} on Python's path")
        found.append(spec)
        within = list(spec.submodule_search_locations or ())
    return found


def _spec(name: str, within: list[str] | None) -> ModuleSpec | None:
    if name in sys.modules:
        return sys.modules[name].__spec__
    for finder in sys.meta_path:
        try:
            spec = finder.find_spec(name, within)
        except (KeyError, AttributeError, ValueError) as error:  # a namespace package in one that is not imported
            raise ImportError(f"{name!r} cannot be found before what it is in is imported: import it first") from error
        if spec is not None:
            return spec
    return None


def _private_name(path: Path, content: bytes = b"") -> str:
    told = str(path.resolve()).encode(errors="surrogateescape") + b"\0" + hashlib.sha256(content).digest()
    return f"palpate_code_{re.sub(r'[^0-9A-Za-z]', '_', path.stem)}_{_sha256(told)[:16]}"  # a dot would be a package


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
