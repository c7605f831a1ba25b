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

from ...datasets.json_text import parse_json
from ...datasets.storage.durable import NewFile
from ..errors import TrustStoreError

NAME = re.compile(r"[0-9a-f]{64}")
ENTRY_BYTES = 1 << 16  # of one file; longer ones are not ours


@dataclass(frozen=True)
class Accepted:
    """A piece of code that was accepted."""

    digest: str
    name: str
    """As the data have it."""
    named_by: str
    """The file that names it; empty: none."""
    files: tuple[str, ...]
    """Where its files were."""
    when: str
    """Date and time, UTC."""


def store_folder() -> Path:
    """Where the store is, or will be; a relative `XDG_CONFIG_HOME` is ignored, as its specification asks.

    Raises TrustStoreError where there is no home folder either.
    """
    given = Path(os.environ.get("XDG_CONFIG_HOME", ""))
    folder = given if given.is_absolute() else Path(os.path.expanduser("~")) / ".config"
    if not folder.is_absolute():
        raise TrustStoreError("there is no home folder for the store of accepted code: set XDG_CONFIG_HOME")
    return folder / "palpate" / "trust"


def accepted() -> frozenset[str]:
    """Digests of all that was accepted; raises TrustStoreError for a store that others can write."""
    folder = _open_folder(make=False)
    if folder is None:
        return frozenset()
    try:
        return frozenset(name for name in os.listdir(folder) if NAME.fullmatch(name) and _is_ours(name, folder))
    finally:
        os.close(folder)


def entries() -> list[Accepted]:
    """All that was accepted, oldest first; raises TrustStoreError as `accepted` does."""
    found = [_entry(digest) for digest in accepted()]
    return sorted(found, key=lambda entry: (entry.when, entry.digest))


def accept(entry: Accepted) -> None:
    """Put a piece of code into the store; raises TrustStoreError if that cannot be written, or others could."""
    folder = _open_folder(make=True)
    if folder is None:
        raise TrustStoreError(f"{store_folder()}: cannot be made")
    try:
        with NewFile(store_folder() / entry.digest) as new:
            os.fchmod(new.handle, 0o600)  # whatever the umask
            new.write(json.dumps(asdict(entry)).encode())
    except OSError as error:
        raise TrustStoreError(f"{store_folder()}: cannot be written ({error.strerror})") from error
    finally:
        os.close(folder)


def forget(digest: str) -> None:
    """Take a piece of code out of the store; raises TrustStoreError if that cannot be written."""
    folder = _open_folder(make=False)
    if folder is None:
        return
    try:
        os.unlink(digest, dir_fd=folder)
    except FileNotFoundError:
        return
    except OSError as error:
        raise TrustStoreError(f"{store_folder()}: cannot be written ({error.strerror})") from error
    finally:
        os.close(folder)


def _entry(digest: str) -> Accepted:
    """What a file of the store says; its name alone counts, so one that cannot be read is listed without words."""
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
        handle = os.open(store_folder() / digest, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
        with open(handle, encoding="utf-8") as file:
            values = parse_json(file.read(ENTRY_BYTES))
        files = tuple(str(path) for path in values["files"])
        return Accepted(digest, str(values["name"]), str(values["named_by"]), files, str(values["when"]))
    return Accepted(digest, "", "", (), "")


def _open_folder(*, make: bool) -> int | None:
    """The store's folder, opened; None where there is none. Raises TrustStoreError for one that others can write."""
    path = store_folder()
    try:
        if make:
            path.parent.parent.mkdir(parents=True, exist_ok=True)
            for folder in (path.parent, path):
                folder.mkdir(mode=0o700, exist_ok=True)
        for folder in (path.parent, path):
            _require_private(folder)
        return os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise TrustStoreError(f"{path}: cannot be opened ({error.strerror})") from error


def _require_private(folder: Path) -> None:
    found = os.stat(folder, follow_symlinks=False)
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.geteuid() or found.st_mode & 0o022:
        raise TrustStoreError(
            f"{folder}: must be a folder of yours that nobody else can write, or others could accept code for you "
            f"(chmod 700 {folder})"
        )


def _is_ours(name: str, folder: int) -> bool:
    try:
        found = os.stat(name, dir_fd=folder, follow_symlinks=False)
    except FileNotFoundError:  # taken out at this moment
        return False
    return stat.S_ISREG(found.st_mode) and found.st_uid == os.geteuid()
