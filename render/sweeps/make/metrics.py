"""Measuring a batch of poses: statistics of each chunk of a recipe, and a row a pose where asked for.

| metric | of a pose | does not apply |
|---|---|---|
| length, length_object, length_hand, length_made | contours after all stages, in all and by kind [m] | |
| length_intensity | integral of the intensity along contours [m] | |
| polylines | their number | |
| area | of S and R together, on all patches: what raw contours enclose, before other stages [m^2] | OC; hand mesh |
| facing_30, facing_60 | whether the palm faces the array's centre within so many degrees: 1 or 0 | without contours |
| removed_<stage> | length that a prune stage removed [m] | |
| draw_frequency_nominal | by the sampling strategy, pauses left out [Hz] | without contours |
| draw_frequency_actual | update rate / samples of a cycle [Hz]; 0 for a still focal point | without contours |

A metric that does not apply to a pose is NaN in columns and does not count in statistics, which are those of the
columns' float32 values, added up in float64.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from ....datasets.motions.facing import SHARE_ANGLES
from ....datasets.storage.schema import removed_name
from ....kernels.metrics.tally import METRICS, STATISTICS, count_bins, count_facing, sum_parts, tally_contours
from ...contour_batch import ContourBatch
from ...errors import SweepError
from ...hands.hand import PatchHand
from ...intersection.scene import PoseBlock, Scene
from ...runtime.stage_timing import StageClock, resolved_times, stage_times
from ...sampling.strategy import SamplingStrategy
from ...stages.registry import BY_RAW_KERNELS
from . import histogram
from .frequency import Pacer
from .unit import CHUNK_POSES, SPAN, text_of

Payload = dict[str, Any]
Numbers = dict[str, np.ndarray]
"""A number for each pose, by key; of a function that returns one array, the key is empty."""


@dataclass(frozen=True)
class UserMetric:
    """A function of contours, and the group of its results."""

    group: str
    source: str
    """`file.py:function` or `package.module:function`, for messages."""
    function: Callable[[ContourBatch], Any] = field(compare=False)

    def numbers(self, contours: ContourBatch) -> Numbers:
        """The function's numbers of poses, float64; raises SweepError, naming what came and what is expected."""
        for array in contours.by_name().values():
            array.flags.writeable = False  # other metrics see the same arrays
        try:
            found = self.function(contours)
        except BaseException as error:  # in a worker, whose Ctrl-C is its parent's: all of these are the function's own
            raise SweepError(f"metric {self.source}: raised {type(error).__name__}: {text_of(error)}") from error
        if not isinstance(found, Mapping):
            return {"": self._checked(found, "", contours.pose_count)}
        if not found or not all(isinstance(key, str) and key.isidentifier() for key in found):
            keys = ", ".join(f"{key!r:.40}" for key in found) or "none"
            raise SweepError(f"metric {self.source}: the keys of its dict must be names such as 'corners', not {keys}")
        return {key: self._checked(found[key], f" as {key!r}", contours.pose_count) for key in sorted(found)}

    def _checked(self, found: Any, key: str, pose_count: int) -> np.ndarray:
        """Numbers as float64, shape [pose]."""
        wanted = f"metric {self.source}: must return{key} one number per pose, an array of shape [{pose_count}]"
        try:
            array = np.asarray(found)
        except Exception as error:  # of lists of several lengths, and of whatever has an __array__
            raise SweepError(f"{wanted}, not {type(found).__name__} ({error})") from error
        if array.dtype.kind not in "biuf":
            raise SweepError(f"{wanted}, not {type(found).__name__} of {array.dtype} ({found!r:.60})")
        if array.shape != (pose_count,):
            raise SweepError(f"{wanted}, not of shape {list(array.shape)}")
        numbers = array.astype(np.float64)
        if np.isinf(numbers).any():
            first = int(np.flatnonzero(np.isinf(numbers))[0])
            raise SweepError(f"{wanted}, each finite or NaN, not {numbers[first]} at pose {first} of the span")
        return numbers


