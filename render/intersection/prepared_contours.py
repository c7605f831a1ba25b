"""Contours of batches of as many poses, again and again, on the CPU: what can be done once is done before."""

from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import warp as wp

from ...datasets.motions.hand_motion import PALM_DOWN
from ...kernels.section.pieces import CutPlanes
from ...kernels.section.room import Room, RoomSize, room_bytes
from ...kernels.section.search import search_for
from ..contour_batch import ContourBatch
from ..coordinate_spacing import warn_of_spacing
from ..errors import PoseError, StrategyError
from ..hands.hand import Hand, PatchHand
from ..hands.plane_hand import PlaneHand
from ..objects.mesh.solid_mesh import MeshObject
from ..objects.solid import Solid
from ..strategies.intersection_strategy import IntersectionStrategy
from ..strategies.user_stage_sources import has_own_stages
from ..validation import is_number
from .mesh_section import intersect, patches_for
from .named_inputs import hand_of, motion_of, solid_of
from .scene import PoseBlock, Scene

CPU = "cpu"
POSES_MOST = 2**20  # of a batch; launching takes no time beside computing then
ROOM_MOST = 2**31  # [byte] of a room


class PreparedContours:
    """Contours of batches of as many poses: those of `render`, bit for bit, without what `render` does for each call.

    Launching the kernels from Python and taking memory takes 0.6 ms a call; launches that are recorded once, in memory
    that stays, take 0.02 ms. A GPU gains little by it, so this runs on the CPU.

    solid, hand, strategy: as in `render`; the hand must be rigid, but for one pose a `PlaneHand` may be articulated.
    pose_count: of each batch.
    Only sections of a mesh by planes are prepared: memory is allocated when made, and anew, twice as much, when a batch
    needs more. Stages that follow ("joined" of hands of planes is one) run on these as in `render`. The rest is
    rendered as `render` does, in milliseconds: batches that need more than 2 GB, meshes that cross themselves, hand
    meshes, voxels and functions. Not for two threads at once.
    Raises MeshError where the strategy needs a closed surface and the object has none, StrategyError for another
    articulated hand and a number of poses that is not 1..2**20.

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
    ) -> None:
        solid, hand = solid_of(solid), hand_of(hand)
        self._is_articulated = isinstance(hand, PlaneHand) and hand.patch_pose is not None
        if hand.pose_count is not None and not (self._is_articulated and pose_count == 1):
            raise StrategyError(
                f"the hand has {hand.pose_count} poses of its own: prepared contours take a rigid one, or, for one "
                "pose, an articulated PlaneHand"
            )
        if not (is_number(pose_count) and 1 <= pose_count <= POSES_MOST and pose_count == int(pose_count)):
            raise StrategyError(f"pose_count must be a whole number of 1..{POSES_MOST}, not {pose_count!r}")
        self.pose_count = int(pose_count)
        """Poses of a batch."""
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
            self._room = self._first_room(cast(MeshObject, solid), cast(PatchHand, hand), poses[:1])
        if (room := self._fitting_room(hand.section_poses(poses) if self._is_articulated else poses)) is not None:
            room.warm()

    def __repr__(self) -> str:
        """One line."""
        scene = self._scene
        return f"{type(self).__name__}({scene.solid.name} on {scene.hand!r}, {self.pose_count} poses)"

    def at(self, pose: np.ndarray) -> ContourBatch:
        """Contours of poses, on the host, in memory that the next call may write over: copy what shall last.

        pose: x y z [m] and quaternion xyzw, hand frame -> array frame, shape [pose, 7].
        Raises PoseError for another number of poses, and what `render` refuses.
        """
        rows = motion_of(pose).pose
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

    def at_checked(self, pose: np.ndarray, hand: PlaneHand | None = None) -> ContourBatch:
        """The same for poses of the right number as `motion_of` leaves them; one pose may be of shape [7].

        hand: as `hand_at` gives it, None for a rigid one.
        """
        scene, section = self._scene, pose
        if hand is not None:
            scene, section = replace(scene, hand=hand), hand.section_poses(pose)
        room = self._fitting_room(section)
        self.struct = None if room is None or not scene.is_raw else room.struct
        if room is not None and scene.is_raw:
            return ContourBatch(**room.contours())
        block = PoseBlock(pose.reshape(-1, 7), 0, CPU)
        batch = scene.raw_contours(block) if room is None else ContourBatch(**room.device_contours())
        batch, _ = scene.staged(batch, block)
        # What stages of users return is not proven, so kernels do not get it.
        if room is not None and batch.on_device and not has_own_stages(scene.strategy):
            self.struct = batch.struct
        return batch.numpy()

    def _fitting_room(self, pose: np.ndarray) -> Room | None:
        """The room, with the contours of poses in it; None where they are rendered without it."""
        while self._room is not None and (needed := self._room.fill(pose)) is not None:
            size = self._room.size.doubled_for(needed)
            if room_bytes(size, self._room.query_count) > ROOM_MOST:
                return None
            self._room = self._room_of(size)
            self.grown += 1
        return self._room

    def _first_room(self, solid: MeshObject, hand: PatchHand, pose: np.ndarray) -> Room | None:
        """Memory for a batch, of a size that is likely enough; None if that exceeds ROOM_MOST."""
        strategy, surface = self._scene.strategy, solid.on(CPU)
        section = wp.array(hand.section_poses(pose), dtype=wp.transform, device=CPU)
        intersect(solid, hand, section, strategy)  # refuses what cannot be done
        patch = patches_for(hand, solid, strategy, CPU)
        shape = self.pose_count, hand.patch_count if self._is_articulated else 1
        poses = wp.full(shape, wp.transform_identity(), dtype=wp.transform, device=CPU)
        self._planes = CutPlanes(surface, poses, patch, strategy.bounded, strategy.closes)
        self._scans = search_for(surface, wp.get_device(CPU)) == "scan"
        size = RoomSize.for_sections(self._planes.section_count)
        return None if room_bytes(size, self._planes.section_count) > ROOM_MOST else self._room_of(size)

    def _room_of(self, size: RoomSize) -> Room:
        return Room(self._planes, size, scans=self._scans)
