"""Wire frames of a playback: one protocol for frames that are made of focal points, and for those of a file."""

from __future__ import annotations  # array("B") takes no index at run time

from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ...datasets.contour_file.reader import ContourFile
from ...datasets.focus_files.frame_reader import FrameReader
from ...device.registry import kind_of
from ..sampling.metrics import SamplingCount
from ..sampling.strategy import SamplingStrategy
from ..validation import require_number
from .drive import Driver, DriveStrategy
from .focal_points import FocusSource

PEAK_LEAST = 0.9  # amplitude that am at full intensity reaches: what its samples miss of the sine's peak is less


@dataclass(frozen=True)
class Making:
    """How frames were made, and what was counted meanwhile; of several repetitions, the first."""

    sampling: SamplingStrategy | None
    """None for focal points of a file."""
    count: SamplingCount | None
    """What the sampler counted; None without one."""
    refused: int
    """Focal points that were silenced: out of reach of all arrays, or invalid."""
    switched: int
    """Frames whose amplitude an array that can only switch plays as 0 or 1."""
    drive: DriveStrategy


class WireFrames(Protocol):
    """Frames for several arrays, block by block."""

    @property
    def frame_count(self) -> int:
        """Of all repetitions."""
        ...

    @property
    def update_rate(self) -> float:
        """[Hz]"""
        ...

    @property
    def repeats(self) -> int:
        """Number of repetitions."""
        ...

    @property
    def making(self) -> Making:
        """How they were made; counts are whole when all frames were taken once."""
        ...

    def __iter__(self) -> Iterator[tuple[array[int], ...]]:
        """Blocks of frames, one array("B") for each array."""
        ...


class MadeFrames:
    """Frames for all arrays of a driver, made of focal points as they are taken; a block is as long as theirs.

    file: what focal points are read from; ContourFileError is raised if it was truncated or changed before a block was
    read. Raises StrategyError for less than one repetition.
    """

    def __init__(
        self,
        source: FocusSource,
        driver: Driver,
        *,
        repeats: int = 1,
        file: ContourFile | FrameReader | None = None,
    ) -> None:
        require_repeats(repeats)
        driver.require_played()
        self.repeats, self.update_rate = repeats, source.update_rate
        self.foci = source.foci
        """Focal points of a frame."""
        self.frame_count = source.frame_count * repeats
        self._source, self._driver, self._file = source, driver, file
        self._refused = self._switched = self._times = 0
        self._peak = 0.0  # greatest amplitude
        self._switches = sum(kind_of(array).layout.is_switch for array in driver.arrays)

    def __iter__(self) -> Iterator[tuple[array[int], ...]]:
        """Blocks of frames, one array("B") for each array."""
        for _ in range(self.repeats):
            self._times += 1
            is_first = self._times == 1
            for focus in self._source:
                packed = self._driver.pack(focus)
                if is_first:
                    self._count(packed.amplitude.numpy(), packed.refused)
                if self._file is not None:
                    self._file.require_unchanged()
                yield tuple(wire_bytes(frames.numpy()) for frames in packed.frames)

    def _count(self, amplitude: np.ndarray, refused: int) -> None:
        self._refused += refused
        self._peak = max(self._peak, float(amplitude.max(initial=0.0)))
        if self._switches:
            self._switched += self._switches * int(np.count_nonzero((amplitude > 0) & (amplitude < 1)))

    @property
    def making(self) -> Making:
        """How they are made, and what was counted so far, the first time round."""
        source = self._source
        return Making(source.sampling, source.count, self._refused, self.switched, self._driver.strategy)

    @property
    def switched(self) -> int:
        """Frames, the first time round, whose amplitude an array that can only switch played as 0 or 1.

        0 where a pose at rest with full intensity is modulated down to 0: switched on and off, it has the frequency of
        the modulation.
        """
        am = None if self._source.sampling is None else self._source.sampling.am
        is_by_design = am is not None and am.depth == 1 and self._source.is_static and self._peak >= PEAK_LEAST
        return 0 if is_by_design else self._switched


def wire_bytes(rows: np.ndarray) -> array[int]:
    """Frames, shape [frame, frame_bytes], as a player takes them."""
    block = array("B")
    block.frombytes(np.ascontiguousarray(rows).data)
    return block


def require_repeats(repeats: int) -> None:
    """Raise StrategyError for less than one repetition, and for what is no whole number."""
    require_number("repeats", repeats, 1, 1e9, whole=True)


def counted_values(count: SamplingCount, strategy: SamplingStrategy) -> dict[str, Any]:
    """What a sampler has counted, and its strategy, for JSON."""
    return {
        "jumps": sum(count.jumps.values()),
        "jumps_by_cause": count.jumps,
        "jump_length": count.jump_length,
        "jump_threshold": strategy.jump_threshold,
        "hops": sum(count.hops.values()),
        "hops_by_cause": count.hops,
        "hop_speed_max": count.hop_longest * strategy.update_rate,
        "hop_speed_max_by_cause": {
            cause: length * strategy.update_rate for cause, length in count.hops_longest.items()
        },
        "step_longest": count.step_longest,
        "absence_max": count.absence_max,
        "samples": count.samples,
        "silent": count.silent,
        "held": count.held,
        "draw_frequency": count.draw_frequency(strategy.update_rate),
        "revisit_rate": count.revisit_rate,
        "sampling": strategy.described(),
    }
