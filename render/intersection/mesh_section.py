"""Raw contours of a mesh on the patches of a hand, or their metrics, for one batch of poses.

Contours of a simple mesh are cut, joined and drawn by kernels. Those of a closed mesh that crosses
itself are the boundary of the region that its winding number defines as inside, computed on the host by section.
"""

from collections.abc import Iterable
from functools import lru_cache
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import warp as wp

from ...kernels.flush import FLUSH_RATE, resolve_flush
from ...kernels.offsets import PointLimitError
from ...kernels.patterns.section_cutting import cut_sections
from ...kernels.patterns.section_drawing import draw_sections
from ...kernels.patterns.section_sums import sum_sections
from ...kernels.pieces.finding import find_pieces
from ...kernels.pieces.plane_loops import plane_loops
from ...kernels.section.contour_writing import draw_contours
from ...kernels.section.joining import join_pieces, order_pieces
from ...kernels.section.tally_undrawn import tally_pieces
from ..contour_batch import ContourBatch, join_polylines
from ..errors import MeshError
from ..hands.hand import Palm, PatchHand
from ..objects.mesh.solid_mesh import MeshObject
from ..objects.solid import Solid
from ..runtime.stage_timing import StageClock
from ..strategies.intersection_strategy import IntersectionStrategy
from .section_regularisation import regularised_contours

PATTERN = "pattern"
"""Method of small closed meshes, the fastest one for them: loops from a table (`kernels.patterns`), without a search
(`find_pieces`)."""


def intersect(
    mesh: MeshObject,
    hand: PatchHand,
    pose: wp.array,
    strategy: IntersectionStrategy,
    *,
    point_limit: int | None = None,
    method: str | None = None,
    timing: dict[str, float] | None = None,
    farthest: float = 0.0,
    relative: bool = False,
) -> tuple[ContourBatch, int]:
    """Raw contours of a mesh on patches, on the device of the poses, and how many points they have.

    pose: wp.transform, hand frame -> array frame, shape [pose]; or as `Hand.section_poses`, shape [pose, 1 or patch].
    strategy: only "outside", "close" and `flush` count here. point_limit: more points than this raise
    `PointLimitError` before memory is allocated for them. method: how contours are looked for, PATTERN or see
    `find_pieces`; the result is the same, and ValueError is raised for one that the mesh does not allow. timing: takes
    the seconds of each stage, which are then waited for one by one. farthest, relative: see `patches_for`.
    """
    patch = patches_for(hand, mesh, strategy, str(pose.device), farthest=farthest, relative=relative)
    if needs_regularising(mesh):
        if method == PATTERN:
            raise ValueError(f"{mesh.name} crosses itself, which the method {PATTERN!r} does not allow")
        batch, count = _regularised(mesh.solid_part, patch, pose, strategy, point_limit, method, timing)
        if not mesh.report.sheet_faces:
            return batch, count
        options = {"method": method, "timing": timing, "farthest": farthest, "relative": relative}
        sheets, added = intersect(mesh.sheet_part, hand, pose, strategy, point_limit=point_limit, **options)
        return join_polylines(batch.numpy(), sheets.numpy()).to(str(pose.device)), count + added
    _require_cuttable(mesh, strategy)
    device, bounded, closes = str(pose.device), strategy.bounded, strategy.closes
    if (table := _loop_table(mesh, pose.device, method)) is not None:
        planes = (table, sections_of(pose), patch)
        with StageClock(timing, "find", device):
            cut = cut_sections(*planes, bounded=bounded, closes=closes)
        with StageClock(timing, "draw", device):
            contours = draw_sections(*planes, cut, bounded=bounded, closes=closes, limit=point_limit)
        return ContourBatch.of_sections(contours, hand.patch_count), contours.points.shape[0]
    found, (surface, section) = _pieces(mesh, patch, pose, strategy, method, timing)
    with StageClock(timing, "join", device):
        joined = join_pieces(surface, found, section, patch, closes=closes, limit=point_limit)
    with StageClock(timing, "draw", device):
        contours = draw_contours(surface, section, patch, joined, bounded=bounded, closes=closes)
    return ContourBatch.of_sections(contours, hand.patch_count), joined.point_count


def needs_regularising(mesh: MeshObject) -> bool:
    """Whether the contours in which planes cut a mesh are not the boundary of its sections: it crosses itself.

    The sections of a surface with open edges have no inside to be regularised by: its contours are drawn as cut.
    """
    return not mesh.is_simple and mesh.report.closed


def _regularised(
    mesh: MeshObject,
    patch: wp.array,
    pose: wp.array,
    strategy: IntersectionStrategy,
    point_limit: int | None,
    method: str | None,
    timing: dict[str, float] | None,
) -> tuple[ContourBatch, int]:
    """`intersect` for a mesh that crosses itself; points of the loops that are cut count for the limit, too."""
    device = str(pose.device)
    section = sections_of(pose)
    surface = mesh.on(device)
    with StageClock(timing, "find", device):
        loops = plane_loops(surface, section, patch, bounded=strategy.bounded, method=method, limit=point_limit)
    with StageClock(timing, "regularise", device):
        stages = {"bounded": strategy.bounded, "closes": strategy.closes}
        batch = regularised_contours(loops, patch, solid=mesh.solid, gap=mesh.gap, **stages)
        if point_limit is not None and batch.point_count > point_limit:
            raise PointLimitError(batch.point_count, point_limit)
        return batch.to(device), batch.point_count


