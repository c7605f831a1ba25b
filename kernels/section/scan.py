"""Scan search, for small surfaces: test every scanned edge, then walk every loop in the plane once.

The walk lists the segments that clipping must test, and another kernel clips them: all lanes of a GPU walk alike, but
clipping diverges and would make the other lanes wait. Closed surfaces are scanned and walked in
float32 (`float32_walk`), and the few queries for which that is not exact enough in float64.
"""

from functools import partial
from typing import Any

import warp as wp

from ..offsets import BLOCK
from ..patch import (
    BOTTOM,
    EXACT,
    LEFT,
    ON,
    RIGHT,
    TOP,
    Coarse,
    Frame,
    Patch,
    coarse_frame,
    half_extents,
    is_above,
    outcode,
    output_point,
    section_frame,
)
from .clip import (
    BEGIN,
    CLEAR,
    CORNERS,
    END,
    FROM,
    HALF,
    STOP,
    Events,
    clip_events,
    corners_left,
    is_quiet,
    needs_left,
    room_for_events,
    write_event,
)
from .float32_walk import (
    ENDED,
    REST,
    Float32Frame,
    Float32Walk,
    Scans,
    begin_loop,
    fetch_words,
    float32_frame,
    held,
    held_vec3,
    is_marked,
    is_walking,
    mark,
    room_for_scans,
    scan_in_float32,
    step_in_float32,
)
from .half_edges import MASK_WORDS, OPEN, Surface
from .lanes import claim_place, claiming_lanes, first_places, in_step, warp_votes_of
from .pieces import CutPlanes, end_list, list_half, room_for_rest, room_for_sections, room_for_steps, section_at
from .walk import Crossing, chain_start, crossing_after, crossing_at, link_of, load_vec4, point_of, vertex_of

wp.set_module_options(EXACT)

EVENTS = 24  # of a query at first; those with more are searched again
LISTED = 32  # scanned crossings that one scan lists; a further scan lists the next ones
WALK_BLOCKS = 10  # that walk at once on a processor; more have too few registers, and spill into the cache of edges
FEW_WALK = wp.constant(16)  # lanes of a warp: if no more are walking, the others claim queries


@wp.struct
class ScanResult:
    """Scanned crossings found by a scan along the scan path."""

    listed: int  # number of listed ones
    step: int  # step of the last listed one
    count: int  # number of all


@wp.func
def scan_crossings(surface: Surface, f: Frame, g: Coarse, start: int, halves: wp.array[wp.int32]):
    """Count the scanned crossings of the scan path after step `start`; list the first LISTED of them."""
    found = ScanResult()
    was = is_above(f, g, vertex_of(load_vec4(surface.scan_path, start)))
    for i in range(start + 1, surface.scan_path.shape[0]):
        side = is_above(f, g, vertex_of(load_vec4(surface.scan_path, i)))
        if side != was:
            half = surface.scan_path_half[i][wp.where(was, 0, 1)]
            if half != OPEN:
                if found.listed < LISTED:
                    halves[found.listed] = half
                    found.listed += 1
                    found.step = i
                found.count += 1
        was = side
    return found


@wp.struct
class Walk:
    """Result of a walk around one loop."""

    events: int  # number of events
    scanned: int  # scanned crossings passed
    listed: int  # steps of the query that are listed so far, and of the loops before
    ended: int  # 1 if it ended at an open edge, so it is a chain and no loop


@wp.struct
class CrossingPoint:
    """A crossing's point (x / d, y / d) without the division, and its outcode."""

    x: wp.float64  # [m^2]
    y: wp.float64
    d: wp.float64  # [m]
    code: int
    clear: int  # CLEAR if in float32, in the array's frame, it lies on the line of no side


