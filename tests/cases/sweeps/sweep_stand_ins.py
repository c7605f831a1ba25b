"""What stands for recipes, a store's memory and workers where only a sweep's bookkeeping is tested."""

import json
from dataclasses import dataclass, field

from palpate.render.sweeps.make.task import PART, Outcome
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
    def of(cls, piece):
        return cls(**json.loads(piece.recipe))


def count_poses(recipe):
    return recipe.poses


def parts_of(recipe, group):
    """(group, key, part) of all that a group of a recipe has."""
    count = -(-recipe.poses // PART) if group in ("contours", "frequency", "poses") else 1
    return [(group, recipe.key(group), part) for part in range(count)]


def rows_of(piece):
    """What making a piece leaves."""
    recipe = StandIn.of(piece)
    return [(group, recipe.key(group), part) for group in piece.groups for part in range(piece.first, piece.stop)]


@dataclass
class Memory:
    """What is done, and how often each part was made."""

    rows: dict[tuple[str, str, int], int] = field(default_factory=dict)

    def done(self, keys):
        found = {key: set() for key in keys}
        for group, key, part in self.rows:
            if (group, key) in found:
                found[group, key].add(part)
        return found

    def record(self, rows):
        for row in rows:
            self.rows[row] = self.rows.get(row, 0) + 1


def good(task, **told):
    return Outcome(task.number, "worker 0", seconds=0.5, pose_count=1, **told)
