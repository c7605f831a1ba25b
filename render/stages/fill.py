"""Fillings of what contours enclose: parallel lines, and outlines farther in."""

import math
from dataclasses import dataclass

import numpy as np

from ..contour_batch import ContourBatch
from ..errors import StrategyError
from .patch_regions import Sections
from .polyline_arrays import Drawn, batch_of
from .registry import Option, Setting, transform_stage

SHORTEST = 1e-7  # [m]; a hatch line below this is a touch
UNIT = 1e-3  # [m] that polygons are handed to manifold3d in: it works to 1e-8 of its unit
ROUND = 64  # segments of a full turn around a corner


def require_planes(stage: str, setting: Setting) -> None:
    """Refuse hands whose skin is no plane."""
    if hasattr(setting.hand, "skin_on"):
        raise StrategyError(
            f"{stage}: fills planes, and the skin of a hand mesh is none: take a Palm or PlaneHand, or the raw stage "
            '"contact", which covers skin'
        )


@transform_stage(
    "hatch",
    needs_closed=True,
    spacing=Option(None, 1e-4, 0.5, "m", widths=1.0),
    angle=Option(0.0, -math.tau, math.tau, "rad"),
    connect=Option("boundary", choices=("boundary", "jump")),
)
def hatch_regions(batch: ContourBatch, setting: Setting, *, spacing: float, angle: float, connect: str) -> ContourBatch:
    """Parallel lines that fill what the contours enclose, holes left out.

    spacing: between lines, a focal width by default [m]; lines pass through the patch's middle, so they stay with the
    hand. angle: of the lines from u towards v [rad]. connect "boundary": from line to line along the region's boundary,
    to and fro; "jump": each line by itself. A region between two lines gets one through its middle. Open contours
    enclose nothing: they are left out with a warning. Not for hand meshes.
    """
    require_planes("hatch", setting)
    sections, drawn = Sections(batch, setting), []
    for group in sections.filled("hatch"):
        loops = [sections.loop(int(line)) for line in group]
        pose, patch = int(sections.pose[group[0]]), int(batch.polyline_patch[group[0]])
        for flat in hatch_lines(loops, spacing, angle, connected=connect == "boundary"):
            drawn.append(Drawn(pose, patch, sections.lifted(pose, patch, flat, 0.0), False))
    return batch_of(drawn, batch.pose_count)


@dataclass(frozen=True, eq=False, slots=True)
class LineCrossings:
    """Where hatch lines cross loops, by line, then along it."""

    row: np.ndarray
    """Which line, shape [crossing]."""
    point: np.ndarray
    """[m], shape [crossing, 2]."""
    loop: np.ndarray
    """Which loop, shape [crossing]."""
    along: np.ndarray
    """Place on the loop: number of the vertex before, and the part of the way to the next, shape [crossing]."""
    enters: np.ndarray
    """1 where a line comes to the left of the loop, -1 where it leaves it, shape [crossing]."""


def hatch_lines(loops: list[np.ndarray], spacing: float, angle: float, *, connected: bool) -> list[np.ndarray]:
    """Lines over the region inside loops [m], each of shape [point, 2], in the same plane, through the origin.

    loops: counter-clockwise around the region, clockwise around holes, without their first point repeated.
    """
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, -s], [s, c]])  # columns: along the lines, across them
    turned = [loop @ turn for loop in loops]
    low, high = (float(f([f(loop[:, 1]) for loop in turned])) for f in (np.min, np.max))
    rows = spacing * np.arange(math.floor(low / spacing) + 1, math.ceil(high / spacing))
    if len(rows) == 0:
        rows = np.array([0.5 * (low + high)])
    found = _crossings(turned, rows)
    spans = _spans(found)
    lines = _connected(found, spans, turned) if connected else _apart(found, spans)
    return [line @ turn.T for line in lines]


def _crossings(loops: list[np.ndarray], rows: np.ndarray) -> LineCrossings:
    parts = []
    for k, a in enumerate(loops):
        b = np.roll(a, -1, axis=0)
        under_a, under_b = a[:, 1, None] <= rows, b[:, 1, None] <= rows  # a vertex on a line counts as below it
        i, row = np.nonzero(under_a != under_b)
        part = (rows[row] - a[i, 1]) / (b[i, 1] - a[i, 1])
        x = a[i, 0] + part * (b[i, 0] - a[i, 0])
        parts.append(
            (row, x, np.full(len(i), k), i + np.clip(part, 0.0, 1.0 - 1e-12), np.where(under_a[i, row], -1, 1))
        )
    row, x, loop, along, enters = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.lexsort((along, loop, -enters, x, row))
    point = np.stack([x, rows[row]], axis=1)[order]
    return LineCrossings(row[order], point, loop[order], along[order], enters[order])


