"""The code version that results are stored under: the modules that compute results, and the libraries that they use.

| changes the code version | does not |
|---|---|
| a module that a worker's task imports, directly, lazily or through others | commands, tables, figures, schedules |
| what such a module runs | its comments, docstrings and blank lines, what it imports for type checkers |
| the version of a library of `LIBRARIES` | versions of other libraries, of Python and of palpate |

A package's `__init__` counts only if a module takes a name from it, together with the module that defines the name.
"""

import hashlib
import os
import re
from collections.abc import Collection, Iterable, Iterator
from fnmatch import filter as matching
from functools import cache, lru_cache
from importlib.metadata import version
from pathlib import Path

from .bare_source import bare_source

HOUSE = Path(__file__).resolve().parents[3]
"""Folder of palpate's packages."""
PACKAGES = ("kernels", "render", "datasets", "device")
COMPUTING = (
    "render/sweeps/make/work.py",  # what a worker runs
    "render/stages/prune.py",  # the next three are imported by name: stages by their registry,
    "render/stages/built_in.py",
    "render/strategies/presets.py",  # and presets by their table
    "device/boards/*/geometry.py",  # arrays are registered when `device` is imported; drives depend on their geometry,
    "device/boards/*/layout.py",  # and noise and pressure on how they round
)
"""Modules from which all that computes results is reached; paths or patterns, from `HOUSE` on."""
LIBRARIES = ("numpy", "scipy", "trimesh", "manifold3d", "warp-lang")
"""Those that decide numbers: arrays; nearest points, components, filters; meshes of scripts; solids united, outlines
offset; kernels. h5py and xxhash only store, nibabel and pynrrd return the values that a file has."""
_IMPORT = re.compile(r"from (\.+)([\w.]*) import (\([^)]*\)|[^\n]*)")
_FOR_TYPE_CHECKERS = re.compile(r"\nif TYPE_CHECKING:(?:\n .*)+")
_NAME = re.compile(r"(\w+)(?: as \w+)?")
_DIGITS = 16


@cache
def code_version() -> str:
    """Text that names the code that makes results: a digest of palpate's modules, and versions of `LIBRARIES`.

    Results are looked up for the same text only. The first call of a process takes some 0.1 s.
    """
    libraries = ", ".join(f"{name} {version(name)}" for name in LIBRARIES)
    return f"palpate code {modules_digest(COMPUTING)}, {libraries}"


def modules_digest(roots: Iterable[str], house: Path = HOUSE) -> str:
    """Digest of modules and of all that they import of palpate, 16 hexadecimal digits.

    roots: paths or patterns, from `house` on, which is the folder of palpate's packages.
    """
    lines = (f"{path} {_read(house, path).digest}\n" for path in import_closure(roots, house))
    return hashlib.sha256("".join(lines).encode()).hexdigest()[:_DIGITS]


def import_closure(roots: Iterable[str], house: Path = HOUSE) -> list[str]:
    """Paths of the modules that are reached from `roots` by relative imports, sorted; arguments of `modules_digest`."""
    start = len(f"{house}/")
    folders = (found for name in PACKAGES for found in os.walk(house / name))
    modules = {f"{folder[start:]}/{file}" for folder, _, files in folders for file in files if file.endswith(".py")}
    left = [path for root in roots for path in matching(modules, root)]
    found = set(left)
    while left:
        new = set(_imported(house, left.pop(), modules)) - found
        found |= new
        left.extend(new)
    return sorted(found)


class _Source:
    """A module's source: its digest, and what it imports."""

    def __init__(self, text: str) -> None:
        try:
            self._code, strings = bare_source(text)
        except ValueError:  # Python refuses such a module, too; all of its text counts
            self._code, strings = text, []
        code = _FOR_TYPE_CHECKERS.sub("", self._code)
        self.digest = hashlib.sha256("\0".join((code, *strings)).encode()).hexdigest()
        self.imports = _IMPORT.findall(code)

    @property
    def all_imports(self) -> list[tuple[str, str, str]]:
        """Its imports, those for type checkers included."""
        return _IMPORT.findall(self._code)


def _read(house: Path, path: str) -> _Source:
    file = f"{house}/{path}"
    state = os.stat(file)
    return _read_once(file, state.st_ino, state.st_size, state.st_mtime_ns)


@lru_cache(maxsize=1024)
def _read_once(file: str, *_: int) -> _Source:
    """A module, read again only after its file has changed."""
    with open(file, encoding="utf-8") as source:
        return _Source(source.read())


def _imported(house: Path, path: str, modules: Collection[str]) -> Iterator[str]:
    """Modules that a module imports."""
    for base, names in _resolved(path, _read(house, path).imports):
        for name in names:
            yield from _targets(house, base, name, modules)


def _resolved(path: str, imports: Iterable[tuple[str, str, str]]) -> Iterator[tuple[str, list[str]]]:
    """For each relative import the path of its package or module, without a suffix, and the imported names."""
    folders = path.split("/")
    for dots, module, names in imports:
        yield "/".join((*folders[: -len(dots)], *module.split("."))).rstrip("/"), _NAME.findall(names)


def _targets(house: Path, base: str, name: str, modules: Collection[str]) -> Iterator[str]:
    """Modules behind a name that is imported from a package or a module."""
    own = next((own for own in (f"{base}.py", f"{base}/{name}.py", f"{base}/{name}/__init__.py") if own in modules), "")
    if own:
        yield own
        return
    package = f"{base}/__init__.py"
    yield package
    for inner, names in _resolved(
        package, _read(house, package).all_imports
    ):  # lazy names are listed for type checkers
        if name in names:
            yield from _targets(house, inner, name, modules)
