"""Contours of small surfaces: look at every scanned edge, then walk every loop of the plane around once."""

import warp as wp

from .clip import NONE, passage_of, winding_step
from .patch import EXACT, Frame, Patch, Plane, frame_at, is_above, outcode, plane_of
from .piece import (
    CLOSED,
    Pieces,
    begun_at_side,
    begun_inside,
    count_row,
    led_out,
    led_to,
    section_of,
    store_piece,
)
from .surface import MASK_WORDS, OPEN, Surface
from .walk import chain_start, crossing_after, crossing_at, link_of, loaded, point_of, vertex_of

wp.set_module_options(EXACT)

UNBOUNDED = wp.constant(wp.float64(1e30))  # [m]; half extent of a patch that cuts nothing off
LISTED = 32  # scanned crossings that a sweep keeps; more are swept for again


@wp.struct
class Sweep:
    """What a sweep along the trail found."""

    kept: int  # scanned crossings in the list
    step: int  # where the last of them was
    count: int  # scanned crossings in all


@wp.func
def swept(surface: Surface, f: Frame, plane: Plane, start: int, halves: wp.array[wp.int32]):
    """List the scanned crossings of the trail after step `start`, as many as there is room for, and count them all."""
    found = Sweep()
    was = is_above(f, plane, vertex_of(loaded(surface.trail, start)))
    for i in range(start + 1, surface.trail.shape[0]):
        side = is_above(f, plane, vertex_of(loaded(surface.trail, i)))
        if side != was:
            both = surface.trail_half[i]
            half = both[1]
            if was:
                half = both[0]
            if half != OPEN:
                if found.kept < LISTED:
                    halves[found.kept] = half
                    found.kept += 1
                    found.step = i
                found.count += 1
        was = side
    return found


@wp.func
def marked(mask: wp.array[wp.uint32], rank: int):
    """Whether a walk has passed the scanned edge of that rank."""
    return (mask[rank >> 5] >> wp.uint32(rank & 31)) & wp.uint32(1) != wp.uint32(0)


@wp.func
def mark(mask: wp.array[wp.uint32], rank: int):
    """Remember that a walk has passed a scanned edge."""
    mask[rank >> 5] = mask[rank >> 5] | (wp.uint32(1) << wp.uint32(rank & 31))


@wp.struct
class Round:
    """What a walk around one loop found."""

    pieces: int
    winding: int
    scanned: int
    ended: int  # 1 if it came to an end: the loop is a chain


@wp.func
def walked_round(
    surface: Surface,
    f: Frame,
    side: wp.vec2d,
    half: int,
    chain: bool,
    mask: wp.array[wp.uint32],
    pieces: Pieces,
    row: int,
    slot: int,
):
    """Walk from a crossing around its loop, or to the end of its chain, and store the pieces from slot on.

    A piece that the walk starts in the middle of is walked when the walk comes back to it, from where it enters.
    """
    out = Round()
    c = crossing_at(surface, f, half)
    p = point_of(c)
    code_p = outcode(p, side)
    piece = begun_inside(f, half, p)
    inside = code_p == 0
    whole = inside  # so far; a piece begun in the middle of a loop is either the whole loop or not stored
    again = bool(False)
    if chain:
        mark(mask, surface.rank[half])
        out.scanned = 1
        whole = False
    partial = whole
    while True:
        n = crossing_after(surface, f, c)
        q = point_of(n)
        code_q = outcode(q, side)
        if not again:
            out.winding += winding_step(p, q, code_p, code_q, side)
            if n.scanned == 1 and n.half != OPEN:
                mark(mask, surface.rank[n.half])
                out.scanned += 1
        if code_p == 0 and code_q == 0:
            piece = led_to(f, piece, q)
        else:
            whole = False
            t = passage_of(p, q, code_p, code_q, side)
            if t.enter != NONE and not again:
                piece = begun_at_side(f, c.half, p, q, t.enter, side)
                partial = False
                inside = True
            if t.enter != NONE and code_q == 0:
                piece = led_to(f, piece, q)
            if t.leave != NONE and inside:
                piece = led_out(f, piece, p, q, t.leave, side)
                inside = False
                if not partial:
                    store_piece(pieces, row, slot + out.pieces, piece, piece.half)
                    out.pieces += 1
        if n.half == half:
            again = True
        if n.half == OPEN:
            out.ended = 1
            if inside:
                store_piece(pieces, row, slot + out.pieces, piece, piece.half)
                out.pieces += 1
            break
        if again and (whole or not inside):
            break
        c = n
        p = q
        code_p = code_q
    if whole:
        store_piece(pieces, row, slot, piece, CLOSED + surface.rank[half])
        out.pieces = 1
    return out


@wp.kernel
def _trace_pieces(
    # In:
    surface: Surface,
    pose: wp.array[wp.transform],  # hand frame -> array frame, shape [pose]
    patch: wp.array[Patch],
    bounded: int,  # 0: the whole plane
    # Out:
    pieces: Pieces,
):
    """Find the pieces of each row's section."""
    row = wp.tid()
    section = section_of(pieces, row)
    own = patch[section % patch.shape[0]]
    f = frame_at(pose[section // patch.shape[0]], own)
    side = own.half
    if bounded == 0:
        side = wp.vec2d(UNBOUNDED, UNBOUNDED)
    plane = plane_of(f, surface.reach)
    count = int(0)
    winding = int(0)
    scanned = int(0)
    halves = wp.zeros(shape=LISTED, dtype=wp.int32)
    mask = wp.zeros(shape=MASK_WORDS, dtype=wp.uint32)
    found = swept(surface, f, plane, 0, halves)
    total = found.count
    k = int(0)
    while scanned < total and found.kept > 0:
        if k == found.kept:
            found = swept(surface, f, plane, found.step, halves)
            k = 0
        while k < found.kept and marked(mask, surface.rank[halves[k]]):
            k += 1
        if k < found.kept:
            half = halves[k]
            chain = link_of(loaded(surface.corner, half)) == OPEN
            walked = walked_round(surface, f, side, half, chain, mask, pieces, row, count)
            if walked.ended == 1 and not chain:
                half = chain_start(surface, f, half)
                walked = walked_round(surface, f, side, half, True, mask, pieces, row, count)
            count += walked.pieces
            winding += walked.winding
            scanned += walked.scanned
    count_row(pieces, row, count, winding)
