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
import os
import shutil
import signal
import tempfile
import time
import warnings
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from ....datasets.errors import DatasetError
from ....datasets.sweeps.result_row import Columns, ResultRow
from ....datasets.sweeps.store import Key
from ....device.errors import DeviceError
from ...errors import PalpateWarning, RenderError, StrategyError, SweepError
from ...intersection.batch_rendering import is_too_large
from ..plan.code_version import code_version
from ..plan.recipe import WHOLE_GROUPS, is_user_metric
from ..plan.user_metric import load_planned, shown_name
from .batch import (
    AskedMetrics,
    BatchSize,
    PoseRange,
    RenderedChunk,
    batch_capacity,
    learned_size,
    point_limit,
    poses_of,
    take_batch,
)
from .metrics import ChunkSlice, UserMetric, measure_batch
from .rendering import AskedResult, Rendering, read_recipe, recipe_cache
from .sampling_groups import SampledAlike, divide_results
from .unit import CHUNK_POSES, SPAN, Chunk, FailedChunk, Unit, UnitResult, text_of, this_process
from .unsplit import Payloads, make_unsplit

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
            is_signal = not is_elsewhere or signal.getsignal(signal.SIGINT) is not signal.SIG_IGN
            if isinstance(error, KeyboardInterrupt) and is_signal:
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
    rendered, unsplit = _load_chunks(work)
    families: dict[str, list[RenderedChunk]] = {}
    for own in rendered:
        alone = "" if own.rendering.is_fusable else f" {own.rendering.key} {own.number}"
        families.setdefault(own.rendering.family + alone, []).append(own)
    for family in families.values():
        _render_family(family, work)
    alike, alone = divide_results(unsplit, work.device)
    for shared in alike:
        for own in _sample_alike(shared, work):
            alone.setdefault(own.rendering.key, []).append(own)
    for asked in alone.values():
        _add_unsplit(make_unsplit(asked, work.folder, work.device), work)


def _load_chunks(work: UnitWork) -> tuple[list[RenderedChunk], list[AskedResult]]:
    """All that the unit's chunks ask for, each once, with what their recipes name; what cannot be loaded has failed."""
    renderings: dict[str, Rendering] = {}  # by recipe
    metrics: dict[str, AskedMetrics] = {}  # by rendering
    rendered: dict[tuple[str, int], RenderedChunk] = {}
    unsplit: dict[Key, AskedResult] = {}
    for place, chunk in enumerate(work.unit.chunks):
        title = f"chunk {place}"
        try:
            recipe = read_recipe(chunk.recipe)
            title = recipe.title
            if work.unit.parent == this_process() and runs_python(chunk):
                raise SweepError(
                    "it runs Python, which a sweep runs in other processes only, as nothing could end a stage that "
                    "hangs in this one: give run_sweep an executor of processes, not of threads"
                )
            if chunk.recipe not in renderings:
                cache = recipe_cache(work.device)
                renderings[chunk.recipe] = cache.rendering(recipe, allow_code=work.unit.granted)
            rendering = renderings[chunk.recipe]
            if chunk.number * CHUNK_POSES >= rendering.poses.count:
                raise SweepError(f"it has no chunk {chunk.number}, as its motion has {rendering.poses.count} poses")
        except Exception as error:  # of a user's module, too
            work.fail([place], title, error)
            continue
        for group in chunk.groups:
            try:
                metric = work.user_metric(group) if is_user_metric(group) else None
            except RenderError as error:
                work.fail([place], title, error)
                continue
            own = AskedResult(group, recipe, rendering, metric)
            if group in WHOLE_GROUPS:
                unsplit.setdefault((group, own.key), own).places.add(place)
                continue
            asked = metrics.setdefault(rendering.key, AskedMetrics())
            shared = RenderedChunk(rendering, chunk.number, asked)
            rendered.setdefault((rendering.key, chunk.number), shared).ask(own, place)
    return list(rendered.values()), list(unsplit.values())


def _render_family(chunks: Sequence[RenderedChunk], work: UnitWork) -> None:
    """Chunks of one scene, in batches."""
    rendering = chunks[0].rendering
    capacity = batch_capacity(rendering.scene.pose_bytes, work.device)
    size = learned_size(rendering.family, work.device, capacity)
    if rendering.has_own_stages:
        size = BatchSize(capacity, work.device, is_fixed=True)
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
        chunk, asked = own.chunk, own.chunk.metrics
        slices.append(ChunkSlice(chunk.number, at, own.count, asked.samplings, asked.user_metrics, chunk.measured))
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


def _sample_alike(shared: SampledAlike, work: UnitWork) -> list[AskedResult]:
    """Make results of motions in groups; returns those that are left after a group failed as a whole."""
    left = list(shared.motions.values())
    try:
        for payloads in shared.make(work.device, work.folder):
            _add_unsplit(payloads, work)
            left.pop(0)
    except Exception:  # of one motion: making each alone finds which
        return [own for asked in left for own in asked]
    return []


def _add_unsplit(payloads: Payloads, work: UnitWork) -> None:
    """Add results of all poses of a rendering, or note why there are none."""
    for own, payload in payloads.items():
        if isinstance(payload, Exception):
            work.fail(own.places, f"{own.recipe.title} ({own.group})", payload)
        else:
            work.add((own.group, own.key), 0, payload)
    if any(isinstance(payload, dict) and payload.get("reason") is None for payload in payloads.values()):
        work.pose_count += next(iter(payloads)).rendering.poses.count


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
    from ...stages.registry import known_stages

    recipe = read_recipe(chunk.recipe)
    described = recipe.strategy["described"]
    has_code = recipe.thing.get("function") is not None or bool(described.get("modules"))
    if has_code or any(map(is_user_metric, chunk.groups)):
        return True
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
    """Whether the system failed, or an error that it caused, in a way that may pass; never so in a user's code."""
    if error is None or isinstance(error, StrategyError | SweepError):
        return False
    return (isinstance(error, OSError) and error.errno in TRANSIENT) or is_transient(error.__cause__)
