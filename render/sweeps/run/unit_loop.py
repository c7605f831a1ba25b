"""Units given to workers, and what follows from each result.

| result of a unit                            | what follows                                                          |
|---------------------------------------------|-----------------------------------------------------------------------|
| chunks are made                             | their results are recorded                                            |
| a chunk failed, and is named                | it is given up by name: the same error would come again               |
| a chunk failed as the system failed         | it is made again later, and given up after `SYSTEM_TRIES`;            |
|                                             | if it fails for `SYSTEM_FAILURES` chunks in a row, the sweep ends     |
| a reason that names no chunk                | the chunks again, each in a unit of its own; such a one is given up   |
| its worker died                             | the unit again, alone: nothing else is made meanwhile. If it dies     |
|                                             | again, each chunk alone; one that was alone `TRIES` times is given up |
| it takes longer than the limit              | its worker is ended, and its chunks are made again, each in a unit of |
|                                             | its own; such a one is given up                                       |
| no worker has it, and nothing else is made  | the sweep ends with an error                                          |
"""

from __future__ import annotations

import re
import time
from collections import deque
from collections.abc import Callable, Collection, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from dataclasses import dataclass, field

from ....datasets.sweeps.store import SweepStore
from ...errors import SweepError
from ...runtime.interrupt import interrupt_between
from ..make.unit import FailedChunk, Unit, UnitResult, text_of
from .executors import Ended, Pool
from .missing import Missing, PendingChunk

SECONDS = {"cpu": 2.0, "cuda": 3.0}  # of a unit: long beside handing it over, short beside what a kill may lose
RATE_FIRST = {"cpu": 1e4, "cuda": 2e6}  # [pose/s] supposed until any unit was made
FIRST_SHARE = 0.25  # of a unit's length, that of the first unit of a family, whose speed is not known
CHUNKS_FIRST, CHUNKS_MOST = 8, 1000  # of a unit of a family whose speed is not known, and of any
BLEND = 0.5  # weight of the last unit in a family's speed


class UnitCutter:
    """Cuts chunks of one family into units; chunks of one place stay together.

    places: as `Missing.places` gives them. poses: to be made of each family.
    """

    def __init__(self, places: Iterator[list[PendingChunk]], poses: dict[str, int]) -> None:
        self._places, self._poses = places, dict(poses)
        self._next: list[PendingChunk] = next(places, [])
        self._rates: dict[str, float] = {}
        self._done_poses, self._done_seconds = 0, 0.0
        self._kind = "cpu"

    @property
    def is_empty(self) -> bool:
        """Whether all was given."""
        return not self._next

    def rate(self, family: str) -> float:
        """Poses a second of one worker: of the family, else of all that was made, else supposed."""
        mean = self._done_poses / self._done_seconds if self._done_seconds else RATE_FIRST[self._kind]
        return self._rates.get(family, mean)

    def seconds_left(self) -> float:
        """For one worker, of what was not given yet."""
        return sum(poses / self.rate(family) for family, poses in self._poses.items())

    def take(self, device: str, worker_count: int = 1) -> list[PendingChunk]:
        """Chunks for one of some workers with a device; none if all was given."""
        self._kind = "cuda" if device.startswith("cuda") else "cpu"
        if not self._next:
            return []
        family = self._next[0].family
        seconds = SECONDS[self._kind] * (1.0 if family in self._rates else FIRST_SHARE)
        room = min(seconds * self.rate(family), self._poses[family] / worker_count)
        most = CHUNKS_MOST if family in self._rates else CHUNKS_FIRST
        chunks: list[PendingChunk] = []
        while self._next and self._next[0].family == family and (not chunks or self._next[0].pose_count <= room):
            if len(chunks) >= most:
                break
            room -= self._next[0].pose_count
            self._poses[family] = max(0, self._poses[family] - self._next[0].pose_count)
            chunks += self._next
            self._next = next(self._places, [])
        return chunks

    def learn(self, family: str, poses: int, seconds: float) -> None:
        """Take note of the time that a unit took."""
        if not poses or seconds <= 0.0:
            return
        known = self._rates.get(family, poses / seconds)
        self._rates[family] = 1.0 / ((1.0 - BLEND) / known + BLEND * seconds / poses)
        self._done_poses += poses
        self._done_seconds += seconds


