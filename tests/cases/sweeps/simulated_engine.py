"""Workers on a simulated clock, whose chunks do what the recipe's object is called, and a plan of such recipes.

| object | a chunk of it |
|---|---|
| fast, s3, s8, s30 | takes 0.05, 3, 8, 30 s of processor time without a sign of progress |
| raise | fails with an error |
| crash | ends its worker after a second |
| endless | computes for ever |
| asleep | waits for ever, without using processor time |
| hog | takes 1 GB of memory more each second |
"""

import math
from dataclasses import dataclass, field

from sweep_stand_ins import StandIn, rows_of

from palpate.datasets.sweeps.shard import ShardRow, write_shard
from palpate.render.sweeps.make.task import FailedChunk, Outcome, Running, Task

MAKER = "test"
SECONDS = {"fast": 0.05, "s3": 3.0, "s8": 8.0, "s30": 30.0, "raise": 0.1, "crash": 1.0, "hog": 1e9}
SECONDS |= {"endless": math.inf, "asleep": math.inf}


@dataclass
class StandInPlan:
    wanted: list
    groups: tuple = ("contours", "frequency")
    name: str = "plan"

    @property
    def granted(self):
        return frozenset()

    @property
    def user_metrics(self):
        return {}

    @property
    def recipe_count(self):
        return len(self.wanted)

    def recipes(self):
        return iter(self.wanted)


@dataclass
class SimulatedWorker:
    ready_at: float
    task: Task | None = None
    place: int = 0
    began: float = 0.0
    chunk_began: float = 0.0
    done: list = field(default_factory=list)
    failed: list = field(default_factory=list)


class SimulatedEngine:
    """An Engine. kind: "processes" or "dask", which differ in how soon deaths are known and workers replaced.

    share: of a core that each worker gets: the host is busy. The clock moves in `wait` only.
    """

    def __init__(self, worker_count, kind="processes", share=1.0):
        self.name = f"simulated {kind}"
        self.worker_most, self.kind, self.share = worker_count, kind, share
        self.start_seconds = {"processes": 1.5, "dask": 5.0}[kind]  # of a worker
        self.notice_seconds = {"processes": 0.0, "dask": 2.0}[kind]  # until a death is known
        self.now, self.workers, self.coming, self.store = 0.0, [], [], None
        self.ended, self.task_count, self.most_workers = [], 0, 0

    def clock(self):
        return self.now

    def start(self, store):
        self.store = store
        self.workers.append(SimulatedWorker(self.now + self.start_seconds))
        self.grow(self.worker_most if self.kind == "dask" else 1)

    def grow(self, worker_count):
        while len(self.workers) < min(worker_count, self.worker_most):
            self.workers.append(SimulatedWorker(self.now + self.start_seconds))

    def _ready(self):
        return [worker for worker in self.workers if worker.ready_at <= self.now]

    @property
    def devices(self):
        return ("cpu",) * len(self._ready())

    def free_count(self):
        return sum(worker.task is None for worker in self._ready())

    def submit(self, task):
        worker = next(worker for worker in self._ready() if worker.task is None)
        self.task_count += 1
        self.most_workers = max(self.most_workers, len(self.workers))
        worker.task, worker.place, worker.done, worker.failed = task, 0, [], []
        worker.began = worker.chunk_began = self.now

    def _seconds(self, worker):
        return SECONDS[StandIn.of(worker.task.chunks[worker.place]).thing] / self.share

    def wait(self, timeout):
        until = self.now + timeout
        while not self._due() and self.now < until:
            events = [worker.chunk_began + self._seconds(worker) for worker in self.workers if worker.task]
            events += [worker.ready_at for worker in self.workers if worker.ready_at > self.now]
            events += [at for at, _ in self.coming]
            self.now = min([until, *(at for at in events if at > self.now)])
            for worker in self.workers:
                self._advance(worker)
            if self.free_count():
                break
        due = self._due()
        self.coming = [pair for pair in self.coming if pair[0] > self.now]
        return due

    def _due(self):
        return [outcome for at, outcome in self.coming if at <= self.now]

    def _advance(self, worker):
        while worker.task and worker.chunk_began + self._seconds(worker) <= self.now:
            thing = StandIn.of(worker.task.chunks[worker.place]).thing
            if thing == "crash":
                self._lose(worker, "was killed by signal 11")
                return
            if thing == "raise":
                worker.failed.append(FailedChunk(worker.place, "it cannot be made"))
            else:
                worker.done.append(worker.place)
            worker.chunk_began += self._seconds(worker)
            worker.place += 1
            is_over = worker.chunk_began - worker.began > worker.task.seconds
            if is_over or worker.place == len(worker.task.chunks):
                self._finish(worker)

    def _finish(self, worker):
        task, worker.task = worker.task, None
        left = tuple(range(worker.place, len(task.chunks)))
        rows = [ShardRow(*row, {"poses": 1}) for place in worker.done for row in rows_of(task.chunks[place])]
        name = f"shards/{task.name}.h5" if rows else None
        if rows:
            write_shard(self.store / name, rows, maker=MAKER)
        error = "it cannot be made" if worker.failed else None
        seconds = self.now - worker.began
        poses = sum(StandIn.of(task.chunks[place]).poses for place in worker.done)
        self.coming.append(
            (
                self.now,
                Outcome(
                    task.number, "w", name, len(rows), poses, seconds, error, failed=tuple(worker.failed), left=left
                ),
            )
        )

    def _lose(self, worker, reason):
        task = worker.task
        known = (worker.place,) if self.now - worker.began > 0.5 else (() if self.kind == "processes" else None)
        lost = Outcome(task.number, "w", error=f"worker {reason}", is_lost=True, suspects=known)
        self.coming.append((self.now + self.notice_seconds, lost))
        worker.task = None
        worker.ready_at = self.now + self.notice_seconds + self.start_seconds

    def running(self):
        out = {}
        for worker in self.workers:
            if worker.task:
                wall = self.now - worker.chunk_began
                thing = StandIn.of(worker.task.chunks[worker.place]).thing
                used = 0.0 if thing == "asleep" else wall * self.share
                memory = int(wall * self.share * 1e9) if thing == "hog" else 10**8
                out[worker.task.number] = Running(self.now - worker.began, used, memory, waiting_seconds=wall)
        return out

    def drop(self, number, reason):
        for worker in self.workers:
            if worker.task and worker.task.number == number:
                self.ended.append(reason)
                self._lose(worker, f"was ended: {reason}")

    def close(self):
        self.workers.clear()
