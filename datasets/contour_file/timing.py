"""Time that the chunks of a rendering took: /timing of a contour file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from ..errors import ContourFileError
from ..storage.hdf5 import Hdf5Reader
from ..storage.hdf5_output import Hdf5Output
from ..storage.schema import TIMING
from .header import get_json, json_text


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


def timing_of(first: int, stop: int, seconds: Mapping[str, float]) -> Timing:
    """That of one chunk: time by stage [s]."""
    values = np.array(list(seconds.values()), np.float64).reshape(1, -1)
    return Timing(list(seconds), np.array([first], np.int64), np.array([stop], np.int64), values)


def write_timing(output: Hdf5Output, timing: Timing) -> None:
    """Write /timing to a file."""
    output.attributes("/timing", {"stages": json_text({"stages": timing.stages}, "timing")})
    for spec, column in zip(TIMING, timing[1:], strict=True):
        output.add(spec, column)


def get_timing(file: Hdf5Reader) -> Timing:
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
