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
from collections.abc import Iterable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from ....datasets.errors import DatasetError
from ....datasets.sweeps.result_row import ResultRow
from ....device.errors import DeviceError
from ....kernels.offsets import PointLimitError
from ...errors import PalpateWarning, RenderError, SweepError
from ...intersection.batch_rendering import is_too_large
from ..plan.code_version import code_version
from ..plan.recipe import WHOLE_GROUPS, Recipe, is_user_metric
from ..plan.user_metric import load_planned, shown_name
from .batch import (
    POSES_FIRST,
    BatchSize,
    PoseRange,
    RenderedChunk,
    RenderingWants,
    Wants,
    batch_capacity,
    join_ranges,
    point_limit,
    poses_of,
    take_batch,
    want_chunk,
    wants_of,
)
from .metrics import ChunkSlice, measure_batch
from .rendering import Rendering, read_recipe, recipe_cache
from .sampling_groups import SampledAlike, UnsplitChunk, divide_chunks
from .unit import SPAN, Chunk, FailedChunk, Unit, UnitResult, text_of, this_process
from .unsplit import make_unsplit
from .user_metrics import UserMetric

TRANSIENT = {
    getattr(errno, name)
    for name in ("ENOSPC", "EDQUOT", "EFBIG", "EROFS", "EIO", "ESTALE", "ETIMEDOUT", "EAGAIN", "EMFILE", "ENFILE")
}
"""Errors of the system that may have passed when the chunk is made again."""


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
    user_metrics: dict[str, UserMetric] = field(default_factory=dict)
    """By group, those that are loaded."""
    pose_count: int = 0

    def add(
        self,
        group: str,
        key: str,
        chunk: int,
        payload: dict[str, Any],
        columns: dict[str, np.ndarray] | None = None,
    ) -> None:
        """Add a result."""
        self.rows.append(ResultRow.of(self.unit.code_version, group, key, chunk, payload, columns))
        if payload.get("path") is not None:
            self.files.append(payload["path"])

    def fail(self, places: Iterable[int], title: str, error: BaseException) -> None:
        """Note chunks that could not be made, the first reason of each."""
        for place in places:
            failed = FailedChunk(place, f"{title}: {reason_of(error)}", is_transient(error))
            self.failed.setdefault(place, failed)


def make_unit(unit: Unit, device: str) -> UnitResult:
    """Make the chunks of a unit; nothing is changed but `unit.scratch`, and only there if files are kept.

    device: Warp's. Raises nothing but what ends the process: what goes wrong is in the result, by chunk.
    """
    started = time.perf_counter()
    if unit.code_version != (own := code_version()):
        return UnitResult(refusal=f"a worker runs other code: {own}, not {unit.code_version}")
    is_near = unit.scratch != "" and Path(unit.scratch).is_dir()
    try:
        folder = Path(tempfile.mkdtemp(prefix="unit-", dir=unit.scratch if is_near else None))
    except OSError as error:
        return _all_failed(unit, error, started)
    work = UnitWork(unit, device, folder)
    is_elsewhere = unit.parent != this_process()
    caught: list[warnings.WarningMessage] = []
    try:
        with warnings.catch_warnings(record=True) if is_elsewhere else nullcontext(caught) as caught:
            if is_elsewhere:  # this process has no reader of warnings; the giving one shows them
                warnings.simplefilter("always", PalpateWarning)
            _make(work)
        files = tuple((name, folder / name if is_near else (folder / name).read_bytes()) for name in work.files)
    except Exception as error:
        return _all_failed(unit, error, started)
    except (SystemExit, KeyboardInterrupt) as error:  # raised by a user's function: no reason to end a worker
        if isinstance(error, KeyboardInterrupt) and not is_elsewhere:
            raise
        return _all_failed(unit, RuntimeError(f"something in it raised {error!r:.80}"), started)
    finally:
        if not (is_near and work.files):
            shutil.rmtree(folder, ignore_errors=True)
    failed = tuple(work.failed[place] for place in sorted(work.failed))
    if failed and is_elsewhere and not is_usable(device):
        os._exit(1)  # nothing works in this process any more; the unit is made again in another one
    texts = tuple(dict.fromkeys(str(own.message) for own in caught if issubclass(own.category, PalpateWarning)))
    seconds = time.perf_counter() - started
    return UnitResult(tuple(work.rows), files, failed, work.pose_count, seconds, warnings=texts)


def is_usable(device: str) -> bool:
    """Whether Warp can still work on a device; on a GPU, nothing does after a fault in a kernel."""
    if wp.get_device(device).is_cpu:
        return True
    try:
        return wp.full(1, 7, dtype=wp.int32, device=device).numpy()[0] == 7
    except Exception:
        return False


