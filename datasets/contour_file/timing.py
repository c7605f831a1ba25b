"""Time that the chunks of a rendering took: /timing of a contour file."""

from __future__ import annotations

from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from ..errors import ContourFileError
from ..storage.hdf5 import Hdf5Reader
from .header import get_json
from .part_reader import PartReader


class Timing(NamedTuple):
    """Time that the chunks of a rendering took; it differs from run to run."""

    stages: list[str]
    """Names of the columns of `seconds`."""
    first: NDArray[np.int64]
    """First pose of each chunk, shape [chunk]."""
    stop: NDArray[np.int64]
    """The pose after the last of each chunk, shape [chunk]."""
    seconds: NDArray[np.float64]
    """Time spent [s], shape [chunk, stage]; NaN where a chunk had no such stage."""


def get_timing(file: Hdf5Reader | PartReader) -> Timing:
    """The /timing of one file."""
    stages: object = get_json(file, "/timing", "stages").get("stages", [])
    seconds = file.read("/timing/seconds")
    if (
        not isinstance(stages, list)
        or [type(stage) for stage in cast(list[object], stages)] != [str] * seconds.shape[1]
    ):
        raise ContourFileError(
            f"{file.path}: attribute stages of /timing does not name the {seconds.shape[1]} columns of /timing/seconds"
        )
    return Timing(cast(list[str], stages), file.read("/timing/first"), file.read("/timing/stop"), seconds)


def join_timing(blocks: list[Timing]) -> Timing:
    """Chunks of several files in their order; a stage's column stands where it first appeared."""
    stages = list(dict.fromkeys(stage for block in blocks for stage in block.stages))
    first = np.concatenate([np.zeros(0, np.int64), *(block.first for block in blocks)])
    stop = np.concatenate([np.zeros(0, np.int64), *(block.stop for block in blocks)])
    seconds = np.full((len(first), len(stages)), np.nan)
    row = 0
    for block in blocks:
        seconds[row : row + len(block.first), [stages.index(stage) for stage in block.stages]] = block.seconds
        row += len(block.first)
    return Timing(stages, first, stop, seconds)
