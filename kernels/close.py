"""Boundary of region ∩ patch (CC): pieces joined along the patch's own boundary where that lies in the solid."""

import warp as wp

from .patch import EXACT, Patch, corner, side_position
from .ragged import HAND, Polylines, empty_polylines, offsets_of

wp.set_module_options(EXACT)

NONE = wp.constant(-1)


@wp.struct
class Ends:
    """Where a section's pieces enter and leave the patch, sorted along its boundary; scratch, shape [piece]."""

    leaving: wp.array[wp.int32]  # piece, in the order of the places where pieces leave
    entering: wp.array[wp.int32]  # piece, in the order of the places where pieces enter
    follower: wp.array[wp.int32]  # the piece that the boundary leads to from where this one leaves
    corners: wp.array[wp.int32]  # how many corners it passes on the way


@wp.func
def end_side(lines: Polylines, piece: wp.int64, leaving: bool):
    """Side of the patch by which a piece leaves, or enters."""
    if leaving:
        return lines.side[piece][1]
    return lines.side[piece][0]


@wp.func
def end_position(lines: Polylines, piece: wp.int64, leaving: bool):
    """How far along that side it does."""
    i = lines.polyline_start[piece]
    if leaving:
        i = lines.polyline_start[piece + wp.int64(1)] - wp.int64(1)
    return side_position(end_side(lines, piece, leaving), lines.point[i])


@wp.func
def sort_ends(lines: Polylines, base: wp.int64, count: int, leaving: bool, order: wp.array[wp.int32]):
    """Insertion sort of a section's open pieces by where they enter or leave; returns how many there are."""
    n = int(0)
    for piece in range(count):
        line = base + wp.int64(piece)
        if lines.closed[line] == wp.uint8(0):
            side = end_side(lines, line, leaving)
            position = end_position(lines, line, leaving)
            slot = int(n)
            while slot > 0:
                other = base + wp.int64(order[base + wp.int64(slot - 1)])
                other_side = end_side(lines, other, leaving)
                if other_side < side:
                    break
                if other_side == side and end_position(lines, other, leaving) <= position:
                    break
                order[base + wp.int64(slot)] = order[base + wp.int64(slot - 1)]
                slot -= 1
            order[base + wp.int64(slot)] = piece
            n += 1
    return n


@wp.func
def corners_between(lines: Polylines, leaving: wp.int64, entering: wp.int64, wraps: bool):
    """Corners passed counter-clockwise; none where rounding has swapped two ends that all but coincide."""
    gap = end_side(lines, entering, False) - end_side(lines, leaving, True)
    if wraps:
        return gap + 4
    return wp.max(gap, 0)


@wp.kernel
def _match_pieces(
    # In:
    lines: Polylines,
    corner_winding: wp.array[wp.int32],  # of the solid around corner 0, shape [section]
    # Out:
    ends: Ends,
    seen: wp.array[wp.uint8],  # scratch, comes as 0, shape [piece]
    polyline_count: wp.array[wp.int64],  # shape [section + 1]
    point_count: wp.array[wp.int64],  # shape [section + 1]
):
    """Match leaving and entering ends.

    Along the boundary the solid begins where a piece leaves and ends where one enters. At corner 0 `winding` stretches
    are open already: the first entries end those, so the k-th leaving end goes with the (k + winding)-th entering one,
    around the corner where that is past the last. By rank alone: ends that rounding has swapped stay matched.
    """
    section = wp.tid()
    base = lines.section_start[section]
    count = int(lines.section_start[section + 1] - base)
    winding = corner_winding[section]
    points = int(0)
    polylines = int(0)
    if count > 0:
        points = int(lines.polyline_start[base + wp.int64(count)] - lines.polyline_start[base])
    open_count = sort_ends(lines, base, count, True, ends.leaving)
    sort_ends(lines, base, count, False, ends.entering)
    for k in range(open_count):
        leaving = ends.leaving[base + wp.int64(k)]
        entering = ends.entering[base + wp.int64((k + wp.max(winding, 0)) % open_count)]
        passed = corners_between(
            lines, base + wp.int64(leaving), base + wp.int64(entering), k + wp.max(winding, 0) >= open_count
        )
        ends.follower[base + wp.int64(leaving)] = entering
        ends.corners[base + wp.int64(leaving)] = passed
        points += passed
    for piece in range(count):
        if seen[base + wp.int64(piece)] == wp.uint8(0):
            polylines += 1
            j = int(piece)
            while j != NONE and seen[base + wp.int64(j)] == wp.uint8(0):
                seen[base + wp.int64(j)] = wp.uint8(1)
                j = ends.follower[base + wp.int64(j)]
    if open_count == 0 and winding > 0:
        polylines += 1
        points += 4
    polyline_count[section] = wp.int64(polylines)
    point_count[section] = wp.int64(points)