def _all_failed(unit: Unit, error: BaseException, started: float) -> UnitResult:
    """A unit of which the reason for its failure names no chunk."""
    reason, passes = reason_of(error), is_transient(error)
    failed = tuple(FailedChunk(place, reason, passes) for place, _ in enumerate(unit.chunks))
    return UnitResult(failed=failed, seconds=time.perf_counter() - started, is_unnamed=True)


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


def _make(work: UnitWork) -> None:
    """All chunks: those that share batches first, then what cannot be split."""
    unit = work.unit
    cache = recipe_cache(work.device)
    known: dict[
        str, tuple[Recipe, Rendering]
    ] = {}  # chunks of a recipe share a rendering, whose poses are made at once
    chunks: dict[tuple[str, int], RenderedChunk] = {}
    unsplit: list[UnsplitChunk] = []
    for place, chunk in enumerate(unit.chunks):
        title = f"chunk {place}"
        try:
            if unit.parent == this_process() and runs_python(chunk):
                raise SweepError(
                    "it runs Python, which a sweep runs in other processes only, as nothing could end a stage that "
                    "hangs in this one: give run_sweep an executor of processes, not of threads"
                )
            if chunk.recipe not in known:
                recipe = read_recipe(chunk.recipe)
                title = recipe.title
                known[chunk.recipe] = recipe, cache.rendering(recipe, allow_code=unit.granted)
        except Exception as error:  # of a user's module, too
            work.fail([place], title, error)
            continue
        recipe, rendering = known[chunk.recipe]
        title = recipe.title
        if chunk.groups[0] in WHOLE_GROUPS:
            unsplit.append(UnsplitChunk(place, chunk.groups, recipe, rendering))
        else:
            groups = [group for group in chunk.groups if _is_ready(group, place, title, work)]
            if groups:
                want_chunk(chunks, place, chunk.number, groups, recipe, rendering, work.user_metrics)
    families: dict[str, list[RenderedChunk]] = {}
    for own in chunks.values():
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


def _is_ready(group: str, place: int, title: str, work: UnitWork) -> bool:
    """Whether a group can be made: the function of a user's metric is loaded first, once; else the chunk has failed."""
    if not is_user_metric(group) or group in work.user_metrics:
        return True
    source = dict(work.unit.user_metrics).get(group, "")
    try:
        work.user_metrics[group] = UserMetric(group, shown_name(source), load_planned(group, source, work.unit.granted))
    except RenderError as error:
        work.fail([place], title, error)
    return group in work.user_metrics


def _render_family(chunks: Sequence[RenderedChunk], work: UnitWork) -> None:
    """Chunks of one scene, in batches."""
    rendering, is_fixed = chunks[0].rendering, chunks[0].rendering.has_own_stages
    known = (rendering.family, work.device)
    first = _batches_known.get(known, POSES_FIRST["cpu" if work.device == "cpu" else "cuda"])
    size = BatchSize(batch_capacity(rendering.scene.pose_bytes, work.device), first, is_fixed=is_fixed)
    wants = wants_of(chunks)
    left = [PoseRange(chunk, chunk.first, chunk.stop) for chunk in chunks]
    lost: set[str] = set()
    while left := [own for own in left if own.chunk.rendering.key not in lost]:
        batch, left = take_batch(left, size.poses)
        count = sum(own.count for own in batch)
        started = time.perf_counter()
        try:
            _render_batch(batch, wants, work)
            size.learn(count, time.perf_counter() - started)
        except (PointLimitError, MemoryError, RuntimeError) as error:
            if is_too_large(error) and count > SPAN:
                size.shrink(count)
                left = join_ranges([*batch, *left], lambda chunk: chunk)
            else:
                lost |= _render_alone(batch, wants, work, error)
        except Exception as error:  # of one recipe, or of a user's stage
            lost |= _render_alone(batch, wants, work, error)
    if not is_fixed:
        _batches_known[rendering.family, work.device] = size.poses


_batches_known: dict[tuple[str, str], int] = {}
"""Poses of the last batch of a family on a device: the next unit begins with as many."""


def _render_alone(batch: Sequence[PoseRange], wants: Wants, work: UnitWork, error: Exception) -> set[str]:
    """Make a batch that failed again, rendering by rendering; returns those that fail by themselves."""
    keys = list(dict.fromkeys(own.chunk.rendering.key for own in batch))
    lost: set[str] = set()
    for key in keys:
        alone = [own for own in batch if own.chunk.rendering.key == key]
        places = set().union(*(own.chunk.places for own in alone))
        try:
            if len(keys) == 1:
                raise error
            _render_batch(alone, wants, work)
        except Exception as reason:
            lost.add(key)
            work.fail(places, alone[0].chunk.rendering.name, reason)
    return lost


