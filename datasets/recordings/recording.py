"""A recorded hand: OpenXR's 26 joints over time, checked, aligned, its gaps held, and the palm's motion made of it."""

import math
import sys
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ..errors import RecordingError, RecordingWarning
from ..hand_model.frames import BREADTH_SHARE, knuckle_width, side_from_axes
from ..hand_model.joints import JOINT_COUNT, JOINT_NAMES, Joint
from ..motions.hand_motion import HandMotion
from ..rigid import NORM_TOLERANCE, POSITION_FARTHEST, Numbers, is_finite, pose_inverse, pose_product, rotate
from .alignment import Alignment, alignment_pose
from .conventions import PALM_LEAST, palm_agreement, require_agreement
from .gaps import hold_joints, resample_joints

GAP_MOST = 0.1
"""Joints that are missing for longer than this [s] are not held or bridged."""

BREADTH_LEAST, BREADTH_MOST = 0.04, 0.14
"""A hand's breadth [m]; what measures less or more is in other units."""

_FRONT_NEAREST, _FRONT_FARTHEST = 0.03, 1.5  # [m] above the array
_FRONT_ANGLE = math.tan(math.radians(60.0))
_FRONT_EDGE = 0.1  # [m] beyond which an array's own extent no longer counts
_RATE_MOST = 1e5  # [Hz]
_FRAMES_MOST = 4_000_000  # of a resampled recording: 6 GB


