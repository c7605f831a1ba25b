"""What a sweep will cost before it is made: recipes, renderings, poses, bytes and seconds, from small samples.

Seconds and bytes are estimates: of as many families (an object, a hand, a strategy) as a few seconds suffice for, a
piece of the plan's own work is made in a folder that is then thrown away. Families that were not sampled count as their
mean.
"""

from __future__ import annotations

import json
import random
import shutil
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

from ....datasets.sweeps.shard import read_shard
from ...errors import PlanError
from ..make.poses import EXPLORATION, RANDOM, pose_count
from ..make.task import PART, Piece, Task
from ..plan.loading import Plan
from ..plan.recipe import WHOLE_GROUPS, Recipe
from .log import clock_time
from .missing import Counts, Missing, Stretch

RECIPES_MOST, POSES_MOST = 10**6, 10**12  # beyond either, a sweep is made only with --yes
RECIPES_SCATTERED, PARTS_LISTED = 200, 1000  # looked at to know the size of a plan of any number of recipes
RECIPES_READ = 20_000  # of a plan; the rest counts as their mean
FAMILIES_SAMPLED = 20
SECONDS_SAMPLED = 5.0
SAMPLE_POSES = {"cpu": 1024, "cuda": 1 << 20}
SAMPLE_FIRST = {"cpu": 64, "cuda": 1024}  # of what is loaded and compiled before the clock runs
ALL_THE_SAME = "; --yes makes it all the same"
ROW_BYTES = 1200  # of a part in the manifest
TABLE_BYTES = 9000  # of memory, of a recipe while the table is written
TABLE_BYTES_TOLD = 10**8  # from this on people are told
POSE_BYTES = 48  # of a row of per-pose columns
CONTOUR_BYTES = 600  # of a pose in a contour file, some 35 points: nothing is rendered to know it
FOCUS_BYTES, TRANSDUCER_BYTES = 16, 4  # of a frame: position and intensity; a transducer's delay


@dataclass(frozen=True)
class Estimate:
    """What a sweep is expected to cost."""

    recipes: int
    is_exact: bool
    """Whether all recipes were read; otherwise all other numbers grow with those that were."""
    is_bound: bool
    """Whether there may be fewer recipes."""
    recipes_done: int
    """Of which everything is there."""
    renderings: int
    """To be made, each once however many recipes share it."""
    poses: int
    """Of all recipes."""
    poses_to_render: int
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
        about = "" if self.is_exact else "about "
        recipes = "at most " if self.is_bound else ""
        out = [
            f"{recipes}{self.recipes:,} recipes, {about}{self.poses:,} poses; {self.recipes_done:,} recipes are done",
            f"to make: {about}{self.renderings:,} renderings of {about}{self.poses_to_render:,} poses",
            f"on the disk: about {byte_size(self.bytes)} of {byte_size(self.bytes_free)} free",
        ]
        if self.bytes_table >= TABLE_BYTES_TOLD:
            out.append(f"memory: about {byte_size(self.bytes_table)} while the table is written")
        if self.seconds is not None:
            of = f"{self.families_sampled} of {self.families} combinations of object, hand and strategy"
            workers = f"{self.workers} worker{'s' if self.workers > 1 else ''}"
            out.append(f"time: about {clock_time(self.seconds)} with {workers}, an estimate from samples of {of}")
        if self.code:
            out.append(f"code that a sweep would run, and this did not: {'; '.join(self.code)}")
        if self.refusal is not None:
            out.append(f"refused without --yes: {self.refusal}")
        return out


