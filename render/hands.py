"""Hands: the patches of skin on which contours are drawn."""

from dataclasses import asdict, dataclass

import numpy as np
import warp as wp

from ..kernels.patch import ON, Patch
from .errors import StrategyError

SMALLEST, LARGEST = 1e-4, 1.0  # side of a palm [m]


@dataclass(frozen=True)
class Palm:
    """One rectangle over the palm: u = X, v = -Z (towards the finger tips), n = Y (into the hand) of the hand frame."""

    width: float = 0.085
    """Along u [m]."""
    length: float = 0.085
    """Along v [m]."""

    def __post_init__(self) -> None:
        """Refuse a palm that is no size for skin: float32 could not tell its corners apart."""
        for field in ("width", "length"):
            value = getattr(self, field)
            if not (np.isfinite(value) and SMALLEST <= value <= LARGEST):
                raise StrategyError(f"palm {field} must lie between {SMALLEST:g} and {LARGEST:g} m, not {value}")

    @property
    def patch_count(self) -> int:
        """Number of patches."""
        return 1

    def on(self, device: str) -> wp.array:
        """Patches on a Warp device, dtype Patch, shape [patch]."""
        patch = Patch()
        patch.u, patch.v, patch.n = wp.vec3d(1.0, 0.0, 0.0), wp.vec3d(0.0, 0.0, -1.0), wp.vec3d(0.0, 1.0, 0.0)
        patch.half = wp.vec2d(self.width / 2 - float(ON), self.length / 2 - float(ON))
        return wp.array([patch], dtype=Patch, device=device)

    def corners(self, pose: np.ndarray) -> np.ndarray:
        """The palm's four corners at poses [m], array frame, shape [pose, 4, 3], counter-clockwise seen from +n.

        pose: float, shape [pose, 7].
        """
        pose = np.atleast_2d(np.asarray(pose, np.float64))
        u, v = 0.5 * self.width * np.array([-1, 1, 1, -1]), 0.5 * self.length * np.array([-1, -1, 1, 1])
        local = np.stack([u, np.zeros(4), -v], axis=1)
        return pose[:, None, :3] + rotated(pose[:, None, 3:], local[None])

    def described(self) -> dict:
        """What a file says about the hand, for JSON."""
        return {"kind": "palm", **asdict(self)}


def rotated(quaternion: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Vectors rotated by unit quaternions xyzw; shapes broadcast."""
    a, w = quaternion[..., :3], quaternion[..., 3:]
    t = np.cross(a, x)
    return x + 2.0 * (w * t + np.cross(a, t))


def hand_from(described: dict) -> Palm:
    """The hand that a file describes.

    Raises StrategyError for a kind that this version does not know.
    """
    if described.get("kind") != "palm":
        raise StrategyError(f"unknown hand {described.get('kind')!r}; known: palm")
    return Palm(float(described["width"]), float(described["length"]))
