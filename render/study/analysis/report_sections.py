"""The analysis as sections of a report: sentences, tables and pictures."""

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from ...reports.report_pages import ReportPicture, ReportSection, ReportTable
from ..plan.study_plan import StudyPlan
from .answer_measures import Cell, Measure, cell_text, level_label, level_text
from .figures import (
    draw_magnitudes,
    draw_measure,
    draw_participants,
    draw_psychometric,
    draw_scale,
    draw_staircases,
)
from .hypothesis_tests import RANKS_LEAST, SIGNIFICANT, StatisticalTest
from .level_answers import MagnitudeScale
from .measure_tests import AGAINST, AMBIGUOUS, FOR, FactorTests, MeasureTests
from .psychometric_fit import FittedValue
from .study_analysis import FittedLevels, StudyAnalysis

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


ASSUMPTIONS = (
    (
        "Shapiro-Wilk test",
        "values are independent",
        "All cells of all participants are taken together, as in the founding paper. With few values it finds only "
        "gross departures; with many, harmless ones.",
    ),
    (
        "Wilcoxon signed-rank test",
        "participants are independent; differences are symmetrical around their median",
        "Zeros are left out. Below 50 differences without ties and zeros p is exact; else a normal approximation with "
        "corrections for ties and continuity, as R's wilcox.test does it. The difference is the pseudo-median.",
    ),
    (
        "t-test",
        "participants are independent; differences are from a normal distribution",
        "It stands beside Wilcoxon's test: decide before you look which of them counts.",
    ),
    (
        "Friedman test",
        "participants are independent; each has a value at every level",
        "It asks whether any level differs, before pairs are compared. Chi-square approximation.",
    ),
    (
        "Holm's correction",
        "nothing",
        "The pairs of levels of one factor in one measure are a family, and so are the participants' binomial tests. "
        "Measures and factors are not corrected for each other.",
    ),
    (
        "exact binomial test",
        "answers of one participant are independent and have one probability",
        "It asks of one participant whether they answer by chance.",
    ),
    (
        "chi-square test of homogeneity",
        "answers are independent; expected counts are at least 5",
        "It asks whether participants differ from each other by more than chance.",
    ),
    (
        "tendency of a participant",
        "nothing; it is no test",
        "The founding paper's rule: five sixths of a participant's cells on one side of chance, where those at chance "
        "count for both sides. Of people who answer at random in 6 cells of 10 answers it calls 25 % `for` and 25 % "
        "`against`: the binomial tests beside it keep to 5 %.",
    ),
    (
        "psychometric function",
        "answers are independent; the cumulative Gaussian describes them; at most 6 % lapses",
        "Maximum likelihood; intervals by profile likelihood. The deviance's p is poor for few answers a level. Levels "
        "of a staircase follow the answers, and intervals are too short: in simulations with two tracks of 10 "
        "reversals 91 % held the threshold, not 95 %.",
    ),
    (
        "tests by cells",
        "all values are independent, which those of one participant are not",
        "The founding paper's way, for comparison. Where participants differ, it finds differences that are none.",
    ),
)
"""Test, what it assumes, and how it is done."""
FITS_SHOWN = 24  # in one picture


def report_sections(analysis: StudyAnalysis) -> list[ReportSection]:
    """The sections of a report, in the order of a paper's results."""
    sections = [_participants_section(analysis)]
    sections += [_choice_section(own, asked_text(own.measure, analysis.table.plan)) for own in analysis.choices]
    sections += [_measure_section(own, "Ratio r") for own in analysis.ratios]
    sections += [_measure_section(own, own.measure.title.capitalize()) for own in analysis.scales]
    for name in dict.fromkeys(own.answers.block.name for own in analysis.fits):
        sections.append(_fit_section([own for own in analysis.fits if own.answers.block.name == name]))
    for own in analysis.thresholds:
        blocks = {cell.name for cell in own.measure.cells}
        doubts = threshold_doubts([fitted for fitted in analysis.fits if fitted.answers.block.name in blocks])
        sections.append(_measure_section(own, own.measure.title.capitalize(), doubts))
    sections += [_magnitude_section(own) for own in analysis.magnitudes]
    sections += [_measure_section(own, own.measure.title.capitalize()) for own in analysis.exponents]
    written = [own for own in analysis.open if own.question.kind == "text" and own.texts]
    if written:
        tables = [
            ReportTable(f"{own.question.text} ({own.place})", ("participant", "answer"), own.texts) for own in written
        ]
        text = "As they wrote it; nothing is counted."
        sections.append(ReportSection("What people wrote", text, tuple(tables)))
    text = "Decide before you look at the answers which tests count. What is written above rests on those by ranks."
    return [*sections, ReportSection("What the tests assume", text, (ReportTable("", ASSUMED_HEAD, ASSUMPTIONS),))]