@dataclass(frozen=True, eq=False)
class HandRecording:
    """One hand's joints over time, in the array's frame, or in the tracker's until `transformed`.

    Checked and copied when made; the arrays are read-only. Frames count from 0. Raises RecordingError for arrays of
    another shape, times that do not increase, quaternions whose norm is not 1 within 1e-3, a hand whose breadth is not
    4 to 14 cm (other units), orientations that contradict positions, a left hand with the joints of a right one or the
    reverse, and a palm that is never seen.

    >>> from palpate.datasets import Y_UP, load_recording, write_sample
    >>> recording = load_recording(write_sample("leap", "hand.json")).transformed(Y_UP)
    >>> recording, recording.joint_pose.shape, recording.motion()
    (HandRecording(30 frames of a right hand), (30, 26, 7), HandMotion(30 poses, 1 s at 30 Hz))
    """

    time: NDArray[np.float64] | None
    """[s], shape [frame], starting at 0 and strictly increasing; None for poses without time."""
    joint_pose: NDArray[np.float64]
    """x y z [m] and unit quaternion xyzw of each joint (`Joint`), shape [frame, 26, 7]; NaN where not valid."""
    joint_radius: NDArray[np.float64]
    """From each joint to the skin [m], shape [26] or [frame, 26]."""
    valid: NDArray[np.bool_] | None = None
    """Which joints are known, shape [frame, 26]; None: those whose pose is finite."""
    is_left: bool = False
    """Whether it is a left hand."""
    hand_id: str = ""
    """What the tracker called it."""
    offset: float = 0.0
    """What the recording's clock read at time 0 [s]."""
    derived: tuple[str, ...] = ()
    """Joints that the tracker does not give; `hand_model/frames.py` describes how they are derived."""
    counts: Mapping[str, int] = field(default_factory=dict[str, int])
    """What was found and done: absent_frames, missing_joints, held_joints, dropped_frames."""
    kept: NDArray[np.bool_] | None = None
    """Which of the joints known were not seen but `held`, shape [frame, 26]; None: none."""

    def __post_init__(self) -> None:
        pose, valid = _validate_pose(self.joint_pose, self.valid)
        time, start = _validate_time(self.time, len(pose))
        radius = _validate_radius(self.joint_radius, valid)
        kept = None if self.kept is None else _validate_flags("kept", self.kept, valid.shape) & valid
        for array in (pose, valid, radius, time, kept):
            if array is not None:
                array.setflags(write=False)
        values = {"time": time, "joint_pose": pose, "joint_radius": radius, "valid": valid, "kept": kept}
        values |= {"offset": float(self.offset) + start, "counts": dict(self.counts)}
        for name, value in values.items():
            object.__setattr__(self, name, value)
        _check_size(pose)
        side = "left" if self.is_left else "right"
        if palm_agreement(pose[..., :3], pose[..., 3:]) < PALM_LEAST:
            require_agreement(pose[..., :3], pose[..., 3:], side)
        _check_side(pose, side)

    def __repr__(self) -> str:
        """One line."""
        return f"HandRecording({len(self)} frames of a {'left' if self.is_left else 'right'} hand)"

    def __len__(self) -> int:
        return len(self.joint_pose)

    @property
    def known(self) -> NDArray[np.bool_]:
        """Whether each joint is known, shape [frame, 26]."""
        return is_finite(self.joint_pose) if self.valid is None else self.valid

    @property
    def present(self) -> NDArray[np.bool_]:
        """In which frames there is a hand: those whose palm is known, shape [frame]."""
        return self.known[:, Joint.PALM]

    @property
    def breadth(self) -> float:
        """The hand's breadth at the knuckles [m], median over frames; NaN for a palm without fingers."""
        return BREADTH_SHARE * knuckle_width(self.joint_pose[..., :3])

    def skin_offset(self) -> Numbers:
        """Middle of the palm's skin in the frame of PALM [m], shape [3]: the same for all frames, so that it is still.

        Across: midway between the index and little knuckles; along: between middle knuckle and wrist; out of the palm
        by its radius. Medians over frames; 0 for what is never known.
        """
        present = self.present
        pose = self.joint_pose[present]
        local = pose_product(pose_inverse(pose[:, Joint.PALM, None]), pose)[..., :3]
        across = (local[:, Joint.INDEX_PROXIMAL, 0] + local[:, Joint.LITTLE_PROXIMAL, 0]) / 2.0
        along = (local[:, Joint.MIDDLE_PROXIMAL, 2] + local[:, Joint.WRIST, 2]) / 2.0
        radius = np.atleast_2d(self.joint_radius)[:, Joint.PALM]
        return np.array([_median(across), -_median(radius), _median(along)])

    def skin_pose(self) -> Numbers:
        """The palm's poses, hand frame -> recording's frame, shape [present frame, 7]."""
        palm = self.joint_pose[self.present, Joint.PALM]
        return np.concatenate([palm[:, :3] + rotate(palm[:, 3:], self.skin_offset()), palm[:, 3:]], axis=1)

    def motion(self) -> HandMotion:
        """The palm's motion: a pose for each frame with a palm; where there is none, a gap of time.

        Sampling holds the last pose before a gap, then fades (`SamplingStrategy.hold`, `.fade`). Warns where no pose
        is in front of the array, which `transformed` corrects.
        """
        pose = self.skin_pose()
        height, aside = pose[:, 2], np.linalg.norm(pose[:, :2], axis=1)
        is_near = (height >= _FRONT_NEAREST) & (height <= _FRONT_FARTHEST)
        if not (is_near & (aside <= _FRONT_EDGE + _FRONT_ANGLE * height)).any():
            middle = np.median(pose[:, :3], axis=0).round(3).tolist()
            warnings.warn(
                f"the hand is nowhere in front of the array (its palm is at {middle} m): an alignment is missing,"
                " or the one given is not of this tracker",
                RecordingWarning,
                stacklevel=2,
            )
        time = None if self.time is None else self.time[self.present]
        return HandMotion(time, pose.astype(np.float32), self.offset)

    def joints_in_hand(self) -> NDArray[np.float64]:
        """Poses of the joints in the hand frame, a row for each pose of `motion`; shape [present frame, 26, 7].

        NaN for joints that are not known: `held` fills short gaps.
        """
        return pose_product(pose_inverse(self.skin_pose()[:, None]), self.joint_pose[self.present])

    def radii(self) -> NDArray[np.float64]:
        """Radii of the joints [m], shape [26], or a row for each pose of `motion`, shape [present frame, 26]."""
        return self.joint_radius if self.joint_radius.ndim == 1 else self.joint_radius[self.present]

    def transformed(self, alignment: Alignment) -> "HandRecording":
        """The recording in another frame: array frame <- tracker frame.

        alignment: x y z [m] qx qy qz qw, a 4 x 4 matrix, or the path of a JSON file (`write_alignment`); no scale.
        """
        return self._replace(joint_pose=pose_product(alignment_pose(alignment), self.joint_pose))

    def held(self, gap_most: float = GAP_MOST, *, whole: bool = False) -> "HandRecording":
        """Joints that are missing while the palm is seen keep their place in the hand for at most `gap_most` [s].

        After that they are missing. whole: then all of the frame is, a gap of time in `motion`, as a hand's skin needs
        all joints; a joint that no frame has is not missed. Counted: held_joints, dropped_frames. Frames without a palm
        are gaps of time as they were: sampling holds and fades there. Held again, a joint's time goes on from where it
        was last seen.
        """
        _check_gap(gap_most)
        found = hold_joints(self.time, self.joint_pose, self.known, self.kept, gap_most, whole=whole)
        if not found.valid[:, Joint.PALM].any():
            raise RecordingError(f"no frame has all joints, even held for {gap_most:g} s")
        more = {"held_joints": found.held, "dropped_frames": found.dropped}
        counts = {**self.counts, **{name: self.counts.get(name, 0) + count for name, count in more.items()}}
        return self._replace(joint_pose=found.pose, valid=found.valid, counts=counts, kept=found.kept)

    def resampled(self, rate: float, gap_most: float = GAP_MOST) -> "HandRecording":
        """Frames at k / rate [Hz] from the first to the last: positions linear, rotations by slerp.

        Gaps longer than `gap_most` [s] stay gaps. Raises RecordingError without time, for an unusable rate, and for
        more than 4 million frames.
        """
        _check_gap(gap_most)
        if not (_is_number(rate) and 0.0 < rate <= _RATE_MOST):
            raise RecordingError(f"rate must be greater than 0 and at most {_RATE_MOST:g} Hz, got {rate!r:.60}")
        if self.time is None:
            raise RecordingError("poses without time cannot be resampled")
        count = float(self.time[-1]) * rate + 1e-9
        if count >= _FRAMES_MOST:
            raise RecordingError(
                f"{float(self.time[-1]):g} s at {rate:g} Hz are {count:.3g} frames, {_FRAMES_MOST:g} can be"
            )
        at = np.arange(math.floor(count) + 1) / rate
        pose, valid = resample_joints(self.time, self.joint_pose, self.known, at, gap_most)
        kept = None if self.kept is None else _kept_at(at, self.time, self.kept)
        radius = self.joint_radius
        if radius.ndim == 2:
            radius = np.stack([_interpolate(at, self.time, column) for column in radius.T], axis=1)
        return self._replace(time=at, joint_pose=pose, joint_radius=radius, valid=valid, kept=kept)

    def _replace(self, **fields: object) -> "HandRecording":
        return replace(self, **fields)  # pyright: ignore[reportArgumentType]  # the fields' own types, checked again


