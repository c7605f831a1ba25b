"""A job: what contours are rendered of, by which workers, in how much memory; checked once, where a call comes in."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from ...datasets.motions.hand_motion import HandMotion
from ..errors import StrategyError
from ..hands.hand import Hand
from ..objects.moving_object import object_poses
from ..objects.solid import Solid
from ..runtime.span_workers import warp_device
from ..strategies.intersection_strategy import IntersectionStrategy
from ..validation import is_number
from .named_inputs import hand_and_motion_of, motion_of, solid_of
from .scene import Scene

MEMORY_DEFAULT = 512 * 10**6  # [byte]; or more for many workers:
MEMORY_WORKER = {"cpu": 200 * 10**6, "cuda": 10**9}  # [byte] by kind of device; a GPU is full with 300,000 poses
MEMORY_SMALLEST = 2**20  # [byte]; room for one pose of any mesh that fits itself


@dataclass(frozen=True, eq=False)
class ContourJob:
    """A scene, the poses at which it is rendered, and the means for it; `of` checks them."""

    scene: Scene
    motion: HandMotion
    devices: tuple[str, ...]
    """Full names of Warp devices, one for each worker."""
    memory: int
    """For the working arrays and results of all chunks that are computed, wait or are with the caller [byte]."""
    progress: Callable[[int, int], object] | None = None
    """Called with the number of poses done, and of all."""

    @classmethod
    def of(
        cls,
        scene: Scene,
        motion: HandMotion | np.ndarray,
        *,
        device: str = "cpu",
        devices: Sequence[str] | str | None = None,
        memory: float | None = None,
        memory_least: int = MEMORY_SMALLEST,
        progress: Callable[[int, int], object] | None = None,
    ) -> Self:
        """Workers on `devices`, or one on `device`; memory: by default `memory_for` them.

        Raises StrategyError for an unknown device, none at all, and too small a budget; PoseError where the hand or the
        object has another number of poses than the motion.
        """
        motion = motion_of(motion)
        named = [device] if devices is None else [devices] if isinstance(devices, str) else devices
        names = tuple(warp_device(name) for name in named)
        if not names:
            raise StrategyError("devices must name one device at least")
        memory = checked_memory(memory, names, least=memory_least)
        scene.require_poses(len(motion))
        return cls(scene, motion, names, memory, progress)

    def report(self, done: int) -> None:
        """Report how many poses are done, if the caller asked for progress."""
        if self.progress is not None:
            self.progress(done, len(self.motion))


def job_of(
    solid: Solid | str | Path,
    hand: Hand | str,
    motion: HandMotion | np.ndarray | str | Path,
    strategy: IntersectionStrategy | str,
    *,
    object_pose: HandMotion | np.ndarray | None = None,
    points: str = "array",
    **means: Any,
) -> ContourJob:
    """The job of objects, or of names and files, as `render` takes them; means: options of `ContourJob.of`."""
    solid = solid_of(solid)
    hand, motion = hand_and_motion_of(hand, motion, solid)
    placed = None if object_pose is None else object_poses(object_pose, motion)
    return ContourJob.of(Scene.of(solid, hand, strategy, object_pose=placed, points=points), motion, **means)


def memory_for(devices: Sequence[str]) -> int:
    """Memory that workers on these devices have together unless they are given another budget [byte]."""
    return max(MEMORY_DEFAULT, sum(MEMORY_WORKER["cpu" if name == "cpu" else "cuda"] for name in devices))


def checked_memory(memory: float | None, devices: Sequence[str], *, least: int = MEMORY_SMALLEST) -> int:
    """A budget [byte], by default `memory_for` the devices; raises StrategyError for one that is none or too small."""
    if memory is None:
        return memory_for(devices)
    if not is_number(memory):
        raise StrategyError(f"memory must be a number of bytes, not {memory!r}")
    if not least <= memory < np.inf:  # a NaN compares false
        raise StrategyError(f"memory must be at least {least} bytes, not {memory}")
    return int(memory)
