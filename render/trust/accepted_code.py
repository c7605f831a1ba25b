"""The store of accepted code: one small file for each piece, in a folder that only its owner can write.

It lies in `$XDG_CONFIG_HOME/palpate/trust`, by default `~/.config/palpate/trust`. A file's name is the digest of what
was accepted (`trust.Code.digest`); its content is for people.
"""

import contextlib
import json
import os
import re
import stat
from dataclasses import asdict, dataclass
from pathlib import Path

from ...datasets.errors import DatasetError
from ...datasets.json_text import read_json
from ...datasets.storage.durable import NewFile
from ..errors import TrustStoreError

NAME = re.compile(r"[0-9a-f]{64}")


@dataclass(frozen=True)
class Accepted:
    """A piece of code that was accepted."""

    digest: str
    name: str
    """Name of the code in the data."""
    named_by: str
    """Path of the file that names it; empty: the user named it."""
    files: tuple[str, ...]
    """Paths of its files."""
    when: str
    """Date and time, UTC."""


def store_folder() -> Path:
    """The store's folder, which may not exist yet; a relative `XDG_CONFIG_HOME` is ignored, as its specification asks.

    Raises TrustStoreError where there is no home folder either.
    """
    given = Path(os.environ.get("XDG_CONFIG_HOME", ""))
    folder = given if given.is_absolute() else Path(os.path.expanduser("~")) / ".config"
    if not folder.is_absolute():
        raise TrustStoreError("there is no home folder for the store of accepted code: set XDG_CONFIG_HOME")
    return folder / "palpate" / "trust"


def accepted() -> frozenset[str]:
    """Digests of all that was accepted; raises TrustStoreError for a store that others can write."""
    folder = store_folder()
    try:
        _require_private(folder)
        with os.scandir(folder) as files:
            return frozenset(
                file.name for file in files if NAME.fullmatch(file.name) and file.is_file(follow_symlinks=False)
            )
    except FileNotFoundError:  # nothing was ever accepted
        return frozenset()
    except OSError as error:
        raise TrustStoreError(f"{folder}: cannot be read ({error.strerror})") from error


def entries() -> list[Accepted]:
    """All that was accepted, oldest first; raises TrustStoreError as `accepted` does."""
    return sorted(map(_entry, accepted()), key=lambda entry: (entry.when, entry.digest))


def accept(entry: Accepted) -> None:
    """Put a piece of code into the store; raises TrustStoreError if that cannot be written, or others could."""
    folder = store_folder()
    try:
        for private in (folder.parent, folder):
            private.mkdir(mode=0o700, parents=True, exist_ok=True)
        _require_private(folder)
        with NewFile(folder / entry.digest) as new:
            os.fchmod(new.handle, 0o600)  # whatever the umask
            new.write(json.dumps(asdict(entry)).encode())
    except OSError as error:
        raise TrustStoreError(f"{folder}: cannot be written ({error.strerror})") from error


def forget(digest: str) -> None:
    """Take a piece of code out of the store; raises TrustStoreError if that cannot be written."""
    folder = store_folder()
    try:
        (folder / digest).unlink(missing_ok=True)
    except OSError as error:
        raise TrustStoreError(f"{folder}: cannot be written ({error.strerror})") from error


def _entry(digest: str) -> Accepted:
    """The content of a file of the store; its name alone counts, so one that cannot be read is listed without text."""
    with contextlib.suppress(DatasetError, OSError, ValueError, KeyError, TypeError):
        values = read_json(store_folder() / digest)
        files = tuple(str(path) for path in values["files"])
        return Accepted(digest, str(values["name"]), str(values["named_by"]), files, str(values["when"]))
    return Accepted(digest, "", "", (), "")


def _require_private(store: Path) -> None:
    """Raise TrustStoreError if another user can write the store, or replace it; FileNotFoundError if there is none."""
    for folder in (store.parent, store):
        found = folder.lstat()
        if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.geteuid() or found.st_mode & 0o022:
            raise TrustStoreError(
                f"{folder}: must be a folder of yours that nobody else can write, or others could accept code for you "
                f"(chmod 700 {folder})"
            )
