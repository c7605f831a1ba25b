"""Making a unit: a pure function from chunks to rows of the store, on any worker.

| poses of | rendered |
|---|---|
| a rigid hand | in batches that recipes of one object, hand and strategy share, whatever their motions |
| a hand posed by a recording | by themselves, since its rows are the motion's |
| either, too many for the memory, or for a second | in batches of whole spans of 512 poses |
| groups that cannot be split | in `sampling_groups`, many recipes at once, else in `unsplit`, recipe by recipe |

How poses are put into batches changes no bit of a result. A recipe that fails does not take others with it: a batch
that fails is made again, recipe by recipe.
"""

import errno
import json
import os
import shutil
import tempfile
import time
import warnings
from collections.abc import Collection, Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from ....datasets.errors import DatasetError
from ....datasets.sweeps.result_row import Columns, ResultRow
from ....datasets.sweeps.store import Key
from ....device.errors import DeviceError
from ...errors import PalpateWarning, RenderError, SweepError
from ...intersection.batch_rendering import is_too_large
from ..plan.code_version import code_version
from ..plan.recipe import WHOLE_GROUPS, Recipe, is_user_metric
from ..plan.user_metric import load_planned, shown_name
from .batch import (
    POSES_FIRST,
    AskedMetrics,
    BatchSize,
    PoseRange,
    RenderedChunk,
    batch_capacity,
    point_limit,
    poses_of,
    take_batch,
)
from .metrics import ChunkSlice, measure_batch
from .rendering import Rendering, read_recipe, recipe_cache
from .sampling_groups import SampledAlike, UnsplitChunk, divide_chunks
from .unit import CHUNK_POSES, SPAN, Chunk, FailedChunk, Unit, UnitResult, text_of, this_process
from .unsplit import make_unsplit
from .user_metrics import UserMetric

TRANSIENT = {
    getattr(errno, name)
    for name in ("ENOSPC", "EDQUOT", "EFBIG", "EROFS", "EIO", "ESTALE", "ETIMEDOUT", "EAGAIN", "EMFILE", "ENFILE")
}
"""Errors of the system that may have passed when the chunk is made again."""


def make_unit(unit: Unit, device: str) -> UnitResult:
    """Make the chunks of a unit; nothing is changed but `unit.scratch`, and only there if files are kept.

    device: Warp's. Raises nothing but KeyboardInterrupt in the process that gives the unit: whatever goes wrong is in
    the result, by chunk.
    """
    if unit.code_version != (own := code_version()):
        return UnitResult(refusal=f"a worker runs other code: {own}, not {unit.code_version}")
    started, is_elsewhere = time.perf_counter(), unit.parent != this_process()
    caught: list[warnings.WarningMessage] = []
    with ExitStack() as stack:
        if is_elsewhere:  # nobody reads the warnings of this process: the one that gives the unit shows them
            caught = stack.enter_context(warnings.catch_warnings(record=True))
            warnings.simplefilter("always", PalpateWarning)
        try:
            result = _made(unit, device)
        except BaseException as error:  # a user's function may raise any: that is no reason to end a worker
            if isinstance(error, KeyboardInterrupt) and not is_elsewhere:
                raise
            reason, passes = reason_of(error), is_transient(error)
            failed = tuple(FailedChunk(place, reason, passes) for place, _ in enumerate(unit.chunks))
            result = UnitResult(failed=failed, is_unnamed=True)
    if result.failed and is_elsewhere and not is_usable(device):
        os._exit(1)  # nothing works in this process any more; the unit is made again in another one
    texts = tuple(dict.fromkeys(str(own.message) for own in caught if issubclass(own.category, PalpateWarning)))
    return replace(result, seconds=time.perf_counter() - started, warnings=texts)


def _made(unit: Unit, device: str) -> UnitResult:
    """The result but for its seconds and warnings; raises what names no chunk."""
    is_near = unit.scratch != "" and Path(unit.scratch).is_dir()
    folder = Path(tempfile.mkdtemp(prefix="unit-", dir=unit.scratch if is_near else None))
    work, is_left = UnitWork(unit, device, folder), False
    try:
        _make(work)
        files = tuple((name, folder / name if is_near else (folder / name).read_bytes()) for name in work.files)
        is_left = is_near and bool(files)  # for the store, which moves the files
    finally:
        if not is_left:
            shutil.rmtree(folder, ignore_errors=True)
    failed = tuple(work.failed[place] for place in sorted(work.failed))
    return UnitResult(tuple(work.rows), files, failed, work.pose_count)


