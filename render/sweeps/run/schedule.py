"""Which tasks a sweep's workers are given, one after another, and what is done about those that go wrong.

| what came of a task                      | what is done                                                              |
|------------------------------------------|----------------------------------------------------------------------------|
| all of it                                | its poses a second size the next ones                                     |
| some pieces failed, and are named        | these again, each alone; the rest is done                                 |
| an error that names no piece             | all again, each piece alone                                               |
| its worker died, or it took far too long | all again, each rendering alone; one that was alone, in two halves        |
| its worker could not write               | the same again, later; again and again without success: the sweep stops   |
| one piece failed `TRIES` times           | given up by name; the rest goes on                                        |

A copy of a task that takes long is given to a worker that has nothing left to do: the first to end counts, since both
leave the same.
"""

from __future__ import annotations

import errno
import os
from collections import Counter, deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from ...errors import SweepError
from ..make.task import PART, Outcome, Piece, Task
from .missing import Missing, Stretch, Want
from .pace import Pace

AHEAD = 2  # tasks under way or submitted, a worker
CHUNKS_AHEAD = 4  # times what all workers make in one target time: recipes are read until so much is known
TRIES = 2  # of a piece alone
LATE_SECONDS, LATE_FACTOR = 60.0, 10.0  # a task that has run for longer than both is dropped
COPY_SECONDS, COPY_FACTOR = 5.0, 2.0  # one that has run for longer than both is worth a copy
FAMILIES_SHARED = 256  # with more families left than that, tasks are not made shorter towards the end
WRITES_FAILED = 12  # one after another without a success: nobody can write any more
HOLD_FIRST, HOLD_LONGEST = 0.25, 8.0  # [s] before tasks are given out again after a failed write
STORAGE_SENTENCES = tuple(os.strerror(code) for code in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS))


@dataclass(eq=False)
class Unit:
    """Parts of one rendering, for some of those who want them."""

    stretch: Stretch
    wants: tuple[Want, ...]
    first: int
    stop: int
    failures: int = 0
    """Times that it was known to have failed, or lost a worker, alone."""

    @property
    def poses(self) -> int:
        """To be rendered."""
        return self.stretch.poses(self.first, self.stop)

    def parted(self, failures: int) -> list[Unit]:
        """Each piece by itself."""
        return [Unit(self.stretch, (want,), self.first, self.stop, failures) for want in self.wants]

    def halved(self, failures: int) -> list[Unit]:
        """Two with half the parts each; one, if there is only one part."""
        middle = (self.first + self.stop) // 2
        ranges = ((self.first, middle), (middle, self.stop))
        return [Unit(self.stretch, self.wants, first, stop, failures) for first, stop in ranges if first < stop]


@dataclass(eq=False)
class Job:
    """A task, with its copies."""

    units: tuple[Unit, ...]
    expected: float
    """Seconds."""
    numbers: set[int] = field(default_factory=set)
    """Under way."""
    is_settled: bool = False

    @property
    def poses(self) -> Counter[str]:
        """To be rendered, by family."""
        count: Counter[str] = Counter()
        for unit in self.units:
            count[unit.stretch.family] += unit.poses
        return count

    def pieces(self) -> list[tuple[Unit, Want]]:
        """In the order of the task's."""
        return [(unit, want) for unit in self.units for want in unit.wants]