def measure(metric: UserMetric, batch: ContourBatch, first: int, count: int, before: Payload | None) -> Payload:
    """What is stored of poses first..first + count of a batch on the host, which begin at a span of their chunk.

    before: what is stored of the poses of the chunk before these. Returns {"poses": n, "stat": {key: [count, sum, sum
    of squares, least, greatest]}, "seconds": {"metrics": s}}; NaN does not count.
    Raises SweepError for what is no number per pose, and for other keys than before.
    """
    started = perf_counter()
    known = before or {"poses": 0, "stat": {}, "seconds": {"metrics": 0.0}}
    stat: dict[str, list[Any]] = known["stat"]
    for begin in range(first, first + count, SPAN):
        numbers = metric.numbers(batch.select(begin, min(begin + SPAN, first + count)))
        if stat and set(numbers) != set(stat):
            raise SweepError(
                f"metric {metric.source}: must return the same keys for all poses, first {_shown(stat)}, then "
                f"{_shown(numbers)}"
            )
        stat = {key: _added(stat.get(key), own[~np.isnan(own)].tolist()) for key, own in numbers.items()}
    seconds = {"metrics": known["seconds"]["metrics"] + perf_counter() - started}
    return {"poses": known["poses"] + count, "stat": stat, "seconds": seconds}


def _added(known: Sequence[Any] | None, numbers: Sequence[float]) -> list[Any]:
    """Statistics with those of one more span, whose sums are exact before they are rounded."""
    count, total, square, least, greatest = known or (0, 0.0, 0.0, None, None)
    if not numbers:
        return [count, total, square, least, greatest]
    return [
        count + len(numbers),
        total + math.fsum(numbers),
        square + math.fsum(number * number for number in numbers),
        min(numbers) if least is None else min(least, *numbers),
        max(numbers) if greatest is None else max(greatest, *numbers),
    ]


def _shown(keys: Mapping[str, Any]) -> str:
    return ", ".join(key or "one array" for key in keys)


FACING = tuple(f"facing_{degrees}" for degrees in SHARE_ANGLES)
FREQUENCIES = ("draw_frequency_nominal", "draw_frequency_actual")
WHOLE_NUMBERS = ("polylines",)  # columns of int32


@dataclass(frozen=True)
class ChunkSlice:
    """Consecutive poses of a batch that belong to one chunk."""

    number: int
    """Of the chunk, whose first pose is `number * CHUNK_POSES` of its recipe."""
    first: int
    """Place of the first pose in the batch."""
    count: int
    """Number of poses, at most `CHUNK_POSES`; a multiple of `SPAN` unless the chunk ends here."""
    samplings: tuple[SamplingStrategy, ...] = ()
    """Strategies whose draw frequencies are asked for."""
    user_metrics: tuple[UserMetric, ...] = ()
    before: "Measured | None" = None
    """The measurement of the chunk's earlier poses, asked for the same; None where the chunk begins here."""


@dataclass(frozen=True)
class Measured:
    """The measurement of a chunk up to the end of a slice, that of `ChunkSlice.before` included; payloads are JSON.

    A payload is {"poses": n, "poses_drawn": n, "stat": {metric: [count, sum, sum of squares, least, greatest]},
    "seconds": {stage: s}}; only finite values count, and where none does, least and greatest are None. That of contours
    also has "histogram": {"length": numbers of poses in the bins of `histogram`}.
    """

    contours: dict[str, Any]
    """`METRICS` of the kernels, `FACING`, and removed_<stage>."""
    frequency: tuple[dict[str, Any], ...]
    """`FREQUENCIES` of each sampling strategy of the slice."""
    user_metrics: dict[str, dict[str, Any] | SweepError]
    """By group: the payload that `user_metrics.measure` returns, or why there is none."""
    columns: tuple[dict[str, np.ndarray], ...] = ()
    """If asked for: of each sampling strategy a row for each pose of the slice, without those before."""


