"""Turns: a polyline shorter than a step is drawn in one of some cycles, instead of never.

Where the samples of every cycle lie in the same places, a polyline that lies between two of them is not drawn at all.
"""

import math

import numpy as np

from palpate.render.sampling.strategy import SamplingStrategy

SHARE_LEAST = 1 / 8  # of a step that a polyline takes at least: so all have been drawn after some eight cycles


def longest_passages(duration: np.ndarray, piece: np.ndarray) -> np.ndarray:
    """Time of the longest passage along each polyline that a cycle has, shape [polyline]; NaN for one that it has not.

    duration: of each segment; piece: number of the polyline that it is on, -1 between two; shape [segment].
    """
    first = np.flatnonzero(np.append(True, np.diff(piece) != 0))
    took, of = np.add.reduceat(duration, first), piece[first]
    longest = np.zeros(int(piece.max(initial=0)) + 1)
    np.maximum.at(longest, of[of >= 0], took[of >= 0])
    return np.where(longest > 0, longest, np.nan)


def by_turns(
    duration: np.ndarray, piece: np.ndarray, count: int, strategy: SamplingStrategy
) -> tuple[np.ndarray, int, int]:
    """Durations, after how many cycles of `count` samples every polyline has been drawn, and the samples of these.

    One cycle, and 0 for its own samples, where each polyline takes a step at least. Else those that take less than
    SHARE_LEAST of a step are lengthened to it, and there is one sample more in that many cycles, or one less where a
    draw frequency has a lower bound. The numbers of samples and of cycles then have no divisor in common, so the
    samples of all these cycles lie evenly: a polyline that takes 1 / n of a step has one in one of about n cycles.
    """
    longest, step = longest_passages(duration, piece), float(duration.sum()) / count
    least = float(np.nanmin(longest))
    if least >= step * (1.0 - 1e-9):
        return duration, 1, 0
    if least < SHARE_LEAST * step:
        scale = np.where(longest < SHARE_LEAST * step, SHARE_LEAST * step / longest, 1.0)
        duration = np.where(piece >= 0, duration * scale[piece], duration)
        least, step = SHARE_LEAST * step, float(duration.sum()) / count
    turns = math.ceil(step / least + 1.0 / count)
    pace = strategy.pace
    fewer = pace.kind == "capped" and strategy.update_rate * turns < pace.lowest * (count * turns + 1)
    return duration, turns, count * turns + (-1 if fewer else 1)
