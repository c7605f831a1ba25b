"""What a worker of a sweep does: make the chunks of a task, leave one shard, and report the outcome.

| poses of | rendered |
|---|---|
| a rigid hand | in batches that recipes of one object, hand and strategy share, whatever their motions |
| a hand posed by a recording | by themselves, since its rows are the motion's |
| either, too many for the memory, or for a second | in batches of whole spans of 512 poses |
| groups that cannot be split | in `sampling_groups`, many recipes at once, else in `unsplit`, recipe by recipe |

How poses are put into batches changes no bit of a result. A recipe that fails does not take others with it: a batch
that fails is made again, recipe by recipe.
"""

import contextlib
import errno
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ....datasets.errors import DatasetError
from ....datasets.sweeps.shard import ShardRow, write_shard
from ....device.errors import DeviceError
from ....kernels.offsets import PointLimitError
from ...errors import RenderError, SweepError
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
from .task import SPAN, FailedChunk, Outcome, Task, text_of
from .unsplit import make_unsplit
from .user_metrics import UserMetric

SHARDS = "shards"
NAMED = 3  # recipes that failed in an error's sentence; all are in `Outcome.failed`
TRANSIENT = {
    getattr(errno, name)
    for name in ("ENOSPC", "EDQUOT", "EFBIG", "EROFS", "EIO", "ESTALE", "ETIMEDOUT", "EAGAIN", "EMFILE", "ENFILE")
}
"""Errors of the system that may have passed when the chunk is made again."""

Progress = Callable[[Sequence[int] | None], object]
"""Takes the places of the chunks that are begun; None where these go on."""


@dataclass(eq=False)
class TaskWork:
    """A task under way: what has been made and what could not be."""

    device: str
    store: Path
    progress: Progress
    until: float = float("inf")
    """Nothing more is begun after this [s, `time.perf_counter`]."""
    rows: list[ShardRow] = field(default_factory=list)
    columns: list[dict[str, Any] | None] = field(default_factory=list)
    failed: dict[int, FailedChunk] = field(default_factory=dict)
    left: set[int] = field(default_factory=set)
    user_metrics: dict[str, UserMetric] = field(default_factory=dict)
    """By group, those that are loaded."""
    pose_count: int = 0

    @property
    def is_over(self) -> bool:
        """Whether the task's time is over, and something of it was made, so that no task goes round for ever."""
        return time.perf_counter() > self.until and bool(self.rows or self.failed)

    def add(self, row: ShardRow, columns: dict[str, Any] | None = None) -> None:
        """Put into the shard."""
        self.rows.append(row)
        self.columns.append(columns)

    def fail(self, places: Iterable[int], title: str, error: BaseException) -> None:
        """Note chunks that could not be made, the first reason of each."""
        for place in places:
            failed = FailedChunk(place, f"{title}: {reason_of(error)}", is_transient(error))
            self.failed.setdefault(place, failed)


def run_task(task: Task, device: str, *, worker: str = "", progress: Progress = lambda places: None) -> Outcome:
    """Make the chunks of a task and write their results as one shard of the store.

    device: Warp's. worker: who this is, for the outcome. progress: called when chunks are begun, and after every batch.
    Raises nothing but what ends the process: what goes wrong is in the outcome, by chunk.
    """
    started = time.perf_counter()
    work = TaskWork(device, Path(task.store), progress, started + task.seconds)
    try:
        _make(task, work)
        shard = _write(task, work)
    except Exception as error:  # whatever it is, the parent gets to know
        seconds = time.perf_counter() - started
        every = tuple(FailedChunk(place, reason_of(error), is_transient(error)) for place, _ in enumerate(task.chunks))
        message = f"task {task.number}: {reason_of(error)}"
        return Outcome(task.number, worker, seconds=seconds, error=message, failed=every)
    return Outcome(
        task.number,
        worker,
        shard,
        row_count=len(work.rows),
        pose_count=work.pose_count,
        seconds=time.perf_counter() - started,
        error=_sentence([failed.message for failed in work.failed.values()]),
        failed=tuple(work.failed[place] for place in sorted(work.failed)),
        left=tuple(sorted(work.left - work.failed.keys())),
    )


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


