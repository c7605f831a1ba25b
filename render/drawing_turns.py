"""Turns: a polyline shorter than a step is drawn in one of some cycles, instead of never.

Where the samples of every cycle lie in the same places, a polyline that lies between two of them is not drawn at all.
"""

import math

import numpy as np

from .sampling_strategy import SamplingStrategy

SHARE_LEAST = 1 / 8  # of a step that a polyline takes at least: so all have been drawn after some eight cycles


def longest_passages(duration: np.ndarray, piece: np.ndarray) -> np.ndarray:
    """Time of the longest passage along each polyline that a cycle has, shape [polyline]; NaN for one that it has not.

    duration: of each way from node to node; piece: number of the polyline that it is on, -1 between two; shape [way].
    """
    first = np.flatnonzero(np.append(True, np.diff(piece) != 0))
    took, of = np.add.reduceat(duration, first), piece[first]
    longest = np.zeros(int(piece.max(initial=0)) + 1)
    np.maximum.at(longest, of[of >= 0], took[of >= 0])
    return np.where(longest > 0, longest, np.nan)


def stretched(duration: np.ndarray, piece: np.ndarray, least: float) -> np.ndarray:
    """Durations, those on polylines that take less time than `least` lengthened until they take it."""
    longest = longest_passages(duration, piece)
    scale = np.where(longest < least, least / longest, 1.0)
    return duration if (scale == 1.0).all() else np.where(piece >= 0, duration * scale[piece], duration)


def turns_of(duration: np.ndarray, piece: np.ndarray, count: int, strategy: SamplingStrategy) -> tuple[int, int]:
    """After how many cycles of `count` samples every polyline has been drawn, and the samples of so many cycles.

    One cycle, and 0 for its own samples, where each polyline takes a step at least. Else there is one sample more in
    that many cycles, or one less where a draw frequency has a lower bound. The numbers of samples and of cycles then
    have no divisor in common, so the samples of all these cycles lie evenly: a polyline that takes 1 / n of a step has
    a sample in one of about n cycles.
    """
    share = float(np.nanmin(longest_passages(duration, piece))) / float(duration.sum()) * count
    if share >= 1.0 - 1e-9:
        return 1, 0
    turns = math.ceil(1.0 / share + 1.0 / count)
    pace = strategy.pace
    fewer = pace.kind == "capped" and strategy.update_rate * turns < pace.lowest * (count * turns + 1)
    return turns, count * turns + (-1 if fewer else 1)
