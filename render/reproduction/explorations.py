"""Explorers of an object: their motions, and the lengths of the contours that each would have felt."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ...datasets.motions.hand_motion import HandMotion
from ..hands.hand import Palm
from ..motions.explorations.explored import exploration
from ..objects.mesh.solid_mesh import MeshObject
from ..scripting.rendered_batch import render
from ..strategies.intersection_strategy import closed_contour
from ..validation import require_number
from .paper_numbers import (
    BLOCK_COUNT,
    EXPLORATION_SECONDS,
    EXPLORER_COUNT,
    RECORDING_SECONDS,
    REPETITION_COUNT,
)

COUNT_MOST = 1000
"""Most explorers, and most repetitions."""
POSE_RATE = 90.0
"""Poses a second [Hz]: of the trackers that such studies use."""


@dataclass(frozen=True)
class StudySettings:
    """How large the study is that is made again, and the palm. Raises StrategyError for what is out of bounds."""

    explorers: int = EXPLORER_COUNT
    repetitions: int = REPETITION_COUNT
    """Explorations of each block: explorer, object and one of two visual conditions."""
    palm: Palm = field(default_factory=Palm)
    recording: float = RECORDING_SECONDS
    """Length of each recording of noise [s]; 0: no noise."""

    def __post_init__(self) -> None:
        """Refuse counts that are out of bounds."""
        require_number("explorers", self.explorers, 1, COUNT_MOST, whole=True)
        require_number("repetitions", self.repetitions, 1, COUNT_MOST, whole=True)
        if self.recording != 0:
            require_number("recording", self.recording, 1.0, 120.0, unit="s")

    @property
    def exploration_count(self) -> int:
        """Explorations of one object."""
        return self.explorers * BLOCK_COUNT * self.repetitions


@dataclass(frozen=True)
class FeltLengths:
    """Lengths of contours on the palm, by explorer, block and pose."""

    object_name: str
    closed: np.ndarray
    """Of CC [m], float32, shape [explorer, block, pose]."""
    open: np.ndarray
    """Of OC [m], float32, same shape: the part of CC that is the object's."""


def explorer_motion(solid: MeshObject, explorer: int, repetition: int) -> HandMotion:
    """The motion of one exploration: EXPLORATION_SECONDS at POSE_RATE.

    explorer: 0 to COUNT_MOST - 1. repetition: 0 to BLOCK_COUNT * COUNT_MOST - 1, counted through the blocks.
    """
    return exploration(solid, EXPLORATION_SECONDS, rate=POSE_RATE, explorer=explorer + 1, seed=repetition)


def recorded_motion(solid: MeshObject, explorer: int, seconds: float) -> HandMotion:
    """The motion of an explorer whose noise is recorded for so long [s]; none that `explorer_motion` gives."""
    return exploration(solid, seconds, rate=POSE_RATE, explorer=explorer + 1, seed=BLOCK_COUNT * COUNT_MOST)


def measure_lengths(
    solid: MeshObject, settings: StudySettings, progress: Callable[[int], None] = lambda explorers: None
) -> FeltLengths:
    """Render every exploration of an object with CC, which holds OC; progress: called with the explorers done."""
    repetitions = BLOCK_COUNT * settings.repetitions
    closed, opened = [], []
    for explorer in range(settings.explorers):
        poses = [explorer_motion(solid, explorer, repetition).pose for repetition in range(repetitions)]
        lengths = render(solid, settings.palm, np.concatenate(poses), closed_contour()).lengths()
        closed.append(lengths.sum(axis=1).reshape(BLOCK_COUNT, -1))
        opened.append(lengths[:, 0].reshape(BLOCK_COUNT, -1))
        progress(explorer + 1)
    return FeltLengths(solid.name, np.stack(closed), np.stack(opened))
