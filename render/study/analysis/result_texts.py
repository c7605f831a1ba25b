"""Results as sentences and cells of tables, in the style of the field's papers."""

import math
from collections.abc import Iterable, Sequence

import numpy as np

from .hypothesis_tests import SIGNIFICANT
from .measure_tests import MeasureTests
from .measures import Measure, cell_text, level_text
from .statistical_test import StatisticalTest

TEST_HEAD = ("comparison", "test", "n", "statistic", "p", "p (Holm)", "effect size", "difference (95 %)", "note")
PAIRS_LISTED = 6
"""Pairs without a difference that a sentence lists; of more it says how many, and a table has them."""
NOTHING = 1e-12
"""Numbers below it are 0 but for rounding."""
SHORT_NAMES = {
    "rank-biserial r": "r_rb",
    "Cohen's d_z": "d_z",
    "Cohen's d": "d",
    "Cohen's h": "h",
    "Kendall's W": "W_K",
}


def number_text(value: float | None) -> str:
    """A number with three digits, or all of a larger whole one; empty for none."""
    if value is None or math.isnan(value):
        return ""
    value = 0.0 if abs(value) < NOTHING else value  # no -0, and no rounding error
    return f"{value:.0f}" if 999.5 <= abs(value) < 1e6 else f"{value:.3g}"


def p_text(p: float | None) -> str:
    """A p value, as in a column of them; a dash for none. No p that is below 0.05 is rounded to it."""
    if p is None:
        return "-"
    if p < 0.001:
        return "< 0.001"
    texts = (f"{p:.{digits}f}" for digits in range(3, 17))
    return next((own for own in texts if (float(own) < SIGNIFICANT) == (p < SIGNIFICANT)), str(p))


def p_equation(p: float, *, symbol: str = "p") -> str:
    """A p value as papers print it: p = 0.012."""
    text = p_text(p)
    return f"{symbol} {text}" if text.startswith("<") else f"{symbol} = {text}"


def statistic_text(test: StatisticalTest) -> str:
    """V = 40, or t(9) = -4.06; empty where there is no test."""
    if test.value is None:
        return ""
    freedom = f"({test.freedom:g})" if test.freedom is not None else ""
    return f"{test.statistic}{freedom} = {number_text(test.value)}"


def is_found(test: StatisticalTest) -> bool:
    """Whether a test finds a difference: its p, corrected where there is a family, is below 0.05."""
    return test.p_final is not None and test.p_final < SIGNIFICANT


def test_text(test: StatisticalTest) -> str:
    """What stands in brackets: the test, and its numbers, or why there are none."""
    return f"{test.test}, {numbers_text(test)}" if test.p is not None else f"{test.test}: {numbers_text(test)}"


def numbers_text(test: StatisticalTest) -> str:
    """The test's statistic, n, p and effect size, or why there is no test."""
    if test.p is None:
        return test.note.removeprefix("no test: ")
    holm = test.p_holm
    effect = (
        [] if test.effect_size is None else [f"{SHORT_NAMES.get(test.effect, test.effect)} = {test.effect_size:.2f}"]
    )
    p = p_equation(test.p) if holm is None else p_equation(holm, symbol="p_Holm")
    count = f"n = {test.n}{f', {test.zeros} of them 0' * (test.zeros > 0)}"
    found = []
    if test.difference is not None and test.difference_low is not None and test.difference_high is not None:
        low, high = number_text(test.difference_low), number_text(test.difference_high)
        found = [f"difference {number_text(test.difference)} [{low}, {high}]"]
    return ", ".join([statistic_text(test), count, p, *effect, *found])


def test_row(test: StatisticalTest) -> tuple[str, ...]:
    """A row below TEST_HEAD."""
    interval = number_text(test.difference)
    if test.difference_low is not None and test.difference_high is not None:
        interval += f" ({number_text(test.difference_low)} to {number_text(test.difference_high)})"
    effect = "" if test.effect_size is None else f"{SHORT_NAMES.get(test.effect, test.effect)} = {test.effect_size:.2f}"
    corrected = "" if test.p_holm is None else p_text(test.p_holm)
    return (
        test.compares, test.test, str(test.n), statistic_text(test), p_text(test.p), corrected, effect, interval,
        test.note,
    )  # fmt: skip


def chance_sentence(name: str, test: StatisticalTest, chance: float) -> str:
    """Whether a measure is above chance."""
    if test.p is None:
        return f"Whether {name} differs from chance ({chance:g}) cannot be tested ({test_text(test)})."
    if not is_found(test):
        return f"No difference of {name} from chance ({chance:g}) was found ({test_text(test)})."
    side = "above" if (test.effect_size or 0.0) > 0 else "below"
    return f"{_capital(name)} is {side} chance ({chance:g}; {test_text(test)})."


