"""The search that finds the pieces of a surface's contours in every patch at every pose: all find the same pieces.

| search | work | threads |
|---|---|---|
| scan | scan of all scanned edges, for surfaces with a scan path | one a section; one that is done takes the next |
| tree | descent of the box hierarchy, walks from triangle to triangle | one a section |
| flat | descent of the box hierarchy, crossings ranked side by side | many a section, for large surfaces on GPUs |
"""

from typing import Any, Protocol

from ..patch import require_section_poses
from .flat_search import FlatSearch
from .pieces import CutPlanes
from .scan import ScanSearch
from .tree import TreeSearch

SCAN_FACES_CPU, SCAN_FACES_GPU = 5000, 6500  # of more triangles other searches find pieces faster (performance.md)

_FORCED_BY_TESTS: str | None = None  # "scan", "tree" or "flat": tests compare the searches; None: the fastest one


class Search(Protocol):
    """A search whose launches are not waited for, so that joining is launched while it runs."""

    def launch(self) -> Any:
        """ContourPieces of the sections that are searched; called once."""

    def rest(self) -> list[Any]:
        """Searches of sections that are not done yet, since room was too small; waits for the device."""


def search_for(surface: Any, device: Any) -> str:
    """The fastest search for a surface: "scan" for small ones, "tree" or on a GPU "flat" for others."""
    if _FORCED_BY_TESTS is not None:
        return _FORCED_BY_TESTS
    most = SCAN_FACES_CPU if device.is_cpu else SCAN_FACES_GPU
    if surface.corner.shape[0] // 3 <= most and surface.scan_path.shape[0] > 0:
        return "scan"
    return "tree" if device.is_cpu else "flat"


def lists_steps(device: Any) -> bool:
    """Whether the scan search lists steps, to draw from them: one thread alone draws faster by walking."""
    return device.is_cuda


def first_search(planes: CutPlanes, *, draws: bool) -> Search:
    """The search of all sections, not launched yet.

    draws: whether the pieces will be drawn (`draw_contours`); a scan search then lists what drawing is faster with.
    Raises ValueError for poses that are neither those of the hand nor those of each patch.
    """
    require_section_poses(planes.pose, planes.patch)
    name = search_for(planes.surface, planes.pose.device)
    if name == "scan":
        return ScanSearch(planes, lists=draws and lists_steps(planes.pose.device))
    return FlatSearch(planes, None, planes.section_count) if name == "flat" else TreeSearch(planes)