@dataclass(eq=False)
class UnitWork:
    """A unit under way: what has been made and what could not be."""

    unit: Unit
    device: str
    folder: Path
    """Of kept files, under their paths within the store."""
    rows: list[ResultRow] = field(default_factory=list)
    files: list[str] = field(default_factory=list)
    """Paths of kept files within the store."""
    failed: dict[int, FailedChunk] = field(default_factory=dict)
    pose_count: int = 0
    _user_metrics: dict[str, UserMetric] = field(default_factory=dict)

    def add(self, key: Key, chunk: int, payload: dict[str, Any], columns: Columns | None = None) -> None:
        """Add a result."""
        self.rows.append(ResultRow.of(self.unit.code_version, *key, chunk, payload, columns))
        if payload.get("path") is not None:
            self.files.append(payload["path"])

    def add_unsplit(self, key: Key, places: Iterable[int], title: str, payload: dict[str, Any] | Exception) -> None:
        """Add a result of all poses, or note why there is none. places: of the chunks that ask for it."""
        if isinstance(payload, Exception):
            self.fail(places, f"{title} ({key[0]})", payload)
        else:
            self.add(key, 0, payload)

    def fail(self, places: Iterable[int], title: str, error: BaseException) -> None:
        """Note chunks that could not be made, the first reason of each."""
        for place in places:
            failed = FailedChunk(place, f"{title}: {reason_of(error)}", is_transient(error))
            self.failed.setdefault(place, failed)

    def user_metric(self, group: str) -> UserMetric:
        """The user's metric of a group, whose function is loaded once; raises what loading raises."""
        if group not in self._user_metrics:
            source = dict(self.unit.user_metrics).get(group, "")
            function = load_planned(group, source, self.unit.granted)
            self._user_metrics[group] = UserMetric(group, shown_name(source), function)
        return self._user_metrics[group]


def _make(work: UnitWork) -> None:
    """All chunks: those of split groups in batches, then those of groups that need all poses at once."""
    rendered, unsplit = _sorted_chunks(work)
    families: dict[str, list[RenderedChunk]] = {}
    for own in rendered:
        alone = "" if own.rendering.is_fusable else f" {own.rendering.key} {own.number}"
        families.setdefault(own.rendering.family + alone, []).append(own)
    for family in families.values():
        _render_family(family, work)
    alike, alone = divide_chunks(unsplit, work.device)
    for shared in alike:
        for chunk in _sample_alike(shared, work):
            alone.setdefault(chunk.rendering.key, []).append(chunk)
    for asked in alone.values():
        _make_unsplit(asked, work)


def _sorted_chunks(work: UnitWork) -> tuple[Collection[RenderedChunk], list[UnsplitChunk]]:
    """Chunks of the unit by how they are made, their recipes loaded; those that cannot be loaded have failed."""
    known: dict[str, tuple[Recipe, Rendering, AskedMetrics]] = {}  # by recipe: its chunks share all of these
    metrics: dict[str, AskedMetrics] = {}  # by rendering, which recipes share
    rendered: dict[tuple[str, int], RenderedChunk] = {}
    unsplit: list[UnsplitChunk] = []
    for place, chunk in enumerate(work.unit.chunks):
        title = f"chunk {place}"
        try:
            if work.unit.parent == this_process() and runs_python(chunk):
                raise SweepError(
                    "it runs Python, which a sweep runs in other processes only, as nothing could end a stage that "
                    "hangs in this one: give run_sweep an executor of processes, not of threads"
                )
            if chunk.recipe not in known:
                recipe = read_recipe(chunk.recipe)
                title = recipe.title
                rendering = recipe_cache(work.device).rendering(recipe, allow_code=work.unit.granted)
                known[chunk.recipe] = recipe, rendering, metrics.setdefault(rendering.key, AskedMetrics())
            if chunk.number * CHUNK_POSES >= (count := known[chunk.recipe][1].poses.count):
                raise SweepError(f"it has no chunk {chunk.number}, as its motion has {count} poses")
        except Exception as error:  # of a user's module, too
            work.fail([place], title, error)
            continue
        recipe, rendering, asked = known[chunk.recipe]
        if chunk.groups[0] in WHOLE_GROUPS:
            unsplit.append(UnsplitChunk(place, chunk.groups, recipe, rendering))
            continue
        for group in chunk.groups:
            try:
                metric = work.user_metric(group) if is_user_metric(group) else None
            except RenderError as error:
                work.fail([place], recipe.title, error)
                continue
            key = rendering.key, chunk.number
            rendered.setdefault(key, RenderedChunk(rendering, chunk.number, asked)).ask(place, group, recipe, metric)
    return rendered.values(), unsplit


