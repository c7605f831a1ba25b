"""How a parent records what workers leave: shards of about a second together, since each time waits for the disk."""

from __future__ import annotations

import contextlib
import os

from ....datasets.errors import SweepStoreError
from ....datasets.sweeps.manifest import NAME as MANIFEST
from ....datasets.sweeps.record import Read
from ....datasets.sweeps.shard import read_shard
from ....datasets.sweeps.store import SweepStore
from ...errors import SweepError

HOLD = 1.0  # [s] that shards lie whole in the store before they are recorded
PROBE_BYTES = 1 << 20  # that must fit on the store's disk, or it counts as full


class ShardRecording:
    """Shards that are to be recorded. run: names the run's files."""

    def __init__(self, store: SweepStore, run: str) -> None:
        self._store, self._run = store, run
        self._held: list[Read] = []
        self._held_since = 0.0
        self.task_count = 0
        """Tasks of this run."""

    def hold(self, name: str, now: float) -> str | None:
        """Have a shard recorded soon; returns what is wrong with one that is missing or damaged.

        Raises SweepError if the disk is full, the store is gone, or other code than the parent's made the shard.
        """
        try:
            shard = self._store.check(name)
        except SweepStoreError as error:
            self.require_room()
            try:
                read_shard(self._store.folder / name, columns=False)
            except SweepStoreError as damage:
                return str(damage)
            raise SweepError(self.with_remedy(str(error))) from error
        if shard is not None:
            self._held_since = self._held_since if self._held else now
            self._held.append(shard)
        return None

    def record_old(self, now: float) -> None:
        """Record what was held for long enough."""
        if self._held and now - self._held_since >= HOLD:
            self.record()

    def record(self) -> None:
        """Put held shards into the manifest, all in one transaction."""
        held, self._held = self._held, []
        try:
            if held:
                self._store.record_all(held)
        except SweepStoreError as error:
            self.require_room()
            raise SweepError(self.with_remedy(str(error))) from error

    def require_room(self) -> None:
        """Raise SweepError if the store's disk takes no more, or the store is gone."""
        self.require_store()
        probe = self._store.folder / f"probe-{self._run}.tmp"
        try:
            with probe.open("xb") as file:
                file.write(bytes(PROBE_BYTES))
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            message = f"{self._store.folder} takes no more: {error.strerror}"
            raise SweepError(self.with_remedy(message)) from error
        finally:
            with contextlib.suppress(OSError):
                probe.unlink()

    def require_store(self) -> None:
        """Raise SweepError if the store is gone."""
        if not (self._store.folder / MANIFEST).exists():
            raise SweepError(
                f"{self._store.folder} was removed while the sweep ran, with all that was made: the same command "
                "begins anew"
            )

    def with_remedy(self, message: str) -> str:
        """An error that ends the run, with what is safe."""
        return (
            f"{message}; what {self.task_count} tasks of this run made is safe, and the same command goes on from there"
        )