class _Size:
    """Adds up what is expected on the disk."""

    def __init__(self) -> None:
        self._transducers: dict[str, int] = {}

    def of(self, recipe: Recipe, poses: int, groups: Sequence[str]) -> int:
        """Bytes of groups of a recipe."""
        parts = -(-poses // PART)
        total = sum(ROW_BYTES * (1 if group in WHOLE_GROUPS else parts) for group in groups)
        motion, rate = recipe.motion, float(recipe.sampling["described"].get("update_rate") or 10_000.0)
        frames = poses / float(motion.get("rate") or 90.0) * rate
        if "poses" in groups:
            total += POSE_BYTES * poses
        if "keep-contours" in groups:
            total += CONTOUR_BYTES * poses
        if "keep-focal-points" in groups:
            total += round(FOCUS_BYTES * frames)
        if "keep-drives" in groups:
            total += round(TRANSDUCER_BYTES * frames * self._transducer_count(recipe))
        return total

    def _transducer_count(self, recipe: Recipe) -> int:
        """Of all arrays of a recipe."""
        text = json.dumps(recipe.array)
        if text not in self._transducers:
            from ..make.rendering import arrays_of  # what renders

            self._transducers[text] = sum(model.transducer_count for model in arrays_of(recipe.array)[0])
        return self._transducers[text]


def refuse_too_large(plan: Plan, folder: Path, *, share: float = 1.0) -> None:
    """Raise PlanError for a sweep of too many recipes, poses or bytes. share: of the plan's poses that are missing."""
    recipes, free = plan.recipe_count, bytes_free(folder)
    poses, size = (round(recipes * share * mean) for mean in mean_size(plan))
    reasons = [
        f"more than {RECIPES_MOST:,} recipes" if recipes > RECIPES_MOST else "",
        f"more than {POSES_MOST:,} poses" if poses > POSES_MOST else "",
        f"more than the {byte_size(free)} that its disk has free" if size > free else "",
    ]
    if any(reasons):
        raise PlanError(
            f"the plan has {'' if plan.is_exact else 'at most '}{recipes:,} recipes, about {poses:,} poses to make, "
            f"and they would take about {byte_size(size)}: {' and '.join(filter(None, reasons))}{ALL_THE_SAME}"
        )


def _refusal(plan: Plan, folder: Path, counts: Counts) -> str | None:
    """Why a run would be refused without `--yes`."""
    share = counts.poses_incomplete / max(1, counts.poses) if plan.recipe_count <= RECIPES_MOST else 1.0
    try:
        refuse_too_large(plan, folder, share=share)
    except PlanError as error:
        return str(error).removesuffix(ALL_THE_SAME)
    return None


def mean_size(plan: Plan) -> tuple[float, float]:
    """Poses and bytes of a recipe on average, from some that lie anywhere in the plan."""
    size, poses, total = _Size(), 0, 0
    recipes = list(scattered(plan, RECIPES_SCATTERED))
    for recipe in recipes:
        own = pose_count(recipe)
        poses, total = poses + own, total + size.of(recipe, own, plan.groups)
    return poses / len(recipes), total / len(recipes)


def scattered(plan: Plan, count: int) -> Iterator[Recipe]:
    """So many combinations of a plan's axes, whatever its constraints; always the same ones."""
    rng = random.Random(0)
    listed = {axis: list(islice(axis.parts(), PARTS_LISTED)) for product in plan.products for axis in product.axes}
    weights = [product.recipe_count for product in plan.products]
    for _ in range(count):
        (product,) = rng.choices(plan.products, weights)
        yield Recipe.of([rng.choice(listed[axis]) for axis in product.axes])


def estimate(plan: Plan, missing: Missing, folder: Path, *, devices: Sequence[str]) -> Estimate:
    """Estimate what making what is missing costs.

    missing: of the plan's recipes, nothing of which has been read. devices: Warp device of each worker.
    """
    while not missing.is_exhausted and missing.counts.recipes < RECIPES_READ:
        missing.read()
    counts = missing.counts
    stretches = {family: list(own) for family, own in missing.stretches.items()}
    samples = _Sampler(devices[0]).run(stretches)
    scale = pose_scale = 1.0
    if not missing.is_exhausted:
        scale = plan.recipe_count / counts.recipes
        pose_scale = plan.recipe_count * mean_size(plan)[0] / counts.poses
    size, known, renderings = _Size(), 0, set[str]()
    for stretch in (stretch for own in stretches.values() for stretch in own):
        for want in stretch.wants:
            recipe = Recipe.from_json(want.recipe)
            known += size.of(recipe, stretch.poses(stretch.first, stretch.stop), want.groups)
            renderings.add(recipe.key("contours"))
    return Estimate(
        recipes=counts.recipes if missing.is_exhausted else plan.recipe_count,
        is_exact=missing.is_exhausted,
        is_bound=not (missing.is_exhausted or plan.is_exact),
        recipes_done=round(counts.done * scale),
        renderings=round(len(renderings) * scale),
        poses=round(counts.poses * pose_scale),
        poses_to_render=round(counts.poses_missing * pose_scale),
        bytes=round(known * pose_scale),
        bytes_free=bytes_free(folder),
        bytes_table=TABLE_BYTES * (missing.counts.recipes if missing.is_exhausted else plan.recipe_count),
        seconds=samples.seconds(stretches, counts, pose_scale, len(devices)),
        workers=len(devices),
        families=len(stretches),
        families_sampled=len(samples.rates),
        refusal=_refusal(plan, folder, counts),
        code=tuple(code.title for code in plan.code),
        problems=tuple(dict.fromkeys((*(failure.sentence for failure in missing.failures), *samples.problems))),
    )


class _Sampler:
    """Makes a little of families, and takes the time."""

    def __init__(self, device: str) -> None:
        kind = "cuda" if device.startswith("cuda") else "cpu"
        self._device = device
        self._first, self._poses = SAMPLE_FIRST[kind], SAMPLE_POSES[kind]
        self.rates: dict[str, float] = {}
        """Seconds a pose, by family."""
        self.problems: list[str] = []

    def run(self, families: dict[str, list[Stretch]]) -> _Sampler:
        """Sample families evenly, as long as time is left."""
        names = list(families)
        step = max(1, len(names) // FAMILIES_SAMPLED)
        until = time.perf_counter() + SECONDS_SAMPLED
        for name in names[::step][:FAMILIES_SAMPLED]:
            if time.perf_counter() > until:
                break
            self._sample(name, families[name])
        return self

    def _sample(self, family: str, stretches: Sequence[Stretch]) -> None:
        if any(names_code(Recipe.from_json(want.recipe)) for stretch in stretches for want in stretch.wants):
            return  # an estimate runs none
        self._timed(stretches, self._first)  # loads, compiles
        took = self._timed(stretches, self._poses)
        if took is not None:
            self.rates[family] = took

    def _timed(self, stretches: Sequence[Stretch], poses: int) -> float | None:
        """Seconds a pose of making so many; None if it cannot be made."""
        from ..make.work import run_task  # what renders

        pieces, count = sample_pieces(stretches, poses)
        folder = Path(tempfile.mkdtemp(prefix="palpate-sample-"))
        try:
            outcome = run_task(Task(0, pieces, str(folder), "sample"), self._device, worker="sample")
            if outcome.shard is not None:
                read_shard(folder / outcome.shard, columns=False)  # what the parent does with it
        finally:
            shutil.rmtree(folder, ignore_errors=True)
        if outcome.error is not None:
            self.problems.append(outcome.error)
            return None
        return outcome.seconds / count

    def seconds(
        self, families: dict[str, list[Stretch]], counts: Counts, scale: float, worker_count: int
    ) -> float | None:
        """For all families; None if none was sampled, 0 if nothing is missing."""
        if not counts.poses_missing:
            return 0.0
        if not self.rates:
            return None
        mean = sum(self.rates.values()) / len(self.rates)
        total = sum(
            self.rates.get(family, mean) * sum(own.poses(own.first, own.stop) for own in stretches)
            for family, stretches in families.items()
        )
        return total * scale / worker_count


def sample_pieces(stretches: Sequence[Stretch], poses: int) -> tuple[tuple[Piece, ...], int]:
    """Pieces of about so many poses, from the first stretches, motions shortened where they can be; and their poses."""
    pieces: list[Piece] = []
    count = 0
    for stretch in stretches:
        recipes = [shortened(Recipe.from_json(want.recipe), poses - count) for want in stretch.wants]
        pieces += [Piece(recipe.to_json(), want.groups) for recipe, want in zip(recipes, stretch.wants, strict=True)]
        count += min(PART, pose_count(recipes[0]))
        if count >= poses:
            break
    return tuple(pieces), count


def names_code(recipe: Recipe) -> bool:
    """Whether making a recipe runs code that it names."""
    return recipe.thing.get("function") is not None or bool(recipe.strategy["described"].get("modules"))


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
