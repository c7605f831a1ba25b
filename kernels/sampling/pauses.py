"""Pauses: at corners, and where the contours have some of their own; and where a pause is on another track.

As `_corners_of` and `_with_pauses` in render/sampling/track.py, and `entered` in continuity.py.
"""

import warp as wp

from ..contours import Contours
from .cursor import way_at
from .layout import (
    INFINITE,
    ONE,
    TINY,
    TWO,
    ZERO,
    DrawnPiece,
    FocusPlace,
    PoseTrack,
    SamplingPlan,
    TrackNodes,
    distance,
    product,
    squared,
    sum_of,
)
from .pieces import is_loop, row_of, source_of


@wp.func
def drawn_dwell(c: Contours, plan: SamplingPlan, piece: DrawnPiece, size: int, i: int):
    """Pause that the contours have at the i-th vertex of a piece as drawn [s]; at the ends of a loop only the last."""
    k = source_of(piece, size, i)
    loop = is_loop(c, plan, piece.line)
    if k > 0 or (k == 0 and not loop):
        return wp.float64(c.dwell[row_of(c, piece.line, k)])
    total = ZERO
    if i > 0 and k < 0:  # the end of a loop that begins near these vertices, if any
        for near in range(wp.max(piece.before, 1), piece.after):
            total += wp.float64(c.dwell[row_of(c, piece.line, near)])
    return total


@wp.func
def no_pause(nodes: TrackNodes, at: wp.int64):
    """Let there be no pause at a node."""
    if nodes.pause.shape[0] > 0:
        nodes.pause[at] = ZERO
        nodes.corner[at] = wp.uint8(0)


@wp.func
def copy_pause(nodes: TrackNodes, source: wp.int64, at: wp.int64):
    """Let there be the pause of another node."""
    if nodes.pause.shape[0] > 0:
        nodes.pause[at] = nodes.pause[source]
        nodes.corner[at] = nodes.corner[source]


@wp.func
def mark_corners(plan: SamplingPlan, nodes: TrackNodes, first: wp.int64, count: int, loop: bool):
    """Mark the nodes of a piece where it turns by more than an angle, and open ends.

    A loop's first node is marked at its end; for sections at its start, too.
    """
    if plan.dwell_time == ZERO and plan.dwell_ratio == ZERO:
        return
    begin = wp.vec3d(ZERO, ZERO, ZERO)  # direction of the first way
    before = begin
    last = int(0)  # node at the end of the way before
    for i in range(1, count):
        a = nodes.point[first + wp.int64(i - 1)]
        b = nodes.point[first + wp.int64(i)]
        length = distance(a, b)
        if length > ZERO:
            unit = (b - a) / length
            if last == 0:
                begin = unit
            elif product(before, unit) < plan.corner_cosine:
                nodes.corner[first + wp.int64(last)] = wp.uint8(1)
            before = unit
            last = i
    if product(before, begin) < plan.corner_cosine:
        nodes.corner[first + wp.int64(last)] = wp.uint8(1)
    if loop and plan.sections > 0:
        nodes.corner[first] = nodes.corner[first + wp.int64(count - 1)]
    if not loop:
        nodes.corner[first] = wp.uint8(1)
        nodes.corner[first + wp.int64(count - 1)] = wp.uint8(1)


@wp.func
def insert_pauses(plan: SamplingPlan, nodes: TrackNodes, first: wp.int64, count: int):
    """Repeat each node at which the focal point pauses; returns how many there are then.

    count: of nodes, each with the duration of the way to it, which for a repeated one is the pause.
    """
    marked = int(0)
    for i in range(count):
        marked += int(nodes.corner[first + wp.int64(i)])
    each = plan.dwell_time
    if each == ZERO and marked > 0:
        total = sum_of(nodes.knot, first + wp.int64(1), count - 1)
        each = plan.dwell_ratio * total / wp.float64(marked)
    more = int(0)
    for i in range(count):
        at = first + wp.int64(i)
        if int(nodes.corner[at]) == 1:
            nodes.pause[at] = nodes.pause[at] + each
        if nodes.pause[at] > ZERO:
            more += 1
    to = first + wp.int64(count + more - 1)
    for i in range(wp.where(more > 0, count, 0)):
        source = first + wp.int64(count - 1 - i)
        pause = nodes.pause[source]
        if pause > ZERO:
            move_node(nodes, source, to, pause)
            to -= wp.int64(1)
        move_node(nodes, source, to, nodes.knot[source])
        to -= wp.int64(1)
    return count + more


@wp.func
def move_node(nodes: TrackNodes, source: wp.int64, at: wp.int64, duration: wp.float64):
    """Write a node as another, with the duration of the way to it [s]."""
    nodes.point[at] = nodes.point[source]
    nodes.piece[at] = nodes.piece[source]
    nodes.knot[at] = duration
    if nodes.intensity.shape[0] > 0:
        nodes.intensity[at] = nodes.intensity[source]


