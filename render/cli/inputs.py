"""Checks of what a command is given that need neither Warp nor NumPy, so that a request that must fail does so at once.

What is right here may still be refused by what reads it: each message is the one that this gives.
"""

from collections.abc import Collection, Iterable
from pathlib import Path

from ...datasets.errors import ContourFileError, MotionError, name_nothing
from ...datasets.known_names import find_name, likely_file, likely_name
from ...datasets.storage.durable import fitting_name
from ..errors import MeshError, PlanError, StrategyError
from ..file_kinds import described_file, is_point_list
from ..output_file import require_output
from .shared_options import HANDS, OBJECTS, SAMPLINGS, STRATEGIES

EXPLORATION = "exploration"


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


def require_known_strategy(source: str) -> None:
    """Raise for a strategy that is neither a preset nor a file; a preset of sampling has a hint of its own."""
    if find_name(source, (*STRATEGIES, *SAMPLINGS)) is None and not Path(source).exists():
        meant = likely_name(source, STRATEGIES) or likely_file(source)
        if meant:
            raise StrategyError(
                f"unknown strategy {source!r}{meant}: neither a preset ({', '.join(STRATEGIES)}) nor a JSON file"
            )


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
