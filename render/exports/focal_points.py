"""Focal points for formats that hold them: sampled from the chosen poses, or read from a file that has them."""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...datasets.contour_file.reader import ContourFile
from ...datasets.focus_files.frame_reader import FOCAL_POINTS, FrameReader, frame_format
from ...datasets.focus_files.ptlist import read_ptlist
from ...datasets.storage.schema import Arrays
from ..errors import StrategyError
from ..playback.focal_points import ContourSource, sampling_of_run
from ..sampling.metrics import FocalPoints
from ..sampling.presets import sampling_of
from ..sampling.sampler import Sampler, joined
from ..sampling.strategy import SamplingStrategy
from .pose_choice import Ends, Progress, picked, seconds_of


class SamplingFields(NamedTuple):
    """How contours become focal points."""

    sampling: SamplingStrategy | str | Path | None = None
    """None is the preset "stm"."""
    speed: float | None = None
    """[m/s]; None is the strategy's."""
    update_rate: float | None = None
    """[Hz]; None is the strategy's."""
    duration: float | None = None
    """When to stop, if not at the end of the motion [s]."""


class FocusFormat(NamedTuple):
    """What a format takes."""

    owner: str
    """What holds focal points, for messages: "a point list"."""
    count_most: int
    require_rate: Callable[[float], object]
    """Raises StrategyError for an update rate [Hz] that it does not take."""


class SampledFocus(NamedTuple):
    """Focal points, and what is known of them."""

    focus: FocalPoints
    update_rate: float
    """[Hz]"""
    jumps: int | None
    """None for focal points that were read."""


def holds_focus(path: Path) -> bool:
    """Whether a file holds focal points instead of contours; raises StrategyError for one of drives or wire
    frames."""
    if path.suffix.lower() == ".ptlist":
        return True
    kind = frame_format(path)
    if kind not in (None, FOCAL_POINTS):
        held = kind.removeprefix("palpate ")
        raise StrategyError(f"{path} holds {held} of one array, which no other format takes; palpate info shows them")
    return kind is not None


def read_focus(path: Path, asked: SamplingFields, seconds: Ends, target: FocusFormat) -> SampledFocus:
    """Focal points of a point list, or of a file that a sweep has kept.

    Raises StrategyError for more than the format takes, several at once, and options of sampling.
    """
    if fields := [name for name, value in asked._asdict().items() if value is not None]:
        raise StrategyError(f"{path} holds focal points at a rate of its own, so {fields[0]} cannot be asked for")
    if path.suffix.lower() == ".ptlist":
        points = read_ptlist(path)
        target.require_rate(points.update_rate)
        first, stop = _samples(path, seconds, len(points.intensity), points.update_rate)
        _require_count(path, stop - first, points.update_rate, target, _span(first, points.update_rate, target))
        level = (points.intensity * np.float32(points.intensity_peak))[first:stop]
        return SampledFocus(FocalPoints(points.position[first:stop], level), points.update_rate, None)
    with FrameReader(path) as file:
        target.require_rate(file.update_rate)
        first, stop = _samples(path, seconds, file.frame_count, file.update_rate)
        _require_count(path, stop - first, file.update_rate, target, _span(first, file.update_rate, target))
        focus = FocalPoints(*file.focal_points(first, stop))
        if focus.position.ndim > 2:
            raise _several(target, focus.position.shape[1])
        return SampledFocus(focus, file.update_rate, None)


def sample_focus(
    file: ContourFile, chosen: range, asked: SamplingFields, target: FocusFormat, watch: Progress
) -> SampledFocus:
    """Focal points of the chosen poses, the first of which is at time 0.

    Raises StrategyError for more than the format takes, and several at once; PoseError for poses without times.
    """
    changes = {name: getattr(asked, name) for name in ("speed", "update_rate")}
    run = file.live_run if len(chosen) == file.pose_count else None  # chosen poses are a motion of their own
    default = "stm" if run is None else sampling_of_run(run)
    strategy = sampling_of(default if asked.sampling is None else asked.sampling)
    sampler = Sampler(replace(strategy, **{name: value for name, value in changes.items() if value is not None}))
    if sampler.strategy.foci > 1:
        raise _several(target, sampler.strategy.foci)
    rate = sampler.strategy.update_rate
    target.require_rate(rate)
    source = ContourSource(ChosenRows(file, chosen), sampler, asked.duration, run=run)
    if source.frame_count > target.count_most:
        moving = chosen if asked.duration is None else chosen[:1]
        fitting = _fitting(file, moving, source.duration, rate, target)
        _require_count(file.path, source.frame_count, rate, target, fitting)
    blocks: list[FocalPoints] = []
    done = 0
    for block in source:
        blocks.append(block)
        done += len(block.intensity)
        watch(done, source.frame_count)
    return SampledFocus(joined(blocks), rate, sum(sampler.count.jumps.values()))