def measure_batch(
    scene: Scene,
    pose: np.ndarray | wp.array,
    slices: Sequence[ChunkSlice],
    *,
    device: str,
    per_pose: bool = False,
    first: int = 0,
    point_limit: int | None = None,
) -> list[Measured]:
    """Render a batch of poses and measure it; returns one result a slice, in order.

    Only statistics leave the device, unless columns or user metrics are asked for. Results are bit-identical however
    slices are put into batches, and on every device.
    pose: of all slices, float32, shape [pose, 7], or wp.transform [pose] on the device. per_pose: whether columns are
    asked for. first: row of the motion that `pose` begins at, for hands that are posed row by row and objects that
    move.
    Raises PointLimitError before memory is taken for more points than `point_limit`; SweepError for slices that are not
    within the batch, and for one that goes on in the middle of a span.
    """
    _require_slices(slices, len(pose))
    clock = stage_times(device)
    asked = list(dict.fromkeys(chain.from_iterable(own.samplings for own in slices)))
    has_user_metrics = any(own.user_metrics for own in slices)
    tallied = _tallied(scene, PoseBlock(pose, first, device, point_limit, clock), len(asked))
    with StageClock(clock, "measure", device):  # whether the palm faces the array; of several patches, their frame
        row = tallied.names.index(FACING[0])
        placed = pose if isinstance(pose, wp.array) else wp.array(pose, dtype=wp.transform, device=device)
        rows = tallied.value[row : row + len(FACING)]
        count_facing(placed, tallied.value[METRICS.index("length")], SHARE_ANGLES, rows)
    with StageClock(clock, "frequency", device):
        pacer = Pacer(tallied.batch, tallied.length)
        for number, strategy in enumerate(asked):
            row = len(tallied.names) + 2 * number
            pacer.frequencies(strategy, tallied.value[row : row + 2])
    with StageClock(clock, "measure", device):
        spans, length = _spans(slices, device), tallied.value[METRICS.index("length")]
        sums = sum_parts(tallied.value, *spans, _begun(tallied, slices, asked, device))
        lowest, highest = histogram.LOWEST, histogram.HIGHEST
        counted = count_bins(length, *spans, lowest=lowest, highest=highest, bits=histogram.BITS)
    found, bins = sums.numpy(), counted.numpy()  # the first downloads: they wait for all work of the device
    seconds = resolved_times(clock)
    pacing = {"frequency": seconds.pop("frequency") / max(1, len(asked))}
    before = [None if own.before is None else own.before.contours for own in slices]
    contours = _payloads(slices, tallied.names, found, before, seconds, len(pose))
    for own, count in zip(slices, bins, strict=True):
        if own.before is not None:
            count += histogram.merge([own.before.contours["histogram"]["length"]])
    for payload, numbers in zip(contours, histogram.describe(bins), strict=True):
        payload["histogram"] = {"length": numbers}
    drawn = [payload["poses_drawn"] for payload in contours]
    frequency = []
    for k, strategy in enumerate(asked):
        own, before = found[:, len(tallied.names) + 2 * k :][:, :2], _frequency_before(slices, strategy)
        frequency.append(_payloads(slices, FREQUENCIES, own, before, pacing, len(pose), drawn))
    places = [[asked.index(strategy) for strategy in own.samplings] for own in slices]
    paced = [tuple(frequency[place][k] for place in own) for k, own in enumerate(places)]
    columns = _columns(tallied, slices, places) if per_pose else [()] * len(slices)
    users = _user_metrics(tallied, slices) if has_user_metrics else [{}] * len(slices)
    return [Measured(*row) for row in zip(contours, paced, users, columns, strict=True)]


def _user_metrics(tallied: "Tallied", slices: Sequence[ChunkSlice]) -> list[dict[str, dict[str, Any] | SweepError]]:
    """Payloads of users' metrics of each slice; an error of one is the result of its own group."""
    host, out = tallied.batch.numpy(), []
    for own in slices:
        before = {} if own.before is None else own.before.user_metrics
        found: dict[str, dict[str, Any] | SweepError] = {}
        for metric in own.user_metrics:
            known = before.get(metric.group)
            try:
                is_failed = isinstance(known, SweepError)
                found[metric.group] = known if is_failed else measure(metric, host, own.first, own.count, known)
            except SweepError as error:
                found[metric.group] = error
        out.append(found)
    return out


