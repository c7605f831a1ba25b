"""Detection of polyline steps that turn so far that an unseen tip of the surface may lie there.

A step turns far if its direction and those of its neighbours differ by more than MOST_TURN, or if it has no neighbour
on the surface. Only points are compared here, so smooth contours cost no question to the field.
"""

from typing import NamedTuple

import warp as wp

from ..offsets import launch, scan_counts
from ..patch import EXACT, to_float64
from .grid import MovedNodes, is_done
from .lines import has_step
from .sample import NO_POINT
from .walk import Trails

wp.set_module_options(EXACT)

MOST_TURN = wp.constant(wp.float64(0.906))  # its cosine: 25 degrees


class Turns(NamedTuple):
    """The steps that turn far, in order."""

    slot: wp.array  # of the point where the step starts, int32, shape [turn]
    start: wp.array  # of each slot: turns before it, int32, shape [slot + 1]


@wp.func
def slot_before(code: wp.array[wp.int32], after: wp.array[wp.int32], slot: int):
    """The point from which a polyline comes to a slot, or NO_POINT where it starts open."""
    if slot > 0:
        if code[slot - 1] != NO_POINT:
            if after[slot - 1] == slot:
                return slot - 1
    k = int(slot)  # the polyline's first point: its last one may lead back to it
    while after[k] > k:
        k += 1
    if after[k] == slot:
        return k
    return NO_POINT


@wp.func
def is_drawn(code: wp.array[wp.int32], after: wp.array[wp.int32], point: wp.array[wp.vec3], slot: int):
    """Whether a step of the object's kind and of non-zero length starts at a slot."""
    if slot == NO_POINT:
        return False
    return code[slot] != NO_POINT and code[slot] & 1 == 0 and has_step(after, point, slot)


@wp.func
def direction(after: wp.array[wp.int32], point: wp.array[wp.vec3], slot: int):
    """Unit vector along the step that starts at a slot."""
    return wp.normalize(to_float64(point[after[slot]]) - to_float64(point[slot]))


@wp.func
def turns_far(code: wp.array[wp.int32], after: wp.array[wp.int32], point: wp.array[wp.vec3], slot: int):
    """Whether the step that starts at a slot turns far."""
    if not is_drawn(code, after, point, slot):
        return False
    before = slot_before(code, after, slot)
    behind = after[slot]
    if not is_drawn(code, after, point, before) or not is_drawn(code, after, point, behind):
        return True
    a = direction(after, point, before)
    b = direction(after, point, slot)
    c = direction(after, point, behind)
    return wp.min(wp.min(wp.dot(a, b), wp.dot(b, c)), wp.dot(a, c)) < MOST_TURN


@wp.kernel
def _count_turns(
    # In:
    code: wp.array[wp.int32],
    after: wp.array[wp.int32],
    section: wp.array[wp.int32],
    point: wp.array[wp.vec3],
    moved: MovedNodes,
    # Out:
    count: wp.array[wp.int32],  # shape [slot + 1]
):
    """Write 1 where a step turns far, else 0."""
    slot = wp.tid()
    n = int(0)
    if slot < code.shape[0]:
        if not is_done(moved, section[slot]):
            if turns_far(code, after, point, slot):
                n = 1
    count[slot] = n


@wp.kernel
def _list_turns(count: wp.array[wp.int32], start: wp.array[wp.int32], slot: wp.array[wp.int32]):
    """List the slots that are counted, in order."""
    k = wp.tid()
    if count[k] == 1:
        slot[start[k]] = k


def list_turns(trails: Trails, point: wp.array, moved: MovedNodes) -> Turns:
    """List the steps that turn far, once nodes are moved only those of their sections; waits for the device."""
    device = point.device
    count = wp.empty(point.shape[0] + 1, dtype=wp.int32, device=device)
    launch(_count_turns, count.shape[0], [*trails, point, moved], [count])
    (start,), (total,) = scan_counts(count)
    slot = wp.empty(total, dtype=wp.int32, device=device)
    launch(_list_turns, point.shape[0], [count, start], [slot])
    return Turns(slot, start)
