"""What a worker of a sweep does: make the pieces of a task, leave one shard, and say what came of it.

| poses of | rendered |
|---|---|
| a rigid hand | in batches that recipes of one object, hand and strategy share, whatever their motions |
| a hand posed by a recording | by themselves, since its rows are the motion's |
| either, too many for the memory | in batches of whole spans of 512 poses |
| groups made in one go | in `unsplit`, recipe by recipe |

How poses are put into batches changes no bit of a result. A recipe that fails does not take others with it: a batch
that fails is made again, recipe by recipe.
"""

import contextlib
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ....datasets.errors import DatasetError
from ....datasets.sweeps.shard import ShardRow, write_shard
from ....device.errors import DeviceError
from ....kernels.offsets import PointLimitError
from ...errors import RenderError
from ...sampling.contour_sampling import SamplingStrategy
from ..plan.code_version import code_version
from ..plan.recipe import WHOLE_GROUPS, Recipe
from .batch import (
    Portion,
    Samplings,
    Stretch,
    batch_capacity,
    is_too_large,
    mended,
    plan_portions,
    point_limit,
    poses_of,
    samplings_of,
    spans_below,
    take_batch,
)
from .metrics import Part, measure_batch
from .rendering import Rendering, read_recipe, workshop_on
from .task import PART, SPAN, Outcome, Piece, Task
from .unsplit import make_whole

SHARDS = "shards"
NAMED = 3  # recipes that failed in an error's sentence; all are in `Outcome.failed`


@dataclass(eq=False)
class Work:
    """A task under way: what has been made and what could not be."""

    device: str
    store: Path
    rows: list[ShardRow] = field(default_factory=list)
    columns: list[dict[str, Any] | None] = field(default_factory=list)
    failed: dict[int, str] = field(default_factory=dict)
    pose_count: int = 0

    def add(self, row: ShardRow, columns: dict[str, Any] | None = None) -> None:
        """Put into the shard."""
        self.rows.append(row)
        self.columns.append(columns)

    def fail(self, pieces: Iterable[int], title: str, error: BaseException) -> None:
        """Note pieces that could not be made, the first reason of each."""
        for piece in pieces:
            self.failed.setdefault(piece, f"{title}: {reason_of(error)}")


def run_task(task: Task, device: str, *, worker: str = "") -> Outcome:
    """Make all pieces of a task and write their results as one shard of the store.

    device: Warp's. worker: who this is, for the outcome. Raises nothing but what ends the process: what goes wrong is
    in the outcome, by piece.
    """
    started = time.perf_counter()
    work = Work(device, Path(task.store))
    try:
        _make(task, work)
        shard = _write(task, work)
    except Exception as error:  # whatever it is, the parent is told
        seconds = time.perf_counter() - started
        every = tuple((k, reason_of(error)) for k in range(len(task.pieces)))
        return Outcome(task.number, worker, seconds=seconds, error=f"task {task.number}: {every[0][1]}", failed=every)
    return Outcome(
        task.number,
        worker,
        shard,
        part_count=len(work.rows),
        pose_count=work.pose_count,
        seconds=time.perf_counter() - started,
        error=_told(list(work.failed.values())),
        failed=tuple(sorted(work.failed.items())),
    )


def reason_of(error: BaseException) -> str:
    """What went wrong, in one sentence."""
    if isinstance(error, RenderError | DatasetError | DeviceError):
        return str(error)
    if isinstance(error, OSError):
        where = f" ({error.filename})" if error.filename else ""
        return f"{error.strerror or error}{where}"
    return f"{type(error).__name__}: {' '.join(str(error).split()) or 'no reason given'}"


def _told(sentences: Sequence[str]) -> str | None:
    """One sentence for all recipes that failed."""
    names = list(dict.fromkeys(sentences))
    if not names:
        return None
    rest = f"; and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return "; ".join(names[:NAMED]) + rest


def _write(task: Task, work: Work) -> str | None:
    """The shard, by its path within the store; None if there is nothing to write."""
    if not work.rows:
        return None
    name = f"{SHARDS}/{task.name}.h5"
    path = work.store / name
    with contextlib.suppress(FileExistsError):
        path.parent.mkdir()
    write_shard(path, work.rows, work.columns, maker=code_version())
    return name


def _make(task: Task, work: Work) -> None:
    """All pieces, the cut groups first."""
    workshop, allowed = workshop_on(work.device), task.code
    portions: dict[tuple[str, int], Portion] = {}
    whole: dict[str, list[tuple[int, Piece, Recipe, Rendering]]] = {}
    for number, piece in enumerate(task.pieces):
        title = f"piece {number}"
        try:
            recipe = read_recipe(piece.recipe)
            title = recipe.title
            rendering = workshop.rendering(recipe, allow_code=allowed)
        except Exception as error:  # of a user's module, too
            work.fail([number], title, error)
            continue
        plan_portions(portions, number, piece, recipe, rendering)
        if set(piece.groups) & set(WHOLE_GROUPS):
            whole.setdefault(rendering.key, []).append((number, piece, recipe, rendering))
    families: dict[str, list[Portion]] = {}
    for portion in portions.values():
        alone = "" if portion.rendering.is_fusable else f" {portion.rendering.key} {portion.part}"
        families.setdefault(portion.rendering.family + alone, []).append(portion)
    for family in families.values():
        _render_family(family, work)
    for asked in whole.values():
        _make_whole(asked, work)