@wp.func
def point_if_clear(g: Coarse, c: Crossing, side: wp.vec2d):
    """The point of a crossing; its outcode is right if it is clear."""
    t = CrossingPoint()
    t.d = c.upper[2] - c.lower[2]
    t.x = c.lower[0] * c.upper[2] - c.upper[0] * c.lower[2]
    t.y = c.lower[1] * c.upper[2] - c.upper[1] * c.lower[2]
    right = wp.abs(t.x) - side[0] * t.d
    top = wp.abs(t.y) - side[1] * t.d
    zero = wp.float64(0.0)
    t.code = wp.where(right > zero, wp.where(t.x > zero, RIGHT, LEFT), 0)
    t.code += wp.where(top > zero, wp.where(t.y > zero, TOP, BOTTOM), 0)
    room = wp.float64(2.0 * g.unsure) * t.d
    if wp.abs(right) > room and wp.abs(top) > room:
        t.clear = CLEAR
    return t


@wp.func
def crossing_point(f: Frame, g: Coarse, c: Crossing, side: wp.vec2d):
    """The point of a crossing; if it may be flush with a side, which is not clear, `point_of` gives the outcode."""
    t = point_if_clear(g, c, side)
    if t.clear == 0:
        near = (f.flush + ON) * t.d
        if wp.abs(wp.abs(t.x) - side[0] * t.d) <= near or wp.abs(wp.abs(t.y) - side[1] * t.d) <= near:
            t.code = outcode(point_of(f, c, side), side)
    return t


@wp.func
def moves(f: Frame, g: Coarse, side: wp.vec2d, c: Crossing, p: CrossingPoint, n: Crossing, q: CrossingPoint):
    """Whether the float32 output points of two crossings differ."""
    room = wp.float64(2.0 * g.unsure) * p.d * q.d  # each point may be moved onto a side
    if wp.abs(p.x * q.d - q.x * p.d) > room or wp.abs(p.y * q.d - q.y * p.d) > room:
        return True
    return not (output_point(f, point_of(f, c, side)) == output_point(f, point_of(f, n, side)))


@wp.func
def walk_loop(
    surface: Surface,
    f: Frame,
    g: Coarse,
    side: wp.vec2d,
    half: int,
    chain: bool,
    mask: wp.array[wp.uint32],
    events: Events,
    query: int,
    start: int,
    listed: int,
):
    """Walk from a crossing around its loop, or to the end of its chain; writes events from number `start` on.

    A segment is an event unless it stays inside, or stays outside without winding around the patch (`is_quiet`).
    listed: number, in the query's list, of the first step's half-edge.
    """
    out = Walk()
    c = crossing_at(surface, f, half)
    p = crossing_point(f, g, c, side)
    begin = wp.where(chain, BEGIN | STOP, BEGIN)
    write_event(events, query, start, (half << HALF) | begin | (p.code << FROM) | p.code, 0)
    out.events = 1
    if chain:
        out.scanned = 1
        mark(mask, surface.rank[half])
    steps = int(0)
    word = wp.uint64(0)
    k = int(listed)
    last = int(0)
    while last == 0:
        n = crossing_after(surface, f, c)
        q = crossing_point(f, g, n, side)
        if n.half == OPEN:
            last = STOP
        elif n.half == half:
            last = END
        if n.scanned == 1 and last != STOP:
            out.scanned += 1
            mark(mask, surface.rank[n.half])
        if (p.code | q.code) == 0:
            if moves(f, g, side, c, p, n, q):
                steps += 1
                word = list_half(events.lists, query, k, word, c.half, True)
                k += 1
        if last != 0 or not is_quiet(p.code, q.code):
            what = (c.half << HALF) | last | (p.code << FROM) | q.code
            if needs_left(p.code, q.code):
                what |= corners_left(point_of(f, c, side), point_of(f, n, side), side) << CORNERS
            else:
                what |= p.clear & q.clear
            write_event(events, query, start + out.events, what, steps)
            out.events += 1
            steps = 0
        c = n
        p = q
    if last == STOP:
        out.ended = 1
    out.listed = end_list(events.lists, query, k, word)
    return out