def _validate_pose(pose: Numbers, valid: NDArray[np.bool_] | None) -> tuple[Numbers, NDArray[np.bool_]]:
    try:
        rows = np.array(pose, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise RecordingError(f"joint_pose must be numbers of shape [frame, {JOINT_COUNT}, 7]") from None
    if rows.ndim != 3 or rows.shape[1:] != (JOINT_COUNT, 7):
        raise RecordingError(f"joint_pose must have shape [frame, {JOINT_COUNT}, 7], got {list(rows.shape)}")
    finite = is_finite(rows)
    flag = finite if valid is None else _validate_flags("valid", valid, finite.shape)
    _refuse(flag & ~finite, rows, "is said to be valid, but is not finite: {}")
    rows[~flag] = np.nan
    _refuse(np.abs(rows[..., :3]).max(axis=2) > POSITION_FARTHEST, rows, f"is beyond {POSITION_FARTHEST:g} m: {{}}")
    norm = np.linalg.norm(rows[..., 3:], axis=2)
    _refuse(
        np.abs(norm - 1.0) > NORM_TOLERANCE, norm, f"has quaternion norm {{:.6g}}; it must be 1 within {NORM_TOLERANCE}"
    )
    rows[..., 3:] /= norm[..., None]
    if not flag[:, Joint.PALM].any():
        raise RecordingError(f"the palm is known in none of {len(rows)} frames")
    return rows, flag


def _validate_flags(name: str, values: NDArray[np.bool_], shape: tuple[int, ...]) -> NDArray[np.bool_]:
    try:
        flags = np.array(values)
    except (TypeError, ValueError):  # rows of different lengths
        flags = np.array(None)
    if flags.dtype.kind not in "biuf" or not np.isin(flags, (0, 1)).all():
        raise RecordingError(f"{name} must be true or false, shape {list(shape)}")
    if flags.shape != shape:
        raise RecordingError(f"{name} must have shape {list(shape)}, got {list(flags.shape)}")
    return flags.astype(np.bool_)


def _refuse(bad: NDArray[np.bool_], values: Numbers, problem: str) -> None:
    if bad.any():
        frame, joint = (int(index) for index in np.argwhere(bad)[0])
        raise RecordingError(f"frame {frame}: {JOINT_NAMES[joint]} {problem.format(values[frame, joint])}")


def _validate_time(time: Numbers | None, frame_count: int) -> tuple[Numbers | None, float]:
    if time is None:
        return None, 0.0
    try:
        clock = np.array(time, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise RecordingError(f"time must be numbers of shape [{frame_count}]") from None
    if clock.shape != (frame_count,):
        raise RecordingError(f"time must have shape [{frame_count}], one a frame, got {list(clock.shape)}")
    shifted = clock - clock[0]
    bad = np.flatnonzero(~np.isfinite(clock) | (np.diff(shifted, prepend=-1.0) <= 0.0))
    if bad.size:
        frame = int(bad[0])
        before = f"{float(clock[frame - 1])!r} s of the frame before" if frame else "a clock's start"
        raise RecordingError(f"frame {frame}: time {float(clock[frame])!r} s is not after {before}")
    return shifted, float(clock[0])


def _validate_radius(radius: Numbers, valid: NDArray[np.bool_]) -> Numbers:
    try:
        values = np.array(radius, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise RecordingError(f"joint_radius must be numbers of shape [{JOINT_COUNT}]") from None
    if values.shape not in ((JOINT_COUNT,), valid.shape):
        raise RecordingError(
            f"joint_radius must have shape [{JOINT_COUNT}] or {list(valid.shape)}, got {list(values.shape)}"
        )
    wide = np.broadcast_to(values, valid.shape)
    _refuse(
        valid & ~((wide > 0.0) & (wide < BREADTH_MOST / 2.0)),
        wide,
        f"has radius {{}} m; 0 to {BREADTH_MOST / 2.0:g} m can be",
    )
    return values


def _check_size(pose: Numbers) -> None:
    breadth = BREADTH_SHARE * knuckle_width(pose[..., :3])
    if breadth < BREADTH_LEAST or breadth > BREADTH_MOST:
        raise RecordingError(
            f"the hand measures {breadth:.4g} m across the palm, hands {BREADTH_LEAST:g} to {BREADTH_MOST:g} m:"
            " are its lengths in another unit than was said?"
        )


def _check_side(pose: Numbers, claimed: str) -> None:
    side = side_from_axes(pose[..., :3], pose[:, Joint.PALM, 3:])
    if side not in (None, claimed):
        raise RecordingError(
            f"said to be a {claimed} hand, but its joints are those of a {side} one"
            " (thumb and little finger are on the other sides): wrong handedness or mirrored positions"
        )


def _check_gap(gap_most: float) -> None:
    if not (_is_number(gap_most) and 0.0 <= gap_most <= sys.float_info.max):
        raise RecordingError(f"gap_most must be finite and 0 s or more, got {gap_most!r:.60}")


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)


def _kept_at(at: Numbers, time: Numbers, kept: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Whether each joint is held at other times: it is in the frame before or in the frame after."""
    after = np.minimum(np.searchsorted(time, at - 1e-9), len(time) - 1)
    before = np.where(time[after] <= at + 1e-9, after, np.maximum(after - 1, 0))
    return kept[before] | kept[after]


def _interpolate(at: Numbers, time: Numbers, values: Numbers) -> Numbers:
    known = np.isfinite(values)
    return np.interp(at, time[known], values[known]) if known.any() else np.full(len(at), np.nan)


def _median(values: Numbers) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else 0.0