def _require_slices(slices: Sequence[ChunkSlice], pose_count: int) -> None:
    """Raise SweepError for slices that no batch has."""
    for own in slices:
        done = 0 if own.before is None else own.before.contours["poses"]
        name = f"chunk {own.number}"
        if own.count < 1 or not 0 <= own.first <= pose_count - own.count:
            raise SweepError(f"{name}: poses {own.first}..{own.first + own.count} of a batch of {pose_count}")
        if done % SPAN or done + own.count > CHUNK_POSES:
            raise SweepError(
                f"{name} goes on after {done} poses with {own.count}: whole spans of {SPAN} must stand before, and a "
                f"chunk has {CHUNK_POSES} poses at most"
            )


class Tallied(NamedTuple):
    """A batch and the metrics of each of its poses, on the device."""

    batch: ContourBatch
    names: tuple[str, ...]  # of metrics of contours
    value: wp.array  # those, then FREQUENCIES of each sampling strategy, float32, shape [metric, pose]
    length: wp.array  # of all contours [m], float64, shape [pose]


def _tallied(scene: Scene, block: PoseBlock, paced: int) -> Tallied:
    """Render and measure poses, with room for the frequencies of `paced` sampling strategies.

    The area is of raw contours, as the lines that stages make may enclose something else.
    """
    stages = [stage.name for stage in scene.strategy.prune_stages if stage.name not in BY_RAW_KERNELS]
    names = (*METRICS, *FACING, *dict.fromkeys(map(removed_name, stages)))
    value = wp.empty((len(names) + 2 * paced, len(block.pose)), dtype=wp.float32, device=block.device)
    length = wp.empty(len(block.pose), dtype=wp.float64, device=block.device)
    batch = scene.raw_contours(block)
    encloses = scene.strategy.closes and isinstance(scene.hand, PatchHand)
    if not encloses:
        value[METRICS.index("area")].fill_(np.nan)
    removed: dict[str, np.ndarray] = {}
    if not scene.is_raw:
        if encloses:
            tally_contours(batch.struct, value, length, measures=False, encloses=True)
        batch, removed = scene.staged(batch, block)
        batch = batch.to(block.device)
    with StageClock(block.timing, "measure", block.device):
        tally_contours(batch.struct, value, length, measures=True, encloses=encloses and scene.is_raw)
        for row, name in enumerate(names[len(METRICS) + len(FACING) :], len(METRICS) + len(FACING)):
            total = sum(gone for stage, gone in removed.items() if removed_name(stage) == name)
            value[row].assign(np.asarray(total, np.float32))
    return Tallied(batch, names, value, length)


