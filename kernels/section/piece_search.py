"""Finding contour pieces: by a scan of all scanned edges ("trace") or a search in the box hierarchy ("seek")."""

from typing import Any

import warp as wp

from ..patch import require_section_poses
from .pieces import room_for_excess, room_for_sections
from .scan_search import scan_search_pieces
from .tree_search import tree_search_pieces

SCAN_SEARCH_FACES_MOST = {"cpu": 5000, "cuda": 8000}  # the tree search is faster for more triangles (performance.md)
METHODS = ("trace", "seek")


def method_for(surface: Any, device: Any) -> str:
    """The faster method for a surface: "trace" or "seek"."""
    small = surface.corner.shape[0] // 3 <= SCAN_SEARCH_FACES_MOST["cpu" if device.is_cpu else "cuda"]
    return "trace" if small and surface.scan_path.shape[0] > 0 else "seek"


def find_pieces(
    surface: Any, pose: wp.array, patch: wp.array, *, bounded: bool, closes: bool, method: str | None = None
) -> list:
    """Find the pieces of a surface's contours in every patch at every pose; both methods find the same pieces.

    surface: Surface; pose: wp.transform, of the hand or of each patch, shape [pose, 1 or patch]; patch: Patch, shape
    [patch]; all on one device.
    bounded: whether patches cut contours off; closes: whether winding numbers are computed.
    method: "trace" (scan search, for surfaces with a scan path), "seek" (tree search, for any), None: the faster one.
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
    found = [room_for_sections(pose.shape[0] * patch.shape[0], device)]
    needed = None
    if method == "trace":
        needed = scan_search_pieces(surface, pose, patch, found[0], bounded=bounded)
    else:
        tree_search_pieces(surface, pose, patch, found[0], bounded=bounded, closes=closes)
    if found[0].excess.numpy()[0] > 0:
        rest = room_for_excess(found[0], device)
        found.append(rest)
        if needed is not None:  # number of events of each row
            room = int(needed.numpy()[rest.section.numpy()].max())
            scan_search_pieces(surface, pose, patch, rest, bounded=bounded, room=room)
        else:
            tree_search_pieces(surface, pose, patch, rest, bounded=bounded, closes=closes)
    return found
