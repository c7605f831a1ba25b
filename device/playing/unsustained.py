"""Contents at a rate that an array cannot keep up for any frames: a burst, or one pattern switched on and off."""

from __future__ import annotations  # array("B") takes no index at run time

from array import array
from collections.abc import Iterable, Iterator
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from ..array import ArrayModel
from ..codec import is_emitting
from ..errors import UpdateRateError


def within_reach(blocks: Iterable[array[int]], model: ArrayModel, divider: int) -> Iterable[array[int]]:
    """Blocks of whole frames, which are refused before the first of them is played where that shows soon.

    A burst is gathered, and comes as one block, so that it is sent in one piece. Alternations of one pattern and off
    are looked at block by block, the first one at once.

    Raises `UpdateRateError`, here or from the blocks: they go beyond what the array plays at this divider.
    """
    if divider >= model.divider_sustained:
        return blocks
    if not model.alternates:
        return _burst(blocks, model, divider)
    alternating = _alternating(blocks, model, divider)
    return chain([block for block in (next(alternating, None),) if block is not None], alternating)


def _burst(blocks: Iterable[array[int]], model: ArrayModel, divider: int) -> list[array[int]]:
    gathered = array("B")
    for block in blocks:
        gathered += block
        if len(gathered) > model.burst_frames * model.frame_bytes:
            raise UpdateRateError(
                f"array {model.name} cannot keep up {model.update_rate(divider):g} Hz (divider {divider}): beyond "
                f"{model.burst_frames} frames it needs divider {model.divider_sustained} or more, which is "
                f"{model.update_rate(model.divider_sustained):.6g} Hz at most"
            )
    return [gathered] if gathered else []


def _alternating(blocks: Iterable[array[int]], model: ArrayModel, divider: int) -> Iterator[array[int]]:
    pattern: NDArray[np.uint8] | None = None
    first = 0
    for block in blocks:
        frames = np.frombuffer(block, np.uint8).reshape(-1, model.frame_bytes)
        on = np.flatnonzero(is_emitting(frames, array=model))
        if len(on):
            pattern = frames[on[0]].copy() if pattern is None else pattern
            other = on[(frames[on] != pattern).any(axis=1)]
            if len(other):
                raise UpdateRateError(
                    f"array {model.name} plays {model.update_rate(divider):g} Hz only as one pattern switched on and "
                    f"off, such as am of one focal point at rest (pace.kind 'still' at one pose), but frame "
                    f"{first + other[0]} has another pattern; it plays any frames at up to "
                    f"{model.update_rate(model.divider_sustained):.6g} Hz"
                )
        first += len(frames)
        yield block
