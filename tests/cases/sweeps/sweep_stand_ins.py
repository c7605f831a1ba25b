"""What stands for recipes, a store's memory and workers where only a sweep's bookkeeping is tested."""

import json
from dataclasses import dataclass, field

from palpate.render.sweeps.make.task import CHUNK_POSES, Outcome
from palpate.render.sweeps.plan.recipe import GROUPS


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
    """(group, key, chunk number) of all that a group of a recipe has."""
    count = -(-recipe.poses // CHUNK_POSES) if group in ("contours", "frequency", "poses") else 1
    return [(group, recipe.key(group), number) for number in range(count)]


def rows_of(chunk):
    """What making a chunk leaves."""
    recipe = StandIn.of(chunk)
    return [(group, recipe.key(group), chunk.number) for group in chunk.groups]


@dataclass
class Memory:
    """What is done, and how often each row was made."""

    rows: dict[tuple[str, str, int], int] = field(default_factory=dict)

    def done(self, keys):
        found = {key: set() for key in keys}
        for group, key, number in self.rows:
            if (group, key) in found:
                found[group, key].add(number)
        return found

    def record(self, rows):
        for row in rows:
            self.rows[row] = self.rows.get(row, 0) + 1


def good(task, **values):
    return Outcome(task.number, "worker 0", **{"seconds": 0.5, "pose_count": 1} | values)
