"""Claims of work by several parents of one sweep: files created exclusively, each as good as its owner's sign of life.

| file | content | created | removed |
|---|---|---|---|
| `claims/BUCKET.N` | its owner | exclusively; N + 1 takes a dead owner's claim N over | by its owner at its end |
| `parents/OWNER` | a number that grows | when the parent begins; written again all the time | by it at its end |

A parent that ends also removes those of parents that were killed on its host.

A parent is dead if its file is missing, if it was a process of this host that is no more, or if its file was not
written for the time of the lease, measured by the clock of the one who looks: clocks of hosts need not agree. A parent
that was believed dead and goes on does no harm: what both make counts once.
"""

from __future__ import annotations

import contextlib
import importlib
import os
import platform
import re
import secrets
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

from ..bounded_file import FileBoundError, open_regular
from ..errors import SweepStoreError
from ..storage.durable import discard

LEASE = 60.0  # [s] without a sign of life after which a parent counts as dead
SIGNS = 6  # of life in the time of a lease
CLAIMS, PARENTS, SHARDS = "claims", "parents", "shards"
TEXT_MOST = 1000  # [byte] of a claim or sign of life
READ_ONLY = ("http", "https", "zip", "tar", "libarchive", "github", "data", "reference")
"""Schemes of URLs behind which nothing can be created."""

_OWNER = re.compile(r"[\w.-]{1,300}")


class ClaimPlace(Protocol):
    """A folder that all parents see. Every method raises OSError where the folder cannot be used."""

    def create(self, name: str, text: str) -> bool:
        """Create a file exclusively; False if it is there."""
        ...

    def write(self, name: str, text: str) -> None:
        """Write a file, which may be there."""
        ...

    def read(self, name: str) -> str | None:
        """Text of a file; None if it is missing."""
        ...

    def remove(self, name: str) -> None:
        """Remove a file, which may be missing."""
        ...

    def names(self, folder: str, prefix: str = "") -> list[str]:
        """Names of a folder's files that begin with a prefix."""
        ...


class LocalPlace:
    """A folder of a file system; on NFS, version 3 at least, creating is exclusive, too."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def create(self, name: str, text: str) -> bool:
        """Create a file exclusively; False if it is there."""
        path = self._folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)
        except FileExistsError:
            return False
        with os.fdopen(handle, "w") as file:
            file.write(text)
        return True

    def write(self, name: str, text: str) -> None:
        """Write a file, which may be there."""
        path = self._folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)

    def read(self, name: str) -> str | None:
        """Text of a file; None if it is missing."""
        try:
            with open_regular(self._folder / name, TEXT_MOST) as file:
                return file.read().decode(errors="replace")
        except (FileNotFoundError, FileBoundError, IsADirectoryError):  # what no parent wrote is nobody's
            return None

    def remove(self, name: str) -> None:
        """Remove a file, which may be missing."""
        discard(self._folder / name)

    def names(self, folder: str, prefix: str = "") -> list[str]:
        """Names of a folder's files that begin with a prefix."""
        try:
            return [name for name in os.listdir(self._folder / folder) if name.startswith(prefix)]
        except FileNotFoundError:
            return []

    def clear(self) -> None:
        """Remove the folders if they are empty: the last parent does."""
        for name in (CLAIMS, PARENTS):
            with contextlib.suppress(OSError):
                (self._folder / name).rmdir()


class SharedPlace:
    """A folder behind a URL of fsspec: `file:///shared/study`, `s3://bucket/study`. It holds shards, too.

    Raises SweepStoreError for a URL without an installed file system.
    """

    def __init__(self, url: str) -> None:
        self.url = url.rstrip("/")
        scheme, is_url, _ = self.url.partition("://")
        if not is_url and not Path(self.url).is_absolute():
            raise SweepStoreError(f"{url}: must be a URL such as s3://bucket/study, or a folder's absolute path")
        if is_url and scheme.rpartition("::")[2] in READ_ONLY:
            raise SweepStoreError(f"{url}: nothing can be created behind {scheme}://; name a folder or an object store")
        try:
            fsspec: Any = importlib.import_module("fsspec")
        except ImportError as error:
            install = "pip install -e '.[share]' in palpate's folder"
            raise SweepStoreError(f"{url}: shared places need fsspec: {install}") from error
        try:
            found = fsspec.core.url_to_fs(self.url)
            self._system: Any = found[0]
            self._root = str(found[1])
        except (ImportError, ValueError) as error:
            raise SweepStoreError(f"{url}: no file system for it is installed ({error})") from error

    def _path(self, name: str) -> str:
        return f"{self._root}/{name}"

    def create(self, name: str, text: str) -> bool:
        """Create a file exclusively (on an object store by a conditional put); False if it is there."""
        try:
            self._make_parent(name)
            self._system.pipe_file(self._path(name), text.encode(), mode="create")
        except FileExistsError:
            return False
        except OSError as error:
            if "PreconditionFailed" in str(error) or "pre-conditions" in str(error):
                return False
            raise
        return True

    def write(self, name: str, text: str) -> None:
        """Write a file, which may be there."""
        self._make_parent(name)
        self._system.pipe_file(self._path(name), text.encode())

    def _make_parent(self, name: str) -> None:
        self._system.makedirs(self._path(name).rpartition("/")[0], exist_ok=True)

    def read(self, name: str) -> str | None:
        """Text of a file; None if it is missing."""
        try:
            return str(self._system.cat_file(self._path(name))[:TEXT_MOST].decode(errors="replace"))
        except FileNotFoundError:
            return None

    def remove(self, name: str) -> None:
        """Remove a file, which may be missing."""
        with contextlib.suppress(FileNotFoundError):
            self._system.rm_file(self._path(name))

    def names(self, folder: str, prefix: str = "") -> list[str]:
        """Names of a folder's files that begin with a prefix."""
        try:
            found: Any = self._system.ls(self._path(folder), detail=False, refresh=True)
        except TypeError:  # a file system without a cache
            found = self._system.ls(self._path(folder), detail=False)
        except FileNotFoundError:
            return []
        names = [str(path).rstrip("/").rpartition("/")[2] for path in found]
        return [name for name in names if name.startswith(prefix) and name]

    def put(self, path: Path, name: str) -> None:
        """Copy a file of this machine to a name that no one else uses; it is there whole or not at all."""
        self._make_parent(name)
        self._system.put_file(str(path), self._path(f"{name}.tmp"))
        self._system.mv(self._path(f"{name}.tmp"), self._path(name))

    def get(self, name: str, path: Path) -> None:
        """Copy a file to this machine."""
        self._system.get_file(self._path(name), str(path))

    def clear(self) -> None:
        """Nothing: shards stay for parents that come later."""


