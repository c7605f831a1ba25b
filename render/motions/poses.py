"""The poses of one motion: on the host, or made on a device where they are used. Counting them needs no Warp."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property, lru_cache
from typing import Any, Protocol, Self

import numpy as np

from ...datasets.errors import MotionError
from ...datasets.known_names import likely_name
from ...datasets.motions.exploration import control_count
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


class PoseRows(Protocol):
    """Poses of a motion, range by range."""

    @property
    def count(self) -> int:
        """Number of poses."""
        ...

    def rows(self, first: int, stop: int, device: str) -> Any:
        """Poses first..stop: float32, shape [pose, 7], on the host, or wp.transform, shape [pose], on the device."""
        ...


class TimedPoses(PoseRows, Protocol):
    """Poses that follow each other in time."""

    @property
    def time(self) -> np.ndarray | None:
        """Of each pose [s]; None where they have none."""
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
        who = f"{who}, seed {self.arguments['seed']}"
        return f"{type(self).__name__}({self.count} poses at {rate:g} Hz, {who})"

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
    def model(self) -> str:
        """Which model makes them."""
        return self.checked.options.model

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

    def trial(self, first: int, stop: int) -> dict[str, Any]:
        """Poses first..stop over the array as the kernels know them."""
        options, seed = self.checked.options, self.arguments["seed"]
        habits = asdict(explorer_habits(options.explorer or 0))
        own = {"workspace": options.workspace, "facing": options.facing, "explorer": options.explorer, "seed": seed}
        range_ = {"rate": self.arguments["rate"], "first": first, "stop": stop}
        return {**habits, **own, **range_, "side": SIDES.index(habits["side"])}

    @cached_property
    def control(self) -> ControlPoints:
        """Control points of one around an object, kept for the next part of its poses."""
        return control_of([self])

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


def explored_rows(ranges: Sequence[tuple[ExploredPoses, int, int]], device: str) -> Any:
    """Poses first..stop of explorations of one model, one after the other, by one launch: wp.transform [pose]."""
    if ranges and ranges[0][0].model == AROUND:
        from .around import rows_around

        return rows_around(ranges, device)
    from ...kernels.motions.over_array import place_explorers, trials_of

    return place_explorers(trials_of([poses.trial(first, stop) for poses, first, stop in ranges]), device=device)


def control_of(motions: Sequence[ExploredPoses]) -> ControlPoints:
    """Control points of explorations around objects, made together on the host."""
    boxes = np.array([motion.checked.box for motion in motions])
    counts = [control_count(float(motion.time[-1])) for motion in motions]
    return control_points(boxes, [motion.arguments["seed"] for motion in motions], counts)
