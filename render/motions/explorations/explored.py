"""The poses of motions: on the host, or made on a device where they are used. Counting them needs no Warp."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property, lru_cache
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike

from ....datasets.errors import MotionError
from ....datasets.known_names import likely_name
from ....datasets.motions.hand_motion import HandMotion
from ...runtime.warp_start import start_quietly
from .control_points import INTERVAL, ControlPoints, Progress, control_count, control_points, control_turns, unreported
from .habits import SIDES, explorer_habits, require_whole
from .options import (
    AROUND,
    DURATION,
    EXPLORATION_DEFAULTS,
    EXPLORATION_MODELS,
    EXPLORATION_OPTIONS,
    RATE,
    SEED,
    VERSIONS,
    Array,
    HasBounds,
    ModelOptions,
    check_bounds,
    check_options,
    count_poses,
    require_reachable,
)


def exploration(
    bounds: ArrayLike | HasBounds | str,
    duration: float = DURATION,
    *,
    rate: float = RATE,
    seed: int = SEED,
    model: str = EXPLORATION_MODELS[0],
    explorer: int | None = None,
    facing: float | None = None,
    workspace: ArrayLike | None = None,
    progress: Progress = unreported,
) -> HandMotion:
    """Make a synthetic exploration that imitates a person's: a palm that wanders over an array.

    bounds: the object (also a mesh of trimesh or PyVista, or the name of a built-in one), or its smallest and largest
    x y z [m], shape [2, 3]. duration [s]; rate: poses per second [Hz]. seed: which trial of the person.
    model: "over-array", a palm in one workspace, whatever the object is, which faces the array
    (`kernels/motions/over_array.py` describes it; bounds only decide whether the object can be reached); or "around", a
    hand that comes to the object from every side, also with its back to the array (described by
    `render/motions/explorations/control_points.py`).
    Of "over-array" alone: explorer, which person, by number (`explorer_habits`), by default 1; facing: largest angle
    between the skin's normal and the direction to the array's centre [rad], by default pi / 3; workspace: lowest and
    highest x y z of the palm's centre [m], shape [2, 3], by default 60 mm around and above the paper's 130 mm cube.
    progress: called at intervals with (done, total).
    Duration and rate only sample the path, at k / rate < duration. The bits are the same on every processor and GPU.
    Raises MotionError for a bad argument, for an object that no hand reaches, and for a motion that takes more memory
    than the budget of one file (`PALPATE_READ_MB`).

    >>> from palpate.render import exploration
    >>> exploration([[-0.06, -0.06, 0.14], [0.06, 0.06, 0.26]], duration=2.0)
    HandMotion(180 poses, 2 s at 90 Hz)
    """
    options = {"model": model, "explorer": explorer, "facing": facing, "workspace": workspace}
    return ExploredPoses.of(bounds, duration=duration, rate=rate, seed=seed, **options).make_motion(progress)


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
    """A synthetic exploration, checked: its poses are made where they are used, with the same bits on every device.

    >>> from palpate.render import ExploredPoses
    >>> poses = ExploredPoses.of("tube", seed=3, explorer=5)
    >>> poses.count, poses.rows(0, 2, "cpu").shape  # 30 s at 90 Hz
    (2700, (2,))
    """

    options: ModelOptions
    box: Array
    """The object's smallest and largest x y z [m], shape [2, 3]."""
    duration: float
    rate: float
    seed: int
    count: int
    """Number of poses."""

    def __repr__(self) -> str:
        """One line."""
        who = self.options.model if self.options.explorer is None else f"person {self.options.explorer}"
        return f"{type(self).__name__}({self.count} poses at {self.rate:g} Hz, {who}, seed {self.seed})"

    @classmethod
    def of(cls, bounds: ArrayLike | HasBounds | str, **options: Any) -> Self:
        """Check the arguments of `exploration`; raises MotionError as it does, and for an option that it has not."""
        if unknown := [name for name in options if name not in EXPLORATION_OPTIONS]:
            meant = likely_name(unknown[0], EXPLORATION_OPTIONS)
            known = ", ".join(EXPLORATION_OPTIONS)
            raise MotionError(f"an exploration has no option {unknown[0]!r}{meant}; known: {known}")
        duration, rate, seed = (options.pop(name, default) for name, default in EXPLORATION_DEFAULTS.items())
        box = check_bounds(bounds)
        checked = check_options(options.pop("model", EXPLORATION_MODELS[0]), **options)
        require_reachable(box, checked.workspace)
        require_whole("seed", seed)
        count = count_poses(duration, rate, checked.model)
        return cls(checked, box, float(duration), float(rate), seed, count)

    @property
    def time(self) -> np.ndarray:
        """Of each pose [s]; the same array each time, not to be written to."""
        return clock_of(self.count, self.rate)

    @property
    def provenance(self) -> Mapping[str, Any]:
        """What makes the motion, as JSON."""
        own, model = self.options._asdict(), self.options.model
        if self.options.workspace is not None:
            own["workspace"] = self.options.workspace.tolist()
        made = {"model": model, "version": VERSIONS[model], "duration": self.duration, "rate": self.rate}
        return {**made, "seed": self.seed, **{name: value for name, value in own.items() if value is not None}}

    def rows(self, first: int, stop: int, device: str) -> Any:
        """Poses first..stop, wp.transform on the device, shape [pose]."""
        return explored_rows([(self, first, stop)], device)

    @cached_property
    def control(self) -> ControlPoints:
        """Control points of one around an object, stored for the next part of its poses."""
        return controls_of([self])[0]

    @cached_property
    def motion(self) -> HandMotion:
        """All of them on the host, with times."""
        return self.make_motion(unreported)

    def make_motion(self, progress: Progress) -> HandMotion:
        """All of them on the host, with times; progress: of poses, around an object of control points."""
        pose = explored_rows([(self, 0, self.count)], "cpu", progress).numpy()
        return HandMotion(self.time, pose, seed=self.seed, provenance=self.provenance)


