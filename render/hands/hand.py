"""Hands: the patches of skin on which contours are drawn."""

from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
import warp as wp

from ...datasets.counted import counted
from ...datasets.rigid import rotate
from ...kernels.patch import ON, Patch
from ..errors import PoseError, StrategyError
from ..validation import is_number, unit_hint

IDENTITY = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
SMALLEST, LARGEST = 1e-4, 1.0  # side of a palm [m]
CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
"""A patch's corners along u and v in half extents, counter-clockwise seen from +n; side k starts at corner k."""


class PatchFrames(NamedTuple):
    """Positions and axes of a hand's patches at poses, in the array frame."""

    origin: np.ndarray
    """Middle of each patch [m], float64, shape [pose, patch, 3]."""
    u: np.ndarray
    """Across (width), unit vector, shape [pose, patch, 3]."""
    v: np.ndarray
    """Along (length, to the finger tips), shape [pose, patch, 3]."""
    n: np.ndarray
    """u x v, into the hand: the skin faces -n; shape [pose, patch, 3]."""
    half: np.ndarray
    """Half extents along u and v [m], shape [patch, 2]."""

    def corners(self) -> np.ndarray:
        """Corners of the patches [m], shape [pose, patch, 4, 3], counter-clockwise seen from +n."""
        local = CORNERS[None] * self.half[:, None]
        along = local[..., :1] * self.u[:, :, None] + local[..., 1:] * self.v[:, :, None]
        return self.origin[:, :, None] + along


@runtime_checkable
class Hand(Protocol):
    """Interface of all hands: Palm, PlaneHand, MeshHand. Poses are hand frame -> array frame.

    >>> from palpate.render import Hand, Palm, flat_hand
    >>> hands: list[Hand] = [Palm(), flat_hand()]
    >>> [hand.patch_count for hand in hands]
    [1, 15]
    """

    @property
    def patch_count(self) -> int:
        """Number of patches; 1 for a hand mesh."""
        ...

    @property
    def pose_count(self) -> int | None:
        """Number of poses of an articulated hand, equal to those of its motion; None for a rigid hand."""
        ...

    def described(self) -> dict[str, Any]:
        """Description of the hand that a file stores as JSON: kind, sizes, SHA-256 of its arrays."""
        ...

    def arrays(self) -> dict[str, np.ndarray]:
        """Arrays of the hand that a file stores beside the description, by name; empty for most hands."""
        ...

    def section_poses(self, pose: np.ndarray, first: int = 0) -> np.ndarray:
        """Poses for kernels: of the hand, float32 [n, 1, 7], or of each patch, float32 [n, patch, 7].

        pose: float32, shape [n, 7], rows `first`.. of the motion. For a rigid hand the result is `pose` itself.
        """
        ...

    def frames(self, pose: np.ndarray, first: int = 0) -> PatchFrames:
        """Frames of the patches at poses; arguments as for `section_poses`."""
        ...

    def corners(self, pose: np.ndarray, first: int = 0) -> np.ndarray:
        """Outlines for pictures [m], shape [n, patch, 4, 3]; NaN for a patch that is absent at a pose."""
        ...


@runtime_checkable
class PatchHand(Hand, Protocol):
    """A hand of planes: Palm, PlaneHand."""

    def on(self, device: str) -> wp.array:
        """Patches on a Warp device, dtype Patch, shape [patch]."""
        ...


@dataclass(frozen=True)
class Palm:
    """One rectangle over the palm: u = X, v = -Z (towards the finger tips), n = Y (into the hand) of the hand frame.

    >>> from palpate.render import Palm, render, static_pose
    >>> palm = Palm(width=0.08, length=0.1)
    >>> render("cube", palm, static_pose([0, 0, 0.2])).length().round(3)  # wholly in the cube: the palm's outline [m]
    array([0.36], dtype=float32)
    """

    width: float = 0.085
    """Along u [m]."""
    length: float = 0.085
    """Along v [m]."""

    def __post_init__(self) -> None:
        """Raise StrategyError for sides outside SMALLEST..LARGEST: float32 cannot separate corners of smaller ones."""
        width, length = require_sides("palm", self.width, self.length)
        object.__setattr__(self, "width", width)
        object.__setattr__(self, "length", length)

    @property
    def patch_count(self) -> int:
        """Number of patches."""
        return 1

    @property
    def pose_count(self) -> None:
        """None: a palm is rigid."""
        return

    def on(self, device: str) -> wp.array:
        """Patches on a Warp device, dtype Patch, shape [patch]."""
        return _palm_on(self, device)

    def section_poses(self, pose: np.ndarray, first: int = 0) -> np.ndarray:
        """The hand's poses, float32, shape [pose, 1, 7]."""
        return rigid_poses(pose)

    def frames(self, pose: np.ndarray, first: int = 0) -> PatchFrames:
        """Frame of the palm's patch at poses, shape [pose, 7]."""
        return frames_at(rigid_poses(pose), np.array([[self.width, self.length]]) / 2)

    def corners(self, pose: np.ndarray, first: int = 0) -> np.ndarray:
        """The palm's four corners at poses [m], array frame, shape [pose, 1, 4, 3], counter-clockwise seen from +n.

        pose: float, shape [pose, 7].
        """
        return self.frames(pose, first).corners()

    def described(self) -> dict:
        """Description of the hand that a file stores as JSON."""
        return {"kind": "palm", **asdict(self)}

    def arrays(self) -> dict[str, np.ndarray]:
        """Empty: the description is complete."""
        return {}