def _render_family(chunks: Sequence[RenderedChunk], work: UnitWork) -> None:
    """Chunks of one scene, in batches."""
    rendering, is_fixed = chunks[0].rendering, chunks[0].rendering.has_own_stages
    family = rendering.family, work.device
    first = _batch_poses.get(family, POSES_FIRST["cpu" if work.device == "cpu" else "cuda"])
    size = BatchSize(batch_capacity(rendering.scene.pose_bytes, work.device), first, is_fixed=is_fixed)
    while chunks:
        batch = take_batch(chunks, size.poses)
        count = sum(own.count for own in batch)
        failed: dict[str, Exception] = {}
        started = time.perf_counter()
        try:
            _render_batch(batch, work)
            size.learn(count, time.perf_counter() - started)
        except Exception as error:  # of one recipe, of a user's stage, or of the memory
            if count > SPAN and is_too_large(error):
                size.shrink(count)
            else:
                failed = _render_alone(batch, work, error)
        for chunk in chunks:
            if (error := failed.get(chunk.rendering.key)) is not None:
                work.fail(chunk.places, chunk.rendering.name, error)
        chunks = [own for own in chunks if own.reached < own.stop and own.rendering.key not in failed]
    if not is_fixed:
        _batch_poses[family] = size.poses


_batch_poses: dict[tuple[str, str], int] = {}
"""Poses of the last batch of a family on a device: the next unit begins with as many."""


def _render_alone(batch: Sequence[PoseRange], work: UnitWork, error: Exception) -> dict[str, Exception]:
    """Make a batch that failed again, rendering by rendering; returns the errors of those that fail by themselves."""
    by_rendering: dict[str, list[PoseRange]] = {}
    for own in batch:
        by_rendering.setdefault(own.chunk.rendering.key, []).append(own)
    if len(by_rendering) == 1:
        return dict.fromkeys(by_rendering, error)
    failed: dict[str, Exception] = {}
    for key, alone in by_rendering.items():
        try:
            _render_batch(alone, work)
        except Exception as reason:
            failed[key] = reason
    return failed


def _render_batch(batch: Sequence[PoseRange], work: UnitWork) -> None:
    """Render and measure poses of one scene together; rows of the chunks that end here are added."""
    slices, at = [], 0
    for own in batch:
        metrics = own.chunk.metrics
        slices.append(
            ChunkSlice(
                own.chunk.number, at, own.count, metrics.samplings, metrics.user_metrics, before=own.chunk.measured
            )
        )
        at += own.count
    found = measure_batch(
        batch[0].chunk.rendering.scene,
        poses_of(batch, work.device),
        slices,
        device=work.device,
        per_pose=any(group == "poses" for own in batch for group, _ in own.chunk.asked),
        first=batch[0].first,
        point_limit=None if at <= SPAN else point_limit(work.device),
    )
    work.pose_count += at
    for own, measured in zip(batch, found, strict=True):  # nothing here can fail: no pose is counted twice
        own.chunk.measured = measured
        own.chunk.columns.append(measured.columns)
    for own in batch:
        if own.stop == own.chunk.stop:
            _add_results(own.chunk, work)


