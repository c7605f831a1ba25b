"""Names that people type: found in any case, and the likely one suggested where none is meant."""

import difflib
import errno
import os
from collections.abc import Collection
from itertools import islice
from os import PathLike
from pathlib import Path

LIKENESS = 0.6
"""Ratio of difflib from which on a name is alike."""
_FILES_MOST = 10_000  # of a folder, which are compared with a name


def find_name(name: object, known: Collection[str]) -> str | None:
    """The known name that is written so, in any case and with `_` or blanks for `-`; None if there is none.

    >>> find_name("Inset_Hatch", ["hatch", "inset-hatch"])
    'inset-hatch'
    """
    if isinstance(name, str) and name in known:
        return name
    wanted = _spelling(name) if isinstance(name, str) else None
    return next((other for other in known if _spelling(other) == wanted), None)


def likely_name(name: object, known: Collection[str]) -> str:
    """The known name that is probably meant, as part of a sentence; empty if none is alike.

    >>> likely_name("tubs", ["cube", "tube"])
    " (did you mean 'tube'?)"
    """
    spellings = {_spelling(other): other for other in known}
    wanted = _spelling(name) if isinstance(name, str) else ""
    close = difflib.get_close_matches(wanted, spellings, 5, LIKENESS)
    close.sort(key=lambda other: sorted(other) != sorted(wanted))  # two letters in the wrong order come first
    return f" (did you mean {spellings[close[0]]!r}?)" if close else ""


def _spelling(name: str) -> str:
    return name.strip().casefold().replace("_", "-").replace(" ", "-")


def likely_file(path: str | PathLike[str]) -> str:
    """The file of the same folder that is probably meant by a path where none is, as part of a sentence, or nothing.

    Of a symbolic link that leads nowhere, why.
    """
    missing = Path(path)
    try:
        if missing.is_symlink():
            return f" (it is a symbolic link {_link_fault(missing)})"
        with os.scandir(missing.parent) as entries:
            names = [entry.name for entry in islice(entries, _FILES_MOST)]
    except (OSError, ValueError):
        return ""
    alike = [name for name in names if not name.startswith(".") and _is_alike(missing, Path(name))]
    return likely_name(missing.name, alike)


def _is_alike(missing: Path, other: Path) -> bool:
    """Whether a file may be meant: its stem is alike and its suffix the same, or its stem is the same."""
    stem, own = _spelling(missing.stem), _spelling(other.stem)
    if missing.suffix.lower() != other.suffix.lower():
        return stem == own
    return difflib.SequenceMatcher(None, stem, own).ratio() > LIKENESS


def _link_fault(link: Path) -> str:
    """Why a symbolic link leads nowhere; raises OSError if it is gone."""
    target = os.readlink(link)
    try:
        os.stat(link)
    except OSError as error:
        if error.errno == errno.ELOOP:
            return f"to {target!r}, which leads back to it"
    return f"to {target!r}, which is not there"


def unknown_name(what: str, name: object, known: Collection[str]) -> str:
    """The sentence that refuses a name: what kind it is of, the one that is probably meant, all known ones."""
    return f"unknown {what} {name!r:.60}{likely_name(name, known)}; known: {', '.join(known)}"
