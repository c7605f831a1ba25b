"""Whether a sweep's store is whole: all is read and proven by its digests; nothing is changed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from ..contour_file.check import check_file
from ..errors import SweepStoreError
from ..focus_files.frame_reader import check_frames, frame_format
from .manifest import NAME, Manifest
from .parts import manifest_problems
from .record import COLUMNS, KEPT, SHARD_SUFFIX, SHARDS
from .shard import read_shard, require_named


@dataclass(frozen=True)
class StoreCheck:
    """What a check found."""

    problems: list[str] = field(default_factory=list[str])
    """A sentence for each damage; none if all is whole."""
    unproven: list[str] = field(default_factory=list[str])
    """A sentence for each file without digests, as palpate wrote them before it had any: it was read, not proven."""


def is_sweep_data(path: str | Path) -> bool:
    """Whether a path is a folder with a sweep's manifest."""
    return (Path(path) / NAME).exists()


def check_store(path: str | Path) -> StoreCheck:
    """Check a store (manifest, columns, shards, kept files); nothing is raised for damage.

    No sweep should write into the store meanwhile: what it removes would be missed.
    """
    path = Path(path)
    found = StoreCheck()
    found.problems.extend(_manifest_sentences(path, found))
    for own in sorted((path / SHARDS).glob(f"*{SHARD_SUFFIX}")):
        found.problems.extend(_damage(read_shard, own))
    for folder in KEPT:
        for own in sorted((path / folder).glob(f"*{SHARD_SUFFIX}")):
            found.problems.extend(check_file(own) if frame_format(own) is None else check_frames(own))
    return found


def _manifest_sentences(folder: Path, found: StoreCheck) -> Iterator[str]:
    """Problems of a manifest, and of the files of columns that it names."""
    try:
        manifest = Manifest(folder, "read")
    except SweepStoreError as error:
        yield str(error)
        return
    try:
        yield from manifest_problems(manifest)
        if manifest.version == 1:
            found.unproven.append(f"{manifest.path} is of version 1, without digests: the next sweep adds them")
        for (name,) in manifest.run("SELECT CAST(name AS BLOB) FROM column_file ORDER BY 1"):
            path = folder / COLUMNS / bytes(name).decode(errors="replace")
            yield from _damage(require_named, path)
    except SweepStoreError as error:
        yield str(error)
    finally:
        manifest.close()


def _damage(prove: Callable[[Path], object], path: Path) -> list[str]:
    """What proving a file finds."""
    try:
        prove(path)
    except SweepStoreError as error:
        return [str(error)]
    return []
