"""How several parents share a sweep: claims of work, and, behind a URL, the shards and kept files that each has made.

| parents             | store            | claims         | results of the others                       |
|---------------------|------------------|----------------|---------------------------------------------|
| of one store        | one folder       | in the store   | are in the store's manifest                 |
| of several machines | each has its own | behind the URL | shards are fetched from there, and recorded |
"""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Self

from ....datasets.errors import SweepStoreError
from ....datasets.storage.durable import TEMPORARY_SUFFIX, discard
from ....datasets.sweeps.claims import LEASE, SHARDS, SIGNS, Claims, LocalPlace, SharedPlace
from ....datasets.sweeps.record import SHARD_SUFFIX, kept_path
from ....datasets.sweeps.shard import read_shard
from ....datasets.sweeps.store import KEPT as KEPT_GROUPS
from ...errors import SweepError

LOOK_SECONDS = {"local": 0.5, "shared": 2.0}  # between looks at what other parents have made
KEPT = "kept"  # folder of kept files behind a URL


class Sharing:
    """One parent's part in a sweep. url: where parents of several machines share it; None: parents of one store.

    Raises SweepError from every method where the place cannot be used.
    """

    def __init__(self, store: Path, url: str | None = None, *, lease: float = LEASE) -> None:
        """Nothing is created before `open`."""
        self._store, self._url, self._lease = store, url, lease
        self.problems: list[str] = []
        """A sentence for each file behind the URL that was left out, because it is damaged or foreign."""
        self._known: set[str] = set()
        """Names of shards behind the URL that were fetched, or are this parent's."""
        self._is_over = threading.Event()
        self._has_company = False
        self._shared: SharedPlace | None = None
        self._claims: Claims | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    @property
    def is_remote(self) -> bool:
        """Whether parents of other machines take part."""
        return self._url is not None

    def open(self) -> None:
        """Begin to claim work; once is enough."""
        if self._claims is not None:
            return
        with self._naming(self._url or str(self._store)):
            self._shared = None if self._url is None else SharedPlace(self._url)
            self._place = self._shared or LocalPlace(self._store)
            self._claims = Claims(self._place, lease=self._lease)
        self._renewer = threading.Thread(target=self._renew, name="palpate sweep claims", daemon=True)
        self._renewer.start()

    @property
    def look_seconds(self) -> float:
        """Time between two looks at what other parents have made [s]."""
        return LOOK_SECONDS["local" if self._shared is None else "shared"]

    @contextlib.contextmanager
    def _naming(self, where: str) -> Iterator[None]:
        try:
            yield
        except SweepStoreError as error:
            raise SweepError(str(error)) from error
        except OSError as error:
            raise SweepError(f"{where}: work cannot be claimed there ({error.strerror or error})") from error

    def _renew(self) -> None:
        """Signs of life, also while this process makes a task itself."""
        while not self._is_over.wait(self._lease / SIGNS / 2):
            with contextlib.suppress(OSError):  # the next one may get through
                self._opened.renew()

    @property
    def _opened(self) -> Claims:
        if self._claims is None:
            raise SweepError("work is claimed by a parent that has not begun")
        return self._claims

    def has_company(self) -> bool:
        """Whether another parent has been seen, now or before."""
        if not self._has_company and self._claims is not None:
            with self._naming(str(self._store)):
                self._has_company = self._opened.has_company()
        return self._has_company

    def takes(self, bucket: str) -> bool:
        """Whether a bucket of chunks is this parent's."""
        with self._naming(str(self._store)):
            return self._opened.take(bucket)

    def publish(self, shard: str) -> None:
        """Copy a shard, and first the kept files that it names, to where the other parents find them."""
        if self._shared is None:
            return
        path = self._store / shard
        with self._naming(self._shared.url):
            for name in _kept_files(path):
                for own in (name.with_suffix(".json"), name):  # beside contours: which code made them
                    if (self._store / own).exists():
                        self._shared.put(self._store / own, f"{KEPT}/{own}")
            self._known.add(path.name)
            self._shared.put(path, f"{SHARDS}/{path.name}")

    def fetch(self) -> list[str]:
        """Copy shards of other parents, and the kept files that they name, into the store; paths within the store.

        What is damaged is left out (`problems`).
        """
        if self._shared is None:
            return []
        fetched = []
        with self._naming(self._shared.url):
            for name in sorted(set(self._shared.names(SHARDS)) - self._known):
                self._known.add(name)
                if name.endswith(SHARD_SUFFIX) and (shard := self._fetched(self._shared, name)):
                    fetched.append(shard)
        return fetched

    def _fetched(self, shared: SharedPlace, name: str) -> str | None:
        """A shard, with the kept files that it names, by its path within the store; None if it is damaged."""
        shard = f"{SHARDS}/{name}"
        try:
            self._get(shared, shard, shard)
            for kept in _kept_files(self._store / shard):
                for own in (kept.with_suffix(".json"), kept):
                    if not (self._store / own).exists():
                        self._get(shared, f"{KEPT}/{own}", str(own))
        except SweepStoreError as error:
            discard(self._store / shard)
            self.problems.append(f"{shared.url}/{shard} is left out: {error}")
            return None
        return shard

    def _get(self, shared: SharedPlace, name: str, path: str) -> None:
        """Copy a file; it gets its own name once it is whole. One that is not there is left out."""
        whole = self._store / path
        whole.parent.mkdir(parents=True, exist_ok=True)
        temporary = whole.with_name(f"{whole.name}.{os.getpid()}{TEMPORARY_SUFFIX}")
        try:
            shared.get(name, temporary)
            os.replace(temporary, whole)
        except FileNotFoundError:  # a row whose file is missing counts as not done
            discard(temporary)

    def close(self) -> None:
        """Give up the claims: what this parent has not made, others may."""
        if self._claims is not None:
            self._is_over.set()
            self._renewer.join()
            self._claims.release()
            self._place.clear()
            self._claims = None


def _kept_files(shard: Path) -> list[PurePosixPath]:
    """Paths within the store of files that a shard's results are about."""
    rows = read_shard(shard, columns=False).rows
    return [path for row in rows if row.group.startswith(KEPT_GROUPS) and (path := kept_path(row.payload)) is not None]