def _add_results(chunk: RenderedChunk, work: UnitWork) -> None:
    """Results of a chunk of which all poses have been measured."""
    measured = chunk.measured
    if measured is None:
        raise RuntimeError("a chunk ended before it was measured")
    rendering = measured.contours["seconds"]  # counted once, however many groups were made of the same contours
    for (group, key), asked in chunk.asked.items():
        place = chunk.metrics.samplings.index(asked.sampling) if asked.sampling else 0
        blocks: list[dict[str, np.ndarray]] = []
        if group == "contours":
            payload = {**measured.contours, "seconds": {}}
        elif asked.metric is not None:
            payload = measured.user_metrics[group]
        elif group == "frequency":
            payload = measured.frequency[place]
        else:
            payload = {"poses": chunk.stop - chunk.first, "seconds": {}}
            blocks = [own[place] for own in chunk.columns]
        if isinstance(payload, SweepError):
            work.fail(asked.places, chunk.rendering.name, payload)
            continue
        try:
            columns = {name: np.concatenate([own[name] for own in blocks]) for name in blocks[0]} if blocks else None
            work.add((group, key), chunk.number, {**payload, "seconds": rendering | payload["seconds"]}, columns)
        except Exception as error:  # no memory for them: the batch is not to be rendered again
            work.fail(asked.places, chunk.rendering.name, error)
        rendering = {}


def _sample_alike(shared: SampledAlike, work: UnitWork) -> list[UnsplitChunk]:
    """Results of motions in groups; returns the chunks that are left after a group failed as a whole."""
    left = dict(shared.asked)
    try:
        for group in shared.groups(work.device, work.folder):
            for chunks, results in group:
                recipe = chunks[0].recipe
                for name, payload in results.items():
                    places = {chunk.place for chunk in chunks if name in chunk.groups}
                    work.add_unsplit((name, recipe.key(name)), places, recipe.title, payload)
                work.pose_count += chunks[0].rendering.poses.count
                del left[recipe.key("sampling")]
    except Exception:  # of one motion: making each alone finds which
        return [chunk for chunks in left.values() for chunk in chunks]
    return []


def _make_unsplit(asked: Sequence[UnsplitChunk], work: UnitWork) -> None:
    """Groups of one rendering that cannot be split."""
    wanted: dict[Key, Recipe] = {}
    places: dict[Key, set[int]] = {}
    for chunk in asked:
        for group in chunk.groups:
            key = group, chunk.recipe.key(group)
            wanted.setdefault(key, chunk.recipe)
            places.setdefault(key, set()).add(chunk.place)
    rendering = asked[0].rendering
    results = make_unsplit(rendering, wanted, work.folder, work.device)
    for key, payload in results.items():
        work.add_unsplit(key, places[key], wanted[key].title, payload)
    if any(isinstance(payload, dict) and payload.get("reason") is None for payload in results.values()):
        work.pose_count += rendering.poses.count


def is_usable(device: str) -> bool:
    """Whether Warp can still work on a device; on a GPU, nothing does after a fault in a kernel."""
    if wp.get_device(device).is_cpu:
        return True
    try:
        return wp.full(1, 7, dtype=wp.int32, device=device).numpy()[0] == 7
    except Exception:
        return False


def runs_python(chunk: Chunk) -> bool:
    """Whether making a chunk runs Python of stages, or code of a user: such may crash or never end."""
    if any(map(is_user_metric, chunk.groups)):
        return True
    parts = json.loads(chunk.recipe)
    described = parts["strategy"]["described"]
    has_code = parts["thing"].get("function") is not None or bool(described.get("modules"))
    return has_code or _has_python_stages(json.dumps(described))


@lru_cache(maxsize=256)
def _has_python_stages(strategy: str) -> bool:
    """Whether a strategy, as JSON, has stages that run on the host or are a user's."""
    from ...stages.registry import known_stages

    described = json.loads(strategy)
    stages = [(role, stage) for role in ("prune", "transform") for stage in described.get(role, ())]
    names = [(role, stage if isinstance(stage, str) else stage["stage"]) for role, stage in stages]
    entries = [known_stages(role).get(name) for role, name in names]
    return any(entry is None or not entry.own or (entry.function and entry.on == "host") for entry in entries)


def reason_of(error: BaseException) -> str:
    """What went wrong, in one sentence."""
    if isinstance(error, RenderError | DatasetError | DeviceError):
        return text_of(error)
    if isinstance(error, OSError):
        where = f" ({error.filename})" if error.filename else ""
        return f"{error.strerror or error}{where}"
    return f"{type(error).__name__}: {' '.join(text_of(error).split()) or 'no reason given'}"


def is_transient(error: BaseException | None) -> bool:
    """Whether the system failed, or an error that it caused, in a way that may pass."""
    if error is None:
        return False
    return (isinstance(error, OSError) and error.errno in TRANSIENT) or is_transient(error.__cause__)
