"""Tips: where two smooth parts of the surface meet beyond the step that joins them, found by climbing.

The ends of a step lie on the surface. If the field has one sign on both sides of its middle, the surface leaves the
step, and the region of that sign (the solid, or in a notch what is around it) goes on beyond it, up to a tip. Sections
parallel to the step are looked at higher and higher: their ends are roots, and from two of them the next height is
extrapolated, so straight sides are done after a few, and curved ones converge. Only signs and roots are asked for.

                e          e: the tip, a root between the last section's middle and beyond
               / \\
              a-x-b        a, b: roots; x: their middle; from x to x the region's sign holds all along
             /     \\
            p---m---q      p, q: the step

A tip is inserted if it is sharp, or farther from the step than TALL: what is round is left as it is. Lengths are in
grid steps unless stated.

Climbing starts at steps that turn far: whose directions and those of their neighbours differ by more than MOST_TURN, or
that have no neighbour on the surface. Only points are compared for this, so smooth contours ask the field nothing.
"""

from typing import Any, NamedTuple

import warp as wp

from ..fields.field import MODULE, Field, inside_function, made_once, root_function
from ..offsets import launch, scan_counts
from ..patch import EXACT, to_float32, to_float64
from .grid import Grid, Grids, Lattice, MovedNodes, is_done, node_at
from .lines import has_step
from .sample import NO_POINT
from .walk import Trails

wp.set_module_options(EXACT)

LEAST = 0.002  # what is nearer to the step is no tip
LOWEST = wp.constant(wp.float64(0.05))  # of the step's length: nor is what is lower than this over its middle
TALL = wp.constant(wp.float64(0.125))
SHARP = wp.constant(wp.float64(-0.866))  # cosine of the widest angle that is one: 150 degrees
REACH = wp.constant(wp.float64(24.0))  # a tip farther away is not looked for
FINE = wp.constant(wp.float64(1e-3))  # width of a section that is as good as the tip
CLIMBS = wp.constant(14)  # sections at most
PATH_PLACES = 16  # places of a path: the step's middle, sections' middles, the tip
SHARE = wp.constant(wp.float64(0.9))  # of the distance to the extrapolated tip at which the next section lies
STRIDE = wp.constant(wp.float64(0.25))  # between places whose sign is checked
NEAR_CELL = wp.constant(wp.float64(0.5))  # no other node lies in a tip this near to its step's cell
HALF = wp.constant(wp.float64(0.5))
ONE = wp.constant(wp.float64(1.0))
MOST_TURN = wp.constant(wp.float64(0.906))  # its cosine: 25 degrees

NO_TIP = wp.constant(0)
TIP = wp.constant(1)
FAR_TIP = wp.constant(2)  # beyond the cells around its step, or beyond the grid: nodes must be moved onto it


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


@wp.struct
class Tips:
    """Tips found by climbing from the steps that turn far."""

    what: wp.array[wp.int32]  # NO_TIP, TIP, FAR_TIP; shape [turn + 1]
    path: wp.array2d[wp.vec2d]  # to a tip: the step's middle, sections' middles, the tip; shape [turn, PATH_PLACES]
    path_count: wp.array[wp.int32]  # places of it


class FoundTips(NamedTuple):
    """Tips, and the points that go with them."""

    tip: wp.array  # of each slot, vec3 [m]: what comes after its point; the point itself where there is none
    far_count: int
    tips: Any = None
    turn_start: Any = None  # turns before each slot, int32, shape [slot + 1]
    room: Any = None  # far tips before each turn, int32, shape [turn + 1]


@wp.struct
class Climb:
    """A tip being climbed."""

    lat: Lattice
    least: wp.float64  # height of the lowest tip
    wanted: bool  # whether the region is inside
    d: wp.vec2d  # the step
    m: wp.vec2d  # its middle
    out: wp.vec2d  # as long as the step, across it, to where the tip is
    x: wp.vec2d  # middle of the highest section
    a: wp.vec2d  # its ends
    b: wp.vec2d
    width: wp.float64  # of it, in lengths of the step, as height is
    height: wp.float64
    ahead: wp.vec2d  # from x to where the tip is expected
    rest: wp.float64  # that in height
    count: int  # places of the path


@wp.func
def grid_place(lat: Lattice, x: wp.vec3d):
    """A point of the grid's plane in grid steps from node (0, 0)."""
    d = x - lat.origin
    return wp.vec2d(wp.dot(d, lat.u) / wp.dot(lat.u, lat.u), wp.dot(d, lat.v) / wp.dot(lat.v, lat.v))


@wp.func
def angle_cosine(lat: Lattice, a: wp.vec2d, tip: wp.vec2d, b: wp.vec2d):
    """Cosine of the angle at a tip between a and b."""
    p = a - tip
    q = b - tip
    return wp.dot(wp.normalize(p[0] * lat.u + p[1] * lat.v), wp.normalize(q[0] * lat.u + q[1] * lat.v))


