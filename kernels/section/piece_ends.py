"""Where pieces enter and leave their patch: what joining compares."""

import warp as wp

from ..patch import Frame, outcode, output_point
from .half_edges import Surface
from .pieces import ContourPieces
from .segment_clipping import NONE, side_point, side_position
from .triangle_walk import crossing_after, crossing_at, point_of


@wp.struct
class PieceEnds:
    """Ends of a row's open pieces, sorted along the boundary; scratch, by slot."""

    leaving: wp.array[wp.int32]  # piece, in the order of the places where pieces leave; in the end, by key
    entering: wp.array[wp.int32]  # piece, in the order of the places where pieces enter
    follower: wp.array[wp.int32]  # the piece that the boundary leads to from where this one leaves; NONE once drawn
    corners: wp.array[wp.int32]  # how many corners it passes on the way
    position: wp.array[wp.vec2d]  # how far along its side each piece enters and leaves [m]
    steps: wp.array[wp.int32]  # steps of non-zero length
    first: wp.array[wp.vec3]  # first and last point [m], array frame
    last: wp.array[wp.vec3]


@wp.func
def place_ends(surface: Surface, f: Frame, half: wp.vec2d, pieces: ContourPieces, i: wp.int64, ends: PieceEnds):
    """Compute where an open piece enters and leaves its patch; add its steps of non-zero length there."""
    side = pieces.side[i]
    position = wp.vec2d()
    steps = pieces.steps[i] // 2
    x = wp.vec3()
    if side[0] != NONE:
        c = crossing_at(surface, f, pieces.half[i])
        q = point_of(f, crossing_after(surface, f, c), half)
        p = side_point(side[0], point_of(f, c, half), q, half)
        x = output_point(f, p)
        position[0] = side_position(side[0], p)
        ends.first[i] = x
        if outcode(q, half) == 0 and not (x == output_point(f, q)):
            steps += 1
    if side[1] != NONE:
        c = crossing_at(surface, f, pieces.out[i])
        p = point_of(f, c, half)
        q = side_point(side[1], p, point_of(f, crossing_after(surface, f, c), half), half)
        y = output_point(f, q)
        position[1] = side_position(side[1], q)
        ends.last[i] = y
        if outcode(p, half) == 0:
            x = output_point(f, p)
        if not (x == y):
            steps += 1
    ends.position[i] = position
    ends.steps[i] = steps
