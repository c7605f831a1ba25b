"""Finding contour pieces.

| method | search | threads |
|---|---|---|
| trace | scan of all scanned edges, for surfaces with a scan path | one a section |
| seek | descent of the box hierarchy, walks from triangle to triangle | one a section |
| flat | descent of the box hierarchy, crossings ranked side by side | many a section, for large surfaces on GPUs |
"""

from collections.abc import Callable
from typing import Any

import warp as wp

from ..patch import require_section_poses
from ..section.pieces import room_for_excess, room_for_sections
from ..section.scan_search import scan_search_pieces
from ..section.step_lists import room_for_steps
from ..section.tree_search import tree_search_pieces
from .flat_search import CrossingLimitError, flat_search_pieces

SCAN_SEARCH_FACES_MOST = 5000  # other searches are faster for more triangles, on a CPU and a GPU (performance.md)
METHODS = ("trace", "seek", "flat")


def method_for(surface: Any, device: Any) -> str:
    """The fastest method for a surface: "trace" for small ones, "seek" or on a GPU "flat" for others."""
    small = surface.corner.shape[0] // 3 <= SCAN_SEARCH_FACES_MOST
    if small and surface.scan_path.shape[0] > 0:
        return "trace"
    return "seek" if device.is_cpu else "flat"


def lists_steps(device: Any) -> bool:
    """Whether the scan search lists steps, to draw from them: one thread alone draws faster by walking."""
    return device.is_cuda


def find_pieces(
    surface: Any, pose: wp.array, patch: wp.array, *, bounded: bool, closes: bool, method: str | None = None
) -> list:
    """Find the pieces of a surface's contours in every patch at every pose; all methods find the same pieces.

    surface: Surface; pose: wp.transform, of the hand or of each patch, shape [pose, 1 or patch]; patch: Patch, shape
    [patch]; all on one device.
    bounded: whether patches cut contours off; closes: whether winding numbers are computed.
    method: "trace" (for surfaces with a scan path), "seek", "flat" (for any; "seek" if a section has more crossings
    than it can link), None: the fastest one.
    Raises ValueError for an unknown method, one that the surface does not allow, and poses of another shape.
    Returns ContourPieces of all sections, and further ContourPieces for sections with more than SLOTS pieces.
    """
    device = pose.device
    require_section_poses(pose, patch)
    method = method or method_for(surface, device)
    if method not in METHODS:
        raise ValueError(f"method must be one of {', '.join(METHODS)}, not {method!r}")
    if method == "trace" and surface.scan_path.shape[0] == 0:
        raise ValueError(f"a surface of {surface.corner.shape[0] // 3} triangles has no scan path: use seek")
    if method == "trace":
        return _scanned_pieces(surface, pose, patch, bounded=bounded)
    if method == "flat":
        try:
            return _searched_pieces(flat_search_pieces, surface, pose, patch, bounded=bounded, closes=closes)
        except CrossingLimitError:  # the tree search has no such limit
            pass
    return _searched_pieces(tree_search_pieces, surface, pose, patch, bounded=bounded, closes=closes)


def _scanned_pieces(surface: Any, pose: wp.array, patch: wp.array, *, bounded: bool) -> list:
    """`find_pieces` by the scan search."""
    row_count = pose.shape[0] * patch.shape[0]
    found = [room_for_sections(row_count, pose.device)]
    if lists_steps(pose.device):
        faces = surface.corner.shape[0] // 3
        found[0].lists = room_for_steps(row_count, faces, bounded=bounded, device=pose.device)
    needed = scan_search_pieces(surface, pose, patch, found[0], bounded=bounded)
    if found[0].excess.numpy()[0] > 0:
        found.append(room_for_excess(found[0], pose.device))
        room = int(needed.numpy()[found[1].section.numpy()].max())  # events of a row
        scan_search_pieces(surface, pose, patch, found[1], bounded=bounded, room=room)
    return found


def _searched_pieces(
    search: Callable, surface: Any, pose: wp.array, patch: wp.array, *, bounded: bool, closes: bool
) -> list:
    """`find_pieces` by a search of the box hierarchy."""
    found = [room_for_sections(pose.shape[0] * patch.shape[0], pose.device)]
    search(surface, pose, patch, found[0], bounded=bounded, closes=closes)
    if found[0].excess.numpy()[0] > 0:
        found.append(room_for_excess(found[0], pose.device))
        search(surface, pose, patch, found[1], bounded=bounded, closes=closes)
    return found
