"""Raw contours of a mesh on the patches of a hand, for one batch of poses.

Contours of a simple mesh are cut, joined and drawn by kernels. Those of a closed mesh that crosses
itself are the boundary of the region that its winding number defines as inside, computed on the host by section.
"""

from functools import lru_cache
from weakref import WeakKeyDictionary

import numpy as np
import warp as wp

from ...kernels.offsets import PointLimitError
from ...kernels.patch import FLUSH_RATE, resolve_flush
from ...kernels.section.draw import draw_contours
from ...kernels.section.join import join_sections
from ...kernels.section.loops import plane_loops
from ...kernels.section.pieces import CutPlanes
from ..contour_batch import ContourBatch, join_polylines
from ..hands.hand import Palm, PatchHand
from ..objects.mesh.solid_mesh import MeshObject
from ..objects.solid import Solid
from ..runtime.stage_timing import StageClock
from ..strategies.intersection_strategy import IntersectionStrategy
from .section_regularisation import regularised_contours


def intersect(
    mesh: MeshObject,
    hand: PatchHand,
    pose: wp.array,
    strategy: IntersectionStrategy,
    *,
    point_limit: int | None = None,
    timing: dict[str, float] | None = None,
    farthest: float = 0.0,
    relative: bool = False,
) -> tuple[ContourBatch, int]:
    """Raw contours of a mesh on patches, on the device of the poses, and how many points they have.

    pose: wp.transform, hand frame -> array frame, shape [pose]; or as `Hand.section_poses`, shape [pose, 1 or patch].
    strategy: only "outside", "close" and `flush` count here. point_limit: more points than this raise
    `PointLimitError` before memory is allocated for them. timing: takes the seconds of each stage, which are
    then waited for one by one. farthest, relative: see `patches_for`.
    """
    patch = patches_for(hand, mesh, strategy, str(pose.device), farthest=farthest, relative=relative)
    if needs_regularising(mesh):
        batch, count = _regularised(mesh.solid_part, patch, pose, strategy, point_limit, timing)
        if not mesh.report.sheet_faces:
            return batch, count
        options = {"timing": timing, "farthest": farthest, "relative": relative}
        sheets, added = intersect(mesh.sheet_part, hand, pose, strategy, point_limit=point_limit, **options)
        return join_polylines(batch.numpy(), sheets.numpy()).to(str(pose.device)), count + added
    if strategy.needs_closed:
        mesh.require_closed()
    device = str(pose.device)
    planes = CutPlanes(mesh.on(device), sections_of(pose), patch, strategy.bounded, strategy.closes)
    joined = join_sections(planes, limit=point_limit, stage=lambda name: StageClock(timing, name, device))
    with StageClock(timing, "draw", device):
        contours = draw_contours(joined)
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
    timing: dict[str, float] | None,
) -> tuple[ContourBatch, int]:
    """`intersect` for a mesh that crosses itself; points of the loops that are cut count for the limit, too."""
    device = str(pose.device)
    section = sections_of(pose)
    surface = mesh.on(device)
    with StageClock(timing, "find", device):
        loops = plane_loops(surface, section, patch, bounded=strategy.bounded, limit=point_limit)
    with StageClock(timing, "regularise", device):
        stages = {"bounded": strategy.bounded, "closes": strategy.closes}
        batch = regularised_contours(loops, patch, solid=mesh.solid, gap=mesh.gap, **stages)
        if point_limit is not None and batch.point_count > point_limit:
            raise PointLimitError(batch.point_count, point_limit)
        return batch.to(device), batch.point_count


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
