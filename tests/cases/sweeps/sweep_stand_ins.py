"""Stand-ins for recipes, a store and workers on a simulated clock, where only a sweep's bookkeeping is tested."""

import json
from concurrent.futures import BrokenExecutor, Future
from dataclasses import dataclass

from palpate.datasets.sweeps.result_row import ResultRow
from palpate.render.sweeps.make.unit import CHUNK_POSES, FailedChunk, Unit, UnitResult
from palpate.render.sweeps.plan.recipe import GROUPS
from palpate.render.sweeps.run.executors import Ended

CODE = "code 1"
BAD = ("raises", "crashes", "hangs", "ends-the-unit")
"""Objects, or motions, whose stand-ins misbehave; the system fails once for "flickers"."""


@dataclass(frozen=True)
class StandIn:
    """A recipe by words: one for each of its parts."""

    thing: str = "cube"
    motion: str = "1"
    sampling: str = "stm"
    array: str = "emulator"
    poses: int = 1000

    def digest(self, names):
        words = {"thing": self.thing, "motion": f"{self.motion}x{self.poses}", "sampling": self.sampling}
        return "/".join({"array": self.array, **words}.get(name, "-") for name in names)

    def key(self, group):
        return self.digest(GROUPS[group])

    @property
    def hash(self):
        return self.digest(GROUPS["keep-drives"])

    @property
    def title(self):
        return f"{self.thing} {self.motion}x{self.poses} {self.sampling} {self.array}"

    def to_json(self):
        return json.dumps(vars(self))

    @classmethod
    def of(cls, chunk):
        return cls(**json.loads(chunk.recipe))


def count_poses(recipe):
    return recipe.poses


def rows_wanted(recipe, group):
    """(group, key, chunk) of all that a group of a recipe has."""
    count = -(-recipe.poses // CHUNK_POSES) if group in ("contours", "frequency", "poses") else 1
    return [(group, recipe.key(group), number) for number in range(count)]


class Memory:
    """What a store holds, and how often each result was made."""

    def __init__(self):
        self.rows = {}

    def done(self, keys):
        found = {key: set() for key in keys}
        for group, key, number in self.rows:
            if (group, key) in found:
                found[group, key].add(number)
        return found

    def add(self, rows, files):
        assert not files
        before = len(self.rows)
        for row in rows:
            place = row.group, row.key, row.chunk
            self.rows[place] = self.rows.get(place, 0) + 1
        return len(self.rows) - before


class Workers:
    """A pool of simulated workers: a unit takes a second for each chunk, unless its object misbehaves.

    kind: "processes", where one death ends all, "cluster", where a worker is ended and comes back, or "other", where
    none can be ended.
    """

    def __init__(self, count, kind="processes", device="cpu"):
        self.kind, self.device, self.name = kind, device, f"{count} simulated"
        self.is_shared, self.is_ready, self.capacity = kind == "processes", True, count
        self.now, self.units, self.most, self.restarts, self.is_closed = 0.0, {}, 0, 0, False
        self.flickered = set()

    @property
    def is_spent(self):
        return self.capacity < 1

    def clock(self):
        return self.now

    def submit(self, unit):
        future = Future()
        future.set_running_or_notify_cancel()
        self.units[future] = unit, self.now
        self.most = max(self.most, len(self.units))
        return future

    def wait(self, futures, timeout):
        """See `unit_loop.Wait`: the clock goes on until a unit ends."""
        ends = {future: own for future, own in ((f, self._end(*self.units[f])) for f in self.units) if own is not None}
        self.now = min([self.now + timeout, *(max(end, self.now) for end in ends.values())])
        for future, end in list(ends.items()):
            if end <= self.now and future in self.units:
                self._resolve(future)
        return [future for future in futures if future.done()]

    @staticmethod
    def _things(unit):
        recipes = [StandIn.of(chunk) for chunk in unit.chunks]
        return [own.motion if own.motion in BAD else own.thing for own in recipes]

    def _end(self, unit, begun):
        """When a unit ends; None if it never does."""
        things = self._things(unit)
        seconds = 0.0
        for thing in things:
            seconds += 1.0
            if thing == "hangs":
                return None
            if thing == "crashes":
                break
        return begun + seconds

    def _resolve(self, future):
        unit, _ = self.units.pop(future)
        if "crashes" in self._things(unit):
            future.set_exception(BrokenExecutor("it crashed"))
            if self.is_shared:
                for other in list(self.units):
                    del self.units[other]
                    other.set_exception(BrokenExecutor("it crashed"))
        else:
            future.set_result(self._made(unit))

    def _made(self, unit: Unit):
        recipes = [StandIn.of(chunk) for chunk in unit.chunks]
        if any(recipe.thing == "ends-the-unit" for recipe in recipes):
            failed = tuple(FailedChunk(place, "no chunk is named") for place, _ in enumerate(recipes))
            return UnitResult(failed=failed, is_unnamed=True)
        rows, failed = [], []
        for place, (chunk, recipe) in enumerate(zip(unit.chunks, recipes, strict=True)):
            if recipe.thing == "raises":
                failed.append(FailedChunk(place, "this stage fails"))
            elif recipe.thing == "flickers" and recipe not in self.flickered:
                self.flickered.add(recipe)
                failed.append(FailedChunk(place, "the disk is full", is_transient=True))
            elif recipe.thing == "full":
                failed.append(FailedChunk(place, "the disk is full", is_transient=True))
            else:
                rows += [ResultRow.of(CODE, group, recipe.key(group), chunk.number, {}) for group in chunk.groups]
        return UnitResult(tuple(rows), failed=tuple(failed), pose_count=1000, seconds=1.0)

    def is_lost(self, error):
        return isinstance(error, BrokenExecutor)

    def end(self, future):
        if self.units.pop(future, None) is None:
            return Ended.NOWHERE
        if self.kind == "other":
            self.capacity -= 1
            return Ended.STUCK
        if self.is_shared:
            self.units.clear()
        return Ended.LOST

    def restart(self):
        self.restarts += 1

    def close(self):
        self.is_closed = True