def _render_family(portions: Sequence[Portion], work: Work) -> None:
    """Portions of one scene, in batches."""
    capacity = batch_capacity(portions[0].rendering.scene.pose_bytes, work.device)
    samplings = samplings_of(portions)
    left = [Stretch(p, p.part * PART, p.stop) for p in portions]
    lost: set[str] = set()
    while left := [stretch for stretch in left if stretch.portion.rendering.key not in lost]:
        batch, left = take_batch(left, capacity)
        try:
            _render_batch(batch, samplings, work)
        except (PointLimitError, MemoryError, RuntimeError) as error:
            count = sum(stretch.count for stretch in batch)
            if is_too_large(error) and count > SPAN:
                capacity, left = max(SPAN, spans_below(count // 2)), mended([*batch, *left])
            else:
                lost |= _render_alone(batch, samplings, work, error)
        except Exception as error:  # of one recipe, or of a user's stage
            lost |= _render_alone(batch, samplings, work, error)


def _render_alone(batch: Sequence[Stretch], samplings: Samplings, work: Work, error: Exception) -> set[str]:
    """Make a batch that failed again, rendering by rendering; returns those that fail by themselves."""
    keys = list(dict.fromkeys(stretch.portion.rendering.key for stretch in batch))
    lost: set[str] = set()
    for key in keys:
        own = [stretch for stretch in batch if stretch.portion.rendering.key == key]
        try:
            if len(keys) == 1:
                raise error
            _render_batch(own, samplings, work)
        except Exception as reason:
            lost.add(key)
            work.fail(set().union(*(stretch.portion.pieces for stretch in own)), own[0].portion.rendering.name, reason)
    return lost


def _render_batch(batch: Sequence[Stretch], samplings: Samplings, work: Work) -> None:
    """Render and measure stretches of one scene together; rows of the portions that end here are added."""
    keys = list(dict.fromkeys(stretch.portion.rendering.key for stretch in batch))
    parts, at = [], 0
    for stretch in batch:
        piece = keys.index(stretch.portion.rendering.key)
        parts.append(Part(piece, stretch.portion.part, at, stretch.count, stretch.portion.measured))
        at += stretch.count
    found = measure_batch(
        batch[0].portion.rendering.scene,
        poses_of(batch, work.device),
        parts,
        device=work.device,
        samplings=[samplings[key] for key in keys],
        per_pose=any(stretch.portion.per_pose for stretch in batch),
        first=batch[0].first,
        point_limit=None if at <= SPAN else point_limit(work.device),
    )
    work.pose_count += at
    for stretch, measured in zip(batch, found, strict=True):
        portion = stretch.portion
        portion.measured = measured
        portion.columns.append(measured.columns)
        if stretch.stop == portion.stop:
            _add_rows(portion, samplings[portion.rendering.key], work)


def _add_rows(portion: Portion, samplings: Sequence[SamplingStrategy], work: Work) -> None:
    """Rows of a portion of which all poses have been measured."""
    measured = portion.measured
    if measured is None:
        raise RuntimeError("a portion ended before it was measured")
    rendering = measured.contours["seconds"]  # told once, however many groups were made of the same contours
    for (group, key), want in portion.wanted.items():
        columns = None
        if want.sampling is None:
            payload = measured.contours
        elif group == "frequency":
            payload = measured.frequency[samplings.index(want.sampling)]
        else:
            blocks = [own[samplings.index(want.sampling)] for own in portion.columns]
            columns = {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}
            payload = {"poses": portion.stop - portion.part * PART, "seconds": {}}
        own = {} if want.sampling is None else payload["seconds"]
        work.add(ShardRow(group, key, portion.part, {**payload, "seconds": rendering | own}), columns)
        rendering = {}


def _make_whole(asked: Sequence[tuple[int, Piece, Recipe, Rendering]], work: Work) -> None:
    """Groups of one rendering that are made in one go."""
    wanted: dict[tuple[str, str], Recipe] = {}
    askers: dict[tuple[str, str], set[int]] = {}
    for number, piece, recipe, _ in asked:
        for group in [group for group in piece.groups if group in WHOLE_GROUPS]:
            place = group, recipe.key(group)
            wanted.setdefault(place, recipe)
            askers.setdefault(place, set()).add(number)
    rendering = asked[0][3]
    is_rendered = False
    for place, result in make_whole(rendering, wanted, work.store, work.device).items():
        if isinstance(result, Exception):
            work.fail(askers[place], f"{wanted[place].title} ({place[0]})", result)
        else:
            work.add(ShardRow(*place, 0, result))
            is_rendered = is_rendered or result.get("reason") is None
    work.pose_count += rendering.poses.count if is_rendered else 0
