"""Which tasks a sweep's workers are given, one after another, and what follows from each outcome.

| outcome of a task                           | what follows                                                           |
|---------------------------------------------|------------------------------------------------------------------------|
| chunks are made                             | they are settled; their speed sizes the next tasks                     |
| chunks are left, as the task's time is over | they are given out again                                               |
| a chunk failed, and is named                | it is given up by name: the same error would come again                |
| a chunk failed as the system failed         | it is given out again, later; `WRITES_FAILED` in a row end the sweep   |
| an error that names no chunk                | the chunks again, each alone; one that was alone is given up           |
| the worker died                             | suspects again, each alone; a suspect that was alone `TRIES` times is  |
|                                             | given up; all others again                                             |
| the worker was ended: late, too much memory | the same, but a suspect that was alone is given up at once             |

Suspects are the chunks that the worker was making, or all of the task if that is not known. A task is ended when its
worker has used `timeout` seconds of processor time since its last sign of progress, or more than `memory` bytes. A
worker that sleeps or waits uses none: it is ended after WAITING_FACTOR times as long on the wall. So a busy machine
loses nothing.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from ...errors import SweepError
from ..make.task import FailedChunk, Outcome, Running, Task
from .limits import WAITING_FACTOR
from .missing import Missing, PendingChunk, ResultKey

SECONDS = {"cpu": 2.0, "cuda": 3.0}  # of a task: long beside handing it over, short beside what a kill may lose
RATE_FIRST = {"cpu": 1e4, "cuda": 2e6}  # [pose/s] until an outcome has come: a small mesh, with its loading
BLEND = 0.5  # weight of the last task in a family's rate
START_SECONDS = 3.0  # of work for each worker that is started: starting one takes 1 to 2 s
SHORTEST = 0.2  # [s] of a task, however little is left: what is shared among workers
OVERTIME = 2.0  # times its planned length, a task begins no further chunk
FAMILIES_SHARED = 256  # with more families left than that, tasks are not made shorter towards the end
AHEAD = 4  # times what all workers make in the length of a task: recipes are read until so much is known
TRIES = 2  # workers that may die while they make a chunk alone
WRITES_FAILED = 12  # one after another without a success: nothing can be written any more
HOLD_FIRST, HOLD_LONGEST = 0.25, 8.0  # [s] before tasks are given out again after a failed write


class Rates:
    """Poses a second of one worker, by family. kind: of the workers' devices, "cpu" or "cuda"."""

    def __init__(self, kind: str) -> None:
        self._first = RATE_FIRST[kind]
        self._known: dict[str, float] = {}
        self._poses, self._seconds = 0.0, 0.0

    def set_first(self, rate: float) -> None:
        """Suppose a rate [pose/s] until an outcome has come."""
        self._first = rate

    def rate(self, family: str) -> float:
        """Of a family: measured, or that of all others on average, or supposed."""
        if family in self._known:
            return self._known[family]
        return self._poses / self._seconds if self._seconds > 0.0 else self._first

    def seconds(self, poses: Mapping[str, int]) -> float:
        """What so many poses of each family take."""
        return sum(count / self.rate(family) for family, count in poses.items())

    def learn(self, poses: Mapping[str, int], seconds: float) -> None:
        """Take note of a task: its time is shared among families as expected."""
        expected = self.seconds(poses)
        if not (seconds > 0.0 and expected > 0.0):
            return
        for family in poses:
            rate = self.rate(family) * expected / seconds
            known = self._known.get(family, rate)
            self._known[family] = 1.0 / ((1.0 - BLEND) / known + BLEND / rate)
        self._poses += sum(poses.values())
        self._seconds += seconds


@dataclass(eq=False)
class GivenTask:
    """A task that a worker has."""

    chunks: tuple[PendingChunk, ...]
    expected: float
    """Seconds."""
    reason: str | None = None
    """Why its worker was ended."""


def poses_of(chunks: Iterable[PendingChunk]) -> Counter[str]:
    """Poses to be rendered, by family; those of one place count once."""
    places = {chunk.place: chunk.pose_count for chunk in chunks}
    out: Counter[str] = Counter()
    for (family, _, _), count in places.items():
        out[family] += count
    return out