def _spans(found: LineCrossings) -> np.ndarray:
    """First and last crossing of each stretch of a line inside the region, shape [span, 2]."""
    winding = np.cumsum(found.enters)  # 0 at the end of every line
    before = winding - found.enters
    first, last = np.flatnonzero((before <= 0) & (winding > 0)), np.flatnonzero((before > 0) & (winding <= 0))
    long = found.point[last, 0] - found.point[first, 0] > SHORTEST
    return np.stack([first, last], axis=1)[long]


def _apart(found: LineCrossings, spans: np.ndarray) -> list[np.ndarray]:
    """Each stretch by itself, every other line backwards."""
    return [found.point[span[::-1] if found.row[span[0]] % 2 else span] for span in spans]


def _connected(found: LineCrossings, spans: np.ndarray, loops: list[np.ndarray]) -> list[np.ndarray]:
    """Stretches joined along the boundary: from the end of one to where the same loop next crosses the next line."""
    span_of = np.full(len(found.row), -1)
    span_of[spans] = np.arange(len(spans))[:, None]
    order = np.lexsort((found.along, found.loop))
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    first = np.searchsorted(found.loop[order], np.arange(len(loops) + 1))
    drawn, lines = np.zeros(len(spans), bool), []

    def onward(at: int) -> tuple[int, list[np.ndarray]]:
        """The neighbour of a crossing on its loop that is on the next line, and the boundary between; -1: none."""
        loop = int(found.loop[at])
        base, count = int(first[loop]), int(first[loop + 1] - first[loop])
        for way in (1, -1):
            to = int(order[base + (place[at] - base + way) % count])
            span = int(span_of[to])
            if found.row[to] == found.row[at] + 1 and span >= 0 and not drawn[span]:
                a, b = (at, to) if way > 0 else (to, at)
                corners = between(loops[loop], float(found.along[a]), float(found.along[b]))
                return to, [corners[::way]]
        return -1, []

    for k in range(len(spans)):
        if drawn[k]:
            continue
        drawn[k] = True
        first_end, other_end = (int(end) for end in spans[k])
        leads_back = onward(other_end)[0] < 0 <= onward(first_end)[0]
        at, parts = (other_end if leads_back else first_end), []
        while at >= 0:
            span = int(span_of[at])
            drawn[span] = True
            end = int(spans[span].sum() - at)
            parts.append(found.point[[at, end]])
            at, corners = onward(end)
            parts.extend(corners)
        lines.append(np.concatenate(parts))
    return lines


def between(loop: np.ndarray, a: float, b: float) -> np.ndarray:
    """Vertices of a loop from one place to another, forwards, shape [point, 2]."""
    first, last = math.floor(a) + 1, math.floor(b)
    if b < a:
        last += len(loop)
    return loop[np.arange(first, last + 1) % len(loop)]


@transform_stage("inset", needs_closed=True, distance=Option(None, 1e-6, 0.5, "m", widths=0.5))
def inset_regions(batch: ContourBatch, setting: Setting, *, distance: float) -> ContourBatch:
    """Outlines moved inwards, so that the focal point's width stays inside.

    distance: half a focal width by default [m]. Regions that are narrower vanish, and fall apart at waists; holes grow.
    Loops are counter-clockwise around what is left, of kind "made", and start near where the region's outline did.
    Open contours enclose nothing: they are left out with a warning. Not for hand meshes.
    """
    require_planes("inset", setting)
    sections, drawn = Sections(batch, setting), []
    for group in sections.filled("inset"):
        loops = [sections.loop(int(line)) for line in group]
        pose, patch = int(sections.pose[group[0]]), int(batch.polyline_patch[group[0]])
        for flat in inset_loops(loops, distance):
            drawn.append(Drawn(pose, patch, sections.lifted(pose, patch, flat, 0.0), True))
    return batch_of(drawn, batch.pose_count)


def inset_loops(loops: list[np.ndarray], distance: float) -> list[np.ndarray]:
    """Loops around what is at least so far inside a region [m]; outer ones by area, the largest first, then holes.

    loops: counter-clockwise around the region, clockwise around holes; [m], each of shape [point, 2].
    """
    from manifold3d import CrossSection, FillRule, JoinType  # a compiled library that most strategies do without

    region = CrossSection([loop / UNIT for loop in loops], FillRule.Positive)
    left = region.offset(-distance / UNIT, JoinType.Round, 2.0, ROUND)
    origin = loops[0][0]
    out = [UNIT * np.asarray(loop, np.float64) for loop in left.to_polygons()]
    out = [np.roll(loop, -int(np.argmin(np.linalg.norm(loop - origin, axis=1))), axis=0) for loop in out]
    return sorted(out, key=lambda loop: (-signed_area(loop), *loop[0].tolist()))


def signed_area(loop: np.ndarray) -> float:
    """Area inside a loop, negative if it runs clockwise [m2]."""
    following = np.roll(loop, -1, axis=0)
    return 0.5 * float((loop[:, 0] * following[:, 1] - following[:, 0] * loop[:, 1]).sum())