@wp.func
def lowest_height(c: Climb):
    """Height of the lowest section, in lengths of the step."""
    return wp.max(LOWEST, c.least / wp.length(c.d))


@wp.func
def is_far(g: Grid, m: wp.vec2d, tip: wp.vec2d):
    """Whether a tip lies beyond the cells around its step's middle, or beyond the grid."""
    for k in range(2):
        end = wp.float64(wp.where(k == 0, g.nu, g.nv))
        if tip[k] < wp.float64(0.0) or tip[k] > end:
            return True
        low = wp.floor(m[k])
        if tip[k] < low - NEAR_CELL or tip[k] > low + ONE + NEAR_CELL:
            return True
    return False


@made_once
def tip_kernel(inside: Any, root: Any, data_type: Any) -> Any:
    """The kernel that climbs tips, for a field's `inside` and `root`."""

    @wp.func
    def has_sign(data: data_type, lat: Lattice, p: wp.vec2d, wanted: bool):
        return inside(data, node_at(lat, p[0], p[1])) == wanted

    @wp.func
    def is_clear(data: data_type, c: Climb, to: wp.vec2d):
        """Whether the region's sign holds all along from the highest section's middle to a place."""
        reach = to - c.x
        count = int(wp.length(reach) / STRIDE) + 1
        for k in range(count):
            if not has_sign(data, c.lat, c.x + (wp.float64(k + 1) / wp.float64(count)) * reach, c.wanted):
                return False
        return True

    @wp.func
    def root_at(data: data_type, lat: Lattice, a: wp.vec2d, b: wp.vec2d):
        return grid_place(lat, root(data, node_at(lat, a[0], a[1]), node_at(lat, b[0], b[1])))

    @wp.func
    def first_root(data: data_type, c: Climb, a: wp.vec2d, reach: wp.vec2d, most: int):
        """The root within a reach from a, in the region, doubled up to `most` times till it ends outside; else a."""
        b = a + reach
        k = int(0)
        while k < most and has_sign(data, c.lat, b, c.wanted):
            b = a + wp.float64(2 << k) * reach
            k += 1
        if k == most:
            return a
        return root_at(data, c.lat, a, b)

    @wp.func
    def begun(data: data_type, lat: Lattice, p: wp.vec2d, q: wp.vec2d, least: wp.float64):
        """The climb from a step on; `count` is 0 if the surface does not leave it."""
        c = Climb()
        c.lat = lat
        c.least = least
        c.d = q - p
        c.m = HALF * (p + q)
        c.x = c.m
        c.a = p
        c.b = q
        c.width = ONE
        c.out = wp.vec2d(c.d[1], -c.d[0])  # to the right, where it is outside
        gap = lowest_height(c)
        c.wanted = has_sign(data, lat, c.m + gap * c.out, True)
        if has_sign(data, lat, c.m - gap * c.out, c.wanted):
            c.count = 1
        if not c.wanted:
            c.out = -c.out
        return c

    @wp.func
    def section_at(data: data_type, c: Climb, y: wp.vec2d, height: wp.float64, guess: wp.float64):
        """The climb with the section through y; `count` is 0 where the sections do not narrow."""
        n = c
        n.a = first_root(data, c, y, -guess * c.d, 6)
        n.b = first_root(data, c, y, guess * c.d, 6)
        n.width = wp.dot(n.b - n.a, c.d) / wp.dot(c.d, c.d)
        n.height = height
        n.x = HALF * (n.a + n.b)
        if not has_sign(data, c.lat, n.x, c.wanted):
            n.x = y
        n.count = c.count + 1
        n.rest = n.width * (height - c.height) / (c.width - n.width)
        n.ahead = (n.rest / (height - c.height)) * (n.x - c.x)
        if n.width >= c.width or wp.length(n.ahead) > REACH or n.width <= wp.float64(0.0):
            n.count = 0
        return n

    @wp.func
    def share_ahead(data: data_type, c: Climb):
        """The share of the distance to the expected tip at which the next section can lie, 0 if it cannot."""
        share = SHARE
        for _ in range(6):
            if is_clear(data, c, c.x + share * c.ahead):
                return share
            share = share * HALF
        return wp.float64(0.0)

    @wp.func
    def tip_of(data: data_type, c: Climb):
        """The tip ahead of the highest section, or that section's middle if there is none."""
        ahead = c.ahead
        if wp.length(ahead) < FINE:
            ahead = FINE * wp.normalize(ahead)
        return first_root(data, c, c.x, wp.float64(2.0) * ahead, 2)

    @wp.func
    def is_near(data: data_type, c: Climb, one: wp.vec2d, other: wp.vec2d):
        """Whether the surface passes near to one end of a section, by its width."""
        within = wp.lerp(one, other, wp.float64(0.25))
        beyond = wp.lerp(one, other, wp.float64(-0.25))
        return has_sign(data, c.lat, within, c.wanted) and not has_sign(data, c.lat, beyond, c.wanted)

    @wp.func
    def is_straight(data: data_type, c: Climb, tip: wp.vec2d):
        """Whether the surface is near, half-way, to the lines from the step's ends to the tip."""
        p = HALF * (tip + c.m - HALF * c.d)
        q = HALF * (tip + c.m + HALF * c.d)
        return is_near(data, c, p, q) and is_near(data, c, q, p)

    @wp.func
    def climb_tip(data: data_type, begin: Climb, path: wp.array2d[wp.vec2d], row: int):
        """The highest section; `count` is 0 if there is no tip."""
        c = begin
        path[row, 0] = c.m
        height = lowest_height(c)
        y = c.m + height * c.out
        guess = wp.float64(0.6)
        while c.count > 0 and c.count <= CLIMBS and height > c.height:
            n = section_at(data, c, y, height, guess)
            if n.count == 0:
                if c.count == 1:  # no second section: nothing is expected yet
                    c.count = 0
                return c
            c = n
            path[row, c.count - 1] = c.x
            size = wp.length(c.d)
            blunt = angle_cosine(c.lat, c.a, c.x + c.ahead, c.b) < SHARP
            if blunt and (c.height + c.rest) * size < TALL:
                c.count = 0
            elif c.width * size > FINE:
                share = share_ahead(data, c)
                y = c.x + share * c.ahead
                height = c.height + share * c.rest
                guess = wp.max((ONE - share) * c.width, wp.float64(1e-3) * c.width)
        return c

    @wp.kernel(**MODULE)
    def _climb_tips(
        # In:
        data: data_type,
        lattice: wp.array[Lattice],
        grid: wp.array[Grid],
        section: wp.array[wp.int32],
        after: wp.array[wp.int32],
        point: wp.array[wp.vec3],
        turn: wp.array[wp.int32],  # slots
        least: wp.float64,
        # Out:
        tip: wp.array[wp.vec3],  # initialised like `point`; shape [slot]
        tips: Tips,
        far: wp.array[wp.int32],  # 1 for a far tip; shape [turn + 1], the last one stays 0
    ):
        """Climb from a step that turns far; write a tip that is near, and the path to one that is far."""
        row = wp.tid()
        slot = turn[row]
        tips.what[row] = NO_TIP
        far[row] = 0
        lat = lattice[section[slot]]
        p = grid_place(lat, to_float64(point[slot]) - lat.lift)
        q = grid_place(lat, to_float64(point[after[slot]]) - lat.lift)
        c = begun(data, lat, p, q, least)
        if c.count == 0:
            return
        c = climb_tip(data, c, tips.path, row)
        if c.count == 0:
            return
        end = tip_of(data, c)
        high = wp.dot(end - c.m, c.out) / wp.length(c.out)
        sharp = angle_cosine(lat, c.a, end, c.b) > SHARP
        if end == c.x or high < least or not (sharp or high > TALL):
            return
        tips.path[row, c.count] = end
        tips.path_count[row] = c.count + 1
        if is_far(grid[section[slot] % grid.shape[0]], c.m, end) or not is_straight(data, c, end):
            tips.what[row] = FAR_TIP
            far[row] = 1
        else:
            tips.what[row] = TIP
            tip[slot] = to_float32(node_at(lat, end[0], end[1]) + lat.lift)

    return _climb_tips


def find_tips(
    field: Field, lattice: wp.array, grids: Grids, trails: Trails, point: wp.array, moved: MovedNodes, *, least: float
) -> FoundTips:
    """Climb from every step that turns far; waits for the device.

    least: height of the lowest tip [grid step]. moved: once nodes are, only their sections are looked at.
    """
    device = point.device
    turns = list_turns(trails, point, moved)
    count = turns.slot.shape[0]
    if count == 0:
        return FoundTips(point, 0)
    tip = wp.clone(point)
    tips = Tips()
    tips.what, tips.path_count = (wp.empty(count, dtype=wp.int32, device=device) for _ in range(2))
    tips.path = wp.empty((count, PATH_PLACES), dtype=wp.vec2d, device=device)
    far = wp.zeros(count + 1, dtype=wp.int32, device=device)
    inputs = [field.data, lattice, grids.grid, trails.section, trails.after, point, turns.slot, wp.float64(least)]
    launch(tip_kernel(inside_function(field), root_function(field), field.data_type), count, inputs, [tip, tips, far])
    (room,), (far_count,) = scan_counts(far)
    return FoundTips(tip, far_count, tips, turns.start, room)
