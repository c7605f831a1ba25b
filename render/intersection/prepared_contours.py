"""Contours of batches of as many poses, again and again: what can be done once is done before."""

from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import warp as wp

from ...datasets.motions.hand_motion import PALM_DOWN
from ...kernels.pieces.finding import method_for
from ...kernels.section.graph_room import GraphRoom
from ...kernels.section.recorded_launches import Room, RoomSize, room_bytes
from ..contour_batch import ContourBatch
from ..coordinate_spacing import warn_of_spacing
from ..errors import PoseError, StrategyError
from ..hands.hand import Hand, PatchHand
from ..hands.plane_hand import PlaneHand
from ..objects.mesh.solid_mesh import MeshObject
from ..objects.solid import Solid
from ..runtime.span_workers import warp_device
from ..strategies.intersection_strategy import IntersectionStrategy
from ..strategies.user_stage_sources import has_own_stages
from ..validation import is_number
from .mesh_section import PATTERN, intersect, patches_for
from .named_inputs import hand_of, motion_of, solid_of
from .scene import PoseBlock, Scene

POSES_MOST = 2**20  # of a batch; launching takes no time beside computing then
ROOM_MOST = 2**31  # [byte] of a room


class PreparedContours:
    """Contours of batches of as many poses: those of `render`, bit for bit, without what `render` does for each call.

    solid, hand, strategy: as in `render`; the hand must be rigid, but for one pose on the CPU a `PlaneHand` may be
    articulated. pose_count: of each batch. device: Warp's; on a GPU all launches are one graph. method: how a mesh is
    searched, see `find_pieces`; only "trace" and "seek" are prepared, which replace others. size: first
    capacities.
    Only sections of a mesh by planes are prepared: memory is allocated when made, and anew, twice as much, when a batch
    needs more. Stages that follow ("joined" of hands of planes is one) run on these as in `render`. The rest is
    rendered as `render` does, in milliseconds: batches that need more than 2 GB, meshes that cross themselves, hand
    meshes, voxels and functions. Not for two threads at once.
    Raises MeshError where the strategy needs a closed surface and the object has none, StrategyError for another
    articulated hand and a number of poses that is not 1..2**20, ValueError, where sections are prepared, for a method
    that does not exist or not for this object.

    >>> import numpy as np
    >>> from palpate.render import PreparedContours, static_pose
    >>> prepared = PreparedContours("cube", "palm", "cc", pose_count=2)
    >>> prepared.at(np.repeat(static_pose([0, 0, 0.2]).pose, 2, axis=0)).length().round(2)  # [m]
    array([0.34, 0.34], dtype=float32)
    """

    def __init__(
        self,
        solid: Solid | str | Path,
        hand: Hand | str,
        strategy: IntersectionStrategy | str,
        pose_count: int = 1,
        *,
        device: str = "cpu",
        method: str | None = None,
        size: RoomSize | None = None,
    ) -> None:
        solid, hand = solid_of(solid), hand_of(hand)
        self._is_articulated = isinstance(hand, PlaneHand) and hand.patch_pose is not None
        if hand.pose_count is not None and not (self._is_articulated and pose_count == 1 and device == "cpu"):
            raise StrategyError(
                f"the hand has {hand.pose_count} poses of its own: prepared contours take a rigid one, or, for one "
                "pose on the CPU, an articulated PlaneHand"
            )
        if not (is_number(pose_count) and 1 <= pose_count <= POSES_MOST and pose_count == int(pose_count)):
            raise StrategyError(f"pose_count must be a whole number of 1..{POSES_MOST}, not {pose_count!r}")
        self.pose_count, self.device = int(pose_count), warp_device(device)
        """Poses of a batch, and where they are rendered."""
        self.grown = 0
        """Number of times that memory was allocated again."""
        self.struct: Any = None
        """The last contours as kernels take them, in arrays that may have room for more; None where none are stored,
        or a stage of a user's made them."""
        self._scene = Scene.of(solid, hand, strategy)
        self._room: Room | None = None
        warn_of_spacing(solid.name, solid.bounds)
        middle = np.array([*solid.bounds.mean(axis=0), *PALM_DOWN], np.float32)
        poses = np.tile(middle, (self.pose_count, 1))
        if self._scene.is_cut_plainly:  # drawn by kernels alone, in memory that can be reused
            self._room = self._first_room(cast(MeshObject, solid), cast(PatchHand, hand), poses[:1], method, size)
        if (room := self._fitting_room(hand.section_poses(poses) if self._is_articulated else poses)) is not None:
            room.warm()

    def __repr__(self) -> str:
        """One line."""
        scene = self._scene
        return f"{type(self).__name__}({scene.solid.name} on {scene.hand!r}, {self.pose_count} poses on {self.device})"

    def at(self, pose: np.ndarray | wp.array) -> ContourBatch:
        """Contours of poses, in memory that the next call may write over: copy what shall last.

        pose: x y z [m] and quaternion xyzw, hand frame -> array frame, shape [pose, 7], or wp.transform [pose] on the
        device, which is not checked: its numbers must be finite and its quaternions of length 1. The batch is on a GPU
        where the device is one, else on the host (NumPy).
        Raises PoseError for another number of poses and poses on another device, and what `render` refuses.
        """
        rows = pose if isinstance(pose, wp.array) else motion_of(pose).pose
        if isinstance(pose, wp.array) and pose.device != wp.get_device(self.device):
            raise PoseError(f"pose is on {pose.device}, but these contours were prepared on {self.device}")
        if len(rows) != self.pose_count:
            raise PoseError(f"there must be {self.pose_count} poses, for which this was prepared, not {len(rows)}")
        return self.at_checked(rows, self.hand_at(None))

    def hand_at(self, patch_pose: np.ndarray | None) -> PlaneHand | None:
        """An articulated hand whose patches have these poses, shape [patch, 7], in one pose of the hand; None if rigid.

        Raises PoseError for patch poses that a `PlaneHand` refuses, without those of an articulated hand, and for those
        of a rigid one.
        """
        hand = self._scene.hand
        if not self._is_articulated:
            if patch_pose is not None:
                raise PoseError(f"patch_pose is for an articulated PlaneHand, and this hand is {hand!r}")
            return None
        if patch_pose is None:
            raise PoseError("the hand is articulated: give the poses of its patches, patch_pose [patch, 7]")
        shape, count = np.shape(patch_pose), hand.patch_count
        if shape != (count, 7):
            raise PoseError(f"patch_pose must have shape [{count}, 7] for this hand's patches, not {list(shape)}")
        return replace(cast(PlaneHand, hand), patch_pose=np.asarray(patch_pose)[None])

    def at_checked(self, pose: np.ndarray | wp.array, hand: PlaneHand | None = None) -> ContourBatch:
        """The same for poses of the right number as `motion_of` leaves them; one pose may be of shape [7].

        hand: as `hand_at` gives it, None for a rigid one.
        """
        scene, section = self._scene, pose
        if hand is not None:
            scene, section = replace(scene, hand=hand), hand.section_poses(cast(np.ndarray, pose))
        room = self._fitting_room(section)
        self.struct = None if room is None or not scene.is_raw else room.struct
        if room is not None and scene.is_raw:
            return ContourBatch(**room.contours())
        block = PoseBlock(pose if isinstance(pose, wp.array) else pose.reshape(-1, 7), 0, self.device)
        batch = scene.raw_contours(block) if room is None else ContourBatch(**room.device_contours())
        batch, _ = scene.staged(batch, block)
        if (
            room is not None and batch.on_device and not has_own_stages(scene.strategy)
        ):  # what users return is not proven
            self.struct = batch.struct
        return batch.numpy() if self.device == "cpu" else batch

    def _fitting_room(self, pose: np.ndarray | wp.array) -> Room | None:
        """The room, with the contours of poses in it; None where they are rendered without it."""
        while self._room is not None and (needed := self._room.fill(pose)) is not None:
            size = self._room.size.doubled_for(needed)
            if room_bytes(size, self._room.query_count) > ROOM_MOST:
                return None
            self._room = self._room_of(size)
            self.grown += 1
        return self._room

    def _first_room(
        self, solid: MeshObject, hand: PatchHand, pose: np.ndarray, method: str | None, size: RoomSize | None
    ) -> Room | None:
        """Memory for a batch, of a size that is likely enough; None if that exceeds ROOM_MOST."""
        strategy, device = self._scene.strategy, self.device
        section = wp.array(hand.section_poses(pose), dtype=wp.transform, device=device)
        intersect(solid, hand, section, strategy, method=method)  # refuses what cannot be done
        surface, patch = solid.on(device), patches_for(hand, solid, strategy, device)
        searched = method or method_for(surface, wp.get_device(device))
        self._made_of = surface, patch
        self._options: dict[str, Any] = {
            "outside": "outside" in strategy.prune,
            "close": "close" in strategy.transform,
            "method": "trace" if searched in ("trace", PATTERN) else "seek",
            "pose_count": self.pose_count,
            "articulated": self._is_articulated,
        }
        query_count = self.pose_count * hand.patch_count
        size = size or RoomSize.for_sections(query_count)
        return None if room_bytes(size, query_count) > ROOM_MOST else self._room_of(size)

    def _room_of(self, size: RoomSize) -> Room:
        room = Room if self.device == "cpu" else GraphRoom
        return room(*self._made_of, **self._options, size=size)