UNIT_SECONDS = 1800.0  # that a unit may take by default
WAIT = 0.5  # [s] for a result, before what takes too long is looked at, and Ctrl-C
HOLD = 1.0  # [s] that results wait for a transaction, which waits for the disk
TRIES = 2  # workers that may die while they make a chunk alone
SYSTEM_TRIES = 5  # for a chunk, the last one some eight seconds after the first
SYSTEM_FAILURES = 12  # one after another without a success: nothing can be written any more
SYSTEM_WAIT = 0.5  # [s] before a chunk is given again after the first of these; then twice as long each time
STEP_LONGEST = 5.0  # [s] that one turn counts at most: a suspended machine wastes no unit's time


@dataclass(eq=False)
class GivenUnit:
    """A unit that a pool has, or will have again."""

    chunks: list[PendingChunk]
    is_alone: bool = False
    """Whether nothing else is made meanwhile, as a worker died that had it."""
    pool: Pool | None = None
    age: float = 0.0
    """Since it was given [s]."""
    strays: int = 0
    """Times that no worker had it, as when the workers of a cluster change."""


@dataclass
class RunFigures:
    """What has happened in a run."""

    poses: int = 0
    rows: int = 0
    units: int = 0
    retries: int = 0
    workers_lost: int = 0
    notes: dict[str, int] = field(default_factory=dict)
    """Sentences, and how often each was met."""
    names: dict[str, None] = field(default_factory=dict)
    """Of the pools that made units."""

    def note(self, sentence: str) -> None:
        """Take note of a sentence for the report."""
        self.notes[sentence] = self.notes.get(sentence, 0) + 1


Wait = Callable[[Collection[Future[UnitResult]], float], Collection[Future[UnitResult]]]
"""Waits for one of some futures, at most so many seconds; gives those that are done."""


def wait_for(futures: Collection[Future[UnitResult]], timeout: float) -> Collection[Future[UnitResult]]:
    """See `Wait`; without futures the time passes."""
    if not futures:
        time.sleep(timeout)
        return ()
    return wait(futures, timeout, FIRST_COMPLETED).done