def _render_batch(batch: Sequence[PoseRange], wants: Wants, work: UnitWork) -> None:
    """Render and measure poses of one scene together; rows of the chunks that end here are added."""
    keys = list(dict.fromkeys(own.chunk.rendering.key for own in batch))
    slices, at = [], 0
    for own in batch:
        rendering = keys.index(own.chunk.rendering.key)
        slices.append(ChunkSlice(rendering, own.chunk.number, at, own.count, own.chunk.measured))
        at += own.count
    found = measure_batch(
        batch[0].chunk.rendering.scene,
        poses_of(batch, work.device),
        slices,
        device=work.device,
        samplings=[wants[key].samplings for key in keys],
        user_metrics=[wants[key].user_metrics for key in keys],
        per_pose=any(own.chunk.per_pose for own in batch),
        first=batch[0].first,
        point_limit=None if at <= SPAN else point_limit(work.device),
    )
    work.pose_count += at
    for own, measured in zip(batch, found, strict=True):
        own.chunk.measured = measured
        own.chunk.columns.append(measured.columns)
        if own.stop == own.chunk.stop:
            _add_rows(own.chunk, wants[own.chunk.rendering.key], work)


def _add_rows(chunk: RenderedChunk, wants: RenderingWants, work: UnitWork) -> None:
    """Rows of a chunk of which all poses have been measured."""
    measured = chunk.measured
    if measured is None:
        raise RuntimeError("a chunk ended before it was measured")
    samplings = wants.samplings
    rendering = measured.contours["seconds"]  # counted once, however many groups were made of the same contours
    for (group, key), wanted in chunk.wanted.items():
        columns = None
        if wanted.metric is not None:
            payload = measured.user_metrics[group]
            if isinstance(payload, SweepError):
                work.fail(wanted.places, chunk.rendering.name, payload)
                continue
        elif wanted.sampling is None:
            payload = measured.contours
        elif group == "frequency":
            payload = measured.frequency[samplings.index(wanted.sampling)]
        else:
            blocks = [own[samplings.index(wanted.sampling)] for own in chunk.columns]
            columns = {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}
            payload = {"poses": chunk.stop - chunk.first, "seconds": {}}
        own = {} if payload is measured.contours else payload["seconds"]
        work.add(group, key, chunk.number, {**payload, "seconds": rendering | own}, columns)
        rendering = {}


def _sample_alike(shared: SampledAlike, work: UnitWork) -> list[UnsplitChunk]:
    """Results of motions in groups; returns the chunks that are left, after a group that failed as a whole."""
    left = dict(shared.asked)
    try:
        for group in shared.groups(work.device, work.folder):
            for chunks, results in group:
                recipe = chunks[0].recipe
                for name, payload in results.items():
                    asking = {chunk.place for chunk in chunks if name in chunk.groups}
                    _note_result(work, (name, recipe.key(name)), recipe.title, asking, payload)
                work.pose_count += chunks[0].rendering.poses.count
                del left[recipe.key("sampling")]
    except Exception:  # of one motion, as making each alone tells
        return [chunk for chunks in left.values() for chunk in chunks]
    return []


def _note_result(
    work: UnitWork, result: tuple[str, str], title: str, places: Iterable[int], payload: dict[str, Any] | Exception
) -> None:
    """Add a result, or the reason why there is none."""
    if isinstance(payload, Exception):
        work.fail(places, f"{title} ({result[0]})", payload)
    else:
        work.add(*result, 0, payload)


def _make_unsplit(asked: Sequence[UnsplitChunk], work: UnitWork) -> None:
    """Groups of one rendering that cannot be split."""
    wanted: dict[tuple[str, str], Recipe] = {}
    places: dict[tuple[str, str], set[int]] = {}
    for chunk in asked:
        for group in chunk.groups:
            key = group, chunk.recipe.key(group)
            wanted.setdefault(key, chunk.recipe)
            places.setdefault(key, set()).add(chunk.place)
    rendering = asked[0].rendering
    is_rendered = False
    for result, payload in make_unsplit(rendering, wanted, work.folder, work.device).items():
        _note_result(work, result, wanted[result].title, places[result], payload)
        is_rendered = is_rendered or (isinstance(payload, dict) and payload.get("reason") is None)
    work.pose_count += rendering.poses.count if is_rendered else 0