class ChosenRows:
    """The chosen poses of a file, numbered from 0 and timed from 0, as a sampler reads contours."""

    def __init__(self, file: ContourFile, chosen: range) -> None:
        self._file, self._chosen = file, chosen
        self.path = file.path
        self.pose_count = len(chosen)

    def motion(self, first: int = 0, stop: int | None = None) -> dict[str, np.ndarray]:
        """Poses, and times [s] if there are any."""
        part = self._part(first, stop)
        rows = {name: values[:: part.step] for name, values in self._file.motion(part.start, part.stop).items()}
        if "time" in rows:
            rows["time"] = rows["time"] - self._file.motion(self._chosen.start, self._chosen.start + 1)["time"][0]
        return rows

    def blocks(self, *, point_limit: int) -> Iterator[tuple[int, int]]:
        """Ranges of the chosen poses, in order, of up to so many points."""
        done = 0
        for _, stop in self._file.blocks(point_limit=point_limit):
            end = min(-(-(stop - self._chosen.start) // self._chosen.step), self.pose_count)
            if end > done:
                yield done, end
                done = end

    def contours(self, first: int, stop: int) -> Arrays:
        """Contours of a range."""
        return picked(self._file, self._part(first, stop))

    def _part(self, first: int, stop: int | None) -> range:
        part = self._chosen[first:stop]
        return range(part.start, min(part.stop, self._chosen.stop), part.step)


def _samples(path: Path, seconds: Ends, count: int, rate: float) -> tuple[int, int]:
    """First focal point, and the one after the last."""
    low, high = (None, None) if seconds is None else seconds_of(seconds)
    first = 0 if low is None else max(int(np.ceil(low * rate - 1e-6)), 0)
    stop = count if high is None else min(int(np.ceil(high * rate - 1e-6)), count)
    if first >= stop:
        raise StrategyError(f"seconds {seconds} hold no focal point of {path}, which lasts {count / rate:g} s")
    return first, stop


def _require_count(path: Path, count: int, rate: float, target: FocusFormat, fitting: str) -> None:
    """Refuse more focal points than a format takes; fitting: what to ask for instead."""
    if count > target.count_most:
        raise StrategyError(
            f"{path}: {count} focal points ({count / rate:g} s at {rate:g} Hz), but {target.owner} holds "
            f"{target.count_most}: {fitting} fits"
        )


def _fitting(file: ContourFile, chosen: range, duration: float, rate: float, target: FocusFormat) -> str:
    """The option by which as much of the chosen poses is exported as a format takes; duration: of all of them [s]."""
    length = target.count_most / rate
    if len(chosen) > 1:
        time = file.motion(chosen.start, chosen[-1] + 1)["time"]
        less = 1.5 * max(duration - float(time[-1] - time[0]), 0.0)  # how long the last pose lasts, and a reserve
        if time[chosen.step] - time[0] < length - less - 2e-3:  # two poses at least: one alone would be a static pose
            return _span(float(time[0]) * rate, rate, target, less)
    return f"duration={_rounded_down(length)}"


def _span(first: float, rate: float, target: FocusFormat, less: float = 0.0) -> str:
    """The range of time that a format takes from its sample `first` on, by `less` [s] shorter than can be."""
    start = first / rate
    return f"seconds={_rounded_down(start)}:{_rounded_down(start + target.count_most / rate - less)}"


def _rounded_down(seconds: float) -> str:
    return f"{math.floor(seconds * 1e3) / 1e3:g}"


def _several(target: FocusFormat, foci: int) -> StrategyError:
    return StrategyError(f"{target.owner} holds one focal point at a time, not foci {foci}")
