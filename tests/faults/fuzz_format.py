"""What the fuzzer knows of a format: valid files, and the public function or command that reads them."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

FAR = 1e6
"""[m]; a pose farther away than this is no pose of a hand."""


class Refused(Exception):
    """What was found wrong and reported without an exception; the text is the report."""


class Wrong(Exception):
    """What was accepted, and should not have been; the text says what."""


@dataclass(frozen=True)
class Format:
    """One kind of input."""

    name: str
    seeds: Callable[[Path], None]
    """Writes valid inputs into a folder: each a file, or a folder."""
    read: Callable[[Path], Any]
    """Reads one: gives what was read, or raises what the house raises, Refused or Wrong."""
    is_checked: bool = False
    """Whether damaged bytes must be refused, or change nothing of what is read."""
    mutable: tuple[str, ...] = ("*",)
    """Patterns of files in a folder of a seed that are damaged."""
    damage: Callable[[Path, Any], str] | None = None
    """A way of its own to damage .h5, .parquet and .sqlite files, used half of the time."""


def one_file(path: Path, *suffixes: str) -> Path:
    """The file of a seed that is a folder, or the seed itself."""
    return next((own for own in sorted(path.iterdir()) if own.suffix in suffixes), path) if path.is_dir() else path


def refuse_far(position: Any) -> None:
    """Raise Wrong for accepted positions [m] that no hand has."""
    farthest = abs(position).max()
    if not farthest < FAR:
        raise Wrong(f"a position of {farthest:.3g} m is accepted")
