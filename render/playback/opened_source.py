"""Open what is to be played: a contour file, contours in memory, or focal points, as focal points block by block."""

from __future__ import annotations  # array("B") takes no index at run time

import math
from array import array
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np

from ...datasets.contour_file.reader import ContourFile
from ...datasets.focus_files.frame_reader import FOCAL_POINTS, FrameReader, frame_format
from ...datasets.focus_files.ptlist import read_ptlist
from ...device.array import ArrayModel
from ...kernels.driving.solve import POINTS_MOST
from ..errors import StrategyError
from ..file_kinds import is_point_list
from ..sampling.metrics import FocalPoints
from ..sampling.presets import sampling_of, sets_rate
from ..sampling.sampler import Sampler
from ..sampling.strategy import SamplingStrategy
from .focus_source import (
    POINTS_A_READ,
    ContourRows,
    ContourSource,
    FocusSource,
    KeptSource,
    PointSource,
    frame_count,
    require_duration,
)
from .placed_arrays import PlacedArray

Block: TypeAlias = "tuple[array[int], ...]"
"""Wire bytes of consecutive frames, for each array."""


class Opened(NamedTuple):
    """What is played."""

    source: FocusSource
    sampler: Sampler | None
    """Makes the focal points; None if they were there."""
    update_rate: float
    """[Hz]"""
    file: ContourFile | FrameReader | None = None
    """Read while it is played; None if all was read before."""


@contextmanager
def opened(
    path: Path, sampling: SamplingStrategy | str | None, duration: float | None, arrays: Sequence[PlacedArray]
) -> Iterator[Opened]:
    """Open a file; by default the update rate is the first array's."""
    if is_point_list(path):
        if sampling is not None:
            raise StrategyError(f"{path}: holds focal points, which no sampling strategy changes")
        points = read_ptlist(path)
        focus = FocalPoints(points.position, points.intensity * np.float32(points.intensity_peak))
        require_duration(duration)
        stop = None if duration is None else frame_count(duration, points.update_rate, path)
        source = PointSource(FocalPoints(focus.position[:stop], focus.intensity[:stop]))
        yield Opened(source, None, points.update_rate)
        return
    if frame_format(path) == FOCAL_POINTS:
        if sampling is not None:
            raise StrategyError(f"{path}: holds focal points, which no sampling strategy changes")
        with FrameReader(path) as kept:
            _require_solvable(kept.foci)
            yield Opened(KeptSource(kept, duration), None, kept.update_rate, kept)
        return
    with ContourFile(path) as file:
        if not file.sealed:
            raise StrategyError(f'{path}: is not finished and cannot be played; mode="resume" finishes it')
        yield sampled(file, sampling, duration, arrays)._replace(file=file)


def sampled(
    contours: ContourRows,
    sampling: SamplingStrategy | str | None,
    duration: float | None,
    arrays: Sequence[PlacedArray],
) -> Opened:
    """Focal points of contours; sampling: None and names take the first array's rate."""
    if sampling is None or (isinstance(sampling, str) and not sets_rate(sampling)):
        strategy = sampling_of(sampling or "stm")
        sampling = replace(strategy, update_rate=usual_rate(arrays[0].model, strategy))
    strategy = sampling_of(sampling)
    _require_solvable(strategy.foci)
    sampler = Sampler(strategy)
    source = ContourSource(contours, sampler, duration)
    for placed in arrays:
        _require_one_pattern(contours, source, strategy, placed.model)
    return Opened(source, sampler, strategy.update_rate)


def _require_one_pattern(
    contours: ContourRows, source: ContourSource, strategy: SamplingStrategy, model: ArrayModel
) -> None:
    """Refuse a motion, before any of it is played, at a rate at which an array only switches one pattern on and off."""
    if not model.alternates or source.is_static:
        return
    sustained = model.update_rate(model.divider_sustained)
    if model.divider(strategy.update_rate) >= model.divider_sustained or not _moves(contours, source.duration):
        return
    asked, slower = f"{strategy.update_rate:g} Hz", f"up to {sustained:.3g} Hz"
    if strategy.am is not None:
        asked, slower = "am", f"am of up to {sustained / 2:.3g} Hz (am.frequency)"
    raise StrategyError(
        f"{contours.path}: {asked} on a {model.name} needs a single pose that does not move, as it switches one "
        f"pattern on and off, but contours are at poses that differ. A motion takes {slower}, or another array"
    )


def _moves(contours: ContourRows, duration: float) -> bool:
    """Whether contours of different poses come before the duration [s] is over; reads no more than shows it."""
    seen: np.ndarray | None = None
    for first, stop in contours.blocks(point_limit=POINTS_A_READ):
        start = contours.contours(first, stop)["pose_start"]
        motion = contours.motion(first, stop)
        drawn = motion["pose"][(np.diff(start) > 0) & (motion["time"] < duration)]
        if len(drawn):
            seen = drawn[0] if seen is None else seen
            if (drawn != seen).any():
                return True
        if motion["time"][-1] >= duration:
            break
    return False


def usual_rate(model: ArrayModel, strategy: SamplingStrategy) -> float:
    """Update rate [Hz] where none is asked for: the array's default.

    Amplitude modulation of a focal point at rest, which is one pattern and off in turns, gets the fastest rate of an
    array that plays any number of those, where the default is too slow for it.
    """
    rate = model.update_rate(model.divider_default)
    is_one_pattern = strategy.pace.kind == "still" and strategy.lm is None
    if model.alternates and is_one_pattern and strategy.am is not None and strategy.am.frequency > rate / 2:
        return model.update_rate(max(model.divider_min, math.ceil(model.frame_clock / model.carrier)))
    return rate


def unchanged(frames: Iterable[tuple[array[int], ...]], file: ContourFile | FrameReader) -> Iterator[Block]:
    """Blocks of frames; raises ContourFileError if the file was truncated or changed before a block was read."""
    for block in frames:
        file.require_unchanged()
        yield block


def _require_solvable(foci: int) -> None:
    if foci > POINTS_MOST:
        raise StrategyError(f"foci must be at most {POINTS_MOST} to be solved for an array, not {foci}")