def _sentence(messages: Sequence[str]) -> str | None:
    """One sentence for all recipes that failed."""
    names = list(dict.fromkeys(messages))
    if not names:
        return None
    rest = f"; and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return "; ".join(names[:NAMED]) + rest


def _write(task: Task, work: TaskWork) -> str | None:
    """The shard, by its path within the store; None if there is nothing to write."""
    if not work.rows:
        return None
    name = f"{SHARDS}/{task.name}.h5"
    path = work.store / name
    with contextlib.suppress(FileExistsError):
        path.parent.mkdir()
    write_shard(path, work.rows, work.columns, maker=code_version())
    return name


def _make(task: Task, work: TaskWork) -> None:
    """All chunks: those that share batches first, then what cannot be split."""
    cache = recipe_cache(work.device)
    known: dict[
        str, tuple[Recipe, Rendering]
    ] = {}  # chunks of a recipe share a rendering, whose poses are made at once
    chunks: dict[tuple[str, int], RenderedChunk] = {}
    unsplit: list[UnsplitChunk] = []
    for place, chunk in enumerate(task.chunks):
        if time.perf_counter() > work.until and place:
            work.left.add(place)
            continue
        work.progress((place,))  # loading a mesh takes seconds
        title = f"chunk {place}"
        try:
            if chunk.recipe not in known:
                recipe = read_recipe(chunk.recipe)
                title = recipe.title
                known[chunk.recipe] = recipe, cache.rendering(recipe, allow_code=task.code)
        except Exception as error:  # of a user's module, too
            work.fail([place], title, error)
            continue
        recipe, rendering = known[chunk.recipe]
        title = recipe.title
        if chunk.groups[0] in WHOLE_GROUPS:
            unsplit.append(UnsplitChunk(place, chunk.groups, recipe, rendering))
        else:
            groups = [group for group in chunk.groups if _is_ready(group, place, title, task, work)]
            if groups:
                want_chunk(chunks, place, chunk.number, groups, recipe, rendering, work.user_metrics)
    families: dict[str, list[RenderedChunk]] = {}
    for own in chunks.values():
        alone = "" if own.rendering.is_fusable else f" {own.rendering.key} {own.number}"
        families.setdefault(own.rendering.family + alone, []).append(own)
    for family in families.values():
        _render_family(family, work)
    alike, alone = divide_chunks(unsplit, work.store, work.device)
    for shared in alike:
        for chunk in _sample_alike(shared, work):
            alone.setdefault(chunk.rendering.key, []).append(chunk)
    for asked in alone.values():
        _make_unsplit(asked, work)


def _is_ready(group: str, place: int, title: str, task: Task, work: TaskWork) -> bool:
    """Whether a group can be made: the function of a user's metric is loaded first, once; else the chunk has failed."""
    if not is_user_metric(group) or group in work.user_metrics:
        return True
    source = dict(task.user_metrics).get(group, "")
    try:
        work.user_metrics[group] = UserMetric(group, shown_name(source), load_planned(group, source, task.code))
    except RenderError as error:
        work.fail([place], title, error)
    return group in work.user_metrics


def _render_family(chunks: Sequence[RenderedChunk], work: TaskWork) -> None:
    """Chunks of one scene, in batches."""
    rendering, is_fixed = chunks[0].rendering, chunks[0].rendering.has_own_stages
    known = (rendering.family, work.device)
    first = _batches_known.get(known, POSES_FIRST["cpu" if work.device == "cpu" else "cuda"])
    size = BatchSize(batch_capacity(rendering.scene.pose_bytes, work.device), first, is_fixed=is_fixed)
    wants = wants_of(chunks)
    left = [PoseRange(chunk, chunk.first, chunk.stop) for chunk in chunks]
    lost: set[str] = set()
    while left := _wanted_still(left, lost, work):
        batch, left = take_batch(left, size.poses)
        count = sum(own.count for own in batch)
        started = time.perf_counter()
        work.progress(sorted(set().union(*(own.chunk.places for own in batch))))
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
"""Poses of the last batch of a family on a device: the next task begins with as many."""