@wp.func
def write_corner(out: Polylines, i: wp.int64, k: int, half: wp.vec2d, edge_count: int):
    """Write patch corner k as point i, hand kind."""
    out.point[i] = corner(k, half)
    out.key[i] = 3 * edge_count + k
    out.kind[i] = wp.uint8(HAND)


@wp.kernel
def _close_polylines(
    # In:
    lines: Polylines,
    patch: wp.array[Patch],
    edge_count: int,
    corner_winding: wp.array[wp.int32],
    ends: Ends,
    point_start: wp.array[wp.int64],  # offsets of the sections' points, shape [section + 1]
    # Out:
    seen: wp.array[wp.uint8],  # scratch, comes as 1, shape [piece]
    out: Polylines,
):
    """Write the loops: pieces as object kind, what joins them as hand kind; the whole boundary if none crosses it."""
    section = wp.tid()
    half = patch[section % patch.shape[0]].half
    base = lines.section_start[section]
    count = int(lines.section_start[section + 1] - base)
    i = point_start[section]
    line = out.section_start[section]
    open_count = int(0)
    for piece in range(count):
        if seen[base + wp.int64(piece)] == wp.uint8(1):
            out.polyline_start[line] = i
            out.closed[line] = wp.uint8(1)
            line += wp.int64(1)
            j = int(piece)
            while j != NONE and seen[base + wp.int64(j)] == wp.uint8(1):
                source = base + wp.int64(j)
                seen[source] = wp.uint8(0)
                for k in range(int(lines.polyline_start[source]), int(lines.polyline_start[source + wp.int64(1)])):
                    out.point[i] = lines.point[k]
                    out.key[i] = lines.key[k]
                    i += wp.int64(1)
                if lines.closed[source] == wp.uint8(0):
                    open_count += 1
                    out.kind[i - wp.int64(1)] = wp.uint8(HAND)
                    for k in range(ends.corners[source]):
                        write_corner(out, i, (lines.side[source][1] + 1 + k) % 4, half, edge_count)
                        i += wp.int64(1)
                j = ends.follower[source]
    if open_count == 0 and corner_winding[section] > 0:
        out.polyline_start[line] = i
        out.closed[line] = wp.uint8(1)
        line += wp.int64(1)
        for k in range(4):
            write_corner(out, i, k, half, edge_count)
            i += wp.int64(1)
    if section == lines.section_start.shape[0] - 2:
        out.polyline_start[line] = i


def close_polylines(lines: Polylines, patch: wp.array, edge_count: int, corner_winding: wp.array) -> Polylines:
    """Close the pieces that `clip_polylines` made of a watertight mesh's sections.

    lines: every open piece enters and leaves through a side of its patch.
    corner_winding: int32, shape [section], from the same call.
    """
    section_count = lines.section_start.shape[0] - 1
    piece_count = lines.closed.shape[0]
    device = lines.closed.device
    ends = Ends()
    ends.leaving = wp.empty(piece_count, dtype=wp.int32, device=device)
    ends.entering = wp.empty(piece_count, dtype=wp.int32, device=device)
    ends.follower = wp.full(piece_count, -1, dtype=wp.int32, device=device)
    ends.corners = wp.zeros(piece_count, dtype=wp.int32, device=device)
    seen = wp.zeros(piece_count, dtype=wp.uint8, device=device)
    polylines = wp.zeros(section_count + 1, dtype=wp.int64, device=device)
    points = wp.zeros(section_count + 1, dtype=wp.int64, device=device)
    wp.launch(
        _match_pieces,
        section_count,
        inputs=[lines, corner_winding],
        outputs=[ends, seen, polylines, points],
        device=device,
    )
    section_start, polyline_count = offsets_of(polylines)
    point_start, point_count = offsets_of(points)
    out = empty_polylines(section_start, polyline_count, point_count)
    wp.launch(
        _close_polylines,
        section_count,
        inputs=[lines, patch, edge_count, corner_winding, ends, point_start],
        outputs=[seen, out],
        device=device,
    )
    return out