ASSUMED_HEAD = ("test", "assumes", "how it is done here")


def _participants_section(analysis: StudyAnalysis) -> ReportSection:
    table = analysis.table
    count = len(table.codes)
    done = count - len(table.unfinished)
    text = (
        f"{count} of {len(table.plan.codes)} participants {_have(count)} taken part; {done} {_have(done)} answered "
        "everything. Practice trials are left out. A participant who lacks a value is left out of the comparisons that "
        "need it, and of nothing else."
    )
    if count < RANKS_LEAST:
        text += (
            f"\n\nFewer than {RANKS_LEAST} participants have taken part: whatever they answered, no p of Wilcoxon's "
            "test can be below 0.05. Read the numbers as a description: that no difference is found says nothing yet."
        )
    counted = [own for own in analysis.open if own.question.kind != "text"]
    tables = []
    if table.sessions:
        kinds = Counter((own.array, own.source, own.palpate) for own in table.sessions)
        days = sorted(own.began[:10] for own in table.sessions)
        text += (
            f"\n\nSessions: {len(table.sessions)}, from {days[0]} to {days[-1]}. Intervals that were stopped, or whose "
            f"trial was played again: {table.replayed_count}."
        )
        rows = [(*kind, str(number)) for kind, number in kinds.items()]
        tables.append(ReportTable("Sessions", ("array", "poses of the hand from", "palpate", "sessions"), rows))
    if counted:
        rows = [(own.question.text, own.place, own.summary) for own in counted]
        tables.append(ReportTable("Questions", ("question", "asked", "answers"), rows))
    if analysis.faults:
        tables.append(ReportTable("What to look at", ("in the data",), [(own,) for own in analysis.faults]))
    return ReportSection("Participants and data", text, tuple(tables))


def asked_text(measure: Measure, plan: StudyPlan) -> str:
    """Says that the blocks of a measure ask different questions, whose answers a mean mixes; empty where they don't."""
    own = {cell.name.partition(": ")[0] for cell in measure.cells}
    asked = list(dict.fromkeys(block.question.text for block in plan.blocks if block.name in own))
    if len(asked) < 2:
        return ""
    return (
        f" Its blocks ask {len(asked)} different questions: where these mean different things, read the levels below, "
        "and not what is said over all cells."
    )


def _choice_section(tests: MeasureTests, asked: str) -> ReportSection:
    measure = tests.measure
    name = measure.name
    counts = measure.counts
    assert counts is not None  # of proportions, as the next two
    assert tests.chance_by_ranks is not None
    assert measure.chance is not None
    fewest, most = (int(own(counts)) if counts.size else 0 for own in (np.min, np.max))
    answers = str(most) if fewest == most else f"{fewest} to {most}"
    paragraphs = [
        f"{name} is the {measure.title} in a cell: {_cells_text(measure)} with {answers} answers each.{asked}",
        f"Over all cells, {name} of participants is {mean_text(measure.by_participant())}. "
        + chance_sentence(name, tests.chance_by_ranks, measure.chance)
        + opposed_text([tests.chance_by_ranks], [tests.chance_by_means]),
        *(factor_paragraph(measure, own) for own in tests.factors),
        _tendency_paragraph(tests),
    ]
    rows = [
        (
            own.code,
            number_text(own.mean),
            f"{own.above} and {own.below} of {own.cells}",
            own.tendency,
            *test_row(own.binomial)[2:6],
        )
        for own in tests.tendencies
    ]
    head = ("participant", name, "cells at chance or above, and at chance or below", "tendency", *TEST_HEAD[2:6])
    tables = (*_measure_tables(tests), ReportTable("Participants, by exact binomial tests of all answers", head, rows))
    pictures = (*_level_pictures(measure), *_pictures(draw_participants(measure)))
    return ReportSection(f"Choices: {name}", "\n\n".join(paragraphs), tables, pictures)


def threshold_doubts(fits: Sequence[FittedLevels]) -> str:
    """What thresholds and just noticeable differences count though their fits warn of it; empty for nothing."""
    found = [own for own in fits if own.fit is not None and own.fit.mu.value is not None]
    outside = sum(not own.answers.x[0] <= (own.fit.mu.value or 0.0) <= own.answers.x[-1] for own in found if own.fit)
    steps = sum(own.fit is not None and own.fit.sigma.value == 0.0 for own in found)
    falling = [own for own in found if own.fit is not None and own.fit.is_increasing is False]
    parts = [
        f"{len(fits) - len(found)} have no threshold and lack here" * (len(found) < len(fits)),
        f"{outside} have a threshold outside the levels and lack here, too" * bool(outside),
        f"{steps} are steps, which count with a JND of 0" * bool(steps),
    ]
    if 0 < len(falling) < len(found):
        who = ", ".join(f"{own.answers.code} in {own.answers.block.name}" for own in falling)
        parts.append(f"{len(falling)} fall with the value where others rise ({who})")
    listed = "; ".join(filter(None, parts))
    return f"Of {len(fits)} fits {listed}: see the notes of each before you trust these numbers." if listed else ""


