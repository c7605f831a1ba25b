"""A hand's patches at every pose of a batch, on the device of stages."""

from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from ...kernels.stages.prune import Patches, place_patches
from ..hands.hand import IDENTITY, PatchFrames

if TYPE_CHECKING:
    from .registry import Setting


def place_hand(setting: "Setting") -> Any:
    """The patches of the setting's hand at its poses, `Patches`, with the bits of `Setting.frames`.

    A rigid hand's are made on the device from those in the hand's frame, another's are uploaded.
    """
    if setting.hand.pose_count is not None:
        return upload_frames(setting.frames, setting.device)
    pose = wp.array(np.ascontiguousarray(setting.pose, np.float32), dtype=wp.transform, device=setting.device)
    rest = setting.hand.frames(np.array([IDENTITY]))
    return place_patches(pose, upload_frames(rest, setting.device))


def upload_frames(frames: PatchFrames, device: str) -> Any:
    """Frames of patches on a device, as kernels take them."""
    patches = Patches()
    for name in ("origin", "u", "v", "n"):
        setattr(patches, name, wp.array(getattr(frames, name).astype(np.float64), dtype=wp.vec3d, device=device))
    patches.half = wp.array(frames.half.astype(np.float64), dtype=wp.vec2d, device=device)
    return patches
