"""What a sweep will cost before it is made: recipes, renderings, poses, bytes, and seconds from small samples.

A little of every family (an object, a hand, a strategy) is made and thrown away, so that what must fail is reported
before a sweep, and the time is known about.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ...errors import PlanError
from ..make.poses import EXPLORATION, RANDOM, pose_count
from ..make.unit import CHUNK_POSES, Chunk, Unit
from ..plan.code_version import code_version
from ..plan.loading import Plan
from ..plan.recipe import WHOLE_GROUPS, Recipe, is_user_metric
from .executors import START_SECONDS
from .missing import Counts, Missing, PendingChunk
from .sweep_run import clock_time

POSES_MOST = 10**12  # beyond, a sweep is made only with --yes
RECIPES_SIZED = 200  # whose bytes are counted; the others count as their mean
SAMPLE_LONGEST = 20.0  # [s] for samples of all families
SAMPLE_FEW = 16  # poses, to load what a family needs
SAMPLE_MANY = {"cpu": 512, "cuda": 1 << 20}  # poses, to know its speed
ROW_BYTES = 1700  # of a result in the store
TABLE_BYTES = 9000  # of memory, of a recipe while the table is written
TABLE_BYTES_SHOWN = 10**8  # from this on it is reported
POSE_BYTES = 48  # of a row of per-pose columns
CONTOUR_BYTES = 600  # of a pose in a contour file, some 35 points: nothing is rendered to know it
FOCUS_BYTES, TRANSDUCER_BYTES = 16, 4  # of a frame: position and intensity; a transducer's delay
ALL_THE_SAME = "; yes=True makes it all the same"


@dataclass(frozen=True)
class Estimate:
    """What a sweep is expected to cost."""

    recipes: int
    recipes_done: int
    """Of which everything is there."""
    renderings: int
    """To be made, each once however many recipes share it."""
    poses: int
    """Of all recipes."""
    poses_to_render: int
    """Of these renderings, each pose once, although some are rendered again to be sampled."""
    bytes: int
    """That the store will take."""
    bytes_free: int
    """On its disk."""
    bytes_table: int
    """Of memory that writing the table takes."""
    seconds: float | None = None
    """With `workers` of them; None where no family could be sampled."""
    workers: int = 1
    families: int = 0
    """Objects, hands and strategies in their combinations, to be made."""
    families_sampled: int = 0
    refusal: str | None = None
    """Why the sweep is made only with `--yes`; None if it is made without."""
    problems: tuple[str, ...] = ()
    """Why families could not be sampled: they will fail."""
    code: tuple[str, ...] = ()
    """Code that a sweep runs, and an estimate does not: recipes with it are neither sampled nor known to be done."""

    def as_dict(self) -> dict[str, Any]:
        """For `--json`."""
        return vars(self) | {"problems": list(self.problems), "code": list(self.code)}

    def sentences(self) -> list[str]:
        """For people."""
        out = [
            f"{self.recipes:,} recipes, {self.poses:,} poses; {self.recipes_done:,} recipes are done",
            f"to make: {self.renderings:,} renderings of {self.poses_to_render:,} poses",
            f"on the disk: about {byte_size(self.bytes)} of {byte_size(self.bytes_free)} free",
        ]
        if self.bytes_table >= TABLE_BYTES_SHOWN:
            out.append(f"memory: about {byte_size(self.bytes_table)} while the table is written")
        if self.seconds is not None:
            of = f"{self.families_sampled} of {self.families} combinations of object, hand and strategy"
            workers = f"{self.workers} worker{'s' if self.workers > 1 else ''}"
            out.append(f"time: about {clock_time(self.seconds)} with {workers}, an estimate from samples of {of}")
        if self.code:
            out.append(f"code that a sweep would run, and this did not: {'; '.join(self.code)}")
        if self.refusal is not None:
            out.append(f"refused without yes=True: {self.refusal}")
        return out


def bytes_of(recipe: Recipe, poses: int, groups: Sequence[str]) -> float:
    """Bytes that groups of a recipe take in the store."""
    from ..make.rendering import arrays_of  # what renders

    chunks = -(-poses // CHUNK_POSES)
    rate = float(recipe.sampling["described"].get("update_rate") or 10_000.0)
    frames = poses / float(recipe.motion.get("rate") or 90.0) * rate
    kept = {
        "poses": POSE_BYTES * poses,
        "keep-contours": CONTOUR_BYTES * poses,
        "keep-focal-points": FOCUS_BYTES * frames,
    }
    if "keep-drives" in groups:
        transducer_count = sum(model.transducer_count for model in arrays_of(recipe.array)[0])
        kept["keep-drives"] = TRANSDUCER_BYTES * frames * transducer_count
    rows = sum(ROW_BYTES * (1 if group in WHOLE_GROUPS else chunks) for group in groups)
    return rows + sum(size for group, size in kept.items() if group in groups)


def bytes_to_make(plan: Plan, counts: Counts) -> int:
    """Bytes that a plan's missing results take, from some recipes all over the plan."""
    recipes = plan.recipes()
    some = recipes[:: -(-len(recipes) // RECIPES_SIZED)]
    sizes = [(bytes_of(own, count, plan.groups), count) for own in some if (count := pose_count(own))]
    mean = sum(size for size, _ in sizes) / max(1, sum(count for _, count in sizes))
    return round(mean * counts.poses_incomplete)


def refuse_too_large(plan: Plan, folder: Path, counts: Counts) -> None:
    """Raise PlanError for a sweep of too many poses or bytes. counts: of what is missing."""
    size, free = bytes_to_make(plan, counts), bytes_free(folder)
    reasons = [
        f"more than {POSES_MOST:,} poses" if counts.poses_incomplete > POSES_MOST else "",
        f"more than the {byte_size(free)} that its disk has free" if size > free else "",
    ]
    if any(reasons):
        raise PlanError(
            f"the plan has {counts.recipes:,} recipes with {counts.poses_incomplete:,} poses to make, and they would "
            f"take about {byte_size(size)}: {' and '.join(filter(None, reasons))}{ALL_THE_SAME}"
        )


def estimate(plan: Plan, missing: Missing, folder: Path, *, devices: Sequence[str]) -> Estimate:
    """Estimate what making what is missing costs. devices: Warp device of each worker."""
    counts, poses = missing.counts, missing.poses_by_family
    samples = FamilySamples(devices[0])
    samples.run(missing)
    refusal = None
    try:
        refuse_too_large(plan, folder, counts)
    except PlanError as error:
        refusal = str(error).removesuffix(ALL_THE_SAME)
    failures = [failure.sentence for failure in missing.failures]
    return Estimate(
        recipes=counts.recipes,
        recipes_done=counts.done,
        renderings=counts.renderings,
        poses=counts.poses,
        poses_to_render=counts.poses_once,
        bytes=bytes_to_make(plan, counts),
        bytes_free=bytes_free(folder),
        bytes_table=TABLE_BYTES * counts.recipes,
        seconds=samples.seconds(poses, len(devices)) if poses else 0.0,
        workers=len(devices),
        families=len(poses),
        families_sampled=len(samples.rates),
        refusal=refusal,
        code=tuple(code.title for code in plan.code),
        problems=tuple(dict.fromkeys((*failures, *samples.problems))),
    )


@dataclass(eq=False)
class FamilySamples:
    """Makes a little of each family."""

    device: str
    rates: dict[str, float] = field(default_factory=dict)
    """Poses a second, by family."""
    load_seconds: float = 0.0
    """For the first poses of all families: each worker loads what it makes."""
    problems: list[str] = field(default_factory=list)

    def run(self, missing: Missing) -> None:
        """Sample families, one after the other, until SAMPLE_LONGEST."""
        many = SAMPLE_MANY["cuda" if self.device.startswith("cuda") else "cpu"]
        until = time.perf_counter() + SAMPLE_LONGEST
        for family, chunk in missing.first_chunks():
            if time.perf_counter() > until:
                return
            loading = self._make(chunk, SAMPLE_FEW)
            timed = None if loading is None else self._make(chunk, many)
            if loading is not None and timed is not None:
                self.load_seconds += loading[1]
                self.rates[family] = timed[0] / timed[1]

    def _make(self, chunk: PendingChunk, poses: int) -> tuple[int, float] | None:
        """Poses and seconds of making a chunk whose motion has so many poses, if it can be shortened; None if it fails.

        What a user's code computes is not run, and contours stand for it.
        """
        from ..make.unit_making import make_unit, runs_python  # what renders

        recipe = Recipe.from_json(chunk.chunk.recipe)
        groups = tuple(group for group in chunk.chunk.groups if not is_user_metric(group)) or ("contours",)
        short = shortened(recipe, poses)
        sample = Chunk(short.to_json(), groups)
        if runs_python(sample):
            return None  # which runs in other processes only
        result = make_unit(Unit((sample,), code_version()), self.device)
        if result.failed:
            self.problems.append(result.failed[0].message)
            return None
        return pose_count(short), result.seconds

    def seconds(self, poses: dict[str, int], worker_count: int) -> float | None:
        """Until all is made, the start of workers included; None if no family could be sampled."""
        if not self.rates:
            return None
        mean = len(self.rates) / sum(1.0 / rate for rate in self.rates.values())
        total = sum(count / self.rates.get(family, mean) for family, count in poses.items())
        workers = max(1, min(worker_count, round((self.load_seconds + total) / START_SECONDS)))
        return (START_SECONDS if workers > 1 else 0.0) + self.load_seconds + total / workers


def shortened(recipe: Recipe, poses: int) -> Recipe:
    """The same recipe with at most so many poses, if its motion can have any number of them."""
    motion = dict(recipe.motion)
    if motion["source"] == RANDOM:
        motion["count"] = min(motion["count"], poses)
    elif motion["source"] == EXPLORATION:
        motion["duration"] = min(motion["duration"], poses / motion["rate"])
    return replace(recipe, motion=motion)


def bytes_free(folder: Path) -> int:
    """Free on the disk that a folder is on, or will be."""
    there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    return shutil.disk_usage(there).free


def byte_size(count: float) -> str:
    """A size for people."""
    for unit in ("bytes", "kB", "MB", "GB", "TB", "PB"):
        if count < 1000:
            return f"{count:.0f} {unit}" if unit == "bytes" else f"{count:.3g} {unit}"
        count /= 1000
    return f"{count:.3g} EB"
