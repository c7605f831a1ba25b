"""A histogram of a metric over poses, from which quantiles are computed: exact counts, merged in any order.

Every factor of two from 2^LOWEST to 2^HIGHEST has 2^BITS bins of equal width. So a quantile is at most half a bin, a
share of 2^-(BITS + 1) = 0.8 %, from the value of the pose that it stands for. Values up to 0, below and above that
range have a bin each.
"""

from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np

LOWEST, HIGHEST, BITS = -10, 6, 6
"""From 1 mm to 64 m, in the unit of the metric; 64 bins each factor of two."""
BINS = (HIGHEST - LOWEST) * 2**BITS + 3


def describe(count: np.ndarray) -> list[list[int]]:
    """JSON of numbers of all bins in their order, shape [histogram, bin]; a list each.

    -n stands for n empty bins, and none follow the last number.
    """
    row, used = np.nonzero(count)
    first = np.searchsorted(row, np.arange(len(count) + 1))  # of each histogram in `used`
    before = np.roll(used, 1)
    before[first[:-1][first[:-1] < len(used)]] = -1
    pairs = np.stack([before + 1 - used, count[row, used]], axis=1).ravel()
    start = np.concatenate([[0], np.cumsum(pairs != 0)])[2 * first].tolist()
    numbers = pairs[pairs != 0].tolist()
    return [numbers[begin:end] for begin, end in pairwise(start)]


def merge(histograms: Iterable[Sequence[int]]) -> np.ndarray:
    """Numbers of all bins of several histograms together, int64, shape [bin]."""
    out = np.zeros(BINS, np.int64)
    for own in histograms:
        numbers = np.array(own, np.int64)
        stop = np.cumsum(np.where(numbers < 0, -numbers, 1))
        out[stop[numbers > 0] - 1] += numbers[numbers > 0]
    return out


def quantiles(count: np.ndarray, percents: Sequence[int], least: float, greatest: float) -> list[float | None]:
    """For each percentage p the smallest value that at least p % of the poses do not exceed; None without a pose.

    That is `numpy.quantile` with method "inverted_cdf", within half a bin: the middle of the bin stands for the value,
    and lies within `least`..`greatest` of all poses.
    """
    total = np.cumsum(count)
    if not total[-1]:
        return [None] * len(percents)
    ranks = [max(1, -(-percent * int(total[-1]) // 100)) for percent in percents]
    bins = np.searchsorted(total, ranks).tolist()
    middles = {own: (_lower_edge(own) + _lower_edge(own + 1)) / 2 for own in bins} | {0: 0.0, BINS - 1: greatest}
    return [min(max(middles[own], least), greatest) for own in bins]


def _lower_edge(own: int) -> float:
    power, step = divmod(own - 2, 2**BITS)
    return 2.0 ** (LOWEST + power) * (1 + step / 2**BITS) if own > 1 else 0.0
