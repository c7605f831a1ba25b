"""Which way contours are looked for: along every scanned edge, or through the hierarchy."""

from typing import Any

import warp as wp

from ..patch import require_section_poses
from .pieces import room_for_excess, room_for_sections
from .scan_search import trace_pieces
from .tree_search import seek_pieces

TRACED_LARGEST = {"cpu": 5000, "cuda": 8000}  # [triangle]; measured (docs/measured/performance.md): larger: seek
METHODS = ("trace", "seek")


def method_for(surface: Any, device: Any) -> str:
    """The faster way for a surface: "trace" or "seek"."""
    small = surface.corner.shape[0] // 3 <= TRACED_LARGEST["cpu" if device.is_cpu else "cuda"]
    return "trace" if small and surface.trail.shape[0] > 0 else "seek"


def find_pieces(
    surface: Any, pose: wp.array, patch: wp.array, *, bounded: bool, closes: bool, method: str | None = None
) -> list:
    """Find what of a surface's contours lies in every patch at every pose; the same pieces by either method.

    surface: Surface; pose: wp.transform, of the hand or of each patch, shape [pose, 1 or patch]; patch: Patch, shape
    [patch]; all on one device.
    bounded: whether patches cut contours off; closes: whether winding numbers are wanted.
    method: "trace" for surfaces with a trail, "seek" for any, None for the faster one.
    Raises ValueError for a method that does not exist, or not for this surface, and for poses of another shape.
    Returns Pieces, and more Pieces for sections that had no room in the first.
    """
    device = pose.device
    require_section_poses(pose, patch)
    method = method or method_for(surface, device)
    if method not in METHODS:
        raise ValueError(f"method must be one of {', '.join(METHODS)}, not {method!r}")
    if method == "trace" and surface.trail.shape[0] == 0:
        raise ValueError(f"a surface of {surface.corner.shape[0] // 3} triangles has no trail to trace: use seek")
    found = [room_for_sections(pose.shape[0] * patch.shape[0], device)]
    needed = None
    if method == "trace":
        needed = trace_pieces(surface, pose, patch, found[0], bounded=bounded)
    else:
        seek_pieces(surface, pose, patch, found[0], bounded=bounded, closes=closes)
    if found[0].excess.numpy()[0] > 0:
        rest = room_for_excess(found[0], device)
        found.append(rest)
        if needed is not None:  # events, that is
            room = int(needed.numpy()[rest.section.numpy()].max())
            trace_pieces(surface, pose, patch, rest, bounded=bounded, room=room)
        else:
            seek_pieces(surface, pose, patch, rest, bounded=bounded, closes=closes)
    return found
