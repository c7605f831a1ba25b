"""What a sweep will cost before it is made: recipes, renderings, poses, bytes and seconds, from small samples.

Something of every family (an object, a hand, a strategy) is made in a folder that is then removed, so that what must
fail is reported before a sweep. A few seconds go into timing families; those that were not timed count as the mean.
"""

from __future__ import annotations

import json
import random
import shutil
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ....datasets.sweeps.shard import read_shard
from ...errors import PlanError
from ..make.poses import EXPLORATION, RANDOM, pose_count
from ..make.task import CHUNK_POSES, Chunk, Task
from ..plan.loading import Plan
from ..plan.recipe import WHOLE_GROUPS, Recipe, is_user_metric
from .log import clock_time
from .missing import Counts, Missing, PendingChunk
from .schedule import START_SECONDS, poses_of

RECIPES_MOST, POSES_MOST = 10**6, 10**12  # beyond either, a sweep is made only with --yes
RECIPES_SCATTERED = 200  # looked at to know the size of a plan of any number of recipes
RECIPES_READ, CHUNKS_LISTED = 20_000, 200_000  # of a plan; the rest counts as their mean
FAMILIES_SAMPLED = 20
SECONDS_SAMPLED = 5.0
LOAD_LONGEST = 60.0  # [s] for loading every combination of object, hand and strategy
CHUNKS_SAMPLED = 4  # of a family, in one task
SLOW = ("noise", "pressure")  # groups that take seconds of few poses: one chunk of each is a sample
SAMPLE_FEW = {"cpu": 64, "cuda": 1024}
SAMPLE_MANY = {"cpu": 512, "cuda": 1 << 20}
START_MOST = (
    3.0  # [s] of processor time for starting the command: in a program that has long been at work it is unknown
)
STARTS_TABLE, SECONDS_ROW = 2.0, 1.7e-4  # of table and figure: in starts of the command, and for each recipe
ALL_THE_SAME = "; yes=True makes it all the same"
ROW_BYTES = 1700  # of a part in the manifest
TABLE_BYTES = 9000  # of memory, of a recipe while the table is written
TABLE_BYTES_SHOWN = 10**8  # from this on it is reported
POSE_BYTES = 48  # of a row of per-pose columns
CONTOUR_BYTES = 600  # of a pose in a contour file, some 35 points: nothing is rendered to know it
FOCUS_BYTES, TRANSDUCER_BYTES = 16, 4  # of a frame: position and intensity; a transducer's delay