class Schedule:
    """Cuts what is missing into tasks.

    store: folder as workers see it. run: names the run's tasks, unique in a store. code: SHA-256 of the files of code
    that workers may run. user_metrics: their sources, by group. timeout [s], memory [byte]: see the module; 0 is no
    bound. takes: claims a bucket of chunks for this parent, False if another has it. has_company: whether other parents
    have been at work. shard (k, n): only chunks whose bucket number is k modulo n are made. Times are seconds of any
    one clock.
    """

    def __init__(
        self,
        missing: Missing,
        *,
        store: str,
        run: str,
        code: frozenset[str] = frozenset(),
        user_metrics: Mapping[str, str] | None = None,
        timeout: float = 0.0,
        memory: int = 0,
        takes: Callable[[str], bool] = lambda bucket: True,
        has_company: Callable[[], bool] = lambda: False,
        shard: tuple[int, int] = (0, 1),
    ) -> None:
        self.missing, self.rates = missing, Rates("cpu")
        self.worker_count = 1
        """May change as workers come and go."""
        self._seconds = SECONDS["cpu"]
        self._store, self._run, self._code = store, run, code
        self._user_metrics = tuple((user_metrics or {}).items())
        self._timeout, self._memory = timeout, memory
        self._takes, self._has_company, self._shard = takes, has_company, shard
        self._taken: set[str] = set()
        self._elsewhere: list[PendingChunk] = []
        self._given: dict[int, GivenTask] = {}
        self._waiting: deque[PendingChunk] = deque()
        self._left: Counter[str] = Counter()  # poses that wait, by family
        self._alone: deque[tuple[PendingChunk, ...]] = deque()
        self._number = 0
        self._held_until = 0.0
        self._writes_failed = 0
        self.retried = 0
        """Tasks given out because of an earlier one that went wrong."""

    @property
    def is_done(self) -> bool:
        """Whether everything is made or given up."""
        return self.missing.is_exhausted and not self._waiting and not self._alone and not self._busy

    @property
    def _busy(self) -> bool:
        """Whether outcomes are to come, of this parent's workers or of another parent."""
        return bool(self._given or self._elsewhere)

    @property
    def given_numbers(self) -> tuple[int, ...]:
        """Tasks that were given to workers and of which no outcome has come."""
        return tuple(self._given)

    @property
    def has_work(self) -> bool:
        """Whether any chunk waits."""
        return bool(self._waiting or self._alone)

    def seconds_left(self) -> float:
        """What is not made yet, for one worker, as far as recipes were read."""
        return self.seconds_waiting() + sum(given.expected for given in self._given.values())

    def seconds_waiting(self) -> float:
        """What no worker has yet, for one worker, as far as recipes were read."""
        alone = sum(self.rates.seconds(poses_of(chunks)) for chunks in self._alone)
        return self.rates.seconds(self._left) + alone

    def set_kind(self, kind: str) -> None:
        """Cut tasks for workers of a kind of device, "cpu" or "cuda"."""
        self._seconds = SECONDS[kind]
        self.rates.set_first(RATE_FIRST[kind])

    # ---- giving out

    def read(self) -> None:
        """Read recipes until enough is known to be missing."""
        enough = AHEAD * self.worker_count * self._seconds
        while not self.missing.is_exhausted and self.rates.seconds(self._left) < enough:
            self._put(self.missing.read())

    def _put(self, chunks: Sequence[PendingChunk]) -> None:
        """Have chunks wait, those of one bucket together; those of other shards are nobody's here."""
        number, count = self._shard
        own = [chunk for chunk in chunks if chunk.bucket_number % count == number]
        for chunk in chunks if count > 1 else ():
            if chunk.bucket_number % count != number:
                self.missing.leave(chunk)
        places = {family: k for k, family in enumerate(dict.fromkeys(chunk.family for chunk in own))}
        own.sort(key=lambda chunk: (places[chunk.family], chunk.bucket))
        self._waiting.extend(own)
        self._left.update(poses_of(own))

    def next_task(self, now: float) -> Task | None:
        """What a free worker should be given; None if nothing waits, or nothing can be written for a while."""
        if now < self._held_until:
            return None
        while True:
            self.read()
            chunks = self._alone.popleft() if self._alone else self._cut()
            if not chunks:
                return None
            if wanted := self._wanted(chunks):
                return self._give(wanted)

    def _wanted(self, chunks: Iterable[PendingChunk]) -> tuple[PendingChunk, ...]:
        """Chunks without those of which every result has failed meanwhile."""
        out = []
        for chunk in chunks:
            if chunk.is_wanted:
                out.append(chunk)
            else:
                self.missing.settle(chunk)
        return tuple(out)

    def _cut(self) -> tuple[PendingChunk, ...]:
        """Chunks for one task, from the front; those of one place stay together."""
        limit, elsewhere = self._limit(), len(self._elsewhere)
        chunks: list[PendingChunk] = []
        places = set()
        seconds = 0.0
        while self._waiting:
            chunk = self._waiting[0]
            if not self._takes(chunk.bucket):
                self._elsewhere.append(self._waiting.popleft())
                continue
            if chunk.bucket not in self._taken:
                self._taken.add(chunk.bucket)
                if self._has_company():
                    self._settle_made(chunk.bucket)
                    continue
            if chunk.place not in places:
                own = chunk.pose_count / self.rates.rate(chunk.family)
                if chunks and seconds + own > limit:
                    break
                places.add(chunk.place)
                seconds += own
            chunks.append(self._waiting.popleft())
        for family, count in poses_of([*chunks, *self._elsewhere[elsewhere:]]).items():
            self._left[family] -= count
            if self._left[family] <= 0:
                del self._left[family]
        return tuple(chunks)

    def _settle_made(self, bucket: str) -> None:
        """Settle chunks at the front that another parent made before it gave its claim up."""
        chunks = []
        while self._waiting and self._waiting[0].bucket == bucket:
            chunks.append(self._waiting.popleft())
        there = self.missing.there([result.key for chunk in chunks for result in chunk.results])
        left = [chunk for chunk in chunks if not chunk.is_in(there)]
        for chunk in chunks:
            if chunk.is_in(there):
                self.missing.settle(chunk)
        self._waiting.extendleft(reversed(left))
        self._left.subtract(poses_of(chunk for chunk in chunks if chunk.is_in(there)))

    def _limit(self) -> float:
        """Length of the next task [s]: towards the end so short that all workers end together."""
        is_last = self.missing.is_exhausted and len(self._left) <= FAMILIES_SHARED
        if not is_last or self.worker_count == 1:
            return self._seconds
        return min(self._seconds, max(SHORTEST, self.rates.seconds(self._left) / (2 * self.worker_count)))

    def _give(self, chunks: tuple[PendingChunk, ...]) -> Task:
        number = self._number
        self._number += 1
        self._given[number] = GivenTask(chunks, self.rates.seconds(poses_of(chunks)))
        name = f"{self._run}-{number:06d}"
        wire = tuple(chunk.chunk for chunk in chunks)
        return Task(number, wire, self._store, name, self._code, self._user_metrics, OVERTIME * self._seconds)

    # ---- what other parents make

    def elsewhere_keys(self) -> list[ResultKey]:
        """Results of chunks that other parents make."""
        return list(dict.fromkeys(result.key for chunk in self._elsewhere for result in chunk.results))

    def look_elsewhere(self, there: Mapping[ResultKey, set[int]]) -> None:
        """Settle chunks that other parents have made, and take over those of parents that are gone.

        there: which chunks of `elsewhere_keys` the store has.
        """
        chunks, self._elsewhere = self._elsewhere, []
        again = []
        for chunk in chunks:
            if chunk.is_in(there):
                self.missing.settle(chunk)
            elif self._takes(chunk.bucket):
                again.append(chunk)
            else:
                self._elsewhere.append(chunk)
        self._put(again)

    # ---- taking back

    def settle(self, outcome: Outcome, now: float) -> None:
        """Do about an outcome what the module's table has; raises SweepError if nothing can be written any more."""
        given = self._given.pop(outcome.number, None)
        if given is None:
            return
        if outcome.is_lost:
            self._retry_lost(given, outcome)
            return
        failed = {own.place: own for own in outcome.failed}
        if outcome.error is not None and not failed and not outcome.left:
            failed = {place: FailedChunk(place, outcome.error) for place, _ in enumerate(given.chunks)}
            if len(given.chunks) > 1:
                self._give_alone(given.chunks)
                return
        made, left = [], []
        for place, chunk in enumerate(given.chunks):
            if place in outcome.left:
                left.append(chunk)
            elif place not in failed:
                made.append(chunk)
                self.missing.settle(chunk)
        if made:
            self._writes_failed = 0
            self.rates.learn(poses_of(made), outcome.seconds)
        self._put(left)
        self._take_failed([(given.chunks[place], own) for place, own in failed.items()], outcome, now)

    def _take_failed(self, failed: Sequence[tuple[PendingChunk, FailedChunk]], outcome: Outcome, now: float) -> None:
        again = [chunk for chunk, own in failed if own.is_transient]
        for chunk, own in failed:
            if not own.is_transient:
                self.missing.give_up(chunk, own.message)
        if again:
            self._writes_failed += 1
            if self._writes_failed >= WRITES_FAILED:
                raise SweepError(f"nothing can be written any more: {outcome.worker}: {outcome.error}")
            self._held_until = now + min(HOLD_LONGEST, HOLD_FIRST * 2 ** (self._writes_failed - 1))
            self._alone.append(tuple(again))
            self.retried += 1

    def _retry_lost(self, given: GivenTask, outcome: Outcome) -> None:
        """A task whose worker died or was ended."""
        places = range(len(given.chunks)) if outcome.suspects is None else outcome.suspects
        suspects = [chunk for place, chunk in enumerate(given.chunks) if place in places]
        others = [chunk for place, chunk in enumerate(given.chunks) if place not in places]
        if others:
            self._alone.append(tuple(others))
            self.retried += 1
        if len(suspects) > 1:
            self._give_alone(suspects)
            return
        for chunk in suspects:
            chunk.failure_count += 1
            if given.reason is not None or chunk.failure_count >= TRIES:
                self.missing.give_up(chunk, given.reason or outcome.error or "its worker died")
            else:
                self._give_alone([chunk])

    def _give_alone(self, chunks: Iterable[PendingChunk]) -> None:
        for chunk in chunks:
            self._alone.append((chunk,))
            self.retried += 1

    # ---- watching

    def overdue(self, running: Mapping[int, Running]) -> dict[int, str]:
        """Tasks that are to be ended, each with the reason."""
        out = {}
        for number, own in running.items():
            given = self._given.get(number)
            if given is None or given.reason is not None:
                continue
            if self._memory and own.memory > self._memory:
                given.reason = (
                    f"its worker used {own.memory / 1e9:.3g} GB of memory, more than the limit of "
                    f"{self._memory / 1e9:.3g} GB for a worker"
                )
            elif self._timeout and own.idle_seconds > self._timeout:
                given.reason = (
                    f"its worker showed no progress in {own.idle_seconds:.0f} s of processor time, more than the limit "
                    f"of {self._timeout:.0f} s for a task"
                )
            elif self._timeout and own.waiting_seconds > WAITING_FACTOR * self._timeout:
                given.reason = (
                    f"its worker showed no progress in {own.waiting_seconds:.0f} s on the wall, more than "
                    f"{WAITING_FACTOR:.0f} times the limit of {self._timeout:.0f} s for a task: it sleeps, or waits "
                    "for a lock, a file or a network"
                )
            if given.reason is not None:
                out[number] = given.reason
        return out


def device_kind(devices: Iterable[str]) -> str:
    """What tasks are cut for: "cuda" if every worker has a GPU, else "cpu"."""
    names = list(devices)
    return "cuda" if names and all(device.startswith("cuda") for device in names) else "cpu"