def pair_sentences(name: str, tests: Sequence[StatisticalTest]) -> str:
    """Which levels differ; all pairs of one factor, whose test is named once."""
    if not tests:
        return ""
    found = [own for own in tests if is_found(own)]
    parts = []
    for own in found:
        levels, is_higher = own.compares.split(" - "), (own.effect_size or 0.0) > 0
        shown = name if not parts else _capital(name)
        if len(levels) == 2:
            side = "higher" if is_higher else "lower"
            parts.append(f"{shown} is {side} for {levels[0]} than for {levels[1]} ({numbers_text(own)}).")
        else:  # a level is called "a - b", so that nobody knows where it ends
            side = "above" if is_higher else "below"
            parts.append(f"{shown} has a difference {own.compares} {side} 0 ({numbers_text(own)}).")
    others = [own for own in tests if own not in found]
    if others:
        what = f"{'No other' if found else 'no'} difference was found"
        if len(others) > PAIRS_LISTED:
            least = min((own.p_final for own in others if own.p_final is not None), default=None)
            p = "" if least is None else f", least {p_equation(least, symbol='p_Holm')}"
            parts.append(f"{what} (in {len(others)} pairs{p}).")
        else:
            listed = []
            for own in others:
                pair = own.compares.split(" - ")
                listed.append(f"{' and '.join(pair) if len(pair) == 2 else own.compares}: {numbers_text(own)}")
            parts.append(f"{what} ({'; '.join(listed)}).")
    is_family = any(own.p_holm is not None for own in tests)
    kind = f"Holm-corrected {tests[0].test}s" if is_family else tests[0].test
    return f"By {kind}, {' '.join(parts)}"


def level_rows(measure: Measure) -> list[tuple[str, ...]]:
    """Descriptive numbers of each level of each factor, of each cell, and of all: of participants' values."""
    rows = []
    for factor, levels in measure.factors.items():
        rows += [(factor, level_text(own), *_described(measure.at_level(factor, own))) for own in levels]
    if len(measure.factors) != 1 or len(measure.cells) != len(next(iter(measure.factors.values()))):
        rows += [
            ("cell", cell_text(cell), *_described(values))
            for cell, values in zip(measure.cells, measure.values.T, strict=True)
        ]
    return [*rows, ("all", "", *_described(measure.by_participant()))]


LEVEL_HEAD = ("", "", "n", "mean", "sd", "median", "least", "largest")


def mean_text(values: np.ndarray) -> str:
    """Mean and standard deviation of what is there."""
    found = values[np.isfinite(values)]
    if not len(found):
        return "nothing"
    spread = f" ± {number_text(float(found.std(ddof=1)))}" if len(found) > 1 else ""
    lacking = f" (n = {len(found)})" if len(found) < len(values) else ""
    return f"{number_text(float(found.mean()))}{spread}{lacking}"


def all_tests(tests: MeasureTests) -> Iterable[tuple[str, str, StatisticalTest]]:
    """Every test of a measure, with its factor and what its values are: `participants` or `cells`."""
    yield "", "cells", tests.normality
    for kind, test in (
        ("participants", tests.chance_by_ranks),
        ("participants", tests.chance_by_means),
        ("cells", tests.chance_by_cells),
        ("answers", tests.heterogeneity),
    ):
        if test is not None:
            yield "", kind, test
    for own in tests.factors:
        if own.omnibus is not None:
            yield own.factor, "participants", own.omnibus
        yield from ((own.factor, "participants", test) for test in (*own.by_ranks, *own.by_means))
        yield from ((own.factor, "cells", test) for test in own.by_cells)
    yield from (("", "answers", own.binomial) for own in tests.tendencies)


def _described(values: np.ndarray) -> tuple[str, ...]:
    found = values[np.isfinite(values)]
    if not len(found):
        return ("0", "", "", "", "", "")
    spread = float(found.std(ddof=1)) if len(found) > 1 else None
    numbers = (float(found.mean()), spread, float(np.median(found)), float(found.min()), float(found.max()))
    return (str(len(found)), *map(number_text, numbers))


def _capital(text: str) -> str:
    """Words begin with a capital letter, symbols such as p_cc, r and jnd stay."""
    return text[:1].upper() + text[1:] if " " in text or (text.isalpha() and len(text) > 3) else text
