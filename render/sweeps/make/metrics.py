"""What a sweep keeps of a batch of poses: statistics of each part of a recipe, and a row a pose where asked for.

| metric | of a pose | does not apply |
|---|---|---|
| length, length_object, length_hand, length_made | contours after all stages, in all and by kind [m] | |
| polylines | their number | |
| area | of S and R together, on all patches: what raw contours enclose, before other stages [m^2] | OC; hand mesh |
| removed_<stage> | length that a prune stage removed [m] | |
| draw_frequency_nominal | the sampling strategy's word, pauses left out [Hz] | without contours |
| draw_frequency_actual | update rate / samples of a cycle [Hz]; 0 for a still focal point | without contours |

What does not apply is NaN in columns, and not counted in statistics. These are of the columns' float32, in float64.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Any, NamedTuple, Self

import numpy as np
import warp as wp

from ....datasets.storage.schema import removed_name
from ....kernels.metrics.tally import METRICS, STATISTICS, sum_parts, tally_contours
from ...contour_batch import ContourBatch
from ...errors import SweepError
from ...hands.hand import PatchHand
from ...intersection.scene import PoseBlock, Scene
from ...runtime.stage_timing import StageClock, resolved_times, stage_times
from ...sampling.strategy import SamplingStrategy
from ...stages.registry import BY_RAW_KERNELS
from .frequency import Pacer, needs_contours
from .task import PART, SPAN

FREQUENCIES = ("draw_frequency_nominal", "draw_frequency_actual")
DRAWS_ON_CPU = True  # there it takes 3 to 10 % less than walking undrawn (measured); the bits are the same
WHOLE_NUMBERS = ("polylines",)  # columns of int32


@dataclass(frozen=True)
class Part:
    """Poses of a batch that belong to one part of one piece, one after the other."""

    piece: int
    """Which of the pieces that the batch is made of."""
    part: int
    """Which part of the recipe, counted from its first pose in steps of `PART`."""
    first: int
    """First pose, counted in the batch."""
    count: int
    """How many poses, at most `PART`; a multiple of `SPAN` unless the part ends here."""
    before: "Measured | None" = None
    """What an earlier batch measured of the poses of this part before these; None: the part begins here."""


@dataclass(frozen=True)
class Measured:
    """What of a part has been measured, that of `Part.before` included; payloads are JSON.

    A payload is {"poses": n, "poses_drawn": n, "stat": {metric: [count, sum, sum of squares, least, greatest]},
    "seconds": {stage: s}}; only finite values count, and where none does, least and greatest are None.
    """

    part: Part
    contours: dict[str, Any]
    """Metrics length, length_object, length_hand, length_made, polylines, area, removed_<stage>."""
    frequency: tuple[dict[str, Any], ...]
    """Metrics draw_frequency_nominal, draw_frequency_actual, for each sampling strategy of the part's piece."""
    columns: tuple[dict[str, np.ndarray], ...] = field(default=())
    """If asked, for each sampling strategy a row for each of the part's poses in this batch, those before left out."""


def measure_batch(
    scene: Scene,
    pose: np.ndarray | wp.array,
    parts: Sequence[Part],
    *,
    device: str,
    samplings: Sequence[Sequence[SamplingStrategy]],
    per_pose: bool = False,
    first: int = 0,
    point_limit: int | None = None,
    timing: dict[str, float] | None = None,
) -> list[Measured]:
    """Render a batch of poses and measure it, nothing but statistics leaving the device; one result a part, in order.

    pose: float32, shape [pose, 7], or wp.transform [pose] on the device: those of all parts. samplings: of each piece,
    empty where draw frequencies are not asked for. first: row of the motion that `pose` begins at, for what is
    articulated or moves. timing: takes the seconds of each stage. Results do not depend, to the bit, on how parts are
    put into batches, nor on the device.
    Raises PointLimitError before memory is taken for more points than `point_limit`, which none is on a GPU where
    lengths are enough (`Scene.is_drawn_to_measure`, `needs_contours`); SweepError for parts that are not within the
    batch, and for one that goes on in the middle of a span.
    """
    _require_parts(parts, len(pose), len(samplings))
    clock = stage_times(device)
    pieces = dict.fromkeys(part.piece for part in parts)
    asked = list(dict.fromkeys(chain.from_iterable(samplings[piece] for piece in pieces)))
    draws = DRAWS_ON_CPU and wp.get_device(device).is_cpu
    if draws or scene.is_drawn_to_measure or any(map(needs_contours, asked)):
        tallied = _tallied(scene, pose, first, device, point_limit, clock, len(asked))
    else:
        tallied = _tallied_undrawn(scene, pose, first, device, clock, len(asked))
    with StageClock(clock, "frequency", device):
        _pace(tallied, asked)
    with StageClock(clock, "measure", device):
        sums = _sums(tallied, parts, asked, samplings, device)
    found = sums.numpy()  # the one download; waits for all that was asked of the device
    seconds = resolved_times(clock)
    if timing is not None:
        timing |= {stage: timing.get(stage, 0.0) + s for stage, s in seconds.items()}
    pacing = {"frequency": seconds.pop("frequency") / max(1, len(asked))}
    before = [None if part.before is None else part.before.contours for part in parts]
    contours = _payloads(parts, tallied.names, found, before, seconds, len(pose))
    drawn = [payload["poses_drawn"] for payload in contours]
    frequency = []
    for k, strategy in enumerate(asked):
        own = found[:, len(tallied.names) + 2 * k :][:, :2]
        before = _paced_before(parts, strategy, samplings)
        frequency.append(_payloads(parts, FREQUENCIES, own, before, pacing, len(pose), drawn))
    numbers = {piece: [asked.index(strategy) for strategy in samplings[piece]] for piece in pieces}
    columns = _columns(tallied, parts, numbers) if per_pose else [()] * len(parts)
    paced = [tuple(frequency[s][k] for s in numbers[part.piece]) for k, part in enumerate(parts)]
    ended = [part if part.before is None else replace(part, before=None) for part in parts]  # it is in the payloads
    return [Measured(*row) for row in zip(ended, contours, paced, columns, strict=True)]


