"""What a store holds, counted without reading results: parts by group, bytes, shards that wait, parents that work."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from .claims import LEASE, PARENTS, is_dead_process
from .manifest import NAME, Manifest
from .record import COLUMNS, KEPT, SHARD_SUFFIX, SHARDS
from .store import SweepStore
from .table import POSES


@dataclass(frozen=True)
class GroupCount:
    """Results of a group that one code version has made."""

    group: str
    results: int
    """Keys."""
    parts: int


@dataclass(frozen=True)
class StoreStatus:
    """What is in a store."""

    groups: dict[str, tuple[GroupCount, ...]]
    """By code version, the one that recorded last at the end."""
    failures: dict[str, int]
    """Recipes that could not be made, by code version."""
    bytes: dict[str, int]
    """Of the manifest, columns, kept files and the tables of poses [byte], by the name of the file or folder."""
    shards_waiting: int
    """That no parent has recorded yet."""
    parents: tuple[str, ...]
    """Which seem to work in the store now; the name of each has its host and the number of its process."""


def store_status(folder: Path) -> StoreStatus:
    """Count what a store holds; nothing is changed. Raises SweepStoreError for a folder that is none, or damaged."""
    SweepStore(folder, mode="read").close()  # it refuses what is no store
    with contextlib.closing(Manifest(folder, "read")) as manifest:
        rows = manifest.run(
            'SELECT maker.maker, part."group", count(DISTINCT part.key), count(part.id), max(part.id) '
            'FROM maker LEFT JOIN part ON part.maker = maker.id GROUP BY maker.id, part."group"'
        )
        failures = manifest.run("SELECT maker.maker, count(*) FROM failure JOIN maker ON id = failure.maker GROUP BY 1")
    groups: dict[str, tuple[GroupCount, ...]] = {}
    last = {maker: max(row[4] or 0 for row in rows if row[0] == maker) for maker, *_ in rows}
    for maker, group, results, parts, _ in sorted(rows, key=lambda row: (last[row[0]], str(row[1]))):
        own = (GroupCount(str(group), int(results), int(parts)),) if parts else ()
        groups[str(maker)] = (*groups.get(str(maker), ()), *own)
    sizes = {name: _bytes(folder / name) for name in (NAME, COLUMNS, *KEPT, POSES)}
    return StoreStatus(
        groups,
        {str(maker): int(count) for maker, count in failures},
        {name: size for name, size in sizes.items() if size},
        waiting_shards(folder),
        tuple(living_parents(folder)),
    )


def waiting_shards(folder: Path) -> int:
    """Shards of a store that no parent has recorded yet."""
    return sum(1 for _ in (folder / SHARDS).glob(f"*{SHARD_SUFFIX}"))


def living_parents(folder: Path) -> Iterator[str]:
    """Parents that gave a sign of life in a store within the time of the lease, and have not ended on this host."""
    for path in sorted((folder / PARENTS).glob("*")):
        with contextlib.suppress(OSError):
            if time.time() - path.stat().st_mtime < LEASE and not is_dead_process(path.name):
                yield path.name


def _bytes(path: Path) -> int:
    """Of a file, or of the files of a folder [byte]."""
    found = 0
    for own in (path, *path.glob("*")):
        with contextlib.suppress(OSError):
            found += own.lstat().st_size if own.is_file() else 0
    return found
