"""What was computed of large meshes, kept on disk, so that it is computed once and not at every start.

An entry is an .npz file under `$XDG_CACHE_HOME/palpate/meshes` (`~/.cache/palpate/meshes`), named by a SHA-256 over
what it was made of and over the sources and libraries that decide about it: another version never reads it. Nothing
depends on entries: one that cannot be read is removed, one that cannot be written is left out.
"""

import contextlib
import hashlib
import json
import os
import re
from collections.abc import Callable, Sequence
from functools import cache
from importlib.metadata import version
from io import BytesIO
from pathlib import Path
from typing import TypeVar

import numpy as np

from ....datasets.array_file import read_arrays
from ....datasets.storage.durable import discard, write_file

SWITCH = "PALPATE_CACHE"  # environment variable: "off", or a folder to use instead
BYTES_MOST = 2_000_000_000  # of all entries; beyond, those that were used least lately are deleted
ENTRY = re.compile(r"[0-9a-f]{64}\.npz(\.[0-9a-f]+\.tmp)?")  # and what a killed process left of one

Kept = TypeVar("Kept")


def kept_folder() -> Path | None:
    """Where entries are; None if keeping is switched off or there is no place for it."""
    given = os.environ.get(SWITCH, "")
    if given.lower() == "off":
        return None
    if given:
        return Path(given)
    base = os.environ.get("XDG_CACHE_HOME", "")
    if os.path.isabs(base):  # a relative one is to be ignored, says its specification
        return Path(base) / "palpate" / "meshes"
    try:
        return Path.home() / ".cache" / "palpate" / "meshes"
    except RuntimeError:
        return None


@cache
def maker_digest(sources: Sequence[str], libraries: Sequence[str]) -> bytes:
    """SHA-256 over palpate's sources, as paths from its root, and the versions of libraries."""
    digest = hashlib.sha256()
    for name in sources:
        digest.update((Path(__file__).parents[3] / name).read_bytes())
    digest.update(json.dumps([(name, version(name)) for name in libraries]).encode())
    return digest.digest()


def read_entry(path: Path, made_of: Callable[[dict[str, np.ndarray]], Kept]) -> Kept | None:
    """What `made_of` makes of an entry's arrays; None if there is no entry or it is damaged, which is then removed.

    made_of: raises any error for arrays that cannot be right.
    """
    try:
        kept = made_of(read_arrays(path))
    except FileNotFoundError:
        return None
    except Exception:  # of a damaged zip file, or a damaged array in it: readers with many errors of their own
        discard(path)
        return None
    with contextlib.suppress(OSError):
        os.utime(path)  # it was used
    return kept


def write_entry(path: Path, arrays: dict[str, np.ndarray]) -> None:
    """Keep arrays if that can be done: not on a full disk, nor in a folder that may not be written."""
    if sum(array.nbytes for array in arrays.values()) > BYTES_MOST:
        return
    content = BytesIO()  # first in memory: zipfile reports a full disk again when it is deleted
    np.savez(content, **arrays)  # pyright: ignore[reportArgumentType]  # takes arrays by any name
    with contextlib.suppress(OSError):
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        write_file(path, content.getbuffer())
        drop_oldest(path.parent)


def drop_oldest(folder: Path) -> None:
    """Delete the entries that were used least lately, until BYTES_MOST hold the others; files of others are left."""
    found = []
    for path in folder.iterdir():
        if not ENTRY.fullmatch(path.name):
            continue
        with contextlib.suppress(OSError):  # another process may have deleted it
            status = path.stat()
            found.append((status.st_mtime, status.st_size, path))
    total = 0
    for _, size, path in sorted(found, reverse=True):
        total += size
        if total > BYTES_MOST:
            discard(path)
