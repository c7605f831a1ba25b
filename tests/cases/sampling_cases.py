"""Motions and sampling strategies at random, and motions that are sampled span by span, for tests of sampling."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import warp as wp
from contour_random import random_strokes

from palpate.kernels.sampling.layout import PoseSchedule
from palpate.kernels.sampling.spans import SpanRoom
from palpate.render import ContourBatch
from palpate.render.contour_batch import join_batches
from palpate.render.sampling.metrics import FocalPoints
from palpate.render.sampling.plan import plan_of, shown_order, ticks_of
from palpate.render.sampling.sampler import MotionSchedule, Sampler, drawable_contours, sample_bounds
from palpate.render.sampling.strategy import (
    AmplitudeModulation,
    Dwell,
    Gap,
    LateralModulation,
    Order,
    Pace,
    SamplingStrategy,
    Sections,
)


def random_strategy(rng):
    """A strategy of any pace, order, gap, pauses, sections, overlays and number of foci."""
    kind = str(rng.choice(["speed", "frequency", "capped", "still"], p=[0.5, 0.2, 0.2, 0.1]))
    order, points = "loop", None
    if kind != "still":
        order = str(rng.choice(["loop", "pendulum", "step", "random"], p=[0.6, 0.2, 0.1, 0.1]))
        points = int(rng.choice([7, 40])) if order in ("step", "random") or rng.random() < 0.2 else None
    in_sections = kind == "frequency" and order == "loop" and points is None and rng.random() < 0.4
    sections = Sections(int(rng.choice([2, 5, 24])), float(rng.choice([0.5, 2.0, 20.0])))
    return SamplingStrategy(
        speed=float(rng.choice([2.0, 7.0, 14.0])),
        update_rate=float(rng.choice([1000.0, 10_000.0])),
        fade=float(rng.choice([0.0, 0.005, 0.02])),
        pace=Pace(kind, points=points, frequency=float(rng.choice([5.0, 70.0]))),
        order=Order(
            order, 3, int(rng.integers(5)), str(rng.choice(["shortest", "given"], p=[0.7, 0.3])), rng.choice([0.0, 0.2])
        ),
        gap=Gap(str(rng.choice(["jump", "return", "pendulum", "close"], p=[0.4, 0.2, 0.2, 0.2]))),
        am=AmplitudeModulation() if rng.random() < 0.15 else None,
        lm=LateralModulation() if rng.random() < 0.15 else None,
        foci=int(rng.choice([1, 2, 5], p=[0.6, 0.2, 0.2])),
        continuity=str(rng.choice(["nearest", "jump"], p=[0.7, 0.3])),
        dwell=random_dwell(rng, kind),
        sections=sections if in_sections else None,
    )


def random_dwell(rng, pace):
    """Pauses that a pace may have."""
    kinds = ["none", "share"] if pace == "frequency" else ["none", "none", "time", "share"]
    kind, angle = str(rng.choice(kinds)), float(rng.choice([0.3, 1.0, 2.5]))
    time, share = float(rng.choice([2e-4, 0.005, 0.1])), float(rng.choice([0.1, 0.8]))
    return Dwell(time if kind == "time" else 0.0, share if kind == "share" else 0.0, angle)


def with_pauses(rng, batch):
    """A batch with pauses at some points, which agree at seams."""
    dwell = rng.choice([0.0, 1e-4, 0.003, 0.02], size=batch.point_count, p=[0.7, 0.1, 0.1, 0.1])
    loop = np.flatnonzero(batch.polyline_closed)
    dwell[batch.polyline_start[loop + 1] - 1] = dwell[batch.polyline_start[loop]]
    return replace(batch, dwell=dwell.astype(np.float32))


def random_motions(rng, pose_count):
    """Poses, times, offsets of motions, when each ends, and when its poses fade; some motions have no pose."""
    start = [0, *np.sort(rng.integers(0, pose_count + 1, rng.integers(0, 4))).tolist(), pose_count]
    time, duration = np.zeros(pose_count), []
    for a, b in pairwise(start):
        interval = rng.choice([0.011, 1e-4, 0.03, 0.15], size=b - a, p=[0.7, 0.1, 0.15, 0.05])
        time[a:b] = np.cumsum(interval) - interval + (0.013 if rng.random() < 0.2 else 0.0)
        duration.append(0.011 + (time[b - 1] if b > a else 0.0))
    pose = rng.normal(size=(pose_count, 7))
    pose[:, 3:] /= np.linalg.norm(pose[:, 3:], axis=1, keepdims=True)
    hold = rng.choice([0.005, 0.05, np.inf], size=len(duration)) if rng.random() < 0.5 else None
    return pose.astype(np.float32), time, np.array(start), np.array(duration), hold


@dataclass(frozen=True)
class Motion:
    """Contours of a motion's poses, and when they are drawn."""

    batch: ContourBatch
    pose: np.ndarray
    time: np.ndarray
    duration: float
    hold: float


