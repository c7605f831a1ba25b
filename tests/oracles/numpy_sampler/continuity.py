"""Continuity: where drawing goes on along the track of a new pose.

| where the focal point is | where it goes on |
|---|---|
| anywhere | at the nearest point passed in the same direction; one passed the other way must be nearer by a slack |
| three ordinary steps or less from any | at one so near, the other way if need be |
| resting at a corner | resting at the nearest corner, for what is left of the pause, if that is not much farther |
| shortly before a corner, or behind it | not behind it, or before it: a pause is neither left out nor made twice |
| in a section | in the section whose middle is nearest, as far through its time |
"""

from dataclasses import dataclass

import numpy as np

from .track import Track

WHOLE_SECTION = 1e-3  # [m] that a section's whole time counts among passes of the same place


@dataclass(frozen=True, eq=False, slots=True)
class Place:
    """Where a focal point is, told such that it can be found on another track."""

    point: np.ndarray
    """[m], shape [3]."""
    direction: np.ndarray | None
    """Unit vector of its motion, in a pause that before it; None before anything is drawn."""
    rested: float | None = None
    """How much of a pause is over, 0..1; None in motion."""
    beside: int = 0
    """1 shortly behind a pause, -1 shortly before one, else 0."""
    middle: np.ndarray | None = None
    """Of the section that is drawn [m], shape [3]."""
    through: float = 0.0
    """How much of the section's time is over, 0..1."""


def place_on(track: Track, knot: float, point: np.ndarray, slack: float) -> Place:
    """The place at a knot of a track; `point` is the point there."""
    i = interval_of(track, knot)
    step = track.step[i]
    if i > 0 and not step.any():  # a pause: how it was reached
        step = track.step[i - 1]
    length = float(np.sqrt(np.einsum("i,i", step, step)))  # its order of sums is the device's; `@` has the processor's
    direction = step / length if length > 0 else None
    if track.pause is not None:
        if track.pause[i]:
            rested = (knot - float(track.knot[i])) / float(track.knot[i + 1] - track.knot[i])
            return Place(point, direction, rested=rested)
        behind, ahead = _pauses_around(track, knot)
        beside = (1 if behind[0] <= ahead[0] else -1) if min(behind[0], ahead[0]) < slack else 0
        return Place(point, direction, beside=beside)
    if track.section is not None:
        k = _section_of(track, knot)
        start, stop = float(track.section[k]), float(track.section[k + 1])
        return Place(point, direction, middle=_middles(track)[k], through=(knot - start) / (stop - start))
    return Place(point, direction)


def entered(track: Track, place: Place, slack: float, step: float) -> float:
    """Knot of a track at which drawing goes on."""
    cost, part = track.approach(place.point, place.direction, slack, step)
    if track.section is not None and place.middle is not None:
        middles = _middles(track)
        k = int(np.argmin(np.linalg.norm(middles - place.middle, axis=1)))
        start, stop = track.section[k], track.section[k + 1]
        knot = track.knot[:-1] + part * np.diff(track.knot)
        cost = cost + WHOLE_SECTION * np.abs((knot - start) / (stop - start) - place.through)
        cost[(track.knot[:-1] < start) | (track.knot[1:] > stop)] = np.inf
    best = int(np.flatnonzero(cost <= cost.min() + 1e-12)[0])  # of equals the first, whatever is rounded
    knot = track.along(best, float(part[best]))
    if track.pause is None:
        return knot
    if place.rested is not None:
        rest = np.flatnonzero(track.pause)
        apart = np.linalg.norm(track.points[rest] - place.point, axis=1)
        if place.direction is not None:  # the pause that is reached by the same direction
            arrival = track.step[rest - 1]
            cosine = (arrival * place.direction).sum(axis=1) / np.maximum(np.linalg.norm(arrival, axis=1), 1e-30)
            apart = apart + slack * (1.0 - cosine) / 2
        nearest = int(np.argmin(apart))
        if apart[nearest] <= cost[best] + slack:
            return track.along(int(rest[nearest]), place.rested)
        return knot
    behind, ahead = _pauses_around(track, knot)
    if place.beside > 0 and ahead[0] < slack and ahead[0] < behind[0]:
        return float(track.knot[ahead[1] + 1])
    if place.beside < 0 and behind[0] < slack and behind[0] < ahead[0]:
        return float(track.knot[behind[1]])
    return knot


def interval_of(track: Track, knot: float) -> int:
    """Number of the way from node to node on which a knot lies."""
    return min(int(np.searchsorted(track.knot, knot, side="right")) - 1, len(track.step) - 1)


def _pauses_around(track: Track, knot: float) -> tuple[tuple[float, int], tuple[float, int]]:
    """Way [m] since the last pause and its interval; way to the next pause and its interval."""
    rest = np.flatnonzero(track.pause)
    way = np.concatenate([[0.0], np.cumsum(np.sqrt(np.einsum("ij,ij->i", track.step, track.step)))])
    here, total = float(np.interp(knot, track.knot, way)), float(way[-1])
    i = interval_of(track, knot)
    k = int(np.searchsorted(rest, i))
    last, following = int(rest[k - 1]), int(rest[k % len(rest)])
    return ((here - float(way[last])) % total, last), ((float(way[following]) - here) % total, following)


def _section_of(track: Track, knot: float) -> int:
    if track.section is None:
        return 0
    return min(int(np.searchsorted(track.section, knot, side="right")) - 1, len(track.section) - 2)


def _middles(track: Track) -> np.ndarray:
    """Middles between the ends of each section [m], shape [section, 3]; a section is passed an odd number of times."""
    if track.section is None:
        return np.zeros((0, 3))
    first = np.searchsorted(track.knot, track.section[:-1], side="right") - 1
    last = np.searchsorted(track.knot, track.section[1:], side="left")
    return 0.5 * (track.points[first] + track.points[last])
