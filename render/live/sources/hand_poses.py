"""The pose of a palm and of its hand's patches, from what a tracker saw in one frame."""

from typing import NamedTuple, Self

import numpy as np

from ....datasets.hand_model.frames import BREADTH_SHARE, complete_joints, knuckle_width, radius_shares, side_from_bends
from ....datasets.hand_model.joints import JOINT_COUNT, Joint
from ....datasets.recordings.alignment import Alignment, split_alignment
from ....datasets.recordings.conventions import mirrored
from ....datasets.recordings.recording import GAP_MOST
from ....datasets.rigid import Numbers, pose_inverse, quaternion_of, rotate
from ...errors import StrategyError
from ...hands.plane_hand import PHALANGES
from .hand_frame import SeenHand
from .plausibility import require_hand, require_near, unit_joints, unit_pose

MEASURED = 30
"""Frames of a hand over which the way from its palm joint to its skin, and its radii, are measured; then they stay."""
_BONES = {f"{finger}-{part}": int(k) for finger, parts in PHALANGES.items() for part, k in parts.items()}
"""The joint at which the bone of each phalanx begins; it ends at the next one."""
_IDENTITY = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


class PatchLayout(NamedTuple):
    """Which patches a hand has, and where they are while no joints are known."""

    names: tuple[str, ...]
    rest: np.ndarray
    """Patch -> hand frame, float32, shape [patch, 7]."""

    @classmethod
    def of(cls, names: tuple[str, ...], rest: np.ndarray) -> Self:
        """Raises StrategyError for a patch that no bone moves."""
        for name in names:
            if name != "palm" and name not in _BONES:
                raise StrategyError(f"patch {name!r} lies under no bone; live patches are: palm, {', '.join(_BONES)}")
        return cls(names, np.asarray(rest, np.float32))


class HandPoses:
    """Poses of one hand, frame by frame, in the array's frame.

    alignment: tracker's frame -> array's; it may mirror. patches: of an articulated hand.
    """

    def __init__(self, alignment: Alignment | None = None, patches: PatchLayout | None = None) -> None:
        self._alignment = split_alignment(_IDENTITY if alignment is None else alignment)
        self._is_aligned = alignment is not None
        self._patches = patches
        if patches is not None:
            self._moved = [at for at, name in enumerate(patches.names) if name in _BONES]
            self._starts = np.array([_BONES[patches.names[at]] for at in self._moved], int)
        self.restart()

    def restart(self) -> None:
        """Another hand comes: what was measured of the one before does not count."""
        self._offsets: list[Numbers] = []
        self._radii: list[Numbers] = []
        self._offset = self._radius = np.zeros(0)
        self._local = np.full((JOINT_COUNT, 7), np.nan)
        self._seen = np.full(JOINT_COUNT, -np.inf)

    def posed(self, frame: SeenHand) -> tuple[Numbers | None, np.ndarray | None]:
        """The palm's pose, float64 [7], and those of the patches, float32 [patch, 7], None for a rigid hand.

        The palm's is None where the tracker does not see it. Raises Implausible for a frame that can be of no hand.
        """
        joints = radius = pose = None
        if frame.joints is not None:
            joints, radius = self._joints(frame)
        if frame.pose is not None:
            pose = self._aligned(unit_pose(frame.pose))
        elif joints is not None and radius is not None and np.isfinite(joints[Joint.PALM]).all():
            palm = joints[Joint.PALM]
            pose = palm.copy()
            pose[:3] += rotate(palm[3:], self._skin_offset(joints, radius))
        if pose is None:
            return None, None
        require_near(pose[:3])
        if self._patches is None:
            return pose, None
        if joints is None or radius is None:
            return pose, self._patches.rest
        return pose, self._patch_poses(frame.time, pose, joints, radius)

    def _aligned(self, pose: Numbers) -> Numbers:
        """Poses, shape [..., 7], in the array's frame."""
        if self._alignment.mirrors:
            pose = np.concatenate(mirrored(pose[..., :3], pose[..., 3:]), axis=-1)
        return moved(self._alignment.pose, pose) if self._is_aligned else pose

    def _joints(self, frame: SeenHand) -> tuple[Numbers, Numbers]:
        """Joints in the array's frame and their radii, what is missing derived as in a recording."""
        joints, radius = unit_joints(frame.joints, frame.radius)  # pyright: ignore[reportArgumentType]  # not None here
        joints = self._aligned(joints)
        require_hand(joints, frame.side)
        unturned = np.isnan(joints[:, 3]) & ~np.isnan(joints[:, 0])
        if unturned.any() or np.isnan(joints[Joint.PALM, 3]):
            side = frame.side or side_from_bends(joints[None, :, :3])
            found = complete_joints(joints[None, :, :3], joints[None, :, 3:], radius[None], is_left=side == "left")
            joints = np.concatenate([found.position[0], found.quaternion[0]], axis=1)
        elif np.isnan(joints[Joint.PALM, 0]):
            ends = joints[Joint.MIDDLE_METACARPAL, :3] + joints[Joint.MIDDLE_PROXIMAL, :3]
            joints[Joint.PALM, :3] = ends / 2.0
        if len(self._radii) < MEASURED:
            unknown = np.isnan(radius)
            if unknown.any():
                breadth = BREADTH_SHARE * knuckle_width(joints[None, :, :3])
                radius[unknown] = (radius_shares() * breadth)[unknown]
            if np.isfinite(radius).all():
                self._radii.append(radius)
                self._radius = np.median(self._radii, axis=0)
        return joints, self._radius if len(self._radius) else radius

    def _skin_offset(self, joints: Numbers, radius: Numbers) -> Numbers:
        """Middle of the palm's skin in the frame of PALM [m], as `HandRecording.skin_offset`."""
        if len(self._offsets) < MEASURED:
            palm = joints[Joint.PALM]
            local = moved(pose_inverse(palm), joints)[:, :3]
            offset = np.array(
                [
                    (local[Joint.INDEX_PROXIMAL, 0] + local[Joint.LITTLE_PROXIMAL, 0]) / 2.0,
                    -radius[Joint.PALM],
                    (local[Joint.MIDDLE_PROXIMAL, 2] + local[Joint.WRIST, 2]) / 2.0,
                ]
            )
            self._offsets.append(np.nan_to_num(offset))
            self._offset = np.median(self._offsets, axis=0)
        return self._offset

    def _patch_poses(self, time: float, pose: Numbers, joints: Numbers, radius: Numbers) -> np.ndarray:
        """Poses of the patches in the hand's frame; joints that were seen within GAP_MOST keep their place in it."""
        layout = self._patches
        assert layout is not None
        local = moved(pose_inverse(pose), joints)
        known = ~np.isnan(local).any(axis=1)
        self._local[known], self._seen[known] = local[known], time
        missing = ~known & (np.abs(time - self._seen) <= GAP_MOST)
        local[missing] = self._local[missing]
        out = layout.rest.copy()
        out[self._moved] = phalanx_poses(local, radius, self._starts)
        return out


