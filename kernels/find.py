"""Which way contours are looked for: along every scanned edge, or through the hierarchy."""

from typing import Any

import warp as wp

from .piece import room_for_excess, room_for_sections
from .seek import _seek_pieces
from .trace import _trace_pieces

TRACED_LARGEST = {"cpu": 2000, "cuda": 2000}  # [triangle]; measured (docs/performance.md): larger ones are sought
METHODS = ("trace", "seek")


def method_for(face_count: int, device: str) -> str:
    """The faster way for a surface of that many triangles: "trace" or "seek"."""
    return METHODS[face_count > TRACED_LARGEST["cpu" if device == "cpu" else "cuda"]]


def find_pieces(
    surface: Any, pose: wp.array, patch: wp.array, *, bounded: bool, closes: bool, method: str | None = None
) -> list:
    """Find what of a surface's contours lies in every patch at every pose; the same pieces by either method.

    surface: Surface; pose: wp.transform, shape [pose]; patch: Patch, shape [patch]; all on one device.
    bounded: whether patches cut contours off; closes: whether winding numbers are wanted.
    method: "trace" for surfaces with a trail, "seek" for any, None for the faster one.
    Returns Pieces, and more Pieces for sections that had no room in the first.
    """
    device = pose.device
    method = method or method_for(surface.corner.shape[0] // 3, "cpu" if device.is_cpu else "cuda")

    def launch(pieces: Any) -> None:
        inputs = [surface, pose, patch, int(bounded), *([int(closes)] if method == "seek" else [])]
        kernel = _seek_pieces if method == "seek" else _trace_pieces
        wp.launch(kernel, pieces.count.shape[0], inputs=inputs, outputs=[pieces], device=device)

    found = [room_for_sections(pose.shape[0] * patch.shape[0], device)]
    launch(found[0])
    if found[0].excess.numpy()[0] > 0:
        found.append(room_for_excess(found[0], device))
        launch(found[1])
    return found
