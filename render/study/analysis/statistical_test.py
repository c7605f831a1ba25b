"""What a statistical test says: values for tables, and a sentence in the field's style."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class StatisticalTest:
    """One test. p is None where the test says nothing, and `note` says why."""

    test: str
    """"Wilcoxon signed-rank test", "Shapiro-Wilk test"."""
    compares: str
    """What with what: "cube - tube", "p_cc - 0.5"."""
    n: int
    """Values, or pairs, that there were."""
    zeros: int = 0
    """Of them, those that a test by ranks leaves out because they are 0."""
    statistic: str = ""
    """Its symbol: "V", "W", "t", "chi2"."""
    value: float | None = None
    freedom: float | None = None
    """Degrees of freedom."""
    p: float | None = None
    """Two-sided, not corrected."""
    p_holm: float | None = None
    """Corrected for the tests of its family by Holm's method; None where it has no family."""
    effect: str = ""
    """Its name: "rank-biserial r", "Cohen's d_z"."""
    effect_size: float | None = None
    difference: float | None = None
    """Mean or median difference, in the measure's unit."""
    difference_low: float | None = None
    difference_high: float | None = None
    """95 % interval of it."""
    note: str = ""
    """Ties, zeros, a normal approximation; or why there is no p."""

    @property
    def p_final(self) -> float | None:
        """The p that counts: the corrected one, if there is one."""
        return self.p if self.p_holm is None else self.p_holm
