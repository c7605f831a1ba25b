"""A user's own Warp function of position as a solid: loaded by name, and tried before anything is rendered.

| what its values are within the bounds | what is done |
|---|---|
| not numbers, or infinite, somewhere | refused, with the first place |
| the same everywhere; above 0 everywhere; below 0 everywhere | refused, with the values |
| a jump over 0 that stays when looked at within 1 nm | refused, with the place and both values |
| below 0 on the bounds' border | closed there, with a warning |
"""

import hashlib
import inspect
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from ....datasets.errors import name_nothing
from ....kernels.fields.field import Field, lattice_of, probe_nodes, probe_points
from ....kernels.fields.user_function import Placed, raw_value
from ...errors import ImplicitError, UntrustedCodeError
from ...trust.permission import UNNAMED, AllowCode, Namer
from ...trust.user_code import CodeSource, find_file, find_installed, run_all
from ...user_warnings import warn_user

TRIED = 64  # cells along the longest side of the bounds where a function is tried
TRIED_LEAST = 8  # along the others
EDGES_TRIED = 20_000  # crossed edges of these cells that are looked at for jumps
NEAR, NEARER = 1e-6, 1e-9  # [m]; a function that goes on has a far smaller difference over the second
JUMP = 1e-3  # share of the difference over a cell's edge: less is rounding

_NOTED: dict[str, tuple[Any, str]] = {}  # by a module's name its spec, new with a reload, and its file's SHA-256 then


def load_function(spec: str, *, allow_code: AllowCode = False, namer: Namer = UNNAMED) -> Any:
    """The Warp function that "package.module:function" or "file.py:function" names.

    allow_code: whether its module may be run where this process has not imported it yet, see `trust`. namer: what names
    it. A file is run anew once it has changed; a package's module is refused then, since Python keeps the old one.
    Raises UntrustedCodeError without permission, ImplicitError for what cannot be imported or is not there.
    """
    where, _, name = spec.rpartition(":")
    module = load_module(spec, allow_code=allow_code, namer=namer)
    if not hasattr(module, name):
        known = [key for key, value in vars(module).items() if isinstance(value, wp.Function) and value.func]
        raise name_nothing(
            ImplicitError(f"{where}: has no {name!r}; its Warp functions are {', '.join(known) or 'none'}")
        )
    return getattr(module, name)


def load_module(spec: str, *, allow_code: AllowCode = False, namer: Namer = UNNAMED) -> Any:
    """The module that holds the function of a name; arguments and errors as of `load_function`."""
    where = spec.rpartition(":")[0]
    try:
        (module,) = run_all([find_function_code(spec, namer)], allow_code)
    except (ImplicitError, UntrustedCodeError):
        raise
    except (Exception, SystemExit) as error:  # a module's own code can raise anything
        raise ImplicitError(f"{where}: cannot be imported ({type(error).__name__}: {error})") from error
    if not where.endswith(".py"):
        return _unchanged(module)
    return module


def find_function_code(spec: str, namer: Namer = UNNAMED) -> CodeSource:
    """The code that holds a function, none of which is run; raises ImplicitError for what is no name, or not there."""
    where, _, name = spec.rpartition(":")
    if not where or not name:
        raise ImplicitError(f"{spec!r}: must be package.module:function or file.py:function")
    try:
        source = find_file(Path(where), namer) if where.endswith(".py") else find_installed(where, namer)
    except (ImportError, OSError) as error:
        refused = f"{where}: cannot be imported ({type(error).__name__}: {error})"
        raise name_nothing(ImplicitError(refused)) from error
    return replace(source, code=replace(source.code, name=f"{source.code.name}:{name}"))


def _unchanged(module: Any) -> Any:
    """A package's module, refused if its file is not as it was when the module was first asked for."""
    file = getattr(module, "__file__", None)
    if file is not None and Path(file).is_file():
        digest = hashlib.sha256(Path(file).read_bytes()).hexdigest()
        spec, noted = _NOTED.setdefault(module.__name__, (module.__spec__, digest))
        if spec is not module.__spec__:
            _NOTED[module.__name__] = module.__spec__, digest
        elif noted != digest:
            raise ImplicitError(f"{module.__name__}: {file} has changed since it was imported: start anew")
    return module


def takes_double(function: Any, name: str) -> bool:
    """Whether a Warp function takes a wp.vec3d, not a wp.vec3; raises ImplicitError if neither, or no Warp function."""
    if not isinstance(function, wp.Function):
        raise ImplicitError(f"{name}: must be a function decorated with @wp.func, not {type(function).__name__}")
    types = list(function.input_types.values())
    if len(types) != 1 or types[0] not in (wp.vec3, wp.vec3d):
        given = ", ".join(f"{key}: {getattr(kind, '__name__', kind)}" for key, kind in function.input_types.items())
        raise ImplicitError(f"{name}: must take one position, wp.vec3 or wp.vec3d, and give a number, not ({given})")
    return types[0] == wp.vec3d


