"""The inputs of a stage beside contours: object, hand, poses, array and device of one batch."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp

from ...kernels.stages.prune import Patches, place_patches
from ..hands.hand import IDENTITY, Hand, PatchFrames
from ..objects.solid import Solid
from ..user_warnings import warn_user


@dataclass(frozen=True)
class Setting:
    """Inputs of a stage beside the contours of one batch of poses."""

    solid: Solid
    hand: Hand
    pose: np.ndarray
    """Hand frame -> array frame, of this batch, float32, shape [pose, 7]."""
    first: int
    """Row of the motion that `pose` begins at."""
    device: str
    """Warp device on which stages with on="device" run."""
    focal_width: float
    """FWHM of p^2 across the focus at the object's middle [m]."""
    step: float
    """Grid step of marching [m]."""
    array_position: np.ndarray = field(default_factory=lambda: np.zeros(3))
    """Middle of the array's face [m], shape [3]."""
    array_normal: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    """Unit vector out of the array, shape [3]."""
    object_pose: np.ndarray | None = None
    """Position of the object's centre and its rotation at each pose, float32 [pose, 7]; None: it stands still."""
    object_centre: np.ndarray | None = None
    """The point of the placed object whose position `object_pose` gives [m], shape [3]; None: middle of its bounds."""
    point_limit: int | None = None
    """Most points that a stage of palpate's own may make of the batch: PointLimitError asks for smaller batches."""
    warned: dict[str, object] = field(default_factory=dict, repr=False)
    """Names of the warnings that this rendering has given; all its batches share it."""

    @cached_property
    def frames(self) -> PatchFrames:
        """The hand's patches at each pose, in the array frame."""
        return self.hand.frames(self.pose, self.first)

    @cached_property
    def patches(self) -> Any:
        """The same on `device`, with the bits of `frames`: `kernels.stages.prune.Patches`."""
        if self.hand.pose_count is not None:
            return _upload_frames(self.frames, self.device)
        # A rigid hand's patches are placed on the device, which saves the upload of those of every pose.
        pose = wp.array(np.ascontiguousarray(self.pose, np.float32), dtype=wp.transform, device=self.device)
        return place_patches(pose, _upload_frames(self.hand.frames(np.array([IDENTITY])), self.device))

    def warn_once(self, name: str, message: str) -> None:
        """Warn the user, unless a batch of this rendering has warned under this name."""
        own = object()
        if self.warned.setdefault(name, own) is own:  # one call, so one of several threads warns
            warn_user(message)


def _upload_frames(frames: PatchFrames, device: str) -> Any:
    patches = Patches()
    for name in ("origin", "u", "v", "n"):
        setattr(patches, name, wp.array(getattr(frames, name).astype(np.float64), dtype=wp.vec3d, device=device))
    patches.half = wp.array(frames.half.astype(np.float64), dtype=wp.vec2d, device=device)
    return patches
