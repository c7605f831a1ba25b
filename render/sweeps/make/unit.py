"""A unit of a sweep and its result: what a worker is given at a time, and what it gives back."""

import os
import secrets
from dataclasses import dataclass, field
from pathlib import Path

from ....datasets.sweeps.result_row import ResultRow

SPAN = 512
"""Poses that one thread adds up, in order."""
CHUNK_POSES = 256 * SPAN
"""Poses of a chunk, counted from a recipe's first: what the store keeps a row for, and what a kill can lose. It is
fixed, so that sums do not depend on who rendered what."""
SENTENCE_MOST = 2000
"""Characters of an error's sentence that are kept; a user's exception may have any number."""


@dataclass(frozen=True)
class Chunk:
    """Poses of one recipe and the groups that are to be made of them; all poses, where a group cannot be split."""

    recipe: str
    """JSON of a `Recipe`."""
    groups: tuple[str, ...]
    """Which metrics, and what to keep (`GROUPS`): either groups of `WHOLE_GROUPS`, or none of these."""
    number: int = 0
    """The chunk's first pose is `number * CHUNK_POSES`; a chunk of all poses has number 0."""


_TOKEN = secrets.token_hex(8)


def this_process() -> tuple[str, int]:
    """A mark of this process that no other one has, on any host; a forked process has another number."""
    return _TOKEN, os.getpid()


@dataclass(frozen=True)
class Unit:
    """Chunks that a worker makes at a time. Making it again gives the same results."""

    chunks: tuple[Chunk, ...]
    code_version: str
    """Of the process that gives the unit; a worker with another one refuses it."""
    granted: frozenset[str] = frozenset()
    """SHA-256 of files of code that recipes and metrics name and that may be run."""
    user_metrics: tuple[tuple[str, str], ...] = ()
    """Group and source, `file.py:function`, of metrics that a user's functions compute."""
    scratch: str = ""
    """Folder for kept files on the store's disk; a worker that does not see it returns their content."""
    parent: tuple[str, int] = field(default_factory=this_process)
    """Process that gives the unit. It never runs a user's code: nothing could end a stage that hangs in it."""


@dataclass(frozen=True)
class FailedChunk:
    """A chunk that could not be made."""

    place: int
    """Of the chunk in its unit."""
    message: str
    is_transient: bool = False
    """Whether trying again may help: a full disk, a network file system that did not answer."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "message", stored_text(self.message))


@dataclass(frozen=True)
class UnitResult:
    """The result of making a unit. Chunks that are not in `failed` are in `rows`."""

    rows: tuple[ResultRow, ...] = ()
    files: tuple[tuple[str, Path | bytes], ...] = ()
    """Kept files: path within the store, and the file in `Unit.scratch` or its content."""
    failed: tuple[FailedChunk, ...] = ()
    pose_count: int = 0
    """Rendered."""
    seconds: float = 0.0
    is_unnamed: bool = False
    """Whether one reason stands in `failed` for all chunks, although another unit could have made some of them."""
    warnings: tuple[str, ...] = ()
    """Of palpate, each once."""
    refusal: str | None = None
    """Why this worker cannot make any unit of this sweep; None if it can."""


def text_of(error: BaseException) -> str:
    """An error's own words; a user's exception may have none that can be shown."""
    try:
        return str(error)
    except BaseException as second:
        return f"its message cannot be shown ({type(second).__name__})"


def stored_text(text: str) -> str:
    """A sentence as the store can hold it: UTF-8, of at most SENTENCE_MOST characters."""
    text = text if len(text) <= SENTENCE_MOST else f"{text[:SENTENCE_MOST]}..."
    return text.encode(errors="backslashreplace").decode()
