"""Planes of a warp's queries, where all its lanes can read them: any lane computes points of any query."""

import warp as wp

from ..patch import Frame
from ..warps import long_at, memory_of_warp, set_long, set_vec3d, vec3d_at

PLANE_WORDS = 17  # of a query, 64 bits each: odd, so that lanes which read different queries seldom wait for each other


@wp.func_native(memory_of_warp(PLANE_WORDS))
def plane_memory(own: wp.array[wp.int64]) -> wp.uint64:
    """Address of the planes of the warp's queries; own: a CPU's memory."""


@wp.struct
class SectionPlane:
    """Frame, extents and place of a query, from which its points are computed."""

    f: Frame
    side: wp.vec2d  # half extents of the patch [m]
    start: wp.int64  # where the query begins, among points or slots


@wp.func
def keep_plane(memory: wp.uint64, lane: int, plane: SectionPlane):
    """Write the plane of a lane's query."""
    i = lane * PLANE_WORDS
    set_vec3d(memory, i, plane.f.origin)
    set_vec3d(memory, i + 3, plane.f.u)
    set_vec3d(memory, i + 6, plane.f.v)
    set_vec3d(memory, i + 9, plane.f.n)
    set_vec3d(memory, i + 12, wp.vec3d(plane.f.flush, plane.side[0], plane.side[1]))
    set_long(memory, i + 15, plane.start)
    set_long(memory, i + 16, wp.int64(plane.f.relative))


@wp.func
def start_at(memory: wp.uint64, lane: int):
    """Index at which a lane's query begins."""
    return long_at(memory, lane * PLANE_WORDS + 15)


@wp.func
def plane_of(memory: wp.uint64, lane: int):
    """The plane of a lane's query."""
    plane = SectionPlane()
    i = lane * PLANE_WORDS
    plane.f.origin = vec3d_at(memory, i)
    plane.f.u = vec3d_at(memory, i + 3)
    plane.f.v = vec3d_at(memory, i + 6)
    plane.f.n = vec3d_at(memory, i + 9)
    x = vec3d_at(memory, i + 12)
    plane.f.flush = x[0]
    plane.side = wp.vec2d(x[1], x[2])
    plane.start = start_at(memory, lane)
    plane.f.relative = int(long_at(memory, i + 16))
    return plane
