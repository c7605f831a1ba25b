"""The poses of a recipe: how many there are, without making them, and their rows, on the host or made on a device.

| motion | number of poses | rows |
|---|---|---|
| exploration | from duration and rate | made on the device where they are used |
| random | given | made on the device where they are used |
| file of poses | from the file's header (HDF5) or its lines | on the host |
| recording of a hand | from its frames, resampled and held as the hand needs them | on the host |
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from ....datasets.motions.hand_motion import HandMotion
from ....datasets.storage.hdf5 import Hdf5Reader
from ...errors import SweepError
from ...motions.explorations.explored import ExploredPoses, HostPoses
from ..plan.recipe import Recipe, digest_source
from .unit import CHUNK_POSES

RANDOM, EXPLORATION = "random", "exploration"
ARTICULATED = ("planes", "skin")
"""Hands that a recording poses, row by row."""
KEPT_MOST = 20_000_000  # random poses of a contour file, which holds them all: 4 GB while they are checked
ROUNDING = 1e-9  # 0.1 s x 30 Hz is three poses, as `exploration` counts them


@dataclass(frozen=True)
class RandomPoses:
    """Random poses in a cube: each depends on the seed and its number only."""

    count: int
    seed: int
    size: float
    """Side of the cube of the hands' places [m]."""
    at: tuple[float, float, float]
    """Its middle [m]."""
    time = None
    """They do not follow each other."""

    def rows(self, first: int, stop: int, device: str) -> Any:
        """Poses first..stop, wp.transform on the device, shape [pose]."""
        from ....kernels.metrics.random_pose import random_poses  # Warp, which counting does without

        return random_poses(first, stop, seed=self.seed, size=self.size, at=self.at, device=device)

    @property
    def motion(self) -> HandMotion:
        """All of them on the host, without time: the same bits as on any device; SweepError if they are too many."""
        if self.count > KEPT_MOST:
            raise SweepError(f"{self.count} random poses are too many for one contour file, which takes {KEPT_MOST}")
        return HandMotion(None, self.rows(0, self.count, "cpu").numpy())


Poses = HostPoses | RandomPoses | ExploredPoses


def pose_count(recipe: Recipe) -> int:
    """Number of poses of a recipe; a motion is read or resampled only where nothing else gives the number.

    Raises MotionError, RecordingError, ContourFileError for a file that cannot be read.
    """
    motion = recipe.motion
    if motion["source"] == RANDOM:
        return int(motion["count"])
    if motion["source"] == EXPLORATION:
        return max(1, math.ceil(motion["duration"] * motion["rate"] - ROUNDING))
    held = recipe.hand["source"] if recipe.hand["source"] in ARTICULATED else ""
    alignment = (motion.get("alignment") or {}).get("source")
    given = motion["source"], motion.get("sha256"), held, motion.get("side"), alignment, motion.get("rate")
    return _file_pose_count(*given)


def chunk_count(recipe: Recipe) -> int:
    """Chunks of `CHUNK_POSES` poses that a recipe has."""
    return -(-pose_count(recipe) // CHUNK_POSES)


@lru_cache(maxsize=256)
def _file_pose_count(
    source: str, sha256: str | None, held: str, side: str | None, alignment: str | None, rate: float | None
) -> int:
    if Path(source).suffix.lower() in (".h5", ".hdf5"):
        with Hdf5Reader(source) as file:
            return file.layout("/motion/pose")[1][0]
    from ...intersection.named_inputs import is_recording  # imports what renders

    if not is_recording(source):
        return len(HandMotion.load(source))
    from ....datasets.recordings.files import load_recording

    recording = load_recording(source, hand=side, alignment=None if alignment is None else Path(alignment))
    if held:
        recording = recording.held(whole=held == "skin")
    if rate is not None:
        recording = recording.resampled(rate)
    return int(np.count_nonzero(recording.present))


def require_unchanged(source: str, sha256: str | None) -> None:
    """Raise SweepError, naming the file, unless it can be read and has this digest; without one there is no file."""
    if sha256 is not None and (found := digest_source(source)) != sha256:
        raise SweepError(f"{source}: has changed since the plan was read (SHA-256 {found[:12]}, not {sha256[:12]})")