def _spans(slices: Sequence[ChunkSlice], device: str) -> tuple[Any, Any, Any]:
    """The spans of slices in the order in which they are added up: first pose, number of poses, first span of a slice.

    int64 on the device, shapes [span], [span] and [slice + 1].
    """
    first, count = (np.array([getattr(own, name) for own in slices], np.int64) for name in ("first", "count"))
    spans = -(-count // SPAN)
    start = np.concatenate([[0], np.cumsum(spans)])
    place = SPAN * (np.arange(start[-1]) - np.repeat(start[:-1], spans))  # within the slice
    left = np.minimum(np.repeat(count, spans) - place, SPAN)
    table = np.concatenate([np.repeat(first, spans) + place, left, start])
    on_device = wp.array(table, dtype=wp.int64, device=device)  # one upload
    return on_device[: start[-1]], on_device[start[-1] : 2 * start[-1]], on_device[2 * start[-1] :]


def _begun(
    tallied: Tallied, slices: Sequence[ChunkSlice], asked: Sequence[SamplingStrategy], device: str
) -> wp.array | None:
    """Statistics of earlier batches, shape [slice, metric, statistic]; None if all slices begin a chunk."""
    if all(own.before is None for own in slices):
        return None
    contours = [None if own.before is None else own.before.contours for own in slices]
    tables = [_statistics(FREQUENCIES, _frequency_before(slices, strategy)) for strategy in asked]
    table = np.concatenate([_statistics(tallied.names, contours), *tables], axis=1)
    return wp.array(table, dtype=wp.float64, device=device)


def _statistics(names: Sequence[str], payloads: Sequence[dict[str, Any] | None]) -> np.ndarray:
    """Statistics of payloads, shape [payload, metric, statistic]."""
    table = np.zeros((len(payloads), len(names), len(STATISTICS)))
    table[..., 3:5] = np.inf, -np.inf
    for number, payload in enumerate(payloads):
        if payload is not None:
            for row, name in enumerate(names):
                known = payload["stat"][name]
                used = 5 if known[0] else 3  # without values there is no least
                table[number, row, :used] = known[:used]
            table[number, :, 5] = payload["poses_drawn"]
    return table


def _frequency_before(slices: Sequence[ChunkSlice], strategy: SamplingStrategy) -> list[dict[str, Any] | None]:
    """The payload of a strategy's draw frequencies that earlier batches measured of each slice's chunk."""
    return [
        own.before.frequency[own.samplings.index(strategy)] if own.before and strategy in own.samplings else None
        for own in slices
    ]


def _payloads(
    slices: Sequence[ChunkSlice],
    names: Sequence[str],
    sums: np.ndarray,
    before: Sequence[dict[str, Any] | None],
    seconds: dict[str, float],
    pose_count: int,
    drawn: Sequence[int] | None = None,
) -> list[dict[str, Any]]:
    """The payload of each slice's chunk.

    before: payloads of earlier batches. seconds: of the whole batch of `pose_count` poses. drawn: poses with contours,
    by default those of the first metric.
    """
    out, rows = [], sums.tolist()
    for k, own in enumerate(slices):
        begun = before[k] or {"poses": 0, "seconds": {}}
        known = begun["seconds"]
        stat = {
            name: [int(row[0]), row[1], row[2], *(row[3:5] if row[0] else (None, None))]
            for name, row in zip(names, rows[k], strict=False)  # frequencies follow
        }
        share = known | {stage: known.get(stage, 0.0) + s * own.count / pose_count for stage, s in seconds.items()}
        poses_drawn = int(rows[k][0][5]) if drawn is None else drawn[k]
        out.append({"poses": begun["poses"] + own.count, "poses_drawn": poses_drawn, "stat": stat, "seconds": share})
    return out


def _columns(
    tallied: Tallied, slices: Sequence[ChunkSlice], places: Sequence[Sequence[int]]
) -> list[tuple[dict[str, np.ndarray], ...]]:
    """A row a pose of each slice, for each of its sampling strategies.

    places: of each slice's sampling strategies among those whose frequencies `tallied` has.
    """
    count, table = len(tallied.names), tallied.value.numpy()
    table[np.isnan(table)] = np.nan  # GPUs write a NaN of the other sign, and kept files are compared by their bytes
    values = dict(zip(tallied.names, table[:count], strict=True))
    values |= {name: values[name].astype(np.int32) for name in WHOLE_NUMBERS}
    out = []
    for own, numbers in zip(slices, places, strict=True):
        done = own.number * CHUNK_POSES + (0 if own.before is None else own.before.contours["poses"])
        pose = {"pose": np.arange(done, done + own.count)}
        rows = slice(own.first, own.first + own.count)
        blocks = []
        for number in numbers:
            rates = table[count + 2 * number :][:2]
            columns = values | dict(zip(FREQUENCIES, rates, strict=True))
            blocks.append(pose | {name: value[rows].copy() for name, value in columns.items()})
        out.append(tuple(blocks))
    return out