def tally_intersection(
    mesh: MeshObject,
    hand: PatchHand,
    pose: wp.array,
    strategy: IntersectionStrategy,
    value: wp.array,
    length: wp.array,
    *,
    method: str | None = None,
    timing: dict[str, float] | None = None,
) -> None:
    """Metrics of `intersect`'s contours, bit-identical to those of `tally_contours`, without memory for points.

    value: float32, takes rows METRICS, shape [metric.., pose], the area NaN unless the strategy closes contours.
    length: takes that of all contours in float64 [m], shape [pose]. The others as for `intersect`.
    """
    patch = patches_for(hand, mesh, strategy, str(pose.device))
    _require_cuttable(mesh, strategy)
    device, bounded, closes = str(pose.device), strategy.bounded, strategy.closes
    if (table := _loop_table(mesh, pose.device, method)) is not None:
        planes = (table, sections_of(pose), patch)
        with StageClock(timing, "find", device):
            cut = cut_sections(*planes, bounded=bounded, closes=closes)
        with StageClock(timing, "measure", device):
            sum_sections(*planes, cut, value, length, bounded=bounded, closes=closes)
        return
    found, (surface, section) = _pieces(mesh, patch, pose, strategy, method, timing, draws=False)
    with StageClock(timing, "join", device):
        ordered = order_pieces(surface, found, section, patch, closes=closes)
    with StageClock(timing, "measure", device):
        tally_pieces(surface, section, patch, ordered, value, length, bounded=bounded, closes=closes)


def _pieces(
    mesh: MeshObject,
    patch: wp.array,
    pose: wp.array,
    strategy: IntersectionStrategy,
    method: str | None,
    timing: dict[str, float] | None,
    *,
    draws: bool = True,
) -> tuple[Iterable[Any], tuple[Any, wp.array]]:
    """Pieces of contours in each patch; and the surface and section poses that they were found with."""
    device, section = str(pose.device), sections_of(pose)
    surface = mesh.on(device)
    options = {"bounded": strategy.bounded, "closes": strategy.closes, "method": method, "draws": draws}
    with StageClock(timing, "find", device):
        found = find_pieces(surface, section, patch, **options)
        if timing is not None:
            found = list(found)  # the search belongs to this stage
    return found, (surface, section)


def _loop_table(mesh: MeshObject, device: Any, method: str | None) -> Any:
    """The mesh's LoopTable on a device if its contours are drawn from that, else None."""
    if method not in (None, PATTERN):
        return None
    table = mesh.loop_table_on(str(device))
    if table is None and method == PATTERN:
        raise ValueError(f"{mesh.name} is open or has too many vertices for the method {PATTERN!r}")
    return table


def _require_cuttable(mesh: MeshObject, strategy: IntersectionStrategy) -> None:
    """Raise MeshError for a mesh whose contours as cut are no result."""
    if needs_regularising(mesh):
        raise MeshError(f"{mesh.name} crosses itself: its contours are drawn to be measured (`intersect`)")
    if strategy.needs_closed:
        mesh.require_closed()


def sections_of(pose: wp.array) -> wp.array:
    """Poses of sections, shape [pose, 1 or patch], of poses of the hand or of patches."""
    return pose.reshape((-1, 1)) if pose.ndim == 1 else pose


def patches_for(
    hand: PatchHand,
    solid: Solid,
    strategy: IntersectionStrategy,
    device: str,
    *,
    farthest: float = 0.0,
    relative: bool = False,
) -> wp.array:
    """A hand's patches on a device, with the distance at which a vertex counts as on them; dtype Patch, shape [patch].

    A strategy without `flush` gets FLUSH_RATE times the largest coordinate of the object and the patch, and of the
    object's own poses on top where it moves: those are rounded, too. farthest: the latter [m]; relative: whether points
    are written relative to their patch.
    """
    least, rate = strategy.flush, 0.0
    if least is None:
        least, rate = FLUSH_RATE * (reach_of(solid) + farthest), FLUSH_RATE
    if type(hand) is Palm:  # a subclass may have other patches
        return _palm_patches(hand, device, least, rate, relative)
    return resolve_flush(hand.on(device), flush=least, flush_rate=rate, relative=relative)


@lru_cache(maxsize=16)
def _palm_patches(palm: Palm, device: str, flush: float, flush_rate: float, relative: bool) -> wp.array:
    """Resolved patches of a palm, which meets the same object in batch after batch; nobody writes to them."""
    resolved = resolve_flush(palm.on(device), flush=flush, flush_rate=flush_rate, relative=relative)
    wp.synchronize_device(device)  # other streams read them, too
    return resolved


_REACH: WeakKeyDictionary[Solid, float] = WeakKeyDictionary()  # of objects that are in use


def reach_of(solid: Solid) -> float:
    """Largest coordinate of an object [m], looked for once; 0 for one without bounds."""
    if solid not in _REACH:
        reach = float(np.abs(solid.bounds).max())
        _REACH[solid] = reach if np.isfinite(reach) else 0.0
    return _REACH[solid]
