"""A hand of several planes: palm and phalanges, rigid, or with a pose for each patch and each pose of the motion.

Planes come from the joints of a recorded hand, one under the palm and one under each phalanx, or from `flat_hand`.
"""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from ...datasets.counted import counted
from ...datasets.hand_model.joints import JOINT_COUNT, JOINT_NAMES, Joint
from ...datasets.rigid import NORM_TOLERANCE, compose, rotate
from ..errors import PoseError, StrategyError
from .hand import IDENTITY, PatchFrames, frames_at, patches_on, poses_text, require_sides, rigid_poses

KNUCKLES = {
    "index": Joint.INDEX_PROXIMAL,
    "middle": Joint.MIDDLE_PROXIMAL,
    "ring": Joint.RING_PROXIMAL,
    "little": Joint.LITTLE_PROXIMAL,
}
PHALANGES = {
    "thumb": {"proximal": Joint.THUMB_PROXIMAL, "distal": Joint.THUMB_DISTAL},
    **{
        name: {"proximal": Joint(k), "intermediate": Joint(k + 1), "distal": Joint(k + 2)}
        for name, k in KNUCKLES.items()
    },
}
"""Parts of each finger, with the joint at which each begins; it ends at the next one."""
FINGERS = tuple(PHALANGES)


class Plane(NamedTuple):
    """A rectangle under a bone, of one size, that moves."""

    name: str
    width: float  # [m]
    length: float  # [m]
    pose: np.ndarray  # in the hand's frame, float64, shape [frame, 7]; NaN where a joint is missing


def planes_of_joints(
    joints: np.ndarray, radius: np.ndarray, *, is_left: bool, palm: bool, fingers: tuple[str, ...]
) -> list[Plane]:
    """Planes of a hand: see `PlaneHand.from_joints`."""
    joints, radius = checked_joints(joints, radius)
    for finger in fingers:
        if finger not in PHALANGES:
            raise StrategyError(f"there is no finger {finger!r}; there are: {', '.join(FINGERS)}")
    if not palm and not fingers:
        raise StrategyError("a hand without palm and fingers has no patch")
    require_side(joints, is_left)
    planes = [palm_plane(joints, radius)] if palm else []
    for finger in dict.fromkeys(fingers):
        planes += [phalanx_plane(f"{finger}-{part}", joints, radius, k) for part, k in PHALANGES[finger].items()]
    return planes


