"""The poses of motions: on the host, or made on a device where they are used. Counting them needs no Warp."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property, lru_cache
from typing import Any, Protocol, Self

import numpy as np

from ...datasets.errors import MotionError
from ...datasets.known_names import likely_name
from ...datasets.motions.exploration import control_count, control_turns, spline_poses
from ...datasets.motions.exploration_options import AROUND
from ...datasets.motions.exploration_strokes import ControlPoints, control_points
from ...datasets.motions.explorer_habits import SIDES, explorer_habits
from ...datasets.motions.hand_motion import (
    EXPLORATION_DEFAULTS,
    EXPLORATION_OPTIONS,
    CheckedExploration,
    HandMotion,
    check_exploration,
    exploration,
)


class TimedPoses(Protocol):
    """Poses of a motion, range by range."""

    @property
    def count(self) -> int:
        """Number of poses."""
        ...

    @property
    def time(self) -> np.ndarray | None:
        """Of each pose [s]; None where they do not follow each other."""
        ...

    def rows(self, first: int, stop: int, device: str) -> Any:
        """Poses first..stop: float32, shape [pose, 7], on the host, or wp.transform, shape [pose], on the device."""
        ...


@dataclass(frozen=True, eq=False)
class HostPoses:
    """Poses that are there already."""

    motion: HandMotion

    @property
    def count(self) -> int:
        """Number of poses."""
        return len(self.motion)

    @property
    def time(self) -> np.ndarray | None:
        """Of each pose [s]; None where they have none."""
        return self.motion.time

    def rows(self, first: int, stop: int, device: str) -> np.ndarray:
        """Poses first..stop, float32, shape [pose, 7]."""
        return self.motion.pose[first:stop]


@dataclass(frozen=True, eq=False)
class ExploredPoses:
    """A synthetic exploration: its poses are the same bits on every device, and those of `exploration`.

    >>> from palpate.render import ExploredPoses
    >>> poses = ExploredPoses.of("tube", seed=3, explorer=5)
    >>> poses.count, poses.rows(0, 2, "cpu").shape  # 30 s at 90 Hz; made where they are asked for
    (2700, (2,))
    """

    arguments: Mapping[str, Any]
    """Of `exploration`."""
    checked: CheckedExploration

    def __repr__(self) -> str:
        """One line."""
        options, rate = self.checked.options, self.arguments["rate"]
        who = options.model if options.explorer is None else f"person {options.explorer}"
        return f"{type(self).__name__}({self.count} poses at {rate:g} Hz, {who}, seed {self.arguments['seed']})"

    @classmethod
    def of(cls, bounds: Any, **options: Any) -> Self:
        """Check the arguments of `exploration`; raises MotionError as it does, and for an option that it has not."""
        if unknown := [name for name in options if name not in EXPLORATION_OPTIONS]:
            meant = likely_name(unknown[0], EXPLORATION_OPTIONS)
            known = ", ".join(EXPLORATION_OPTIONS)
            raise MotionError(f"an exploration has no option {unknown[0]!r}{meant}; known: {known}")
        arguments = {"bounds": bounds, **EXPLORATION_DEFAULTS, **options}
        return cls(arguments, check_exploration(**arguments))

    @property
    def count(self) -> int:
        """Number of poses."""
        return self.checked.pose_count

    @property
    def time(self) -> np.ndarray:
        """Of each pose [s]."""
        return clock_of(self.count, self.arguments["rate"])

    def rows(self, first: int, stop: int, device: str) -> Any:
        """Poses first..stop, wp.transform on the device, shape [pose]."""
        return explored_rows([(self, first, stop)], device)

    @cached_property
    def control(self) -> ControlPoints:
        """Control points of one around an object, kept for the next part of its poses."""
        return control_of([self])[0]

    @cached_property
    def motion(self) -> HandMotion:
        """All of them on the host, with times."""
        return exploration(**self.arguments)


@lru_cache(maxsize=64)
def clock_of(count: int, rate: float) -> np.ndarray:
    """Times of poses at a rate [Hz], as `exploration` has them [s]; the same array each time, not to be written to."""
    time = np.arange(count) / rate
    time.flags.writeable = False
    return time


def joined_rows(ranges: Sequence[tuple[TimedPoses, int, int]], device: str) -> Any:
    """Poses first..stop of several motions, one after the other: on the host if all are there, else on the device."""
    explored = [(poses, first, stop) for poses, first, stop in ranges if isinstance(poses, ExploredPoses)]
    models = {poses.checked.options.model for poses, _, _ in explored}
    if len(explored) == len(ranges) and len(models) < 2:  # as a rule: one launch instead of one for each motion
        return explored_rows(explored, device)
    rows = [poses.rows(first, stop, device) for poses, first, stop in ranges]
    if len(rows) == 1:
        return rows[0]
    if all(isinstance(own, np.ndarray) for own in rows):
        return np.concatenate(rows)
    import warp as wp

    out = wp.empty(sum(len(own) for own in rows), dtype=wp.transform, device=device)
    for at, own in zip(np.cumsum([0, *map(len, rows)]).tolist(), rows, strict=False):
        source = wp.array(own, dtype=wp.transform, device=device) if isinstance(own, np.ndarray) else own
        wp.copy(out, source, dest_offset=at, count=len(own))
    return out


def explored_rows(ranges: Sequence[tuple[ExploredPoses, int, int]], device: str) -> Any:
    """Poses first..stop of explorations of one model, one after the other, by one launch: wp.transform [pose]."""
    if ranges and ranges[0][0].checked.options.model == AROUND:
        return _rows_around(ranges, device)
    from ...kernels.motions.over_array import place_explorers, trials_of

    trials: list[dict[str, Any]] = []
    for poses, first, stop in ranges:
        options, habits = poses.checked.options, asdict(explorer_habits(poses.checked.options.explorer or 0))
        own = {"workspace": options.workspace, "facing": options.facing, "explorer": options.explorer}
        own |= {"seed": poses.arguments["seed"], "rate": poses.arguments["rate"], "first": first, "stop": stop}
        trials.append({**habits, **own, "side": SIDES.index(habits["side"])})
    return place_explorers(trials_of(trials), device=device)


def _rows_around(ranges: Sequence[tuple[ExploredPoses, int, int]], device: str) -> Any:
    """The same of explorations around objects: control points on the host, poses on the device."""
    from ...kernels.motions.around import place_on_splines, spline_ranges

    unsplit = [poses for poses, first, stop in ranges if stop - first == poses.count]
    made = iter(control_of(unsplit) if unsplit else [])  # together; those of a part are kept for the next part
    controls = [next(made) if stop - first == poses.count else poses.control for poses, first, stop in ranges]
    position = np.concatenate([control.position for control in controls])
    quaternion = np.concatenate([control.quaternion for control in controls])
    control_start = np.cumsum([0, *(len(control.position) for control in controls)])
    pose_start = np.cumsum([0, *(stop - first for _, first, stop in ranges)])
    rate = np.array([poses.arguments["rate"] for poses, _, _ in ranges], np.float64)
    begin = np.array([first for _, first, _ in ranges])
    turn = np.concatenate([control_turns(quaternion), np.zeros((1, 3))])
    splines = spline_ranges(control_start[:-1], rate, begin)
    pose, doubtful = place_on_splines(position, quaternion, turn, splines, pose_start, device=device)
    numbers = np.sort(doubtful.numpy()) if len(doubtful) else pose_start[:0]  # of poses whose rounding the host decides
    for motion in np.unique(np.searchsorted(pose_start, numbers, side="right") - 1).tolist():
        own = numbers[(pose_start[motion] <= numbers) & (numbers < pose_start[motion + 1])]
        time = (begin[motion] + (own - pose_start[motion])) / rate[motion]
        rows = spline_poses(controls[motion], time).astype(np.float32)
        for number, row in zip(own.tolist(), rows, strict=True):
            pose[number : number + 1].assign(row[None])
    return pose


def control_of(motions: Sequence[ExploredPoses]) -> list[ControlPoints]:
    """Control points of explorations around objects, made together on the host."""
    boxes = np.array([motion.checked.box for motion in motions])
    counts = [control_count(float(motion.time[-1])) for motion in motions]
    made = control_points(boxes, [motion.arguments["seed"] for motion in motions], counts)
    spans = itertools.pairwise(made.start.tolist())
    return [ControlPoints(made.position[a:b], made.quaternion[a:b], np.array([0, b - a])) for a, b in spans]