class UnitLoop:
    """Makes what is missing.

    pools: at least one. unit_of: a `Unit` of chunks. limit: seconds that a unit may take, 0 for no limit. on_turn:
    called in every turn. clock: seconds; wait: see `Wait`; tests give their own.
    """

    def __init__(
        self,
        missing: Missing,
        cutter: UnitCutter,
        store: SweepStore,
        pools: list[Pool],
        unit_of: Callable[[list[PendingChunk]], Unit],
        *,
        limit: float = UNIT_SECONDS,
        on_turn: Callable[[], None] = lambda: None,
        clock: Callable[[], float] = time.monotonic,
        wait: Wait = wait_for,
    ) -> None:
        self.missing, self.cutter, self.pools = missing, cutter, pools
        self.figures = RunFigures()
        self._store, self._unit_of, self._limit, self._on_turn = store, unit_of, limit, on_turn
        self._clock, self._wait = clock, wait
        self._running: dict[Future[UnitResult], GivenUnit] = {}
        self._again: deque[GivenUnit] = deque()
        self._held: list[UnitResult] = []
        self._recorded = clock()
        self._turned = clock()
        self._later: list[tuple[float, GivenUnit]] = []  # with the time from which they may be given again
        self._system_failures: set[int] = set()  # chunks on which the system failed since the last success
        self._idle = 0.0

    def run(self) -> None:
        """Make everything.

        Raises SweepError if no worker can go on, SweepStoreError if nothing can be recorded, KeyboardInterrupt between
        two turns. What was made is recorded whatever happens.
        """
        try:
            with interrupt_between() as raise_if_interrupted:
                self._give()
                while self._running or self._again or self._later or not self.cutter.is_empty:
                    self._take()
                    self._end_late()
                    self._on_turn()
                    raise_if_interrupted()
                    self._give()
        finally:
            try:
                self._record()
            finally:
                for pool in self.pools:
                    pool.close()

    # ---- giving

    def _give(self) -> None:
        """Give units to pools that have room."""
        now = self._clock()
        self._again.extend(unit for due, unit in self._later if due <= now)
        self._later = [own for own in self._later if own[0] > now]
        while (pool := self._free_pool()) is not None and (unit := self._next_unit(pool)) is not None:
            chunks = [chunk for chunk in unit.chunks if chunk.is_wanted]
            for chunk in unit.chunks:
                if not chunk.is_wanted:
                    self.missing.settle(chunk)
            unit.chunks, unit.pool, unit.age = chunks, pool, 0.0
            if chunks and not self._submit(unit, pool):
                return
            if unit.is_alone:
                return

    def _submit(self, unit: GivenUnit, pool: Pool) -> bool:
        """Give a unit to a pool; whether it took it."""
        try:
            future = pool.submit(self._unit_of(unit.chunks))
        except Exception as error:
            if not pool.is_lost(error):
                raise
            self._again.appendleft(unit)
            pool.restart()
            return False
        self._running[future], self._idle = unit, 0.0
        self.figures.names[pool.name] = None
        return True

    def _free_pool(self) -> Pool | None:
        if any(unit.is_alone for unit in self._running.values()):
            return None
        counts = [sum(unit.pool is pool for unit in self._running.values()) for pool in self.pools]
        free = [pool for pool, count in zip(self.pools, counts, strict=True) if count < pool.capacity]
        return free[0] if free else None

    def _next_unit(self, pool: Pool) -> GivenUnit | None:
        if self._again:
            if self._again[0].is_alone and self._running:
                return None
            return self._again.popleft()
        chunks = self.cutter.take(pool.device, sum(own.capacity for own in self.pools))
        return GivenUnit(chunks) if chunks else None

    # ---- taking

    def _take(self) -> None:
        """Take results of units that are made, and losses."""
        lost: list[tuple[GivenUnit, str]] = []
        for future in self._wait(list(self._running), WAIT):
            self._take_one(future, lost)
        for pool in {id(unit.pool): self._pool_of(unit) for unit, _ in lost}.values():
            pool.restart()
            for future, unit in list(self._running.items()):
                if pool.is_shared and unit.pool is pool:  # it has ended with the others
                    self._take_one(future, lost)
        for unit, why in lost:
            self._lose(unit, why)
        if self._clock() > self._recorded + HOLD or not self._running:
            self._record()

    def _take_one(self, future: Future[UnitResult], lost: list[tuple[GivenUnit, str]]) -> None:
        """Take one unit's result, or add it to those that are lost."""
        unit = self._running.pop(future)
        pool = self._pool_of(unit)
        try:
            result = future.result(timeout=0)
        except Exception as error:
            if not pool.is_lost(error) and future.done():
                raise SweepError(f"{pool.name} cannot make units: {type(error).__name__}: {text_of(error)}") from error
            lost.append((unit, death_reason(error)))
            return
        self._settle(unit, result)

    def _pool_of(self, unit: GivenUnit) -> Pool:
        if unit.pool is None:
            raise RuntimeError("a unit that was not given has a result")
        return unit.pool

    def _settle(self, unit: GivenUnit, result: UnitResult) -> None:
        """Do about a result what the module's table has."""
        if result.refusal is not None:
            raise SweepError(f"{self._pool_of(unit).name}: {result.refusal}")
        for text in result.warnings:
            self.figures.note(text)
        self.figures.units += 1
        if result.is_unnamed and len(unit.chunks) > 1:
            self._give_again(unit.chunks)
            return
        self._held.append(result)
        self.figures.poses += result.pose_count
        failed = {own.place: own for own in result.failed}
        if failed:
            self._record()  # giving up asks the store
        for place, chunk in enumerate(unit.chunks):
            if place in failed:
                self._fail(chunk, failed[place])
            else:
                self.missing.settle(chunk)
        if len(failed) < len(unit.chunks):
            self._system_failures.clear()
            self.cutter.learn(unit.chunks[0].family, result.pose_count, result.seconds)

    def _fail(self, chunk: PendingChunk, failed: FailedChunk) -> None:
        if not failed.is_transient:
            self.missing.give_up(chunk, failed.message)
            return
        self._system_failures.add(id(chunk))
        if len(self._system_failures) >= SYSTEM_FAILURES:
            raise SweepError(f"nothing can be written or read any more: {failed.message}")
        chunk.tries += 1
        if chunk.tries == SYSTEM_TRIES:
            self.missing.give_up(chunk, failed.message)
            return
        self._later.append((self._clock() + SYSTEM_WAIT * 2 ** (chunk.tries - 1), GivenUnit([chunk])))
        self.figures.retries += 1

    def _give_again(self, chunks: Collection[PendingChunk], *, alone: bool = False) -> None:
        """Have chunks made again, each in a unit of its own."""
        self._again.extend(GivenUnit([chunk], is_alone=alone) for chunk in chunks)
        self.figures.retries += len(chunks)

    def _lose(self, unit: GivenUnit, why: str) -> None:
        """A unit whose worker died."""
        pool = self._pool_of(unit)
        self.figures.workers_lost += 1
        self.figures.note(f"a worker of {pool.name} died: {why}")
        if not unit.is_alone:
            self._again.append(GivenUnit(unit.chunks, is_alone=True))
            self.figures.retries += 1
        elif len(unit.chunks) > 1:
            self._give_again(unit.chunks, alone=True)
        else:
            (chunk,) = unit.chunks
            chunk.deaths += 1
            if chunk.deaths >= TRIES:
                self.missing.give_up(chunk, f"{chunk.title}: the worker that made it died: {why}")
            else:
                self._give_again([chunk], alone=True)

    def _record(self) -> None:
        """Have results on the disk, in one transaction."""
        self._recorded = self._clock()
        results, self._held = self._held, []
        rows = [row for result in results for row in result.rows]
        if rows:
            self.figures.rows += self._store.add(rows, dict(pair for result in results for pair in result.files))

    # ---- watching

    def _end_late(self) -> None:
        """End units that take too long."""
        now = self._clock()
        step, self._turned = min(STEP_LONGEST, now - self._turned), now
        for unit in self._running.values():
            unit.age += step if self._pool_of(unit).is_ready else 0.0
        is_idle = not self._running and not self._later
        self._idle = self._idle + step if is_idle else 0.0
        if self._idle > (self._limit or UNIT_SECONDS):
            names = ", ".join(pool.name for pool in self.pools)
            raise SweepError(f"{names}: there has been no worker for {self._idle:.0f} s; what was made is kept")
        for future, unit in list(self._running.items()):
            if self._limit and unit.age > self._limit and future in self._running and not future.done():
                self._end(future, unit, self._pool_of(unit))

    def _end(self, future: Future[UnitResult], unit: GivenUnit, pool: Pool) -> None:
        """End a unit that takes too long."""
        ended = pool.end(future)
        del self._running[future]
        if ended is Ended.NOWHERE:
            unit.strays += 1
            if unit.strays >= TRIES and not any(own.pool is pool for own in self._running.values()):
                raise SweepError(
                    f"a unit was given to {pool.name} {unit.strays} times, and no worker of it has begun: is any "
                    "worker left? What was made is kept"
                )
            self._again.append(unit)
            return
        why = f"it took longer than the {self._limit:g} s that a unit may take (unit_timeout): {ended.value}"
        self.figures.workers_lost += 1
        self.figures.note(f"{pool.name}: a unit was ended, as {why}")
        if len(unit.chunks) == 1:
            self.missing.give_up(unit.chunks[0], f"{unit.chunks[0].title}: {why}")
        else:
            self._give_again(unit.chunks)
        if pool.is_shared:
            for other, own in list(self._running.items()):
                if own.pool is pool and not (other.done() and other.exception() is None):
                    del self._running[other]
                    self._again.append(GivenUnit(own.chunks, own.is_alone))
        if all(own.is_spent for own in self.pools):
            raise SweepError(f"{pool.name} has no worker left that can be used: all take longer than the limit")


def death_reason(error: BaseException) -> str:
    """The reason why a worker died, by an executor's error; loky names the exit codes of all that died at a time."""
    if isinstance(error, CancelledError):
        return "it left the cluster"
    text = " ".join(text_of(error).split()) or type(error).__name__
    codes = re.search(r"exit codes of the workers are \{(.+?)\}", text)
    return text if codes is None else f"it ended with {codes[1]}"
