"""Mesh cut by the planes of patches: one crossing per mesh edge, each knowing the edge of the next."""

import warp as wp

from .patch import EXACT, Frame, Patch, above, blend, flat, frame_at, height
from .ragged import offsets_of
from .winged import OPEN, WingedMesh

wp.set_module_options(EXACT)


@wp.struct
class Crossings:
    """Where a mesh's edges cross the planes, by section (pose-major: section = pose * patch_count + patch)."""

    section_start: wp.array[wp.int64]  # offsets into crossings, shape [section + 1]
    key: wp.array[wp.int32]  # of the mesh edge, ascending within a section
    next_key: wp.array[wp.int32]  # of the crossing that follows, the solid on the left; OPEN at an open border
    point: wp.array[wp.vec2d]  # in the patch's frame [m]


@wp.func
def edge_crossed(mesh: WingedMesh, frame: Frame, edge: int):
    """Whether an edge's ends lie on different sides of the plane."""
    end = mesh.end[edge]
    return above(height(frame, mesh.vertex[end[0]])) != above(height(frame, mesh.vertex[end[1]]))


@wp.func
def key_after(mesh: WingedMesh, frame: Frame, edge: int, lower_above: bool):
    """Key of the crossing that follows: of the triangle that runs down through the plane along this edge.

    Its contour leaves through the edge by which it comes up again:

        third vertex   runs            comes up along
        above          a > b < third   next edge (b to third)
        below          a > b, third    next but one edge (third to a)
    """
    wing = mesh.wing[edge, 1]
    if lower_above:
        wing = mesh.wing[edge, 0]
    if wing[0] == OPEN:
        return OPEN
    if above(height(frame, mesh.vertex[wing[0]])):
        return wing[1]
    return wing[2]


@wp.kernel
def _count_crossings(
    # In:
    mesh: WingedMesh,
    pose: wp.array[wp.transform],  # hand frame -> array frame, shape [pose]
    patch: wp.array[Patch],
    # Out:
    count: wp.array[wp.int64],  # shape [section + 1], the last one stays 0
):
    """Count the mesh edges that cross each section's plane."""
    section = wp.tid()
    frame = frame_at(pose[section // patch.shape[0]], patch[section % patch.shape[0]])
    n = int(0)
    for edge in range(mesh.end.shape[0]):
        if edge_crossed(mesh, frame, edge):
            n += 1
    count[section] = wp.int64(n)


@wp.kernel
def _slice_mesh(
    # In:
    mesh: WingedMesh,
    pose: wp.array[wp.transform],  # hand frame -> array frame, shape [pose]
    patch: wp.array[Patch],
    # Out:
    crossings: Crossings,
):
    """Write each section's crossings in the order of their keys."""
    section = wp.tid()
    frame = frame_at(pose[section // patch.shape[0]], patch[section % patch.shape[0]])
    i = crossings.section_start[section]
    for edge in range(mesh.end.shape[0]):
        end = mesh.end[edge]
        x = mesh.vertex[end[0]]
        y = mesh.vertex[end[1]]
        a = height(frame, x)
        b = height(frame, y)
        if above(a) != above(b):
            p = flat(frame, x)
            q = flat(frame, y)
            crossings.key[i] = edge
            crossings.next_key[i] = key_after(mesh, frame, edge, above(a))
            crossings.point[i] = wp.vec2d(blend(p[0], q[0], a, b), blend(p[1], q[1], a, b))
            i += wp.int64(1)


class CrossingLimitError(MemoryError):
    """A batch has more crossings than the caller has room for."""

    def __init__(self, count: int, limit: int) -> None:
        super().__init__(f"{count} crossings of mesh edges exceed the limit of {limit}")
        self.count = count


def slice_mesh(mesh: WingedMesh, pose: wp.array, patch: wp.array, *, limit: int | None = None) -> Crossings:
    """Cut a mesh by every patch's plane at every pose (not yet by the patch itself).

    A contour keeps the solid on its left seen from +n (Minetto 2017 for the half-open rule). Brute force: every pose
    looks at every edge.

    pose: wp.transform, shape [pose]; patch: Patch, shape [patch]; all on the mesh's device.
    Raises CrossingLimitError, before any memory is taken for them, if there are more crossings than `limit`.
    """
    crossings = Crossings()
    section_count = pose.shape[0] * patch.shape[0]
    device = pose.device
    count = wp.zeros(section_count + 1, dtype=wp.int64, device=device)
    wp.launch(_count_crossings, section_count, inputs=[mesh, pose, patch], outputs=[count], device=device)
    crossings.section_start, total = offsets_of(count)
    if limit is not None and total > limit:
        raise CrossingLimitError(total, limit)
    crossings.key = wp.empty(total, dtype=wp.int32, device=device)
    crossings.next_key = wp.empty(total, dtype=wp.int32, device=device)
    crossings.point = wp.empty(total, dtype=wp.vec2d, device=device)
    wp.launch(_slice_mesh, section_count, inputs=[mesh, pose, patch], outputs=[crossings], device=device)
    return crossings
