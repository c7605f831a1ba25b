"""What in a store belongs to code versions whose results do not count: counted, and removed."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from ..errors import SweepStoreError
from ..json_text import parse_json
from ..storage.durable import discard
from .manifest import Manifest
from .record import COLUMNS, KEPT, kept_path


@dataclass(frozen=True)
class Unused:
    """What can be removed."""

    part_count: int
    """Rows of the manifest."""
    files: tuple[Path, ...]
    """Files of columns, and kept files, that only these rows name; some may be missing."""


def unused_parts(manifest: Manifest, folder: Path, makers: Iterable[int]) -> Unused:
    """What no code version of some, by their numbers in the manifest, has made; raises SweepStoreError."""
    own = f"({', '.join(map(str, makers))})"
    count = int(manifest.run(f"SELECT count(*) FROM part WHERE maker NOT IN {own}")[0][0])
    names = manifest.run(
        "SELECT name FROM column_file WHERE id NOT IN "
        f"(SELECT column_file FROM part WHERE column_file IS NOT NULL AND maker IN {own})"
    )
    kept = f"SELECT payload FROM part WHERE \"group\" LIKE 'keep-%' AND maker {{}} {own}"
    used = set(_kept_paths(manifest.run(kept.format("IN"))))
    unused: set[PurePosixPath] = set()
    for row in manifest.run(kept.format("NOT IN")):
        with contextlib.suppress(SweepStoreError):  # a payload that names another place
            unused.update(_kept_paths([row]))
    unused -= used
    beside = {path.with_suffix(".json") for path in unused}
    columns = [folder / COLUMNS / str(name) for (name,) in names if PurePosixPath(str(name)).name == name]
    files = columns + [folder / path for path in sorted(unused | beside)]
    linked = {folder / name for name in (COLUMNS, *KEPT) if (folder / name).is_symlink()}  # others' files, perhaps
    files = [path for path in files if path.parent not in linked]
    return Unused(count, tuple(files))


def remove_parts(manifest: Manifest, folder: Path, makers: Iterable[int]) -> Unused:
    """Remove what `unused_parts` finds, and what else the manifest knows of these code versions."""
    numbers = tuple(makers)
    others = f"NOT IN ({', '.join(map(str, numbers))})"
    with manifest.transaction():
        unused = unused_parts(manifest, folder, numbers)
        manifest.run(f"DELETE FROM part WHERE maker {others}")
        manifest.run(f"DELETE FROM failure WHERE maker {others}")
        if manifest.version > 2:
            manifest.run(f"DELETE FROM same_results WHERE maker {others} OR counted {others}")
        manifest.run(f"DELETE FROM maker WHERE id {others}")
        manifest.run(
            "DELETE FROM column_file WHERE id NOT IN (SELECT column_file FROM part WHERE column_file IS NOT NULL)"
        )
    for path in unused.files:
        discard(path)
    with contextlib.suppress(SweepStoreError):  # it makes the file smaller, which needs room for a second one
        manifest.run("VACUUM")
    return unused


def _kept_paths(rows: Iterable[tuple[object, ...]]) -> Iterator[PurePosixPath]:
    """Kept files that rows' payloads name, such as contours/KEY.h5; raises SweepStoreError for others."""
    for (payload,) in rows:
        try:
            path = kept_path(parse_json(str(payload), allow_nan=True))
        except (ValueError, TypeError, AttributeError) as error:
            raise SweepStoreError(f"a payload of the store cannot be read, so nothing is removed: {error}") from error
        if path is not None:
            yield path