def random_motion(rng, *, with_intensity, paused):
    """A motion of up to 20 poses; polylines come and go, poses are empty, last for no sample, or fade."""
    count = int(rng.integers(1, 20))
    batch = random_strokes(rng, count, line_most=int(rng.integers(1, 6)), with_intensity=with_intensity)
    batch = with_pauses(rng, batch) if paused else batch
    interval = rng.choice([0.011, 2e-5, 0.03], size=count, p=[0.7, 0.15, 0.15])
    pose = rng.normal(size=(count, 7))
    pose[:, :3] *= 0.01
    pose[:, 3:] /= np.linalg.norm(pose[:, 3:], axis=1, keepdims=True)
    hold = float(rng.choice([0.004, 0.02, np.inf]))
    return Motion(batch, pose, np.cumsum(interval) - interval, float(interval.sum()), hold)


def drawn_in_spans(strategy, motions, cuts):
    """Focal points and counts of motions side by side that are cut into spans; cuts: sample numbers of each motion.

    All motions have as many cuts; between two equal ones a motion has no pose, or poses of no sample.
    """
    rate, sampler = strategy.update_rate, Sampler(strategy, motion_count=len(motions))
    bounds = [sample_bounds(motion.time, motion.duration, rate) for motion in motions]
    ends = [[0, *own, int(bound[-1])] for own, bound in zip(cuts, bounds, strict=True)]
    parts = [[] for _ in motions]
    for k in range(len(ends[0]) - 1):
        spans = [_span_of(*given, *own[k : k + 2], rate) for *given, own in zip(motions, bounds, ends, strict=True)]
        batch = drawable_contours(join_batches([span["batch"] for span in spans]).to("cpu"))
        span = {name: np.concatenate([span[name] for span in spans]) for name in ("first", "count", "time")}
        span["motion_start"] = np.cumsum([0, *[len(span["count"]) for span in spans]])
        span["goes_on"] = np.array([span["goes_on"] for span in spans], np.int32)
        span["hold"] = np.array([ticks_of(motion.hold, rate) for motion in motions])
        pose = np.concatenate([span["pose"] for span in spans])
        position, intensity = (a.numpy() for a in sampler.take(batch, batch.struct, pose, span))
        row = 0
        for own, drawn in zip(parts, spans, strict=True):
            rows = slice(row, row + int(drawn["count"].sum()))
            own.append((position[rows].copy(), intensity[rows].copy()))
            row = rows.stop
    focus = [FocalPoints(*(np.concatenate(part) for part in zip(*own, strict=True))) for own in parts]
    return focus, sampler.counts


def _span_of(motion, bounds, begin, end, rate):
    """Samples begin..end of a motion, and the poses that they are of."""
    first = int(np.searchsorted(bounds[1:], begin, side="right")) if begin < end else len(motion.time)
    stop = int(np.searchsorted(bounds[:-1], end)) if begin < end else first
    starts = np.maximum(bounds[first:stop], begin)
    return {
        "batch": motion.batch.select(first, stop),
        "pose": motion.pose[first:stop],
        "first": starts,
        "count": np.maximum(np.minimum(bounds[first + 1 : stop + 1], end) - starts, 0),
        "time": ticks_of(motion.time[first:stop], rate),
        "goes_on": stop > first and begin > bounds[first],
    }


def schedule_of_motions(counts, device="cpu"):
    """The schedule of motions whose poses have so many samples each; counts: a sequence of each motion's."""
    count = np.concatenate([np.asarray(own, np.int64) for own in counts])
    sizes = [len(own) for own in counts]
    start, schedule = np.cumsum([0, *sizes]), PoseSchedule()
    for name, values in (
        ("motion_start", start),
        ("motion", np.repeat(np.arange(len(sizes)), sizes)),
        ("count", count),
        ("row", np.cumsum(count) - count),
    ):
        setattr(schedule, name, wp.array(values.astype(np.int32), dtype=wp.int32, device=device))
    return schedule


def drawn_room(batch, time, duration, strategy, device="cpu", hold=np.inf):
    """The room of a whole motion that has been drawn; its cycles, nodes and state are to be looked at."""
    schedule = MotionSchedule.of(time, [0, len(time)], [duration], strategy, np.array([hold]))
    batch, points = batch.to(device), strategy.pace.points
    shown = np.zeros(0, np.int64) if points is None else shown_order(strategy.order, points)
    room, row = SpanRoom(1, strategy.foci, shown, device), np.cumsum(schedule.count) - schedule.count
    span = schedule.span(strategy) | {"motion": np.zeros(len(time), np.int64), "row": row, "number": row}
    pose = np.tile([0, 0, 0.2, np.sqrt(0.5), 0, 0, np.sqrt(0.5)], (len(time), 1))
    line_most = int(np.diff(batch.numpy().pose_start).max(initial=0))
    plan = plan_of(strategy, pauses=batch.dwell is not None)
    position, intensity = room.draw(plan, batch.struct, span, pose, line_most=line_most)
    count = int(schedule.count.sum())
    return room, position.numpy()[:count], intensity.numpy()[:count]


def without_folds(batch, strategy):
    """A batch where loops through two places are a point: such a loop has pairs of candidate starts at one place.

    Rounding decides which start of such a pair is chosen, and so it may differ from sampler to sampler.
    """
    points = batch.points.copy()
    for (a, b), closed in zip(pairwise(batch.polyline_start.tolist()), batch.polyline_closed, strict=True):
        if (closed or strategy.gap.kind == "close") and len(np.unique(points[a:b], axis=0)) == 2:
            points[a:b] = points[a]
    return replace(batch, points=points)
