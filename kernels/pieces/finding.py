"""Finding contour pieces.

| method | search | threads |
|---|---|---|
| trace | scan of all scanned edges, for surfaces with a scan path | one a section; one that is done takes the next |
| seek | descent of the box hierarchy, walks from triangle to triangle | one a section |
| flat | descent of the box hierarchy, crossings ranked side by side | many a section, for large surfaces on GPUs |
"""

from collections.abc import Iterable, Iterator
from typing import Any

import warp as wp

from ..patch import require_section_poses
from ..section.clip_events import clip_events
from ..section.pieces import room_for_excess, room_for_sections
from ..section.scan_search import walk_sections
from ..section.step_lists import room_for_steps
from ..section.tree_search import tree_pieces
from .flat_search import flat_search_pieces

SCAN_FACES_CPU, SCAN_FACES_GPU = 5000, 6500  # of more triangles other searches find pieces faster (performance.md)
METHODS = ("trace", "seek", "flat")


def method_for(surface: Any, device: Any) -> str:
    """The fastest method for a surface: "trace" for small ones, "seek" or on a GPU "flat" for others."""
    most = SCAN_FACES_CPU if device.is_cpu else SCAN_FACES_GPU
    if surface.corner.shape[0] // 3 <= most and surface.scan_path.shape[0] > 0:
        return "trace"
    return "seek" if device.is_cpu else "flat"


def lists_steps(device: Any) -> bool:
    """Whether the scan search lists steps, to draw from them: one thread alone draws faster by walking."""
    return device.is_cuda


def find_pieces(
    surface: Any,
    pose: wp.array,
    patch: wp.array,
    *,
    bounded: bool,
    closes: bool,
    method: str | None = None,
    draws: bool = True,
) -> Iterable[Any]:
    """Find the pieces of a surface's contours in every patch at every pose; all methods find the same pieces.

    surface: Surface; pose: wp.transform, of the hand or of each patch, shape [pose, 1 or patch]; patch: Patch, shape
    [patch]; all on one device.
    bounded: whether patches cut contours off; closes: whether winding numbers are computed.
    method: "trace" (for surfaces with a scan path), "seek", "flat" (for any), None: the fastest one.
    draws: whether the pieces will be drawn (`draw_contours`); a scan search then lists what drawing is faster with.
    Raises ValueError for an unknown method, one that the surface does not allow, and poses of another shape.
    Yields ContourPieces, once and in this order: of all sections, in one or several; and further ones of
    sections that had too little room. Scan and flat searches are launched when their ContourPieces are asked for.
    """
    device = pose.device
    require_section_poses(pose, patch)
    method = method or method_for(surface, device)
    if method not in METHODS:
        raise ValueError(f"method must be one of {', '.join(METHODS)}, not {method!r}")
    if method == "trace" and surface.scan_path.shape[0] == 0:
        raise ValueError(f"a surface of {surface.corner.shape[0] // 3} triangles has no scan path: use seek")
    if method == "trace":
        return _scanned_pieces(surface, pose, patch, bounded=bounded, draws=draws)
    search = flat_search_pieces if method == "flat" else tree_pieces
    return search(surface, pose, patch, bounded=bounded, closes=closes)


def _scanned_pieces(surface: Any, pose: wp.array, patch: wp.array, *, bounded: bool, draws: bool) -> Iterator[Any]:
    """`find_pieces` by the scan search; queries with too little room are searched again after the first yield."""
    device, query_count, lists = pose.device, pose.shape[0] * patch.shape[0], None
    if draws and lists_steps(device):
        lists = room_for_steps(query_count, surface.corner.shape[0] // 3, bounded=bounded, device=device)
    events = walk_sections(surface, pose, patch, None, bounded=bounded, lists=lists)
    pieces = room_for_sections(query_count, device)
    if lists is not None:
        pieces.lists = lists
    clip_events(surface, events, pieces)
    count = events.count
    del events  # its memory serves joining
    yield pieces
    if pieces.excess.numpy()[0] > 0:
        rest = room_for_excess(pieces, device)
        room = int(count.numpy()[rest.section.numpy()].max())  # events of a query
        events = walk_sections(surface, pose, patch, rest.section, bounded=bounded, room=room)
        clip_events(surface, events, rest)
        yield rest