def checked_joints(joints: np.ndarray, radius: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Joints [frame, 26, 7] and radii [frame, 26] in float64; a joint that is not wholly finite is wholly NaN."""
    joints, radius = np.array(joints, np.float64), np.asarray(radius, np.float64)
    if joints.ndim != 3 or joints.shape[1:] != (JOINT_COUNT, 7) or len(joints) == 0:
        raise PoseError(f"joints must have shape [frame, {JOINT_COUNT}, 7], not {list(joints.shape)}")
    if radius.shape not in ((JOINT_COUNT,), joints.shape[:2]):
        raise PoseError(f"radius must have shape [{JOINT_COUNT}] or [frame, {JOINT_COUNT}], not {list(radius.shape)}")
    joints[~np.isfinite(joints).all(axis=2)] = np.nan
    radius = np.broadcast_to(radius, joints.shape[:2])
    wrong = ~np.isnan(joints[..., 0]) & ~(radius > 0.0)  # a NaN compares false
    if wrong.any():
        frame, k = np.argwhere(wrong)[0]
        raise PoseError(f"radius of {JOINT_NAMES[k]} in frame {frame} must be above 0 m, not {radius[frame, k]}")
    return joints, radius


def require_side(joints: np.ndarray, is_left: bool) -> None:
    """Raise PoseError if the little finger's knuckle is on the other side of the index finger's than in this hand."""
    across = joints[:, KNUCKLES["little"], 0] - joints[:, KNUCKLES["index"], 0]
    if np.isnan(across).all():
        return
    if (np.nanmedian(across) < 0.0) != is_left:
        sides = ("left", "right") if is_left else ("right", "left")
        raise PoseError(f"these are joints of a {sides[1]} hand, not of a {sides[0]} one: see the knuckles' order")


def palm_plane(joints: np.ndarray, radius: np.ndarray) -> Plane:
    """The palm's plane y = 0: from the wrist to the middle finger's knuckle, across from index to little finger's.

    It lies still in the hand's frame, at the median over the motion.
    """
    used = (Joint.WRIST, KNUCKLES["index"], KNUCKLES["middle"], KNUCKLES["little"])
    there = np.isfinite(joints[:, used, 0])
    if not there.all(axis=1).any():
        names = ", ".join(JOINT_NAMES[k] for k in used)
        raise PoseError(f"palm: in no frame are {names} all there: give them, or leave the palm out with palm=False")
    frame_count = len(joints)
    joints, radius = joints[there.all(axis=1)], radius[there.all(axis=1)]
    ends = [KNUCKLES["index"], KNUCKLES["little"]]
    x, rim = joints[:, ends, 0], radius[:, ends]
    low, high = median((x - rim).min(axis=1)), median((x + rim).max(axis=1))
    front, back = median(joints[:, KNUCKLES["middle"], 2]), median(joints[:, Joint.WRIST, 2])
    pose = [(low + high) / 2, 0.0, (front + back) / 2, 0.0, 0.0, 0.0, 1.0]
    return Plane("palm", high - low, abs(back - front), np.tile(pose, (frame_count, 1)))


def phalanx_plane(name: str, joints: np.ndarray, radius: np.ndarray, k: Joint) -> Plane:
    """The plane under the bone from joint k to the next one, as far away as the skin is.

    Its normal into the finger is Y of the first joint, made orthogonal to the bone.
    """
    from scipy.spatial.transform import Rotation  # a tenth of a second that other hands do without

    a, b = joints[:, k, :3], joints[:, k + 1, :3]
    bone, across = b - a, radius[:, k] + radius[:, k + 1]
    there = np.isfinite(joints[:, [k, k + 1]]).all(axis=(1, 2)) & (np.linalg.norm(bone, axis=1) > 1e-6)
    if not there.any():
        names = f"{JOINT_NAMES[k]} and {JOINT_NAMES[k + 1]}"
        raise PoseError(f"{name}: {names} are in no frame both there and apart: leave the finger out")
    pose = np.full((len(joints), 7), np.nan)
    v = bone[there] / np.linalg.norm(bone[there], axis=1, keepdims=True)
    up = Rotation.from_quat(joints[there, k, 3:]).as_matrix()[..., 1]
    u = np.cross(v, up)
    size = np.linalg.norm(u, axis=1, keepdims=True)
    if (size < 1e-3).any():
        frame = int(np.flatnonzero(there)[np.flatnonzero(size[:, 0] < 1e-3)[0]])
        raise PoseError(f"{name}: in frame {frame} the back (+Y) of {JOINT_NAMES[k]} points along its bone")
    u /= size
    n = np.cross(u, v)
    pose[there, :3] = (a + b)[there] / 2 - across[there, None] / 2 * n
    pose[there, 3:] = Rotation.from_matrix(np.stack([u, n, -v], axis=2)).as_quat()
    return Plane(name, median(across[there]), median(np.linalg.norm(bone[there], axis=1)), pose)


def median(values: np.ndarray) -> float:
    """Median of all."""
    return float(np.median(values))


ABSENT = np.array([0.0, 1000.0, 0.0, 0.0, 0.0, 0.0, 1.0], np.float32)
"""Array-frame pose of a patch that is not there: a plane 1 km away, where no contour is."""


@dataclass(frozen=True)
class HandPatch:
    """A rectangle of skin: u = X (width), v = -Z (length, to the tip) and n = Y (into the hand) of its own frame.

    >>> from palpate.render import HandPatch
    >>> HandPatch("palm", width=0.085, length=0.1)
    HandPatch(name='palm', width=0.085, length=0.1, pose=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    """

    name: str
    """As "palm" or "index-proximal"."""
    width: float
    """Along u [m]."""
    length: float
    """Along v [m]."""
    pose: tuple[float, ...] = IDENTITY
    """Middle of its skin in the hand's frame: x y z [m], quaternion xyzw. A hand with patch poses does not use it."""

    def __post_init__(self) -> None:
        """Check the name, the sides and the pose, whose quaternion is normalised."""
        if not self.name or not isinstance(self.name, str):
            raise StrategyError(f"a patch's name must be a text of one character at least, not {self.name!r}")
        width, length = require_sides(f"patch {self.name!r}:", self.width, self.length)
        object.__setattr__(self, "width", width)
        object.__setattr__(self, "length", length)
        pose = checked_poses(np.asarray(self.pose, np.float64), f"patch {self.name!r}: pose", (7,))
        if np.isnan(pose).any():
            raise PoseError(f"patch {self.name!r}: pose {self.pose} is not finite")
        object.__setattr__(self, "pose", tuple(pose.tolist()))


@dataclass(frozen=True)
class PatchJoint:
    """Two patches that touch along a side of each: 0 towards the wrist (-v), 1 at +u, 2 to the tip (+v), 3 at -u.

    >>> from palpate.render import PatchJoint, flat_hand
    >>> PatchJoint("palm", 2, "index-proximal", 0)  # the palm's side to the tips, the finger's to the wrist
    PatchJoint(patch='palm', side=2, other='index-proximal', other_side=0)
    >>> [joint.other for joint in flat_hand().joints if joint.patch == "palm"]
    ['index-proximal', 'middle-proximal', 'ring-proximal', 'little-proximal']
    """

    patch: str
    side: int
    other: str
    other_side: int

    def __post_init__(self) -> None:
        """Sides as plain numbers; what they name is checked by the hand."""
        for field in ("side", "other_side"):
            side = getattr(self, field)
            if isinstance(side, bool) or not isinstance(side, int | np.integer) or side not in range(4):
                raise StrategyError(f"{self}: a side must be 0, 1, 2 or 3, not {side!r}")
            object.__setattr__(self, field, int(side))


@dataclass(frozen=True, eq=False)
class PlaneHand:
    """Palm and phalanges as patches, rigid, or articulated with a pose for each patch and pose of the motion.

    Raises StrategyError for no patch, a name twice, or a joint with something that is not there; PoseError for patch
    poses of another shape, values that are not finite, or quaternions whose norm is not 1 within 1e-3.

    >>> from palpate.render import HandPatch, PatchJoint, PlaneHand, render, static_pose
    >>> palm, finger = HandPatch("palm", 0.06, 0.06), HandPatch("index", 0.02, 0.03, pose=(0, 0, -0.045, 0, 0, 0, 1))
    >>> hand = PlaneHand((palm, finger), (PatchJoint("palm", 2, "index", 0),))
    >>> hand
    PlaneHand(2 patches, 1 joint, rigid)
    >>> render("cube", hand, static_pose([0, 0, 0.2])).length().round(3)  # both outlines, without where they touch [m]
    array([0.3], dtype=float32)
    """

    patches: tuple[HandPatch, ...]
    joints: tuple[PatchJoint, ...] = ()
    """Which sides touch: see stage "joined"."""
    patch_pose: np.ndarray | None = None
    """Patch -> hand frame: x y z [m], quaternion xyzw; float32, shape [pose, patch, 7]. A row of NaN: the patch is not
    there in that pose, and nothing is drawn on it. None: the patches lie where their own poses say."""

    def __post_init__(self) -> None:
        """Check everything; patch poses are copied and read-only."""
        for field, kind in (("patches", HandPatch), ("joints", PatchJoint)):
            given = getattr(self, field)
            given = tuple(given) if isinstance(given, Iterable) else (given,)
            if wrong := [one for one in given if not isinstance(one, kind)]:
                raise StrategyError(f"a hand's {field} must be of type {kind.__name__}, not {wrong[0]!r:.80}")
            object.__setattr__(self, field, given)
        if not self.patches:
            raise StrategyError("a hand needs one patch at least")
        names = [patch.name for patch in self.patches]
        if twice := {name for name in names if names.count(name) > 1}:
            raise StrategyError(f"patch {min(twice)!r} is there twice")
        for joint in self.joints:
            for name in (joint.patch, joint.other):
                if name not in names:
                    raise StrategyError(f"{joint}: there is no patch {name!r}; there are: {', '.join(names)}")
            if joint.patch == joint.other:
                raise StrategyError(f"{joint}: a patch cannot be joined to itself")
        if self.patch_pose is not None:
            shape = ("pose", len(names), 7)
            checked = checked_poses(self.patch_pose, "patch_pose", shape).astype(np.float32)
            checked.setflags(write=False)
            object.__setattr__(self, "patch_pose", checked)

    def __repr__(self) -> str:
        """One line."""
        patches = f"{len(self.patches)} patch{'es' * (len(self.patches) != 1)}"
        return f"PlaneHand({patches}, {counted(len(self.joints), 'joint')}, {poses_text(self.pose_count)})"

    @property
    def patch_count(self) -> int:
        """Number of patches."""
        return len(self.patches)

    @property
    def pose_count(self) -> int | None:
        """Rows of patch poses; None for a rigid hand."""
        return None if self.patch_pose is None else self.patch_pose.shape[0]

    @property
    def absent(self) -> np.ndarray:
        """Where a patch is not there, bool, shape [pose, patch]; of one pose for a rigid hand."""
        if self.patch_pose is None:
            return np.zeros((1, self.patch_count), bool)
        return np.isnan(self.patch_pose[..., 0])

    @property
    def half(self) -> np.ndarray:
        """Half extents of the patches along u and v [m], shape [patch, 2]."""
        return np.array([[patch.width / 2, patch.length / 2] for patch in self.patches])

    @cached_property
    def _rest(self) -> PatchFrames:
        """Frames of a rigid hand's patches in its own frame."""
        return frames_at(np.array([[patch.pose for patch in self.patches]]), self.half)

    def patch_index(self, name: str) -> int:
        """Number of a patch, as in `ContourBatch.polyline_patch`; raises StrategyError for an unknown name."""
        names = [patch.name for patch in self.patches]
        if name not in names:
            raise StrategyError(f"there is no patch {name!r}; there are: {', '.join(names)}")
        return names.index(name)

    def on(self, device: str) -> wp.array:
        """Patches on a Warp device, dtype Patch, shape [patch]: in the hand's frame, or each in its own."""
        return _patches_on(self.patches, self.patch_pose is not None, device)

    def section_poses(self, pose: np.ndarray, first: int = 0) -> np.ndarray:
        """Poses of the hand, float32 [n, 1, 7], or of each patch, [n, patch, 7]; ABSENT for one that is not there.

        pose: shape [n, 7], rows `first`.. of the motion. Raises PoseError for rows that the hand does not have.
        """
        if self.patch_pose is None:
            return rigid_poses(pose)
        own, pose = self._rows(pose, first)
        section = compose(pose[:, None], own).astype(np.float32)
        section[np.isnan(own[..., 0])] = ABSENT
        return section

    def frames(self, pose: np.ndarray, first: int = 0) -> PatchFrames:
        """Where the patches are; arguments as for `section_poses`. One that is not there is 1 km away."""
        if self.patch_pose is not None:
            return frames_at(self.section_poses(pose, first), self.half)
        rest = self._rest
        pose = np.atleast_2d(np.asarray(pose, np.float64))[:, None]
        q = pose[..., 3:] / np.linalg.norm(pose[..., 3:], axis=-1, keepdims=True)
        origin = pose[..., :3] + rotate(q, rest.origin)
        return PatchFrames(origin, rotate(q, rest.u), rotate(q, rest.v), rotate(q, rest.n), rest.half)

    def corners(self, pose: np.ndarray, first: int = 0) -> np.ndarray:
        """Corners of the patches [m], array frame, shape [n, patch, 4, 3]; NaN for one that is not there."""
        corners = self.frames(pose, first).corners()
        if self.patch_pose is not None:
            corners[self.absent[first : first + len(corners)]] = np.nan
        return corners

    def _rows(self, pose: np.ndarray, first: int) -> tuple[np.ndarray, np.ndarray]:
        pose = np.atleast_2d(np.asarray(pose, np.float64))
        own = np.zeros((0, self.patch_count, 7)) if self.patch_pose is None else self.patch_pose
        if not 0 <= first <= first + len(pose) <= len(own):
            raise PoseError(f"the hand is articulated for {len(own)} poses, not for {first}..{first + len(pose)}")
        return own[first : first + len(pose)], pose

    def described(self) -> dict[str, Any]:
        """What a file says about the hand, for JSON; `poses`, `absent` (patches missing, in all) and the hash of
        the patch poses for an articulated one."""
        text: dict[str, Any] = {
            "kind": "planes",
            "patches": [{**asdict(patch), "pose": list(patch.pose)} for patch in self.patches],
            "joints": [asdict(joint) for joint in self.joints],
        }
        if self.patch_pose is None:
            return text
        digest = hashlib.sha256(np.where(np.isnan(self.patch_pose), np.float32(np.nan), self.patch_pose).tobytes())
        return {**text, "poses": self.pose_count, "absent": int(self.absent.sum()), "sha256": digest.hexdigest()}

    def arrays(self) -> dict[str, np.ndarray]:
        """`patch_pose`, float32, shape [pose * patch, 7], of an articulated hand."""
        return {} if self.patch_pose is None else {"patch_pose": self.patch_pose.reshape(-1, 7)}

    @classmethod
    def from_file(cls, described: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> "PlaneHand":
        """Read back what `described` and `arrays` gave; raises StrategyError where the one is not of the other."""
        patches = [HandPatch(p["name"], p["width"], p["length"], tuple(p["pose"])) for p in described["patches"]]
        joints = [PatchJoint(j["patch"], j["side"], j["other"], j["other_side"]) for j in described["joints"]]
        pose = arrays["patch_pose"].reshape(-1, len(patches), 7) if "poses" in described else None
        hand = cls(tuple(patches), tuple(joints), pose)
        if hand.described().get("sha256") != described.get("sha256"):
            raise StrategyError("the stored patch poses are not those described (SHA-256 differs)")
        return hand

    @classmethod
    def from_joints(
        cls,
        joints_in_hand: np.ndarray,
        radius: np.ndarray,
        *,
        is_left: bool,
        palm: bool = True,
        fingers: Sequence[str] = FINGERS,
    ) -> "PlaneHand":
        """Palm and phalanges of recorded joints, each a patch: sizes are medians over the motion, poses per frame.

        joints_in_hand: joints in the hand's frame, OpenXR's order and axes, x y z [m] and quaternion xyzw, shape
        [frame, 26, 7]; NaN where a joint was not seen. radius: from a joint to the skin [m], shape [26] or [frame,
        26]. fingers: of thumb, index, middle, ring, little. A phalanx is not there in frames that lack one of its
        joints (`absent`). Raises PoseError for other shapes, a joint of a wanted patch that is in no frame, and for
        knuckles that tell the other hand.
        """
        planes = planes_of_joints(joints_in_hand, radius, is_left=is_left, palm=palm, fingers=tuple(fingers))
        patches = tuple(HandPatch(plane.name, plane.width, plane.length) for plane in planes)
        pose = np.stack([plane.pose for plane in planes], axis=1)
        return cls(patches, phalanx_joints([plane.name for plane in planes]), pose)


@lru_cache(maxsize=16)
def _patches_on(patches: tuple[HandPatch, ...], articulated: bool, device: str) -> wp.array:
    """Patches on a device; cached, because a live hand has others at each pose, and making them takes 0.5 ms."""
    pose = [IDENTITY if articulated else patch.pose for patch in patches]
    half = np.array([[patch.width / 2, patch.length / 2] for patch in patches])
    return patches_on(device, frames_at(np.array([pose]), half))


def phalanx_joints(names: Sequence[str]) -> tuple[PatchJoint, ...]:
    """The joints of a hand whose patches are named "palm", "index-proximal", "thumb-distal", ...

    Each phalanx with the next one, and the fingers' first ones with the palm's side 2; the thumb's not, since it is
    attached at the palm's flank, in no line with it.
    """
    joints = []
    for finger in FINGERS:
        chain = [f"{finger}-{part}" for part in ("proximal", "intermediate", "distal") if f"{finger}-{part}" in names]
        if "palm" in names and finger != "thumb" and f"{finger}-proximal" in names:
            chain = ["palm", *chain]
        joints += [PatchJoint(one, 2, other, 0) for one, other in pairwise(chain)]
    return tuple(joints)


def checked_poses(value: np.ndarray, name: str, shape: tuple[int | str, ...]) -> np.ndarray:
    """Poses as float64, quaternions normalised; a row that is not wholly finite is wholly NaN.

    Raises PoseError for another shape, infinite values, and quaternions whose norm is not 1 within NORM_TOLERANCE.
    """
    try:
        pose = np.array(value, np.float64)
    except (TypeError, ValueError):
        raise PoseError(f"{name} must be numbers of shape {list(shape)}") from None
    if pose.ndim != len(shape) or any(isinstance(n, int) and n != m for n, m in zip(shape, pose.shape, strict=True)):
        raise PoseError(f"{name} must have shape [{', '.join(map(str, shape))}], not {list(pose.shape)}")
    if np.isinf(pose).any():
        raise PoseError(f"{name}: row {np.argwhere(np.isinf(pose))[0, :-1].tolist()} is infinite")
    missing = np.isnan(pose).any(axis=-1)
    norm = np.linalg.norm(pose[..., 3:], axis=-1)
    wrong = ~missing & (np.abs(norm - 1.0) > NORM_TOLERANCE)
    if wrong.any():
        at = tuple(np.argwhere(wrong)[0].tolist())
        raise PoseError(f"{name}: row {list(at)} has quaternion norm {norm[at]:.6g}; it must be 1 within 1e-3")
    loose = ~missing & (np.abs(norm - 1.0) > 1e-7)  # less is float32's rounding, and left alone
    pose[loose, 3:] /= norm[loose, None]
    pose[missing] = np.nan
    return pose


BREADTH, HAND_LENGTH = 0.085, 0.187  # [m]; near the means of adults in ANSUR II, which are 78..90 and 181..193 mm
PALM_SHARE = 0.56  # of the hand's length, from the wrist to the middle finger's crease
# Shares read off an open hand's tracked joints, rounded: of the middle finger's length and of the palm's width.
FINGER_SHAPES = {"index": (0.91, 0.245), "middle": (1.0, 0.245), "ring": (0.93, 0.23), "little": (0.74, 0.195)}
PHALANX_SHARES = {"proximal": (0.45, 1.0), "intermediate": (0.29, 0.95), "distal": (0.26, 0.87)}  # of a finger
THUMB_SHAPES = {"proximal": (0.17, 0.28), "distal": (0.13, 0.25)}  # of the hand's length, of the palm's width
THUMB_ANGLE = np.radians(40.0)  # away from the other fingers


def flat_hand(width: float = BREADTH, length: float = HAND_LENGTH, *, is_left: bool = False) -> PlaneHand:
    """A flat, open hand of 15 patches: palm, three phalanges of each finger, two of the thumb; all in one plane.

    width: across the palm [m]; length: from the wrist to the tip of the middle finger [m]. The proportions are
    plausible ones for adults, no measurement of anybody. Raises StrategyError for sides that are no size for skin.

    >>> from palpate.render import flat_hand
    >>> hand = flat_hand(length=0.18)
    >>> hand
    PlaneHand(15 patches, 13 joints, rigid)
    >>> [patch.name for patch in hand.patches if patch.name.startswith("index")]
    ['index-proximal', 'index-intermediate', 'index-distal']
    """
    require_sides("hand", width, length)
    palm = PALM_SHARE * length
    little = -1.0 if is_left else 1.0  # X points to the little finger on a right hand, to the thumb on a left one
    patches = [HandPatch("palm", width, palm)]
    gap = width * (1.0 - sum(share for _, share in FINGER_SHAPES.values())) / (len(FINGER_SHAPES) - 1)
    edge = -width / 2
    for finger, (length_share, width_share) in FINGER_SHAPES.items():
        whole, across = length_share * (length - palm), width_share * width
        x, z = little * (edge + across / 2), -palm / 2
        for part, (along_share, across_share) in PHALANX_SHARES.items():
            along = along_share * whole
            place = (x, 0.0, z - along / 2, *IDENTITY[3:])
            patches.append(HandPatch(f"{finger}-{part}", across_share * across, along, place))
            z -= along
        edge += across + gap
    patches += _flat_thumb(width, length, little)
    return PlaneHand(tuple(patches), phalanx_joints([patch.name for patch in patches]))


def _flat_thumb(width: float, length: float, little: float) -> list[HandPatch]:
    """The thumb's two phalanges, beside the palm and turned away from the fingers."""
    sine, cosine = np.sin(THUMB_ANGLE), np.cos(THUMB_ANGLE)
    along = np.array([-little * sine, 0.0, -cosine])  # to its tip
    turn = (0.0, float(np.sin(little * THUMB_ANGLE / 2)), 0.0, float(np.cos(THUMB_ANGLE / 2)))
    start = np.array([-little * (width / 2 + THUMB_SHAPES["proximal"][1] * width / 2 * cosine), 0.0, 0.02 * length])
    patches = []
    for part, (length_share, width_share) in THUMB_SHAPES.items():
        middle = start + along * length_share * length / 2
        patches.append(
            HandPatch(f"thumb-{part}", width_share * width, length_share * length, (*middle.tolist(), *turn))
        )
        start = start + along * length_share * length
    return patches