def _measure_section(tests: MeasureTests, title: str, doubts: str = "") -> ReportSection:
    measure = tests.measure
    unit = f" [{measure.unit}]" if measure.unit else ""
    scale = f", a scale from {measure.low:g} to {measure.high:g}" if measure.high is not None else ""
    paragraphs = [
        f"{measure.title[:1].upper()}{measure.title[1:]}{unit}{scale}: {_cells_text(measure)}. Participants' means are "
        f"{mean_text(measure.by_participant())}.",
        *filter(None, [doubts]),
        *(factor_paragraph(measure, own) for own in tests.factors),
    ]
    pictures = _level_pictures(measure)
    if measure.high is not None:
        pictures = (*_pictures(draw_scale(measure)), *pictures)
    return ReportSection(title, "\n\n".join(paragraphs), _measure_tables(tests), pictures)


def _measure_tables(tests: MeasureTests) -> tuple[ReportTable, ...]:
    measure = tests.measure
    of_participants = [own for own in (tests.chance_by_ranks, tests.chance_by_means) if own is not None]
    beside = (tests.normality, tests.heterogeneity, tests.chance_by_cells)
    of_cells = [own for own in beside if own is not None]
    for own in tests.factors:
        of_participants += [*([own.omnibus] if own.omnibus is not None else []), *own.by_ranks, *own.by_means]
        of_cells += own.by_cells
    tables = [ReportTable(f"{measure.name} of participants", LEVEL_HEAD, level_rows(measure))]
    if of_participants:
        rows = [test_row(own) for own in of_participants]
        tables.append(ReportTable("Tests: a participant is one observation", TEST_HEAD, rows))
    rows = [test_row(own) for own in of_cells]
    tables.append(
        ReportTable(
            "For comparison, as in the founding paper: each cell of a participant is an observation", TEST_HEAD, rows
        )
    )
    return tuple(tables)


def factor_paragraph(measure: Measure, tests: FactorTests) -> str:
    """What a measure says of one factor: means of its levels, and which of them differ."""
    means = "; ".join(
        f"{level_label(tests.factor, own)}: {mean_text(measure.at_level(tests.factor, own))}" for own in tests.levels
    )
    crossed = ""
    if not tests.is_crossed:
        crossed = (
            " Levels do not stand with the same levels of the other factors, so do not compare these means: tests "
            "compare the cells that the levels share, or these means where they share none."
        )
    omnibus = ""
    if tests.omnibus is not None:
        whether = "Levels differ" if is_found(tests.omnibus) else "No difference between all levels was found"
        whether = whether if tests.omnibus.p is not None else "Whether any level differs cannot be tested"
        omnibus = f" {whether} ({test_text(tests.omnibus)})."
    return f"By {tests.factor}: {means}.{crossed}{omnibus} {pair_sentences(measure.name, tests.by_ranks)}" + (
        opposed_text(tests.by_ranks, tests.by_means)
    )


def opposed_text(by_ranks: Sequence[StatisticalTest], by_means: Sequence[StatisticalTest | None]) -> str:
    """Says that means contradict what ranks find, else a reader takes one of them for a mistake; empty for nothing."""
    opposed = [
        ranks.compares
        for ranks, means in zip(by_ranks, by_means, strict=True)
        if is_found(ranks) and means is not None and (ranks.effect_size or 0.0) * (means.difference or 0.0) < 0.0
    ]
    if not opposed:
        return ""
    return f" The mean of {', '.join(opposed)} has the other sign: few far values move a mean more than ranks."


def _tendency_paragraph(tests: MeasureTests) -> str:
    counts = {kind: sum(own.tendency == kind for own in tests.tendencies) for kind in (FOR, AGAINST, AMBIGUOUS)}
    groups = (
        f"{counts[FOR]} of {_participants(len(tests.tendencies))} {_have(counts[FOR])} five sixths of their cells at "
        f"chance or above, {counts[AGAINST]} at chance or below, and {counts[AMBIGUOUS]} "
        f"{'is' if counts[AMBIGUOUS] == 1 else 'are'} ambiguous."
    )
    test = tests.heterogeneity
    if test is None or test.p is None:
        return groups
    if is_found(test):
        return (
            f"{groups} Participants differ by more than chance ({test_text(test)}): there are subgroups, or each has a "
            "tendency of their own."
        )
    return f"{groups} No difference between participants beyond chance was found ({test_text(test)})."