def require_sides(name: str, width: float, length: float) -> tuple[float, float]:
    """Both sides of a patch as Python floats; raises StrategyError unless they lie in SMALLEST..LARGEST [m]."""
    for field, value in (("width", width), ("length", length)):
        if not (is_number(value) and SMALLEST <= value <= LARGEST):  # a NaN compares false
            hint = unit_hint(value, SMALLEST, LARGEST, "m") if is_number(value) else ""
            raise StrategyError(f"{name} {field} must lie between {SMALLEST:g} and {LARGEST:g} m, not {value!r}{hint}")
    return float(width), float(length)


def poses_text(pose_count: int | None) -> str:
    """Whether a hand is rigid or articulated, in words."""
    return "rigid" if pose_count is None else f"articulated for {counted(pose_count, 'pose')}"


def require_rows(hand: Hand, pose_count: int) -> None:
    """Raise PoseError unless an articulated hand has a row for each pose of the motion."""
    if hand.pose_count is not None and hand.pose_count != pose_count:
        raise PoseError(f"the hand is articulated for {hand.pose_count} poses, but the motion has {pose_count}")


@lru_cache(maxsize=16)
def _palm_on(palm: Palm, device: str) -> wp.array:
    """The palm's patch on a device; cached, because making one takes as long as launching ten kernels."""
    return patches_on(device, palm.frames(np.array(IDENTITY)))


def patches_on(device: str, frames: PatchFrames) -> wp.array:
    """Patches for kernels, dtype Patch, shape [patch], from frames of one pose."""
    patches = []
    for k, half in enumerate(frames.half):
        patch = Patch()
        patch.origin, patch.u = wp.vec3d(*frames.origin[0, k]), wp.vec3d(*frames.u[0, k])
        patch.v, patch.n = wp.vec3d(*frames.v[0, k]), wp.vec3d(*frames.n[0, k])
        patch.half = wp.vec2d(*(half - float(ON)))
        patches.append(patch)
    return wp.array(patches, dtype=Patch, device=device)


def rigid_poses(pose: np.ndarray) -> np.ndarray:
    """`Hand.section_poses` of a rigid hand: float32, shape [pose, 1, 7]."""
    return np.atleast_2d(np.asarray(pose, np.float32))[:, None]


def poses_on_host(pose: np.ndarray | wp.array) -> np.ndarray:
    """Poses as a NumPy array, float32, shape [pose, 7]; also takes wp.transform [pose]."""
    return pose.numpy().reshape(-1, 7) if isinstance(pose, wp.array) else pose


def sections_on(hand: Hand, pose: np.ndarray | wp.array, first: int, device: str) -> wp.array:
    """`Hand.section_poses` on a Warp device, wp.transform, shape [pose, 1 or patch].

    pose: float32, shape [pose, 7], or wp.transform [pose] on that device, which is not copied for a rigid hand.
    """
    if isinstance(pose, wp.array) and hand.pose_count is None:
        return pose.reshape((-1, 1))
    return wp.array(hand.section_poses(poses_on_host(pose), first), dtype=wp.transform, device=device)


def frames_at(pose: np.ndarray, half: np.ndarray) -> PatchFrames:
    """Frames of patches from their poses, shape [pose, patch, 7], and half extents [m], shape [patch, 2]."""
    pose = np.asarray(pose, np.float64)
    q = pose[..., 3:] / np.linalg.norm(pose[..., 3:], axis=-1, keepdims=True)
    u, back, n = (rotate(q, np.eye(3)[k]) for k in (0, 2, 1))
    return PatchFrames(pose[..., :3], u, 0.0 - back, n, np.asarray(half, np.float64))  # 0.0: no -0.0