@wp.kernel
def _scan_sections(
    # In:
    surface: Surface,
    pose: wp.array2d[wp.transform],  # of the hand or of each patch -> array frame, shape [pose, 1 or patch]
    patch: wp.array[Patch],
    bounded: int,  # 0: the whole plane
    section: wp.array[wp.int32],  # of each query; empty if queries are sections
    # Out:
    scans: Scans,
    event_count: wp.array[wp.int32],  # 0 for queries whose planes miss the surface, shape [query]
    doubtful: wp.array[wp.int32],  # queries that need float64, in any order, shape [query]
    doubtful_count: wp.array[wp.int32],  # zero-initialised, shape [1]
):
    """Scan the scan path for each query's plane, if the surface is closed; list the queries that must be walked."""
    query = wp.tid()
    sure = surface.is_open == 0
    crossings = int(0)
    if sure:
        own = section_at(section, query)
        side = half_extents(patch[own % patch.shape[0]], bounded)
        g = coarse_frame(section_frame(pose, patch, own), side, surface.reach)
        unsure = held(g.unsure)
        found = scan_in_float32(surface, held_vec3(g.n), held(g.distance), scans, query)
        sure = found.least > unsure
        crossings = found.count
    if not sure:
        doubtful[wp.atomic_add(doubtful_count, 0, 1)] = query
    elif crossings > 0:
        scans.listed[wp.atomic_add(scans.count, 0, 1)] = wp.vec2i(query, crossings)
    else:
        event_count[query] = 0


@wp.func
def finish_section(walk: Float32Walk, events: Events, doubtful: wp.array[wp.int32], doubtful_count: wp.array[wp.int32]):
    """End the query of a walk; returns whether another loop of it is to be walked instead."""
    if walk.steps >= 0 and walk.events >= REST:
        return False
    if walk.steps >= 0:
        events.count[walk.query] = walk.events
        events.listed[walk.query] = end_list(events.lists, walk.query, walk.listed, walk.word)
    else:
        doubtful[wp.atomic_add(doubtful_count, 0, 1)] = walk.query
    return True


@wp.kernel(launch_bounds=(BLOCK, WALK_BLOCKS))
def _walk_loops(
    # In:
    surface: Surface,
    pose: wp.array2d[wp.transform],
    patch: wp.array[Patch],
    bounded: int,
    section: wp.array[wp.int32],
    scans: Scans,
    # Out:
    events: Events,
    doubtful: wp.array[wp.int32],
    doubtful_count: wp.array[wp.int32],
):
    """Walk around all loops of the listed queries. Lanes that are done claim others, once there are several."""
    count = scans.count[0]
    ours = first_places(wp.tid())
    g = Float32Frame()
    walk = Float32Walk()
    walk.query = OPEN
    walk.steps = ENDED
    works = bool(True)
    while works:
        if walk.query != OPEN and not is_walking(walk):
            if finish_section(walk, events, doubtful, doubtful_count):
                walk.query = OPEN
        place = claim_place(walk.query == OPEN, ours, scans.claimed, count)
        ours = wp.vec2i(place[1], place[2])
        if place[0] != OPEN:
            walk.query = scans.listed[place[0]][0]
            walk.events = REST * scans.listed[place[0]][1]
            walk.listed = 0
            own = section_at(section, walk.query)
            side = half_extents(patch[own % patch.shape[0]], bounded)
            g = float32_frame(section_frame(pose, patch, own), side, surface.reach)
            walk.words = fetch_words(surface, scans, walk.query)
        if walk.query != OPEN and not is_walking(walk):
            walk = begin_loop(surface, g, events, walk)
        few = wp.where(ours[0] < count, FEW_WALK, 0)
        while warp_votes_of(is_walking(walk))[1] > few:
            walk = step_in_float32(surface, g, events, walk)
            if in_step():  # lanes vote after every second step
                walk = step_in_float32(surface, g, events, walk)
        works = warp_votes_of(walk.query != OPEN)[1] > 0


