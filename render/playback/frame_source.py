"""Focal points -> drives -> wire bytes of each array, block by block, made as they are taken."""

from __future__ import annotations  # array("B") takes no index at run time

from array import array
from collections.abc import Iterator
from typing import Any, NamedTuple

from ...device.codec import encode_frames, switched_count
from ..errors import StrategyError
from ..sampling.metrics import FocalPoints, SamplingCount
from ..sampling.sampler import Sampler
from ..sampling.strategy import SamplingStrategy
from .device_frames import PulsePacker
from .drive import Driver
from .focus_source import ContourSource, FocusSource

PEAK_LEAST = 0.9  # amplitude that am at full intensity reaches: what its samples miss of the sine's peak is less
KEPT_BYTES_MOST = 1 << 26  # of frames that are kept for the next time round


class Encoded(NamedTuple):
    """Frames of a block of focal points."""

    block: tuple[array[int], ...]
    """For each array."""
    refused: int
    switched: int


class FrameSource:
    """Wire bytes for all arrays of a driver; a block of them is as long as the focal points' block.

    Focal points that are the same object as before are encoded once, and bytes that are played again come as the same
    array("B"), as long as frames do not depend on those before them and all of it is not more than KEPT_BYTES_MOST.

    packer: makes the frames on its device instead of the driver, for the driver's only array.
    """

    def __init__(
        self,
        source: FocusSource,
        driver: Driver,
        *,
        repeats: int = 1,
        sampler: Sampler | None = None,
        packer: PulsePacker | None = None,
    ) -> None:
        require_repeats(repeats)
        self.frame_count = source.frame_count * repeats
        self.refused = 0
        """Focal points, the first time round, that no array could reach, or that were none: silenced."""
        self.counted: SamplingCount | None = None
        """What `sampler` had counted after the first time round; None before."""
        self._sampler = sampler
        self._switched, self._peak = 0, 0.0
        self._source, self._driver, self._repeats, self._packer = source, driver, repeats, packer
        self._last: tuple[FocalPoints, Encoded] | None = None
        self._kept: list[Encoded] | None = None

    @property
    def switched(self) -> int:
        """Frames, the first time round, whose amplitude an array that can only switch played as 0 or 1.

        0 where a pose at rest with full intensity is modulated down to 0: switched on and off, it has the frequency of
        the modulation.
        """
        am = None if self._sampler is None else self._sampler.strategy.am
        is_at_rest = isinstance(self._source, ContourSource) and self._source.is_static
        is_by_design = am is not None and am.depth == 1 and is_at_rest and self._peak >= PEAK_LEAST
        return 0 if is_by_design else self._switched

    def __iter__(self) -> Iterator[tuple[array[int], ...]]:
        """Blocks of frames, one array("B") for each array."""
        frame_bytes = sum(model.frame_bytes for model in self._driver.arrays)
        fits = self._source.frame_count * frame_bytes <= KEPT_BYTES_MOST
        keeping = self._repeats > 1 and fits
        blocks: list[Encoded] = []
        for time in range(self._repeats):
            if self._kept is not None:
                for encoded in self._kept:
                    yield encoded.block
                continue
            for focus in self._source:
                encoded = self._encoded(focus)
                keeping = keeping and self._is_memoryless(focus)
                if keeping:
                    blocks.append(encoded)
                if time == 0:
                    self.refused += encoded.refused
                    self._switched += encoded.switched
                yield encoded.block
            self._kept = blocks if keeping else None
            if time == 0 and self._sampler is not None:
                self.counted = self._sampler.count

    def _encoded(self, focus: FocalPoints) -> Encoded:
        if self._last is not None and self._last[0] is focus and self._is_memoryless(focus):
            return self._last[1]
        encoded = self._driven(focus) if self._packer is None else self._packed(focus, self._packer)
        self._last = focus, encoded
        return encoded

    def _packed(self, focus: FocalPoints, packer: PulsePacker) -> Encoded:
        frame, refused = packer.pack_host(focus)
        return Encoded((array("B", frame.tobytes()),), refused, 0)  # a pulse has steps of width

    def _driven(self, focus: FocalPoints) -> Encoded:
        drives = self._driver.drive(focus)
        self._peak = max(self._peak, float(drives.amplitude.max(initial=0.0)))
        block = tuple(
            array("B", encode_frames(part.delay, part.amplitude, array=model).tobytes())
            for model, part in zip(self._driver.arrays, self._driver.split(drives), strict=True)
        )
        switched = sum(switched_count(drives.amplitude, array=model) for model in self._driver.arrays)
        return Encoded(block, drives.refused, switched)

    def _is_memoryless(self, focus: FocalPoints) -> bool:
        """Whether frames depend on their focal points alone: no slew limit, no gauge."""
        return self._driver.strategy.slew is None and focus.position.ndim == 2


def require_repeats(repeats: int) -> None:
    """Raise StrategyError for less than one repetition."""
    if repeats < 1:
        raise StrategyError(f"repeats must be at least 1, not {repeats}")


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
        "draw_frequency_nominal": count.draw_frequency(strategy.update_rate),  # deprecated: its name of old
        "revisit_rate": count.revisit_rate,
        "sampling": strategy.described(),
    }