def _require_parts(parts: Sequence[Part], pose_count: int, piece_count: int) -> None:
    """Raise SweepError for parts that no batch has."""
    for part in parts:
        done = 0 if part.before is None else part.before.contours["poses"]
        name = f"part {part.part} of piece {part.piece}"
        if not 0 <= part.piece < piece_count:
            raise SweepError(f"{name}: there are samplings for {piece_count} pieces")
        if part.count < 1 or not 0 <= part.first <= pose_count - part.count:
            raise SweepError(f"{name}: poses {part.first}..{part.first + part.count} of a batch of {pose_count}")
        if done % SPAN or done + part.count > PART:
            raise SweepError(
                f"{name} goes on after {done} poses with {part.count}: whole spans of {SPAN} must stand before, and a "
                f"part has {PART} poses at most"
            )


class Tallied(NamedTuple):
    """A batch and what is known of each of its poses, on the device."""

    batch: ContourBatch | None  # None: not drawn
    names: tuple[str, ...]  # of metrics of contours
    value: wp.array  # those, then FREQUENCIES of each sampling strategy, float32, shape [metric, pose]
    length: wp.array  # of all contours [m], float64, shape [pose]


def _tallied(
    scene: Scene,
    pose: np.ndarray | wp.array,
    first: int,
    device: str,
    limit: int | None,
    clock: dict[str, float],
    paced: int,
) -> Tallied:
    """Render and measure, with room for so many sampling strategies.

    The area is of raw contours, since stages may leave what encloses something else.
    """
    block = PoseBlock(pose, first, device, limit, clock)
    batch = scene.raw_contours(block)
    encloses = scene.strategy.closes and isinstance(scene.hand, PatchHand)
    stages = [stage.name for stage in scene.strategy.prune_stages if stage.name not in BY_RAW_KERNELS]
    names = (*METRICS, *dict.fromkeys(map(removed_name, stages)))
    value = wp.empty((len(names) + 2 * paced, batch.pose_count), dtype=wp.float32, device=device)
    length = wp.empty(batch.pose_count, dtype=wp.float64, device=device)
    if not encloses:
        value[METRICS.index("area")].fill_(np.nan)
    removed: dict[str, np.ndarray] = {}
    if not scene.is_raw:
        if encloses:
            tally_contours(batch, value, length, measures=False, encloses=True)
        batch, removed = scene.staged(batch, block)
        batch = batch.to(device)
    with StageClock(clock, "measure", device):
        tally_contours(batch, value, length, measures=True, encloses=encloses and scene.is_raw)
        for row, name in enumerate(names[len(METRICS) :], len(METRICS)):
            total = sum(gone for stage, gone in removed.items() if removed_name(stage) == name)
            value[row].assign(np.asarray(total, np.float32))
    return Tallied(batch, names, value, length)


def _tallied_undrawn(
    scene: Scene, pose: np.ndarray | wp.array, first: int, device: str, clock: dict[str, float], paced: int
) -> Tallied:
    """The same of contours that are raw and exact, and not drawn: a GPU takes longer to write points than to walk."""
    value = wp.empty((len(METRICS) + 2 * paced, len(pose)), dtype=wp.float32, device=device)
    length = wp.empty(len(pose), dtype=wp.float64, device=device)
    scene.tally(PoseBlock(pose, first, device, timing=clock), value, length)
    return Tallied(None, METRICS, value, length)