class Claims:
    """The claims of one parent. clock: seconds, which only grow."""

    def __init__(self, place: ClaimPlace, *, lease: float = LEASE, clock: Callable[[], float] = time.monotonic) -> None:
        self._place, self._lease, self._clock = place, lease, clock
        self.owner = f"{platform.node() or 'host'}-{os.getpid()}-{secrets.token_hex(4)}"
        self._own: dict[str, str] = {}
        """File of each claim, by bucket."""
        self._seen: dict[str, tuple[str, float]] = {}
        """Content of other parents' files, and when it was first seen."""
        self._sign = 0
        self._signed_at = -float("inf")
        self.renew()

    def renew(self) -> None:
        """Give a sign of life, if it is time for one."""
        now = self._clock()
        if now - self._signed_at >= self._lease / SIGNS:
            self._sign += 1
            self._signed_at = now
            self._place.write(f"{PARENTS}/{self.owner}", str(self._sign))

    def has_company(self) -> bool:
        """Whether there is a file of another parent, dead or alive."""
        return any(name != self.owner for name in self._place.names(PARENTS))

    def take(self, bucket: str) -> bool:
        """Whether a bucket is this parent's, which claims it if it is free, or its owner dead."""
        if bucket in self._own:
            return True
        numbers = [name.rpartition(".")[2] for name in self._place.names(CLAIMS, f"{bucket}.")]
        last = max((int(number) for number in numbers if number.isdecimal()), default=0)
        if last:
            owner = self._place.read(f"{CLAIMS}/{bucket}.{last}")
            if owner is not None and self._is_alive(owner):
                return False
        name = f"{CLAIMS}/{bucket}.{last + 1}"
        if not self._place.create(name, self.owner):
            return False
        self._own[bucket] = name
        for number in range(1, last + 1):  # of dead owners
            self._place.remove(f"{CLAIMS}/{bucket}.{number}")
        return True

    def _is_alive(self, owner: str) -> bool:
        """See the module. An empty name is that of a parent that has just created its file."""
        if owner and not _OWNER.fullmatch(owner):
            return False  # no parent has such a name, which may lead out of the folder
        sign = self._place.read(f"{PARENTS}/{owner}") if owner else ""
        if sign is None or is_dead_process(owner):
            return False
        seen = self._seen.get(owner)
        if seen is None or seen[0] != sign:
            self._seen[owner] = (sign, self._clock())
            return True
        return self._clock() - seen[1] < self._lease

    def release(self) -> None:
        """Remove what this parent has created, and what killed ones of this host have; the rest dies with the lease."""
        with contextlib.suppress(OSError):
            for name in self._own.values():
                self._place.remove(name)
            self._place.remove(f"{PARENTS}/{self.owner}")
            for owner in filter(is_dead_process, self._place.names(PARENTS)):
                self._place.remove(f"{PARENTS}/{owner}")
            for name in self._place.names(CLAIMS):
                if is_dead_process(self._place.read(f"{CLAIMS}/{name}") or ""):
                    self._place.remove(f"{CLAIMS}/{name}")
        self._own.clear()


def is_dead_process(owner: str) -> bool:
    """Whether an owner was a process of this host that is no more."""
    host, _, rest = owner.rpartition("-")[0].rpartition("-")
    if host != platform.node() or not rest.isdecimal():
        return False
    try:
        os.kill(int(rest), 0)
    except (ProcessLookupError, OverflowError):  # no process has so large a number
        return True
    except PermissionError:
        return False
    with contextlib.suppress(OSError):  # where there is /proc: a process that ended and was not waited for is dead, too
        return Path(f"/proc/{rest}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    return False
