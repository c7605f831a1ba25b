"""Continuity: where drawing goes on along the cycle of a new pose.

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

from .cycle import Cycle

WHOLE_SECTION = 1e-3  # [m] that a section's whole time counts among passes of the same place


@dataclass(frozen=True, eq=False, slots=True)
class Place:
    """Place of a focal point, described such that it can be found on another cycle."""

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


def place_on(cycle: Cycle, parameter: float, point: np.ndarray, slack: float) -> Place:
    """The place at a parameter of a cycle; `point` is the point there."""
    i = interval_of(cycle, parameter)
    step = cycle.step[i]
    if i > 0 and not step.any():  # a pause: how it was reached
        step = cycle.step[i - 1]
    length = float(np.sqrt(np.einsum("i,i", step, step)))  # its order of sums is the device's; `@` has the processor's
    direction = step / length if length > 0 else None
    if cycle.pause is not None:
        if cycle.pause[i]:
            rested = (parameter - float(cycle.parameter[i])) / float(cycle.parameter[i + 1] - cycle.parameter[i])
            return Place(point, direction, rested=rested)
        behind, ahead = _pauses_around(cycle, parameter)
        beside = (1 if behind[0] <= ahead[0] else -1) if min(behind[0], ahead[0]) < slack else 0
        return Place(point, direction, beside=beside)
    if cycle.section is not None:
        k = _section_of(cycle, parameter)
        start, stop = float(cycle.section[k]), float(cycle.section[k + 1])
        return Place(point, direction, middle=_middles(cycle)[k], through=(parameter - start) / (stop - start))
    return Place(point, direction)


def entered(cycle: Cycle, place: Place, slack: float, step: float) -> float:
    """Parameter of a cycle at which drawing goes on."""
    cost, part = cycle.approach(place.point, place.direction, slack, step)
    if cycle.section is not None and place.middle is not None:
        middles = _middles(cycle)
        k = int(np.argmin(np.linalg.norm(middles - place.middle, axis=1)))
        start, stop = cycle.section[k], cycle.section[k + 1]
        parameter = cycle.parameter[:-1] + part * np.diff(cycle.parameter)
        cost = cost + WHOLE_SECTION * np.abs((parameter - start) / (stop - start) - place.through)
        cost[(cycle.parameter[:-1] < start) | (cycle.parameter[1:] > stop)] = np.inf
    best = int(np.flatnonzero(cost <= cost.min() + 1e-12)[0])  # of equals the first, whatever is rounded
    parameter = cycle.along(best, float(part[best]))
    if cycle.pause is None:
        return parameter
    if place.rested is not None:
        rest = np.flatnonzero(cycle.pause)
        apart = np.linalg.norm(cycle.points[rest] - place.point, axis=1)
        if place.direction is not None:  # the pause that is reached by the same direction
            arrival = cycle.step[rest - 1]
            cosine = (arrival * place.direction).sum(axis=1) / np.maximum(np.linalg.norm(arrival, axis=1), 1e-30)
            apart = apart + slack * (1.0 - cosine) / 2
        nearest = int(np.argmin(apart))
        if apart[nearest] <= cost[best] + slack:
            return cycle.along(int(rest[nearest]), place.rested)
        return parameter
    behind, ahead = _pauses_around(cycle, parameter)
    if place.beside > 0 and ahead[0] < slack and ahead[0] < behind[0]:
        return float(cycle.parameter[ahead[1] + 1])
    if place.beside < 0 and behind[0] < slack and behind[0] < ahead[0]:
        return float(cycle.parameter[behind[1]])
    return parameter


def interval_of(cycle: Cycle, parameter: float) -> int:
    """Number of the segment from node to node on which a parameter lies."""
    return min(int(np.searchsorted(cycle.parameter, parameter, side="right")) - 1, len(cycle.step) - 1)


def _pauses_around(cycle: Cycle, parameter: float) -> tuple[tuple[float, int], tuple[float, int]]:
    """Distance since the last pause [m] and its interval; distance to the next pause and its interval."""
    rest = np.flatnonzero(cycle.pause)
    arc = np.concatenate([[0.0], np.cumsum(np.sqrt(np.einsum("ij,ij->i", cycle.step, cycle.step)))])
    here, total = float(np.interp(parameter, cycle.parameter, arc)), float(arc[-1])
    i = interval_of(cycle, parameter)
    k = int(np.searchsorted(rest, i))
    last, following = int(rest[k - 1]), int(rest[k % len(rest)])
    return ((here - float(arc[last])) % total, last), ((float(arc[following]) - here) % total, following)


def _section_of(cycle: Cycle, parameter: float) -> int:
    if cycle.section is None:
        return 0
    return min(int(np.searchsorted(cycle.section, parameter, side="right")) - 1, len(cycle.section) - 2)


def _middles(cycle: Cycle) -> np.ndarray:
    """Middles between the ends of each section [m], shape [section, 3]; a section is passed an odd number of times."""
    if cycle.section is None:
        return np.zeros((0, 3))
    first = np.searchsorted(cycle.parameter, cycle.section[:-1], side="right") - 1
    last = np.searchsorted(cycle.parameter, cycle.section[1:], side="left")
    return 0.5 * (cycle.points[first] + cycle.points[last])