@wp.func
def walk_all_loops(surface: Surface, f: Frame, g: Coarse, side: wp.vec2d, events: Events, query: int):
    """Walk around all loops of a query; returns the query's number of events."""
    halves = wp.zeros(shape=LISTED, dtype=wp.int32)
    mask = wp.zeros(shape=MASK_WORDS, dtype=wp.uint32)
    found = scan_crossings(surface, f, g, 0, halves)
    total = found.count
    count = int(0)
    scanned = int(0)
    listed = int(0)
    k = int(0)
    while scanned < total and found.listed > 0:
        if k == found.listed:
            found = scan_crossings(surface, f, g, found.step, halves)
            k = 0
        while k < found.listed and is_marked(mask, surface.rank[halves[k]]):
            k += 1
        if k < found.listed:
            half = halves[k]
            chain = link_of(load_vec4(surface.corner, half)) == OPEN
            walk = walk_loop(surface, f, g, side, half, chain, mask, events, query, count, listed)
            if walk.ended == 1 and not chain:
                half = chain_start(surface, f, half)
                walk = walk_loop(surface, f, g, side, half, True, mask, events, query, count, listed)
            count += walk.events
            scanned += walk.scanned
            listed = walk.listed
    events.listed[query] = listed
    return count


@wp.kernel
def _walk_doubtful_loops(
    # In:
    surface: Surface,
    pose: wp.array2d[wp.transform],
    patch: wp.array[Patch],
    bounded: int,
    section: wp.array[wp.int32],
    doubtful: wp.array[wp.int32],
    doubtful_count: wp.array[wp.int32],
    # Out:
    events: Events,
):
    """Walk in float64 around all loops of queries that float32 cannot decide, and around those of an open surface."""
    if wp.tid() < doubtful_count[0]:
        query = doubtful[wp.tid()]
        own = section_at(section, query)
        f = section_frame(pose, patch, own)
        side = half_extents(patch[own % patch.shape[0]], bounded)
        g = coarse_frame(f, side, surface.reach)
        events.count[query] = walk_all_loops(surface, f, g, side, events, query)


class ScanSearch:
    """A scan search of all sections, or of the queries of `pieces`, which have room for all of theirs."""

    def __init__(self, planes: CutPlanes, pieces: Any = None, *, lists: bool = False) -> None:
        self.planes, self.pieces, self.lists = planes, pieces, lists

    def launch(self) -> Any:
        """ContourPieces of the queries, which the device may not have found yet."""
        planes, device = self.planes, self.planes.pose.device
        section, query_count, room, lists = None, planes.section_count, EVENTS, None
        if self.pieces is not None:  # a query without room for its events has counted these as its pieces
            section, query_count = self.pieces.section, self.pieces.section.shape[0]
            room = max(EVENTS, int(self.pieces.room.numpy().max()))
        if self.lists:
            face_count = planes.surface.corner.shape[0] // 3
            lists = room_for_steps(query_count, face_count, bounded=planes.bounded, device=device)
        inputs = [*planes.inputs, section]
        launch = partial(wp.launch, device=device, block_dim=BLOCK)
        counters = wp.zeros(3, dtype=wp.int32, device=device)
        scans = room_for_scans(planes.surface, query_count, counters, device)
        doubts = [wp.empty(query_count, dtype=wp.int32, device=device), counters[2:]]
        count = wp.empty(query_count, dtype=wp.int32, device=device)
        launch(_scan_sections, query_count, inputs=inputs, outputs=[scans, count, *doubts])
        events = room_for_events(count, room, lists)
        lanes = claiming_lanes(device, query_count, WALK_BLOCKS)
        launch(_walk_loops, lanes, inputs=[*inputs, scans], outputs=[events, *doubts])
        launch(_walk_doubtful_loops, query_count, inputs=[*inputs, *doubts], outputs=[events])
        if self.pieces is None:
            self.pieces = room_for_sections(query_count, device)
        if lists is not None:
            self.pieces.lists = lists
        clip_events(planes.surface, events, self.pieces)
        return self.pieces

    def rest(self) -> list["ScanSearch"]:
        """The search of queries that had too little room, if any; waits for the device."""
        pieces = room_for_rest(self.pieces, self.planes.pose.device)
        return [] if pieces is None else [ScanSearch(self.planes, pieces)]