def source_of(function: Any) -> str:
    """A Warp function's own source text; empty where there is none."""
    try:
        return inspect.getsource(function.func)
    except (OSError, TypeError):
        return ""


def try_function(function: Any, bounds: np.ndarray, name: str) -> np.ndarray:
    """Look at a function within its bounds as the table says; warns, or raises ImplicitError.

    bounds: own coordinates [m], shape [2, 3]. Returns which nodes of the lattice it was tried on are inside.
    """
    field = Field(raw_value(function, takes_double(function, name)), Placed, Placed())
    size = np.ptp(bounds, axis=0)
    cells = np.maximum(np.ceil(TRIED * size / size.max()), TRIED_LEAST).astype(int)
    shape = tuple((cells + 1).tolist())
    try:
        value = probe_nodes(field, lattice_of(bounds[0], size / cells), shape, device="cpu")
    except Exception as error:  # Warp's compiler raises anything
        reason = str(error).strip().splitlines() or [""]
        raise ImplicitError(f"{name}: cannot be compiled ({type(error).__name__}: {reason[-1]})") from error
    check_values(value, bounds, cells, name)
    check_jumps(field, value, bounds, cells, name)
    inside = value < 0
    border = inside.copy()
    border[1:-1, 1:-1, 1:-1] = False
    if border.any():
        at = bounds[0] + np.argwhere(border)[0] * size / cells
        warn_user(
            f"{name}: reaches its bounds' border, at {point_text(at)} for one, and is closed there: widen them to "
            "hold all"
        )
    return inside


def check_values(value: np.ndarray, bounds: np.ndarray, cells: np.ndarray, name: str) -> None:
    """Refuse values that leave no surface."""
    odd = ~np.isfinite(value)
    if odd.any():
        first = np.argwhere(odd)[0]
        at = bounds[0] + first * np.ptp(bounds, axis=0) / cells
        raise ImplicitError(
            f"{name}: is not a number at {int(odd.sum())} of {odd.size} points within its bounds, "
            f"at {point_text(at)} for one ({value[tuple(first)]:g})"
        )
    low, high = float(value.min()), float(value.max())
    tried = f"at all {value.size} points tried within its bounds"
    if low == high:
        raise ImplicitError(f"{name}: is {low:g} {tried}; it must be below 0 inside and above 0 outside")
    if low >= 0:
        raise ImplicitError(f"{name}: is never below 0, so nothing is inside ({low:g} to {high:g} {tried})")
    if high < 0:
        raise ImplicitError(f"{name}: is below 0 {tried} ({low:g} to {high:g}), so they hold no surface")


def crossed_edges(value: np.ndarray, bounds: np.ndarray, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ends of lattice edges of which one is inside [m], inner and outer, shape [edge, 3]; a share if there are many."""
    inner, outer = [], []
    for axis in range(3):
        a, b = np.moveaxis(value, axis, 0)[:-1] < 0, np.moveaxis(value, axis, 0)[1:] < 0
        at = np.argwhere(a != b)
        first = a[tuple(at.T)]
        low = np.insert(at[:, 1:], axis, at[:, 0], axis=1)
        high = low + np.eye(3, dtype=int)[axis]
        inner.append(np.where(first[:, None], low, high))
        outer.append(np.where(first[:, None], high, low))
    step = np.ptp(bounds, axis=0) / cells
    every = max(1, sum(map(len, inner)) // EDGES_TRIED)
    return bounds[0] + np.concatenate(inner)[::every] * step, bounds[0] + np.concatenate(outer)[::every] * step


def check_jumps(field: Field, value: np.ndarray, bounds: np.ndarray, cells: np.ndarray, name: str) -> None:
    """Refuse a function that jumps over 0: edges are halved around the change of sign, down to 1 nm."""
    inner, outer = crossed_edges(value, bounds, cells)
    below, above = (probe_points(field, x, device="cpu") for x in (inner, outer))
    whole = above - below
    near = whole
    while (reach := float(np.linalg.norm(outer - inner, axis=1).max())) > NEARER:
        middle = (inner + outer) / 2
        f = probe_points(field, middle, device="cpu")
        inside = (f < 0)[:, None]
        inner, outer = np.where(inside, middle, inner), np.where(inside, outer, middle)
        below, above = np.where(f < 0, f, below), np.where(f < 0, above, f)
        if reach / 2 > NEAR / 2:
            near = above - below
    jump = above - below
    stays = (jump > near / 2) & (jump > JUMP * whole)
    if stays.any():
        worst = int(np.argmax(np.where(stays, jump, 0.0)))
        raise ImplicitError(
            f"{name}: is not continuous: it jumps from {below[worst]:g} to {above[worst]:g} at "
            f"{point_text(inner[worst])}"
        )


def point_text(x: np.ndarray) -> str:
    """A place for a message."""
    return f"({', '.join(f'{c:.4g}' for c in x)}) m"
