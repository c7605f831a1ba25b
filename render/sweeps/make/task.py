"""What passes between the parent of a sweep and its workers: chunks of work one way, paths and counts the other."""

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

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


@dataclass(frozen=True)
class Task:
    """What a worker is given at a time; made again by another, it leaves the same files."""

    number: int
    chunks: tuple[Chunk, ...]
    store: str
    """Folder of the store, as every worker sees it."""
    name: str
    """Of the shard: unique in the store's history, so that no worker writes over another's."""
    code: frozenset[str] = frozenset()
    """SHA-256 of files of code that recipes and metrics name and that may be run: those that the parent ran."""
    user_metrics: tuple[tuple[str, str], ...] = ()
    """Group and source, `file.py:function`, of metrics that a user's functions compute."""
    seconds: float = float("inf")
    """After so long the worker begins no further chunk: it returns those that are left."""


def text_of(error: BaseException) -> str:
    """An error's own words; a user's exception may have none that can be shown."""
    try:
        return str(error)
    except BaseException as second:
        return f"its message cannot be shown ({type(second).__name__})"


def stored_text(text: str) -> str:
    """A sentence as logs and the manifest can hold it: UTF-8, of at most SENTENCE_MOST characters."""
    text = text if len(text) <= SENTENCE_MOST else f"{text[:SENTENCE_MOST]}..."
    return text.encode(errors="backslashreplace").decode()


@dataclass(frozen=True)
class FailedChunk:
    """A chunk that could not be made."""

    place: int
    """Of the chunk in its task."""
    message: str
    is_transient: bool = False
    """Whether trying again may help: a full disk, a network file system that did not answer."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "message", stored_text(self.message))


@dataclass(frozen=True)
class Outcome:
    """The result of giving a task to a worker.

    | error | is_lost | means |
    |---|---|---|
    | None | False | chunks are in the shard, but for those that `failed` and that are `left` |
    | a sentence | False | the task raised, or some chunks failed; those of `failed` are named |
    | a sentence | True | the worker died, or was ended: nothing of the task is kept |
    """

    number: int
    worker: str
    """Who made it: process, host, device."""
    shard: str | None = None
    """Path of the file that it left, within the store."""
    row_count: int = 0
    """Results of chunks in the shard."""
    pose_count: int = 0
    seconds: float = 0.0
    error: str | None = None
    """One sentence; None if all went well."""
    is_lost: bool = False
    failed: tuple[FailedChunk, ...] = ()
    left: tuple[int, ...] = ()
    """Places of chunks that were not begun, as the task's time was over."""
    suspects: tuple[int, ...] | None = None
    """Of a lost task: places of the chunks that were being made; None if that is not known."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "error", None if self.error is None else stored_text(self.error))


@dataclass(frozen=True)
class Running:
    """How far a worker is with its task."""

    seconds: float
    """Since it began."""
    idle_seconds: float
    """Processor time that it has used since its last sign of progress."""
    memory: int = 0
    """Of its process [byte]; 0 if that is not known."""
    waiting_seconds: float = 0.0
    """Time on the wall since its last sign of progress; suspensions of the machine are left out."""


class Engine(Protocol):
    """Who makes tasks: this process, others of this host, or a cluster. A worker has one task at a time."""

    @property
    def name(self) -> str:
        """In the log."""
        ...

    @property
    def devices(self) -> tuple[str, ...]:
        """Warp device of each worker that can work now."""
        ...

    @property
    def worker_most(self) -> int:
        """Workers that it may have."""
        ...

    def start(self, store: Path) -> None:
        """Start the first worker, or find workers; they need not be ready when this returns.

        Raises SweepError, naming the worker, for one that cannot do the work, here or in `wait`.
        """
        ...

    def grow(self, worker_count: int) -> None:
        """Have so many workers, at most `worker_most`: seconds of work are left."""
        ...

    def free_count(self) -> int:
        """Workers that can be given a task now."""
        ...

    def submit(self, task: Task) -> None:
        """Give a task to a free worker."""
        ...

    def wait(self, timeout: float) -> list[Outcome]:
        """Outcomes since the last call; waits for one, or for a worker that becomes free, at most `timeout` [s]."""
        ...

    def running(self) -> dict[int, Running]:
        """Tasks that a worker has begun, by number."""
        ...

    def drop(self, number: int, reason: str) -> None:
        """End the worker that makes a task. The task's outcome, which `wait` returns, is lost, with the reason."""
        ...

    def close(self) -> None:
        """End all workers, whatever they do."""
        ...
