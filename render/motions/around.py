"""Poses of explorations around objects, of many at once: control points on the host, poses on the device."""

import itertools
from collections.abc import Sequence

import numpy as np
import warp as wp

from ...datasets.motions.exploration import control_turns, spline_poses
from ...datasets.motions.exploration_strokes import ControlPoints
from ...kernels.motions.around import place_on_splines, spline_ranges
from .poses import ExploredPoses, control_of

Ranges = Sequence[tuple[ExploredPoses, int, int]]


def rows_around(ranges: Ranges, device: str) -> wp.array:
    """Poses first..stop of explorations around objects, one after the other, wp.transform on the device."""
    controls = _controls_of(ranges)
    position, quaternion = (np.concatenate(rows) for rows in list(zip(*controls, strict=True))[:2])
    control_start = np.cumsum([0, *(len(control.position) for control in controls)])
    pose_start = np.cumsum([0, *(stop - first for _, first, stop in ranges)])
    rate = np.array([poses.arguments["rate"] for poses, _, _ in ranges], np.float64)
    first = np.array([first for _, first, _ in ranges])
    turn = np.concatenate([control_turns(quaternion), np.zeros((1, 3))])
    own = spline_ranges(control_start[:-1], rate, first)
    pose, doubtful = place_on_splines(position, quaternion, turn, own, pose_start, device=device)
    if len(doubtful):
        _place_doubtful(ranges, controls, pose_start, np.sort(doubtful.numpy()), pose)
    return pose


def _controls_of(ranges: Ranges) -> list[ControlPoints]:
    """Control points of each; those of a motion of which a part is made are kept for the next part."""
    whole = [poses for poses, first, stop in ranges if stop - first == poses.count]
    made = control_of(whole) if whole else None
    spans = iter([] if made is None else itertools.pairwise(made.start.tolist()))
    out: list[ControlPoints] = []
    for poses, first, stop in ranges:
        if made is None or stop - first != poses.count:
            out.append(poses.control)
        else:
            begin, end = next(spans)
            out.append(ControlPoints(made.position[begin:end], made.quaternion[begin:end], np.array([0, end - begin])))
    return out


def _place_doubtful(
    ranges: Ranges, controls: Sequence[ControlPoints], pose_start: np.ndarray, doubtful: np.ndarray, pose: wp.array
) -> None:
    """Make poses whose rounding is doubtful on the host, which decides it; doubtful: their numbers, ascending."""
    motions = np.searchsorted(pose_start, doubtful, side="right") - 1
    for motion in np.unique(motions).tolist():
        poses, first, _ = ranges[motion]
        numbers = doubtful[motions == motion]
        time = (first + (numbers - pose_start[motion])) / poses.arguments["rate"]
        rows = spline_poses(controls[motion], time).astype(np.float32)
        for number, row in zip(numbers.tolist(), rows, strict=True):
            pose[number : number + 1].assign(row[None])