@wp.func
def is_pause(nodes: TrackNodes, track: PoseTrack, way: int):
    """Whether the focal point rests on a way from node to node."""
    at = track.first + wp.int64(way)
    step = nodes.point[at + wp.int64(1)] - nodes.point[at]
    return squared(step) == ZERO and nodes.knot[at + wp.int64(1)] > nodes.knot[at]


@wp.struct
class PausesAround:
    """The pauses before and behind a place on a track, which is a cycle."""

    behind: wp.float64  # way since the last one [m]
    ahead: wp.float64  # to the next one [m]
    last: wp.int32  # way from node to node
    following: wp.int32


@wp.func
def modulo(value: wp.float64, period: wp.float64):
    """A value within 0..period, as Python has it."""
    out = wp.mod(value, period)
    if out < ZERO:
        out += period
    return out


@wp.func
def pauses_around(nodes: TrackNodes, track: PoseTrack, knot: wp.float64):
    """The pauses around a knot of a track that has some."""
    out = PausesAround()
    found = way_at(nodes.knot, track.first, track.count, knot)
    own = wp.min(found, track.count - 2)
    arc = ZERO
    here = ZERO
    before = -ONE  # arcs of pauses; those first and last on the track serve where there is none on that side
    behind = -ONE
    first = -ONE
    latest = ZERO
    first_way = int(0)
    latest_way = int(0)
    for i in range(track.count):
        at = track.first + wp.int64(i)
        if i == track.count - 1:
            if found == i:
                here = arc
        else:
            step = wp.sqrt(squared(nodes.point[at + wp.int64(1)] - nodes.point[at]))
            if found == i:
                here = arc
                if knot != nodes.knot[at]:
                    slope = ((arc + step) - arc) / (nodes.knot[at + wp.int64(1)] - nodes.knot[at])
                    here = slope * (knot - nodes.knot[at]) + arc
            if is_pause(nodes, track, i):
                latest = arc
                latest_way = i
                if first < ZERO:
                    first = arc
                    first_way = i
                if i < own:
                    before = arc
                    out.last = i
                elif behind < ZERO:
                    behind = arc
                    out.following = i
            arc += step
    if before < ZERO:
        before = latest
        out.last = latest_way
    if behind < ZERO:
        behind = first
        out.following = first_way
    out.behind = modulo(here - before, arc)
    out.ahead = modulo(behind - here, arc)
    return out


@wp.func
def place_by_pauses(plan: SamplingPlan, nodes: TrackNodes, track: PoseTrack, place: FocusPlace, knot: wp.float64):
    """A place at a knot, with how far a pause is over there, or on which side of a near one it is."""
    out = place
    if track.pauses == 0:
        return out
    way = wp.min(way_at(nodes.knot, track.first, track.count, knot), track.count - 2)
    begin = nodes.knot[track.first + wp.int64(way)]
    if is_pause(nodes, track, way):
        out.rested = (knot - begin) / (nodes.knot[track.first + wp.int64(way + 1)] - begin)
        return out
    around = pauses_around(nodes, track, knot)
    if wp.min(around.behind, around.ahead) < plan.threshold:
        out.beside = wp.where(around.behind <= around.ahead, 1, -1)
    return out


@wp.func
def nearest_pause(plan: SamplingPlan, nodes: TrackNodes, track: PoseTrack, place: FocusPlace):
    """The pause of a track nearest to a place, best one that is reached in the same direction; and how near [m]."""
    least = INFINITE
    best = int(0)
    for i in range(track.count - 1):
        if is_pause(nodes, track, i):
            apart = distance(place.point, nodes.point[track.first + wp.int64(i)])
            if squared(place.direction) > ZERO:
                before = i - 1
                if i == 0:
                    before = track.count - 2
                at = track.first + wp.int64(before)
                step = nodes.point[at + wp.int64(1)] - nodes.point[at]
                length = wp.max(distance(nodes.point[at], nodes.point[at + wp.int64(1)]), TINY)
                apart += plan.threshold * (ONE - wp.dot(step, place.direction) / length) / TWO
            if apart < least:
                least = apart
                best = i
    return best, least


@wp.func
def entered_by_pauses(
    plan: SamplingPlan, nodes: TrackNodes, track: PoseTrack, place: FocusPlace, knot: wp.float64, cost: wp.float64
):
    """Knot at which drawing goes on, if without pauses it were at one that costs so much [m].

    A pause goes on at the nearest one. Shortly before a pause, or behind it, none is left out or made twice.
    """
    if track.pauses == 0:
        return knot
    if place.rested >= ZERO:
        way, apart = nearest_pause(plan, nodes, track, place)
        if apart <= cost + plan.threshold:
            begin = nodes.knot[track.first + wp.int64(way)]
            return begin + place.rested * (nodes.knot[track.first + wp.int64(way + 1)] - begin)
        return knot
    around = pauses_around(nodes, track, knot)
    if place.beside > 0 and around.ahead < plan.threshold and around.ahead < around.behind:
        return nodes.knot[track.first + wp.int64(around.following + 1)]
    if place.beside < 0 and around.behind < plan.threshold and around.behind < around.ahead:
        return nodes.knot[track.first + wp.int64(around.last)]
    return knot