def _wanted_still(left: Sequence[PoseRange], lost: set[str], work: TaskWork) -> list[PoseRange]:
    """What has not failed; once the task's time is over, only chunks that are begun, the others are left."""
    ranges = [own for own in left if own.chunk.rendering.key not in lost]
    if not work.is_over:
        return ranges
    for own in ranges:
        if own.chunk.measured is None:
            work.left |= own.chunk.places
    return [own for own in ranges if own.chunk.measured is not None]


def _render_alone(batch: Sequence[PoseRange], wants: Wants, work: TaskWork, error: Exception) -> set[str]:
    """Make a batch that failed again, rendering by rendering; returns those that fail by themselves."""
    keys = list(dict.fromkeys(own.chunk.rendering.key for own in batch))
    lost: set[str] = set()
    for key in keys:
        alone = [own for own in batch if own.chunk.rendering.key == key]
        places = set().union(*(own.chunk.places for own in alone))
        work.progress(sorted(places))
        try:
            if len(keys) == 1:
                raise error
            _render_batch(alone, wants, work)
        except Exception as reason:
            lost.add(key)
            work.fail(places, alone[0].chunk.rendering.name, reason)
    return lost


def _render_batch(batch: Sequence[PoseRange], wants: Wants, work: TaskWork) -> None:
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


def _add_rows(chunk: RenderedChunk, wants: RenderingWants, work: TaskWork) -> None:
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
        work.add(ShardRow(group, key, chunk.number, {**payload, "seconds": rendering | own}), columns)
        rendering = {}


def _sample_alike(shared: SampledAlike, work: TaskWork) -> list[UnsplitChunk]:
    """Results of motions in groups; returns the chunks that are left, after a group that failed as a whole."""
    left = dict(shared.asked)
    places = {chunk.place for chunks in left.values() for chunk in chunks}
    work.progress(sorted(places))
    try:
        for group in shared.groups(work.device, work.store, tick=lambda: work.progress(None)):
            for chunks, results in group:
                recipe = chunks[0].recipe
                for name, payload in results.items():
                    asking = {chunk.place for chunk in chunks if name in chunk.groups}
                    _note_result(work, (name, recipe.key(name)), recipe.title, asking, payload)
                work.pose_count += chunks[0].rendering.poses.count
                del left[recipe.key("sampling")]
                places -= {chunk.place for chunk in chunks}
            work.progress(sorted(places))
            if work.is_over:
                break
    except Exception:  # of one motion, as making each alone tells
        return [chunk for chunks in left.values() for chunk in chunks]
    work.left |= places
    return []


def _note_result(
    work: TaskWork, result: tuple[str, str], title: str, places: Iterable[int], payload: dict[str, Any] | Exception
) -> None:
    """A row of the shard, or why there is none."""
    if isinstance(payload, Exception):
        work.fail(places, f"{title} ({result[0]})", payload)
    else:
        work.add(ShardRow(*result, 0, payload))


def _make_unsplit(asked: Sequence[UnsplitChunk], work: TaskWork) -> None:
    """Groups of one rendering that cannot be split."""
    asking = {chunk.place for chunk in asked}
    if work.is_over:
        work.left |= asking
        return
    work.progress(sorted(asking))
    wanted: dict[tuple[str, str], Recipe] = {}
    places: dict[tuple[str, str], set[int]] = {}
    for chunk in asked:
        for group in chunk.groups:
            key = group, chunk.recipe.key(group)
            wanted.setdefault(key, chunk.recipe)
            places.setdefault(key, set()).add(chunk.place)
    rendering = asked[0].rendering
    is_rendered = False
    made = make_unsplit(rendering, wanted, work.store, work.device, tick=lambda: work.progress(None))
    for result, payload in made.items():
        _note_result(work, result, wanted[result].title, places[result], payload)
        is_rendered = is_rendered or (isinstance(payload, dict) and payload.get("reason") is None)
    work.pose_count += rendering.poses.count if is_rendered else 0
