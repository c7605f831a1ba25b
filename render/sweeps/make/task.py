"""What passes between the parent of a sweep and its workers: pieces of work one way, paths and counts the other."""

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

SPAN = 512
"""Poses that one thread adds up, in order."""
PART = 256 * SPAN
"""Poses of a part, counted from a recipe's first: the unit of what is stored, and of what a kill can lose. Fixed, so
that sums do not depend on who rendered what."""

WHOLE = 0
"""The only part of what must be made in one go."""


@dataclass(frozen=True)
class Piece:
    """Parts of one recipe: what of it is to be made."""

    recipe: str
    """JSON of a `Recipe`."""
    groups: tuple[str, ...]
    """Which metrics, and what to keep (`GROUPS`)."""
    first: int = WHOLE
    """First part."""
    stop: int = WHOLE + 1
    """After the last part; recipes that must be made in one go have one."""


@dataclass(frozen=True)
class Task:
    """What a worker is given at a time; made again by another, it leaves the same files."""

    number: int
    pieces: tuple[Piece, ...]
    store: str
    """Folder of the store, as every worker sees it."""
    name: str
    """Of the shard: unique in the store's history, so that nobody writes over another's."""
    code: frozenset[str] = frozenset()
    """SHA-256 of files of code that recipes name and that may be run: those that the parent ran."""


@dataclass(frozen=True)
class Outcome:
    """What came of a task."""

    number: int
    worker: str
    """Who made it: process, host, device."""
    shard: str | None = None
    """Path of what it left, within the store."""
    part_count: int = 0
    pose_count: int = 0
    seconds: float = 0.0
    error: str | None = None
    """One sentence; None if all went well."""
    is_lost: bool = False
    """Whether the worker died or gave no answer, so that another may do better."""
    failed: tuple[tuple[int, str], ...] = ()
    """Pieces, by their place in the task, that could not be made, each with one sentence; the others are in the
    shard."""


class Engine(Protocol):
    """Who makes tasks: this process, several, or a cluster."""

    @property
    def name(self) -> str:
        """In the log."""
        ...

    @property
    def devices(self) -> tuple[str, ...]:
        """Warp device of each worker."""
        ...

    def start(self, store: Path) -> None:
        """Start the workers; raises SweepError, naming the worker, for one that cannot do the work."""
        ...

    def submit(self, task: Task) -> None:
        """Have a task made; workers take tasks in the order in which they are submitted."""
        ...

    def wait(self, timeout: float | None = None) -> list[Outcome]:
        """What has come of tasks since the last call: at least one, unless nothing came within `timeout` [s]."""
        ...

    def running(self) -> dict[int, float]:
        """Tasks that a worker has begun: number, and seconds since then."""
        ...

    def drop(self, number: int) -> None:
        """End a task that takes too long, with its worker if need be; its outcome is `is_lost`."""
        ...

    def close(self) -> None:
        """End all workers, whatever they do."""
        ...