class Schedule:
    """Cuts what is missing into tasks. store: folder as workers see it; run: names the run's tasks, unique in a store.

    code: SHA-256 of the files of code that workers may run.

    Times are seconds of any one clock.
    """

    def __init__(
        self,
        missing: Missing,
        pace: Pace,
        *,
        worker_count: int,
        store: str,
        run: str,
        code: frozenset[str] = frozenset(),
    ) -> None:
        self.missing, self.pace = missing, pace
        self.worker_count = worker_count
        """May change as workers come and go."""
        self._store, self._run, self._code = store, run, code
        self._jobs: dict[int, Job] = {}
        self._again: deque[tuple[Unit, ...]] = deque()
        self._number = 0
        self._left: Counter[str] = Counter()  # poses not given out yet, by family
        for stretches in missing.stretches.values():
            self._note(stretches)
        self._held_until = 0.0
        self._writes_failed = 0
        self.retried = 0
        """Tasks given out again."""

    @property
    def is_done(self) -> bool:
        """Whether everything is made or given up."""
        return self.has_nothing_left and not self._jobs_open()

    @property
    def has_nothing_left(self) -> bool:
        """Whether everything is given out."""
        return not self._again and self.missing.is_exhausted and not self.missing.stretches

    def seconds_left(self) -> float:
        """What is not made yet, for one worker, as far as recipes were read."""
        waiting = sum(self.pace.seconds(Counter({unit.stretch.family: unit.poses})) for u in self._again for unit in u)
        under_way = sum(job.expected for job in self._jobs.values() if not job.is_settled)
        return self._cut_seconds() + waiting + under_way

    def _cut_seconds(self) -> float:
        return self.pace.seconds(self._left)

    def is_open(self, number: int) -> bool:
        """Whether anybody waits for a task's outcome."""
        return number in self._jobs and not self._jobs[number].is_settled

    # ---- giving out

    def next_task(self, now: float) -> Task | None:
        """What a worker should be given next; None if they have enough, or all is given out."""
        if now < self._held_until or len(self._jobs_open()) >= AHEAD * self.worker_count:
            return None
        units = self._again.popleft() if self._again else self._cut()
        if not units:
            return None
        job = Job(tuple(units), 0.0)
        job.expected = self.pace.seconds(job.poses)
        return self._given(job)

    def _jobs_open(self) -> list[Job]:
        return [job for job in self._jobs.values() if not job.is_settled]

    def _given(self, job: Job) -> Task:
        number = self._number
        self._number += 1
        job.numbers.add(number)
        self._jobs[number] = job
        pieces = tuple(Piece(want.recipe, want.groups, unit.first, unit.stop) for unit, want in job.pieces())
        return Task(number, pieces, self._store, f"{self._run}-{number:06d}", self._code)

    def _cut(self) -> list[Unit]:
        """Units for one task, from the front."""
        self._read_ahead()
        limit = self.pace.target
        if self.missing.is_exhausted and len(self.missing.stretches) <= FAMILIES_SHARED:
            limit = self.pace.share(self._cut_seconds(), self.worker_count)
        units: list[Unit] = []
        poses: Counter[str] = Counter()
        while self.missing.stretches:
            family = next(iter(self.missing.stretches))
            unit = self._cut_unit(family, poses, limit - self.pace.seconds(poses))
            if unit is None:
                break
            if unit.wants:
                units.append(unit)
                poses[family] += unit.poses
            if not self.missing.stretches:
                self._read_ahead()
        return units

    def _cut_unit(self, family: str, taken: Counter[str], seconds: float) -> Unit | None:
        """The next unit of a family, such that it takes at most so long; None if the task is full."""
        stretches = self.missing.stretches[family]
        stretch = stretches[0]
        room = min(int(seconds * self.pace.rate(family)), self.pace.room(family, taken))
        stop = min(stretch.stop, stretch.first + max(1, room // PART))
        if stretch.poses(stretch.first, stretch.stop) <= room:  # its last part may be small
            stop = stretch.stop
        if taken and stretch.poses(stretch.first, stop) > room:
            return None
        unit = Unit(stretch, tuple(want for want in stretch.wants if want.sentence is None), stretch.first, stop)
        if not unit.wants:  # given up meanwhile, all of it
            unit.stop = stretch.stop
        for want in stretch.wants:
            if want.sentence is not None:
                self.missing.settle(want, unit.stop - unit.first)
        self._left[family] -= unit.poses
        stretch.first = unit.stop
        if stretch.first == stretch.stop:
            stretches.popleft()
            if not stretches:
                del self.missing.stretches[family], self._left[family]
        return unit

    def _read_ahead(self) -> None:
        """Read recipes until enough is known to be missing."""
        enough = CHUNKS_AHEAD * self.worker_count * self.pace.target
        while not self.missing.is_exhausted and self._cut_seconds() < enough:
            self._note(self.missing.read())

    def _note(self, stretches: Iterable[Stretch]) -> None:
        for stretch in stretches:
            self._left[stretch.family] += stretch.poses(stretch.first, stretch.stop)

    # ---- taking back

    def settle(self, outcome: Outcome, now: float) -> list[int]:
        """Take note of an outcome; returns copies of the task that nobody needs any more.

        Raises SweepError if no worker can write any more.
        """
        job = self._jobs.pop(outcome.number, None)
        if job is None:
            return []
        job.numbers.discard(outcome.number)
        if job.is_settled:
            return []
        if outcome.error is None:
            self._writes_failed = 0
            self.pace.learn(job.poses, outcome.seconds)
            self._settle_all(job, {})
            return sorted(job.numbers)
        if job.numbers:  # a copy may do better
            return []
        self._retry(job, outcome, now)
        return []

    def _settle_all(self, job: Job, but: Mapping[int, str]) -> None:
        """Pieces are made, but for some by their place."""
        job.is_settled = True
        for place, (unit, want) in enumerate(job.pieces()):
            if place not in but:
                self.missing.settle(want, unit.stop - unit.first)

    def _retry(self, job: Job, outcome: Outcome, now: float) -> None:
        """Do about a task that went wrong what the table above says."""
        job.is_settled = True
        sentence = outcome.error or ""
        failed = dict(outcome.failed)
        if len(job.pieces()) == 1:
            failed = failed or {0: sentence}
        if outcome.is_lost:
            self._retry_lost(job, sentence)
        elif outcome.shard is None and any(told in sentence for told in STORAGE_SENTENCES):
            self._retry_later(job, outcome, now)
        elif failed:
            self._settle_all(job, failed)
            for place, (unit, want) in enumerate(job.pieces()):
                if place in failed:
                    alone = Unit(unit.stretch, (want,), unit.first, unit.stop, unit.failures + 1)
                    self._again_or_given_up([alone], failed[place])
        else:
            for unit in job.units:
                self._again_or_given_up(unit.parted(unit.failures), sentence)

    def _retry_lost(self, job: Job, sentence: str) -> None:
        """Tasks of many renderings are parted, those of one are halved."""
        is_alone = len(job.units) == 1
        for unit in job.units:
            parts = [unit]
            if is_alone:
                parts = (unit.parted if len(unit.wants) > 1 else unit.halved)(unit.failures + 1)
            self._again_or_given_up(parts, sentence)

    def _retry_later(self, job: Job, outcome: Outcome, now: float) -> None:
        self._writes_failed += 1
        if self._writes_failed >= WRITES_FAILED:
            raise SweepError(f"nothing can be written any more: {outcome.worker}: {outcome.error}")
        self._held_until = now + min(HOLD_LONGEST, HOLD_FIRST * 2 ** (self._writes_failed - 1))
        self._again.append(job.units)
        self.retried += 1

    def _again_or_given_up(self, units: list[Unit], sentence: str) -> None:
        for unit in units:
            if unit.failures < TRIES:
                self._again.append((unit,))
                self.retried += 1
                continue
            for want in unit.wants:
                self.missing.give_up(want, sentence)
                self.missing.settle(want, unit.stop - unit.first)

    # ---- watching

    def late(self, running: Mapping[int, float]) -> list[int]:
        """Tasks that have run for so long that they should be dropped; they get more time when they are made again.

        running: seconds, by number.
        """
        late = []
        for number, seconds in running.items():
            job = self._jobs.get(number)
            if job is not None and seconds > max(LATE_SECONDS, LATE_FACTOR * job.expected):
                late.append(number)
                self.pace.slow_down(job.poses, seconds)
        return late

    def copy_for_idle(self, running: Mapping[int, float]) -> tuple[Task, int] | None:
        """A copy of the task that has run for longest, and its number, if a worker has nothing else left to do."""
        if not self.has_nothing_left or len(running) >= self.worker_count or len(self._jobs) > len(running):
            return None
        long = [
            (seconds, number)
            for number, seconds in running.items()
            if number in self._jobs and len(self._jobs[number].numbers) == 1
            if seconds > max(COPY_SECONDS, COPY_FACTOR * self._jobs[number].expected)
        ]
        if not long:
            return None
        self.retried += 1
        number = max(long)[1]
        return self._given(self._jobs[number]), number
