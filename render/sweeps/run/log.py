"""What happens in a sweep, as JSON lines in its store.

Each line of log.jsonl is one object: `time` (ISO 8601, UTC), `run` (of which parent), `event`, and what belongs to it:

| event | numbers |
|---|---|
| start | plan, recipe_count, groups, maker, engine, devices, recovered (parts that a killed run had left) |
| same-results | maker (this code version), counted (code versions whose results count for it from now on) |
| task | number, worker, pieces, parts, poses, seconds |
| error | number, worker, sentence; the task is made again |
| lost | number, worker, sentence: the worker died, or was ended; the task is made again |
| dropped | number, seconds: it took too long |
| copied | number, of: the task that this one copies |
| failure | recipe_hash, recipe, sentence: given up |
| end | recipes, recipes_failed, poses_rendered, seconds |
| stopped | sentence: why the run ended before its end |
"""

import contextlib
import json
import os
import secrets
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Self

from ....datasets.json_text import parse_json
from ....datasets.storage.durable import open_own

LOG = "log.jsonl"
READ_MOST = 1 << 24  # [byte] of a log: some 100,000 events


@dataclass(frozen=True)
class SweepProgress:
    """How far a sweep is."""

    recipes: int
    """Made, there already, or given up."""
    recipe_count: int
    """In all; at most so many as long as the plan is not read to its end."""
    poses: int
    """Rendered in this run."""
    rate: float
    """Poses a second."""
    seconds_left: float | None
    """To go; None before anything has come back."""


class SweepLog:
    """Appends events to a file; lines of several parents do not mix. A line that cannot be written is left out: a full
    disk is noticed, and reported, where results are recorded. So are all lines where the file is a link or a pipe."""

    def __init__(self, path: Path) -> None:
        self.run = f"{datetime.now(UTC):%Y%m%dT%H%M%S}-{os.getpid()}-{secrets.token_hex(3)}"
        """Distinguishes this parent's lines and shards from others'."""
        self._handle = -1
        with contextlib.suppress(OSError):
            self._handle = open_own(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def write(self, event: str, **values: object) -> None:
        """One line, on its way to the disk when this returns."""
        now = datetime.now(UTC).isoformat(timespec="milliseconds")
        line = json.dumps({"time": now, "run": self.run, "event": event, **values}, ensure_ascii=False)
        if self._handle >= 0:
            with contextlib.suppress(OSError):
                os.write(self._handle, f"{line}\n".encode(errors="replace"))

    def close(self) -> None:
        """Close the file; closing twice does nothing."""
        if self._handle >= 0:
            os.close(self._handle)
            self._handle = -1


def read_log(path: Path) -> list[dict[str, Any]]:
    """Events of a log, the newest last, of its last `READ_MOST` bytes; lines that are no events are left out."""
    try:
        handle = open_own(path, os.O_RDONLY)
    except OSError:
        return []
    with os.fdopen(handle, "rb") as file:
        size = os.fstat(handle).st_size
        file.seek(max(0, size - READ_MOST))
        lines = file.read(READ_MOST).splitlines()
    events: list[dict[str, Any]] = []
    for line in lines:
        with contextlib.suppress(ValueError):
            event = parse_json(line, allow_nan=True)
            if isinstance(event, dict) and {"time", "run", "event"} <= event.keys():
                events.append(event)
    return events


def clock_time(seconds: float) -> str:
    """A duration for people: seconds, minutes, hours or days, in two of them."""
    whole = round(seconds)
    for unit, length, lower, below in (("d", 86400, "h", 3600), ("h", 3600, "min", 60), ("min", 60, "s", 1)):
        if whole >= length:
            return f"{whole // length} {unit} {whole % length // below} {lower}"
    return f"{whole} s" if seconds >= 9.5 else f"{seconds:.1f} s"
