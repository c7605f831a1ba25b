"""Files that match a pattern of a plan, found within a bound: `/**/*.stl` must not walk a whole disk in silence."""

import glob
import os
from collections.abc import Iterator
from pathlib import Path

from .values import refuse

JOKERS = "*?["
DEEP = "**"
FOLDERS_MOST = 10_000
"""Folders that one pattern may look into: about a second on a local disk."""


def has_jokers(text: str) -> bool:
    """Whether a text may be a pattern."""
    return any(joker in text for joker in JOKERS)


def match_files(pattern: str, folder: Path) -> list[str]:
    """Files that match a pattern, sorted, as the pattern spells their folders; relative ones start from `folder`.

    `**` stands for any folders in between, hidden ones and symbolic links to folders left out. Refused: `**` twice, and
    a pattern that looks into more than FOLDERS_MOST folders.
    """
    head, deep, rest = _split(pattern)
    if not deep:
        found = glob.iglob(pattern, root_dir=folder)
    else:
        if DEEP in rest.split("/"):
            refuse(f"may have {DEEP} once in a pattern, not as in {pattern!r}")
        found = (
            os.path.join(inner, name)
            for inner in _folders_below(head, folder, pattern)
            for name in glob.iglob(rest or "*", root_dir=folder / inner)
        )
    return sorted(text for text in found if (folder / text).is_file())


def _split(pattern: str) -> tuple[str, bool, str]:
    """What stands before the first `**`, whether there is one, and what stands after it."""
    parts = pattern.split("/")
    if DEEP not in parts:
        return pattern, False, ""
    place = parts.index(DEEP)
    head = "/".join(parts[:place])
    return "/" if place == 1 and not head else head, True, "/".join(parts[place + 1 :])


def _folders_below(head: str, folder: Path, pattern: str) -> Iterator[str]:
    """Each folder that matches `head`, and each below it, as paths that start like `head`."""
    starts = glob.iglob(head, root_dir=folder) if has_jokers(head) else [head]
    count = 0
    for start in starts:
        top = str(folder / start)
        for inner, names, _ in os.walk(top):
            names[:] = [name for name in names if not name.startswith(".")]
            count += 1
            if count > FOLDERS_MOST:
                refuse(
                    f"{pattern!r} looks into more than {FOLDERS_MOST:,} folders below {top}: name the folder of the "
                    "files more exactly"
                )
            below = os.path.relpath(inner, top)
            yield start if below == "." else os.path.join(start, below)
