"""The skin of a hand at recorded joints: linear blend skinning, with each bone as long and as thick as recorded.

A vertex is carried along by the frames of up to four joints. A joint's frame: Z along its bone as the two joints lie,
X as near to the recorded X as can be. Along the bone it is stretched by the bones' lengths, across it by the joints'
radii for phalanges and by the hands' breadths for the palm; so the skin passes through a hand of another size.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import RecordingError
from ..rigid import Numbers, matrix_of
from .cage import bone_lengths
from .frames import axes_from, knuckle_width
from .joints import BONES, DIGITS, JOINT_COUNT, JOINT_NAMES, Joint
from .shape import HandShape

THICKNESS_LEAST, THICKNESS_MOST = 0.5, 2.0
"""A radius is taken for at least and at most this share of the shape's own."""

_PHALANGES = [joint for digit in DIGITS for joint in digit[1:]]


def posed_vertices(shape: HandShape, joints_in_hand: ArrayLike, radius: ArrayLike | None = None) -> NDArray[np.float32]:
    """Vertices of a hand's skin at joints [m], hand frame, shape [frame, vertex, 3].

    joints_in_hand: x y z [m] and quaternions xyzw, shape [frame, 26, 7] (`HandRecording.joints_in_hand`). radius: from
    joints to the skin [m], shape [26] or [frame, 26]; None: fingers are as thick as the hand is broad. Raises
    RecordingError for another shape, a joint that is not known, and a hand of the other side.

    >>> from palpate.datasets import hand_shape, load_recording, posed_vertices, write_sample
    >>> recording = load_recording(write_sample("openxr", "hand.json"))
    >>> posed_vertices(hand_shape(detail=1), recording.joints_in_hand(), recording.radii()).shape
    (30, 667, 3)
    """
    pose = _validate_joints(joints_in_hand)
    rest = shape.joint_pose[None]
    broad = knuckle_width(pose[..., :3]) / knuckle_width(rest[..., :3])
    if not broad > 0.0:
        raise RecordingError("index and little knuckle lie in the same place: the hand has no breadth")
    across = pose[:, Joint.LITTLE_PROXIMAL, 0] - pose[:, Joint.INDEX_PROXIMAL, 0]
    if (np.median(across) < 0.0) != shape.is_left:
        hand_side = "a left" if shape.is_left else "a right"
        raise RecordingError(f"the shape is {hand_side} hand, the joints are the other hand's")
    thick = _thickness(shape, radius, broad, len(pose))
    scale = np.stack([thick, thick, np.full_like(thick, broad)], axis=2)
    bones = [start for start, _ in BONES]
    length_ratio = bone_lengths(pose[..., :3]) / bone_lengths(rest[..., :3])
    scale[:, bones, 2] = length_ratio[:, bones]
    linear = np.einsum("fjik,fjk,jlk->fjil", _bone_axes(pose), scale, _bone_axes(rest)[0])
    return _blend(shape, linear, pose[..., :3])


def _blend(shape: HandShape, linear: Numbers, position: Numbers) -> NDArray[np.float32]:
    vertices = shape.vertices.astype(np.float64)
    weight = np.zeros((len(vertices), JOINT_COUNT))
    np.put_along_axis(weight, shape.weight_joint, shape.weight.astype(np.float64), axis=1)
    out = np.zeros((len(position), len(vertices), 3))
    for joint in np.flatnonzero(weight.any(axis=0)):
        row = np.flatnonzero(weight[:, joint])
        local = vertices[row] - shape.joint_pose[joint, :3]
        moved = np.einsum("fik,vk->fvi", linear[:, joint], local) + position[:, None, joint]
        out[:, row] += weight[row, joint, None] * moved
    return out.astype(np.float32)


def _bone_axes(pose: Numbers) -> Numbers:
    """Frames of bones, shape [frame, 26, 3, 3]; joints where no bone starts keep their own."""
    axes = matrix_of(pose[..., 3:])
    for start, end in BONES:
        axes[:, start] = axes_from(pose[:, start, :3] - pose[:, end, :3], axes[:, start, :, 0])
    return axes


def _thickness(shape: HandShape, radius: ArrayLike | None, broad: float, frame_count: int) -> Numbers:
    thick = np.full((frame_count, JOINT_COUNT), broad)
    if radius is None:
        return thick
    known = np.asarray(radius, dtype=np.float64)
    if known.shape not in ((JOINT_COUNT,), (frame_count, JOINT_COUNT)):
        wanted = f"[{JOINT_COUNT}] or [{frame_count}, {JOINT_COUNT}]"
        raise RecordingError(f"radius must have shape {wanted}, got {list(known.shape)}")
    ratio = np.broadcast_to(known / shape.joint_radius, thick.shape)[:, _PHALANGES]
    if not np.isfinite(ratio).all():
        raise RecordingError("radius must be finite")
    thick[:, _PHALANGES] = np.clip(ratio, THICKNESS_LEAST, THICKNESS_MOST)
    return thick


def _validate_joints(joints_in_hand: ArrayLike) -> Numbers:
    pose = np.asarray(joints_in_hand, dtype=np.float64)
    if pose.ndim != 3 or pose.shape[1:] != (JOINT_COUNT, 7) or len(pose) == 0:
        raise RecordingError(f"joints_in_hand must have shape [frame, {JOINT_COUNT}, 7], got {list(pose.shape)}")
    unknown = ~np.isfinite(pose).all(axis=2)
    if unknown.any():
        frame, joint = (int(index) for index in np.argwhere(unknown)[0])
        never = ", ".join(JOINT_NAMES[k] for k in np.flatnonzero(unknown.all(axis=0)))
        raise RecordingError(
            f"frame {frame}: {JOINT_NAMES[joint]} is not known; a skin needs all joints: "
            + (f"no frame has {never}" if never else "HandRecording.held(whole=True) leaves out frames that lack one")
        )
    stuck = np.argwhere(~(bone_lengths(pose[..., :3]) > 0.0))
    if stuck.size:
        frame, joint = (int(index) for index in stuck[0])
        raise RecordingError(f"frame {frame}: the bone from {JOINT_NAMES[joint]} has no length")
    return pose
