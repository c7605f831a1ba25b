"""The tests of the founding paper: Shapiro, Wilcoxon by pairs with Holm's correction, and Student's of one sample.

Each gives p, or None where a test says nothing: too few values, or values that are all alike.
"""

from collections.abc import Mapping
from itertools import combinations

import numpy as np

SHAPIRO_LEAST = 3
"""Values that Shapiro's test needs."""
ALIKE = 1e-9
"""Of the largest value: values that differ by less are the same but for rounding."""


def normality(values: np.ndarray) -> float | None:
    """p of Shapiro's test: small where values are not from a normal distribution."""
    from scipy import stats  # 0.5 s that only reports cost

    found = values[np.isfinite(values)]
    if len(found) < SHAPIRO_LEAST or _is_constant(found):
        return None
    return float(stats.shapiro(found)[1])


def mean_zero(values: np.ndarray) -> float | None:
    """p of a one-sample t-test, two-sided: small where the mean is not 0."""
    from scipy import stats

    found = values[np.isfinite(values)]
    if len(found) < 2 or _is_constant(found):
        return None
    return float(stats.ttest_1samp(found, 0.0)[1])


def paired(a: np.ndarray, b: np.ndarray) -> float | None:
    """p of Wilcoxon's signed-rank test of pairs, two-sided; pairs of which one is missing are left out."""
    from scipy import stats

    difference = (a - b)[np.isfinite(a - b)]
    if len(difference) == 0 or not difference.any():
        return None
    return float(stats.wilcoxon(difference)[1])


def holm(p: Mapping[str, float | None]) -> dict[str, float | None]:
    """p corrected for their number by Holm's step-down method; tests that say nothing do not count."""
    known = sorted((value, name) for name, value in p.items() if value is not None)
    corrected: dict[str, float | None] = dict.fromkeys(p)
    largest = 0.0
    for rank, (value, name) in enumerate(known):
        largest = max(largest, min(1.0, value * (len(known) - rank)))
        corrected[name] = largest
    return corrected


def pairwise(values: Mapping[str, np.ndarray]) -> dict[str, float | None]:
    """Wilcoxon's p of all pairs of samples, corrected by Holm's method, by name: "cube - tube"."""
    return holm({f"{a} - {b}": paired(values[a], values[b]) for a, b in combinations(values, 2)})


def p_text(p: float | None) -> str:
    """p in words."""
    if p is None:
        return "no test"
    return "p < 0.001" if p < 0.001 else f"p = {p:.3f}"


def _is_constant(values: np.ndarray) -> bool:
    return bool(np.ptp(values) <= ALIKE * np.abs(values).max())