def _fit_section(fits: Sequence[FittedLevels]) -> ReportSection:
    block = fits[0].answers.block
    is_staircase = block.design == "staircase"
    guess = fits[0].answers.guess
    low = "lapses on both sides" if fits[0].answers.lapses_both_ways else f"guess rate {guess:g}"
    text = (
        f"A cumulative Gaussian over the stimuli's values, fitted to {fits[0].answers.counted} of each participant by "
        f"maximum likelihood ({low}, at most 6 % lapses); intervals of 95 % by profile likelihood. The threshold is "
        "the value halfway between both ends of the curve; the JND leads from there to three quarters of the way."
    )
    if is_staircase:
        text += f" Reversals lie around the value with {0.5 ** (1 / block.down):.1%} of {fits[0].answers.counted}."
    rows, notes = [], []
    for own in fits:
        answers, fit = own.answers, own.fit
        reversals = [number_text(answers.reversal_mean)] if is_staircase else []
        if fit is None:
            rows.append((answers.code, "", "", "", "", *reversals, answers.reason))
            continue
        rows.append(
            (
                answers.code, _interval_text(fit.mu), _interval_text(fit.jnd), _interval_text(fit.lapse),
                p_text(fit.goodness_p), *reversals, fit.note,
            )
        )  # fmt: skip
        if answers.clipped:
            notes.append(f"{answers.code}: {answers.clipped}")
    if notes:
        text += f"\n\nMoves that would have gone beyond the first or last level, by participant: {', '.join(notes)}."
    more = ("mean of reversals",) if is_staircase else ()
    head = ("participant", "threshold (95 %)", "JND (95 %)", "lapses", "fit", *more, "note")
    pictures = _pictures(draw_psychometric(fits[:FITS_SHOWN], omitted=max(0, len(fits) - FITS_SHOWN)))
    if is_staircase:
        pictures = (*pictures, *_pictures(draw_staircases([own.answers for own in fits[:FITS_SHOWN]])))
    return ReportSection(f"Thresholds: {block.name}", text, (ReportTable("", head, rows),), pictures)


def _magnitude_section(scale: MagnitudeScale) -> ReportSection:
    text = (
        "The geometric mean of each participant's estimates, and the slope of its logarithm over that of the value: "
        f"the exponent of the power law. Exponents are {mean_text(scale.exponents)}."
    )
    if scale.reason:
        text = f"There is no exponent: {scale.reason}."
    if scale.left_out:
        text += f" {scale.left_out} estimates of 0 or below have no logarithm, and are left out."
    head = ("participant", *(f"at {own:g}" for own in scale.x), "exponent")
    rows = [
        (code, *(number_text(float(own)) for own in means), number_text(float(exponent)))
        for code, means, exponent in zip(scale.codes, scale.means, scale.exponents, strict=True)
    ]
    pictures = () if scale.reason else _pictures(draw_magnitudes(scale))
    return ReportSection(f"Magnitudes: {scale.block.name}", text, (ReportTable("", head, rows),), pictures)


def _level_pictures(measure: Measure) -> tuple[ReportPicture, ...]:
    """The measure by its first factor, coloured by the second, then by each further one."""
    names = list(measure.factors)
    if not names or not np.isfinite(measure.values).any():
        return ()
    drawn = [draw_measure(measure, *names[:2])] if len(names) > 1 else []
    dot = "the mean of a participant, as in the tests"
    for name in names:
        levels = measure.factors[name]
        cells = tuple(Cell(level_label(name, own), {name: own}) for own in levels)
        values = np.stack([measure.at_level(name, own) for own in levels], axis=1)
        drawn.append(
            draw_measure(replace(measure, cells=cells, values=values, successes=None, counts=None), name, dot=dot)
        )
    return _pictures(*drawn)


def _pictures(*drawn: ReportPicture | None) -> tuple[ReportPicture, ...]:
    return tuple(own for own in drawn if own is not None)


def _cells_text(measure: Measure) -> str:
    count = len(measure.cells)
    return f"{count} cell{'s' * (count != 1)} of {_participants(len(measure.codes))}"


def _participants(count: int) -> str:
    return f"{count} participant{'s' * (count != 1)}"


def _have(count: int) -> str:
    return "has" if count == 1 else "have"


def _interval_text(value: FittedValue) -> str:
    if value.value is None:
        return ""
    if value.low is None and value.high is None:
        return number_text(value.value)
    low, high = (number_text(own) if own is not None else "open" for own in (value.low, value.high))
    return f"{number_text(value.value)} ({low} to {high})"