@dataclass(frozen=True)
class Estimate:
    """What a sweep is expected to cost."""

    recipes: int
    is_exact: bool
    """Whether all recipes were read; otherwise all other numbers grow with those that were."""
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
        about = "" if self.is_exact else "about "
        out = [
            f"{self.recipes:,} recipes, {about}{self.poses:,} poses; {self.recipes_done:,} recipes are done",
            f"to make: {about}{self.renderings:,} renderings of {about}{self.poses_to_render:,} poses",
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


class _Size:
    """Adds up what is expected on the disk."""

    def __init__(self) -> None:
        self._transducers: dict[str, int] = {}

    def of(self, recipe: Recipe, poses: int, groups: Sequence[str]) -> int:
        """Bytes of groups of a recipe."""
        chunks = -(-poses // CHUNK_POSES)
        total = sum(ROW_BYTES * (1 if group in WHOLE_GROUPS else chunks) for group in groups)
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
            f"the plan has {recipes:,} recipes, about {poses:,} poses to make, "
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
    recipes = scattered(plan, RECIPES_SCATTERED)
    for recipe in recipes:
        own = pose_count(recipe)
        poses, total = poses + own, total + size.of(recipe, own, plan.groups)
    return poses / len(recipes), total / len(recipes)


def scattered(plan: Plan, count: int) -> list[Recipe]:
    """So many of a plan's recipes; always the same ones."""
    return random.Random(0).choices(plan.recipes(), k=count)


def estimate(plan: Plan, missing: Missing, folder: Path, *, devices: Sequence[str]) -> Estimate:
    """Estimate what making what is missing costs.

    missing: of the plan's recipes, nothing of which has been read. devices: Warp device of each worker.
    """
    chunks: list[PendingChunk] = []
    while not missing.is_exhausted and missing.counts.recipes < RECIPES_READ and len(chunks) < CHUNKS_LISTED:
        chunks += missing.read()
    counts = missing.counts
    families: dict[str, list[PendingChunk]] = {}
    for chunk in chunks:
        families.setdefault(chunk.family, []).append(chunk)
    samples = SweepSamples(devices[0]).run(families)
    scale = pose_scale = 1.0
    if not missing.is_exhausted:
        scale = plan.recipe_count / counts.recipes
        pose_scale = plan.recipe_count * mean_size(plan)[0] / counts.poses
        pose_scale *= 1.0 + missing.poses_unread / max(1, counts.poses_once)
    size = _Size()
    known = sum(size.of(Recipe.from_json(own.chunk.recipe), own.pose_count, own.chunk.groups) for own in chunks)
    recipe_count = counts.recipes if missing.is_exhausted else plan.recipe_count
    return Estimate(
        recipes=recipe_count,
        is_exact=missing.is_exhausted,
        recipes_done=round(counts.done * scale),
        renderings=round(len({chunk.rendering for chunk in chunks}) * scale),
        poses=round(plan.recipe_count * mean_size(plan)[0]) if not missing.is_exhausted else counts.poses,
        poses_to_render=round(counts.poses_once * pose_scale),
        bytes=round(known * pose_scale),
        bytes_free=bytes_free(folder),
        bytes_table=TABLE_BYTES * recipe_count,
        seconds=samples.seconds(families, pose_scale, len(devices), recipe_count) if chunks else 0.0,
        workers=len(devices),
        families=len(families),
        families_sampled=len(samples.costs),
        refusal=_refusal(plan, folder, counts),
        code=tuple(code.title for code in plan.code),
        problems=tuple(dict.fromkeys((*(failure.sentence for failure in missing.failures), *samples.problems))),
    )


@dataclass(frozen=True)
class Cost:
    """Of making chunks of a family."""

    chunk_seconds: float
    """Of each, however few poses it has."""
    pose_seconds: float
    """Of each pose."""


class SweepSamples:
    """Makes a little of each family, so that what must fail is known, and takes the time of some."""

    def __init__(self, device: str) -> None:
        kind = "cuda" if device.startswith("cuda") else "cpu"
        self._device = device
        self._few, self._many = SAMPLE_FEW[kind], SAMPLE_MANY[kind]
        self.costs: dict[str, Cost] = {}
        """By family."""
        self._start = min(START_MOST, time.process_time())  # of this command, on this host
        self.load_seconds = 0.0
        """Until the first poses of all families were made: each worker loads what it makes."""
        self.problems: list[str] = []

    def run(self, families: Mapping[str, Sequence[PendingChunk]]) -> SweepSamples:
        """Make something of each family, until LOAD_LONGEST; time families evenly, for SECONDS_SAMPLED.

        Of slow groups the first family shows whether they can be made; of the others contours do.
        """
        until = time.perf_counter() + LOAD_LONGEST
        loaded: list[str] = []
        slow_made: set[tuple[str, ...]] = set()
        for name, chunks in families.items():
            if time.perf_counter() > until:
                break
            groups = chunks[0].chunk.groups
            is_again = groups in slow_made
            slow_made |= {groups} if is_slow(groups) else set()
            seconds = self._make(chunks[:1], self._few, ("contours",) if is_again else None)
            if seconds is not None:
                self.load_seconds += seconds
                loaded.append(name)
        step = max(1, len(loaded) // FAMILIES_SAMPLED)
        until = time.perf_counter() + SECONDS_SAMPLED
        for name in loaded[::step][:FAMILIES_SAMPLED]:
            if time.perf_counter() > until and self.costs:
                break
            self._time(name, families[name][:CHUNKS_SAMPLED])
        return self

    def _time(self, family: str, chunks: Sequence[PendingChunk]) -> None:
        """Time few and many poses of chunks; a line through both gives the cost of a chunk and of a pose."""
        most = self._many
        if is_slow(chunks[0].chunk.groups):
            chunks, most = chunks[:1], 2 * self._few
        few, many = self._make(chunks, self._few), self._make(chunks, most)
        if few is None or many is None:
            return
        recipes = [Recipe.from_json(chunk.chunk.recipe) for chunk in chunks]
        first, last = (sum(pose_count(shortened(recipe, count)) for recipe in recipes) for count in (self._few, most))
        slope = max(0.0, many - few) / (last - first) if last > first else 0.0
        slope = slope or many / last
        self.costs[family] = Cost(max(0.0, few - slope * first) / len(chunks), slope)

    def _make(self, chunks: Sequence[PendingChunk], poses: int, groups: tuple[str, ...] | None = None) -> float | None:
        """Seconds of making chunks with motions of so many poses, where these can be shortened; None if it fails.

        groups: instead of the chunks' own.
        """
        from ..make.work import run_task  # what renders

        recipes = [Recipe.from_json(own.chunk.recipe) for own in chunks]
        if any(map(names_code, recipes)):
            return None  # an estimate runs none
        # What a user's code computes is not run, and contours stand for it.
        timed = [tuple(one for one in own.chunk.groups if not is_user_metric(one)) or ("contours",) for own in chunks]
        wire = tuple(
            Chunk(shortened(recipe, poses).to_json(), groups or own) for recipe, own in zip(recipes, timed, strict=True)
        )
        folder = Path(tempfile.mkdtemp(prefix="palpate-sample-"))
        try:
            outcome = run_task(Task(0, wire, str(folder), "sample"), self._device, worker="sample")
            if outcome.shard is not None:
                read_shard(folder / outcome.shard, columns=False)  # what the parent does with it
        finally:
            shutil.rmtree(folder, ignore_errors=True)
        if outcome.error is not None:
            self.problems.append(outcome.error)
            return None
        return outcome.seconds

    def seconds(
        self, families: Mapping[str, Sequence[PendingChunk]], scale: float, worker_count: int, recipe_count: int
    ) -> float | None:
        """Until the command ends: all is made, table and figure are written; None if no family could be timed."""
        if not self.costs:
            return None
        mean = Cost(
            sum(cost.chunk_seconds for cost in self.costs.values()) / len(self.costs),
            sum(cost.pose_seconds for cost in self.costs.values()) / len(self.costs),
        )
        total = 0.0
        for family, chunks in families.items():
            cost = self.costs.get(family, mean)
            poses = sum(poses_of(chunks).values())
            total += (cost.chunk_seconds * len(chunks) + cost.pose_seconds * poses) * scale
        workers = max(1, min(worker_count, round((self.load_seconds + total) / START_SECONDS)))
        starts = 1.0 + (workers > 1) + STARTS_TABLE  # the command itself, its workers at once, and pictures
        return starts * self._start + self.load_seconds + total / workers + SECONDS_ROW * recipe_count


def is_slow(groups: Sequence[str]) -> bool:
    """Whether making groups takes seconds, however few the poses."""
    return any(group in SLOW for group in groups)


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
