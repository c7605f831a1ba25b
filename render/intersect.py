"""Raw contours of a mesh on the patches of a hand: one batch of poses in one go."""

import warp as wp

from ..kernels.close import join_pieces
from ..kernels.draw import draw_contours
from ..kernels.find import find_pieces
from .contours import ContourBatch
from .hands import PatchHand
from .objects import MeshObject
from .stage_clock import StageClock
from .strategy import IntersectionStrategy


def intersect(
    thing: MeshObject,
    hand: PatchHand,
    pose: wp.array,
    strategy: IntersectionStrategy,
    *,
    point_limit: int | None = None,
    method: str | None = None,
    timing: dict[str, float] | None = None,
) -> tuple[ContourBatch, int]:
    """Raw contours of a mesh on patches, on the device of the poses, and how many points they have.

    pose: wp.transform, hand frame -> array frame, shape [pose]; or as `Hand.section_poses`, shape [pose, 1 or patch].
    strategy: only "outside" and "close" count here. point_limit: more points than this raise `PointLimitError` before
    memory is taken for them. method: how contours are looked for, see `find_pieces`; the result is the same.
    timing: takes the seconds of each stage, which are then waited for one by one.
    """
    if strategy.needs_closed:
        thing.require_closed()
    device = str(pose.device)
    pose = pose.reshape((-1, 1)) if pose.ndim == 1 else pose
    surface, patch = thing.on(device), hand.on(device)
    bounded, closes = strategy.bounded, strategy.closes
    with StageClock(timing, "find", device):
        found = find_pieces(surface, pose, patch, bounded=bounded, closes=closes, method=method)
    with StageClock(timing, "join", device):
        joined = join_pieces(surface, found, pose, patch, closes=closes, limit=point_limit)
    with StageClock(timing, "draw", device):
        contours = draw_contours(surface, pose, patch, joined, bounded=bounded, closes=closes)
    return ContourBatch.from_device(contours, hand.patch_count), joined.point_count