@dataclass(frozen=True)
class Spans:
    """Which poses of a batch are added up, in which order; on the device."""

    first: wp.array
    """First pose of each span, int64, shape [span]."""
    count: wp.array
    """Its poses, int64, shape [span]."""
    part_start: wp.array
    """Offsets of parts into spans, int64, shape [part + 1]."""

    @classmethod
    def of(cls, parts: Sequence[Part], device: str) -> Self:
        """The spans of parts, each counted from the part's first pose."""
        first, count = (np.array([getattr(part, name) for part in parts], np.int64) for name in ("first", "count"))
        spans = -(-count // SPAN)
        start = np.concatenate([[0], np.cumsum(spans)])
        place = SPAN * (np.arange(start[-1]) - np.repeat(start[:-1], spans))  # within the part
        left = np.minimum(np.repeat(count, spans) - place, SPAN)
        table = np.concatenate([np.repeat(first, spans) + place, left, start])
        on_device = wp.array(table, dtype=wp.int64, device=device)  # one upload
        return cls(on_device[: start[-1]], on_device[start[-1] : 2 * start[-1]], on_device[2 * start[-1] :])


def _pace(tallied: Tallied, asked: Sequence[SamplingStrategy]) -> None:
    """Draw frequencies of all poses by every strategy, into their rows."""
    pacer = Pacer(tallied.batch, tallied.length)
    for row, strategy in enumerate(asked):
        first = len(tallied.names) + 2 * row
        pacer.frequencies(strategy, tallied.value[first : first + 2])


def _sums(
    tallied: Tallied,
    parts: Sequence[Part],
    asked: Sequence[SamplingStrategy],
    samplings: Sequence[Sequence[SamplingStrategy]],
    device: str,
) -> wp.array:
    """Statistics of each part on the device, those of earlier batches included, shape [part, metric, statistic]."""
    begun = None
    if any(part.before is not None for part in parts):
        contours = [None if part.before is None else part.before.contours for part in parts]
        rates = [_begun(FREQUENCIES, _paced_before(parts, strategy, samplings)) for strategy in asked]
        table = np.concatenate([_begun(tallied.names, contours), *rates], axis=1)
        begun = wp.array(table, dtype=wp.float64, device=device)
    spans = Spans.of(parts, device)
    return sum_parts(tallied.value, spans.first, spans.count, spans.part_start, begun)


def _begun(names: Sequence[str], before: Sequence[dict[str, Any] | None]) -> np.ndarray:
    """Statistics that payloads tell, shape [part, metric, statistic]."""
    begun = np.zeros((len(before), len(names), len(STATISTICS)))
    begun[..., 3:5] = np.inf, -np.inf
    for part, payload in enumerate(before):
        if payload is not None:
            for row, name in enumerate(names):
                known = payload["stat"][name]
                used = 5 if known[0] else 3  # without values there is no least
                begun[part, row, :used] = known[:used]
            begun[part, :, 5] = payload["poses_drawn"]
    return begun


def _paced_before(
    parts: Sequence[Part], strategy: SamplingStrategy, samplings: Sequence[Sequence[SamplingStrategy]]
) -> list[dict[str, Any] | None]:
    """What earlier batches told of a strategy's draw frequencies, a part each."""
    place = [list(own).index(strategy) if strategy in own else None for own in samplings]
    return [
        None if part.before is None or (at := place[part.piece]) is None else part.before.frequency[at]
        for part in parts
    ]


def _payloads(
    parts: Sequence[Part],
    names: Sequence[str],
    sums: np.ndarray,
    before: Sequence[dict[str, Any] | None],
    seconds: dict[str, float],
    pose_count: int,
    drawn: Sequence[int] | None = None,
) -> list[dict[str, Any]]:
    """What is stored of each part; seconds: of the whole batch of so many poses; drawn: None for the first metric's."""
    out, rows = [], sums.tolist()
    for k, part in enumerate(parts):
        own = before[k] or {"poses": 0, "seconds": {}}
        known = own["seconds"]
        stat = {
            name: [int(row[0]), row[1], row[2], *(row[3:5] if row[0] else (None, None))]
            for name, row in zip(names, rows[k], strict=False)  # frequencies follow
        }
        share = known | {stage: known.get(stage, 0.0) + s * part.count / pose_count for stage, s in seconds.items()}
        poses_drawn = int(rows[k][0][5]) if drawn is None else drawn[k]
        out.append({"poses": own["poses"] + part.count, "poses_drawn": poses_drawn, "stat": stat, "seconds": share})
    return out


def _columns(
    tallied: Tallied, parts: Sequence[Part], numbers: Mapping[int, Sequence[int]]
) -> list[tuple[dict[str, np.ndarray], ...]]:
    """A row a pose of each part, for each sampling strategy of its piece; numbers: of those of a piece, in the rows."""
    count, table = len(tallied.names), tallied.value.numpy()
    values = dict(zip(tallied.names, table[:count], strict=True))
    values |= {name: values[name].astype(np.int32) for name in WHOLE_NUMBERS}
    out = []
    for part in parts:
        done = part.part * PART + (0 if part.before is None else part.before.contours["poses"])
        pose = {"pose": np.arange(done, done + part.count)}
        rows = slice(part.first, part.first + part.count)
        own = []
        for number in numbers[part.piece]:
            rates = table[count + 2 * number :][:2]
            columns = values | dict(zip(FREQUENCIES, rates, strict=True))
            own.append(pose | {name: value[rows].copy() for name, value in columns.items()})
        out.append(tuple(own))
    return out
