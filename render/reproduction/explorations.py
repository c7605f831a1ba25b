"""Explorers of an object: their motions, the lengths of the contours that each would have felt, and r of these."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import combinations
from typing import NamedTuple

import numpy as np

from ...datasets.motions.hand_motion import HandMotion
from ..hands.hand import Palm
from ..motions.explorations.explored import exploration
from ..objects.mesh.solid_mesh import MeshObject
from ..scripting.rendered_batch import render
from ..strategies.intersection_strategy import closed_contour
from ..study.analysis.hypothesis_tests import check_normality, compare_pairs_by_ranks
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


def holm(p: Mapping[str, float | None]) -> dict[str, float | None]:
    """p corrected for their number by Holm's step-down method; tests that say nothing do not count."""
    known = sorted((value, name) for name, value in p.items() if value is not None)
    corrected: dict[str, float | None] = dict.fromkeys(p)
    largest = 0.0
    for rank, (value, name) in enumerate(known):
        largest = max(largest, min(1.0, value * (len(known) - rank)))
        corrected[name] = largest
    return corrected


def pairwise(values: Mapping[str, np.ndarray]) -> dict[str, float | None]:
    """Wilcoxon's p of all pairs of samples, corrected by Holm's method, by name: "cube - tube"."""
    return holm({f"{a} - {b}": compare_pairs_by_ranks(values[a], values[b], "").p for a, b in combinations(values, 2)})


def p_text(p: float | None) -> str:
    """p in words."""
    if p is None:
        return "no test"
    return "p < 0.001" if p < 0.001 else f"p = {p:.3f}"


class BlockRatios(NamedTuple):
    """r of each block in both readings, float64, shape [explorer, block]; NaN where nothing was drawn with OC."""

    whole: np.ndarray
    """A palm wholly inside counts in CC as its whole boundary: `r`."""
    open: np.ndarray
    """It counts as nothing, because it has no open contour to close: `r_open`."""


def block_ratios(lengths: FeltLengths) -> BlockRatios:
    """r of blocks: mean length of CC over mean length of OC, of all poses of the block, empty ones included."""
    opened = lengths.open.sum(axis=-1, dtype=np.float64)
    inside = lengths.open == 0.0
    whole = lengths.closed.sum(axis=-1, dtype=np.float64)
    partly = np.where(inside, 0.0, lengths.closed).sum(axis=-1, dtype=np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        return BlockRatios(*(np.where(opened > 0.0, sum_ / opened, np.nan) for sum_ in (whole, partly)))


def ratio_values(ratios: dict[str, np.ndarray]) -> dict[str, dict]:
    """Mean, standard deviation and Shapiro's p of r by object; ratios: shape [explorer, block]."""
    return {name: _summary(r.ravel()) for name, r in ratios.items()}


def ratio_tests(ratios: dict[str, np.ndarray]) -> dict[str, dict[str, float | None]]:
    """Pairwise Wilcoxon tests with Holm's correction, by blocks as in the paper, and by explorers.

    The blocks of one explorer are not independent of each other, which the test takes them for. The means of each
    explorer are, so the second row is the one to rely on.
    """
    return {
        "by_block": pairwise({name: r.ravel() for name, r in ratios.items()}),
        "by_explorer": pairwise({name: r.mean(axis=1) for name, r in ratios.items()}),
    }


def _summary(r: np.ndarray) -> dict:
    found = r[np.isfinite(r)]
    return {
        "mean": float(found.mean()) if len(found) else None,
        "sd": float(found.std(ddof=1)) if len(found) > 1 else None,
        "lowest": float(found.min()) if len(found) else None,
        "highest": float(found.max()) if len(found) else None,
        "blocks": len(found),
        "blocks_without_contours": len(r) - len(found),
        "shapiro_p": check_normality(found, "").p,
    }