def moved(outer: Numbers, poses: Numbers) -> Numbers:
    """`pose_product` of one pose [7] and many [..., 7], by matrices: few poses take a third of the time."""
    x, y, z, w = outer[3:].tolist()
    turn = np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )
    product = np.array([[w, -z, y, x], [z, w, -x, y], [-y, x, w, z], [-x, -y, -z, w]])
    out = np.empty(poses.shape)
    out[..., :3] = np.einsum("ij,...j->...i", turn, poses[..., :3]) + outer[:3]
    out[..., 3:] = np.einsum("ij,...j->...i", product, poses[..., 3:])
    return out


def phalanx_poses(joints: Numbers, radius: Numbers, starts: np.ndarray) -> Numbers:
    """Poses of the planes under bones, each from a joint to the next one: those of `phalanx_plane`, for one frame.

    joints: in the hand's frame, shape [26, 7]. radius: [26]. starts: joints at which the bones begin, shape [bone].
    A plane of which a joint is missing, or whose joints coincide, is NaN. Shape [bone, 7].
    """
    first, second = joints[starts], joints[starts + 1]
    bone = second[:, :3] - first[:, :3]
    length = np.sqrt(np.einsum("bk,bk->b", bone, bone))
    x, y, z, w = first[:, 3], first[:, 4], first[:, 5], first[:, 6]
    up = np.stack([2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)], axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        v = bone / np.where(length > 1e-6, length, np.nan)[:, None]
        u = _cross(v, up)
        size = np.sqrt(np.einsum("bk,bk->b", u, u))
        u = u / np.where(size > 1e-3, size, np.nan)[:, None]
    n = _cross(u, v)
    reach = (radius[starts] + radius[starts + 1])[:, None] / 2.0
    out = np.empty((len(starts), 7))
    out[:, :3] = (first[:, :3] + second[:, :3]) / 2.0 - reach * n
    out[:, 3:] = quaternion_of(np.stack([u, n, -v], axis=2))
    out[np.isnan(out).any(axis=1) | np.isnan(second).any(axis=1)] = np.nan
    return out


def _cross(a: Numbers, b: Numbers) -> Numbers:
    """Vector products of rows; `np.cross` takes five times as long for so few."""
    return a[:, [1, 2, 0]] * b[:, [2, 0, 1]] - a[:, [2, 0, 1]] * b[:, [1, 2, 0]]
