"""r, how much longer closed contours are than open ones, of every block of every explorer, and what tests say of it."""

from typing import NamedTuple

import numpy as np

from .explorations import FeltLengths
from .significance import normality, pairwise


class BlockRatios(NamedTuple):
    """r of each block in both readings, float64, shape [explorer, block]; NaN where nothing was drawn with OC."""

    whole: np.ndarray
    """A palm wholly inside counts in CC as its whole boundary: `r`."""
    open: np.ndarray
    """It counts as nothing, because it has no open contour to close: `r_open`."""


def block_ratios(lengths: FeltLengths) -> BlockRatios:
    """r of blocks: mean length of CC over mean length of OC, of all poses of the block, empty ones included."""
    opened = lengths.open.sum(axis=-1, dtype=np.float64)
    inside = lengths.open == 0.0
    whole = lengths.closed.sum(axis=-1, dtype=np.float64)
    partly = np.where(inside, 0.0, lengths.closed).sum(axis=-1, dtype=np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        return BlockRatios(*(np.where(opened > 0.0, sum_ / opened, np.nan) for sum_ in (whole, partly)))


def ratio_values(ratios: dict[str, np.ndarray]) -> dict[str, dict]:
    """Mean, standard deviation and Shapiro's p of r by object; ratios: shape [explorer, block]."""
    return {name: _summary(r.ravel()) for name, r in ratios.items()}


def ratio_tests(ratios: dict[str, np.ndarray]) -> dict[str, dict[str, float | None]]:
    """Pairwise Wilcoxon tests with Holm's correction, by blocks as in the paper, and by explorers.

    The blocks of one explorer are not independent of each other, which the test takes them for. The means of each
    explorer are, so the second row is the one to rely on.
    """
    return {
        "by_block": pairwise({name: r.ravel() for name, r in ratios.items()}),
        "by_explorer": pairwise({name: r.mean(axis=1) for name, r in ratios.items()}),
    }


def _summary(r: np.ndarray) -> dict:
    found = r[np.isfinite(r)]
    return {
        "mean": float(found.mean()) if len(found) else None,
        "sd": float(found.std(ddof=1)) if len(found) > 1 else None,
        "lowest": float(found.min()) if len(found) else None,
        "highest": float(found.max()) if len(found) else None,
        "blocks": len(found),
        "blocks_without_contours": len(r) - len(found),
        "shapiro_p": normality(found),
    }