@lru_cache(maxsize=64)  # thousands of motions that are made together share one array
def clock_of(count: int, rate: float) -> np.ndarray:
    """Times of poses at a rate [Hz], k / rate [s]."""
    time = np.arange(count) / rate
    time.flags.writeable = False
    return time


def joined_rows(ranges: Sequence[tuple[TimedPoses, int, int]], device: str) -> Any:
    """Poses first..stop of several motions, one after the other: on the host if all are there, else on the device."""
    explored = [(poses, first, stop) for poses, first, stop in ranges if isinstance(poses, ExploredPoses)]
    models = {poses.options.model for poses, _, _ in explored}
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


def explored_rows(
    ranges: Sequence[tuple[ExploredPoses, int, int]], device: str, progress: Progress | None = None
) -> Any:
    """Poses first..stop of explorations of one model, one after the other, made together: wp.transform [pose]."""
    start_quietly()
    if ranges and ranges[0][0].options.model == AROUND:
        return _rows_around(ranges, device, progress or unreported)
    from ....kernels.motions.over_array import place_explorers, trials_of

    trials: list[dict[str, Any]] = []
    for poses, first, stop in ranges:
        options = poses.options
        habits = asdict(explorer_habits(options.explorer or 0))
        own = {"rate": poses.rate, "seed": poses.seed, "first": first, "stop": stop}
        trials.append({**habits, **options._asdict(), **own, "side": SIDES.index(habits["side"])})
    return place_explorers(trials_of(trials), device=device, report=progress)


def _rows_around(ranges: Sequence[tuple[ExploredPoses, int, int]], device: str, progress: Progress) -> Any:
    """The same of explorations around objects: control points on the host, poses on the device."""
    from ....kernels.motions.around import place_on_splines

    unsplit = [poses for poses, first, stop in ranges if stop - first == poses.count]
    made = dict(zip(unsplit, controls_of(unsplit, progress), strict=True))  # together; a part's are stored for the next
    controls = [made.get(poses) or poses.control for poses, _, _ in ranges]
    quaternion = np.concatenate([control.quaternion for control in controls])
    control_start = np.cumsum([0, *(len(control.position) for control in controls)])
    pose_start = np.cumsum([0, *(stop - first for _, first, stop in ranges)])
    splines = [(at, poses.rate, first) for at, (poses, first, _) in zip(control_start.tolist(), ranges, strict=False)]
    position = np.concatenate([control.position for control in controls])
    turn = np.concatenate([control_turns(quaternion), np.zeros((1, 3))])
    return place_on_splines(position, quaternion, turn, splines, pose_start, interval=INTERVAL, device=device)


def controls_of(motions: Sequence[ExploredPoses], progress: Progress = unreported) -> list[ControlPoints]:
    """Control points of explorations around objects, made together on the host."""
    if not motions:
        return []
    counts = [control_count((motion.count - 1) / motion.rate) for motion in motions]
    boxes = np.array([motion.box for motion in motions])
    made = control_points(boxes, [motion.seed for motion in motions], counts, progress)
    spans = itertools.pairwise(made.start.tolist())
    return [ControlPoints(made.position[a:b], made.quaternion[a:b], np.array([0, b - a])) for a, b in spans]
