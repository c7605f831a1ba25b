"""Checks of what a command is given that need neither Warp nor NumPy, so that a request that must fail does so at once.

What is right here may still be refused by what reads it: each message is the one that this gives.
"""

import sys
from collections.abc import Collection, Iterable
from importlib.util import find_spec
from pathlib import Path

from ...datasets.errors import ContourFileError, MotionError, NotStoreError, name_nothing
from ...datasets.known_names import find_name, likely_file, likely_name
from ...datasets.storage.durable import fitting_name
from ...device.errors import UnknownArrayError
from ..errors import MeshError, PlanError, StrategyError
from ..file_kinds import described_file, is_point_list
from ..output_file import require_output

OBJECTS = ("cube", "sphere", "tube", "dog", "dog-detailed", "rock", "boulder")
STRATEGIES = (
    "oc", "cc", "whole", "mammoth", "corners", "corner-pauses", "edges", "simplified", "smooth", "inset",
    "hatch", "inset-hatch", "ellipse", "pca-ellipse", "circle", "centroid", "depth", "depth-hatch",
)  # fmt: skip
SAMPLINGS = (
    "stm", "constant-frequency", "capped", "pendulum", "fast-return", "dtp", "stp", "am", "lm", "pressure",
    "multi-focus", "am-multi-focus", "step", "random",
)  # fmt: skip
HANDS = ("palm", "planes", "skin")
ARRAYS = {
    "emulator": (),
    "pat16": ("openmpd", "asierinho", "pat"),
    "sonicsurface": ("sonic-surface",),
    "stratos": ("stratos-explore", "ultraleap", "ultrahaptics", "usx"),
    "autd3": ("autd",),
}
"""Names of arrays, each with those that it also has.

A test compares these names with the modules that have what they name, which import NumPy or Warp.
"""
EXPLORATION = "exploration"
STORE = "store.sqlite"


def require_contour_files(files: Iterable[Path], *, also: Collection[str] = (), takes_points: bool = False) -> None:
    """Raise for what is no contour file by its name and first bytes, and where none is.

    also: names of objects that are taken, too; takes_points: whether lists of focal points are.
    """
    for file in files:
        if find_name(str(file), also) is not None:
            continue
        if is_point_list(file) and takes_points:
            continue  # its reader tells whether it is there
        if file.is_file() and (what := described_file(file)) is not None and not also:
            raise StrategyError(f"{file} is no contour file but {what}")
        if file.exists() or (file.name and fitting_name(file, ".partial").exists()):
            continue
        if find_name(str(file), OBJECTS) is not None:
            raise StrategyError(
                f"{file} is an object, not a file: palpate render {file} exploration -o {file}.h5 makes one"
            )
        meant = likely_name(str(file), also) or likely_file(file)
        raise name_nothing(ContourFileError(f"{file} does not exist{meant}"))


def require_file(file: Path, hint: str) -> None:
    """Raise PlanError where there is no file; hint: what it should be."""
    if not file.exists():
        raise PlanError(f"{file}: cannot be read (No such file or directory){likely_file(file)}; {hint}")


def require_object(source: str) -> None:
    """Raise for the name of an object that is neither built in, nor a file, nor a function."""
    is_there = find_name(source, OBJECTS) is not None or ":" in source or not source or Path(source).exists()
    if not is_there and find_name(source, HANDS) is None:
        meant = likely_name(source, OBJECTS) or likely_file(source)
        raise name_nothing(MeshError(f"{source}: no such file{meant}; built-in objects are {', '.join(OBJECTS)}"))


def require_motion(source: str) -> None:
    """Raise for a motion that is neither a file nor the word for an exploration."""
    if find_name(source, (EXPLORATION,)) is None and not Path(source).exists() and Path(source).suffix:
        raise name_nothing(MotionError(f"{source}: no such motion file{likely_file(source)}"))


def require_strategy(source: str) -> None:
    """Raise for a strategy that is probably a misspelt preset."""
    if not source.casefold().startswith(("open", "closed")):  # other words for oc and cc
        _require_preset("strategy", source, STRATEGIES)


def require_sampling(source: str | None) -> None:
    """Raise for a way of sampling that is probably a misspelt preset."""
    if source is not None:
        _require_preset("sampling", source, SAMPLINGS)


def _require_preset(kind: str, source: str, known: Collection[str]) -> None:
    """Raise StrategyError where neither a preset nor a file has a name, and something has one that is alike.

    A name like no other is left to what loads presets, which has more to say about it.
    """
    if find_name(source, (*STRATEGIES, *SAMPLINGS)) is not None or Path(source).exists():
        return
    if meant := likely_name(source, known) or likely_file(source):
        raise StrategyError(f"unknown {kind} {source!r}{meant}: neither a preset ({', '.join(known)}) nor a JSON file")


def require_array(source: str) -> None:
    """Raise UnknownArrayError for an array that is not known.

    Where the registry of arrays is imported already, an array may be registered there; what loads arrays asks it.
    """
    if "palpate.device.registry" in sys.modules:
        return
    called = [name for own, others in ARRAYS.items() for name in (own, *others)]
    if not source.endswith(".json") and _letters(source) not in map(_letters, called):
        known = ", ".join(f"{name} ({', '.join(others)})" if others else name for name, others in ARRAYS.items())
        raise UnknownArrayError(f"unknown array {source!r}{likely_name(source, called)}; known: {known}")


def _letters(name: str) -> str:
    return "".join(name.casefold().replace("-", "").replace("_", "").split())


def require_store(folder: Path) -> None:
    """Raise NotStoreError for a folder that is no sweep's store."""
    if not (folder / STORE).exists():
        raise NotStoreError(f"{folder.absolute()} is not a sweep's store: it has no {STORE}")


def require_extra(module: str, error: Exception) -> None:
    """Raise an error where a module of an extra is not installed; it is not imported."""
    if find_spec(module) is None:
        raise error


def require_end(out: Path, ends: Collection[str], what: str) -> None:
    """Raise StrategyError for a file to write whose name ends otherwise."""
    if out.suffix not in ends:
        raise StrategyError(f"{out}: {what} must end in {' or '.join(ends)}")


def require_output_file(out: Path, ends: Collection[str], *, overwrite: bool, sources: Iterable[Path] = ()) -> None:
    """Raise StrategyError for a file of another kind, and for what `require_output` refuses."""
    if out.suffix.lower() not in ends:
        raise StrategyError(f"{out}: must end in one of {', '.join(ends)}")
    require_output(out, overwrite=overwrite, sources=sources)


def worker_count(text: str) -> int | None:
    """A number of workers, None for "auto"; raises StrategyError for what is neither."""
    if text == "auto":
        return None
    if not text.isdecimal():
        raise StrategyError(f"--workers must be a number or auto, not {text!r}")
    return int(text)
