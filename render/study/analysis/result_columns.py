"""The analysis as tables for other programs: a row for each answer, each value of a measure, each test, each fit."""

import math
import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ....datasets.storage.durable import write_file
from ...errors import RenderError
from ..plan.study_plan import PlannedBlock
from .answer_measures import Level
from .answer_reading import StudyTable
from .psychometric_fit import FittedValue
from .report_sections import all_tests
from .study_analysis import StudyAnalysis

Columns = dict[str, list[Any]]
"""Values by the name of a column; None is missing."""
PAIR_DESIGNS = ("2ifc", "constant", "staircase")
"""Designs whose options are the intervals of a trial, where it has several."""


def answer_columns(table: StudyTable) -> Columns:
    """A row for each answer, with the levels of its block: the tidy table.

    r is the mean over a trial's intervals with closed contours; of several questions the first one has it.
    """
    blocks = {own.name: own for own in table.plan.blocks}
    numbers = {code: number for number, code in enumerate(table.plan.codes)}
    ratios: dict[tuple[str, str, int], list[float]] = defaultdict(list)
    for own in table.ratios:
        ratios[own.code, own.block, own.trial].append(own.r)
    factors = _factor_names(table)
    rows = []
    for own in table.answers:
        block = blocks.get(own.block)
        is_number = isinstance(own.value, int | float)
        is_pair = block is not None and block.design in PAIR_DESIGNS and own.kind == "choice" and len(own.stimuli) > 1
        is_first = block is not None and own.trial >= 0 and own.name == block.question.name
        r = ratios.get((own.code, own.block, own.trial)) if is_first else None
        rows.append(
            {
                "code": own.code, "participant": numbers[own.code], "block": own.block, "block_position": own.position,
                "design": "" if block is None else block.design,
                **{_column(name): _level(block, name) for name in factors},
                "trial": own.trial, "is_practice": own.is_practice, "name": own.name, "kind": own.kind,
                "number": float(own.value) if is_number and own.value is not None else None,
                "text": own.value if isinstance(own.value, str) else None,
                "label": own.label, "key": own.key,
                "chosen": own.stimuli[int(own.value or 0)] if is_pair and is_number else None,
                "first": own.stimuli[0] if own.stimuli else None,
                "second": own.stimuli[1] if len(own.stimuli) > 1 else None,
                "track": own.track, "level": own.level, "comparison": own.comparison, "seconds": own.seconds,
                "r": None if r is None else float(np.mean(r)),
            }
        )  # fmt: skip
    return _columns(rows)


def measure_columns(analysis: StudyAnalysis) -> Columns:
    """A row for each participant, measure and cell."""
    of_cells = (name for tests in analysis.tests for cell in tests.measure.cells for name in cell.factors)
    factors = dict.fromkeys([*_factor_names(analysis.table), *(name for name in of_cells if name != "block")])
    rows = []
    for tests in analysis.tests:
        measure = tests.measure
        for code, values, place in zip(measure.codes, measure.values, range(len(measure.codes)), strict=True):
            for number, (cell, value) in enumerate(zip(measure.cells, values, strict=True)):
                rows.append(
                    {
                        "code": code,
                        "measure": measure.name,
                        "cell": cell.name,
                        **{_column(name): _text(cell.factors.get(name)) for name in factors},
                        "value": None if np.isnan(value) else float(value),
                        "successes": None if measure.successes is None else int(measure.successes[place, number]),
                        "answers": None if measure.counts is None else int(measure.counts[place, number]),
                    }
                )
    return _columns(rows)


def outcome_columns(analysis: StudyAnalysis) -> Columns:
    """A row for each test. observations: `participants`, `cells` (of participants), or `answers`."""
    rows = []
    for tests in analysis.tests:
        for factor, kind, own in all_tests(tests):
            rows.append(
                {
                    "measure": tests.measure.name, "factor": factor, "compares": own.compares, "test": own.test,
                    "observations": kind, "n": own.n, "statistic": own.statistic, "value": own.value,
                    "freedom": own.freedom, "p": own.p, "p_holm": own.p_holm, "effect": own.effect,
                    "effect_size": own.effect_size, "difference": own.difference, "difference_low": own.difference_low,
                    "difference_high": own.difference_high, "note": own.note,
                }
            )  # fmt: skip
    return _columns(rows)


def fit_columns(analysis: StudyAnalysis) -> Columns:
    """A row for each psychometric function."""
    rows = []
    for own in analysis.fits:
        answers, fit = own.answers, own.fit
        row = {
            "code": answers.code, "block": answers.block.name, "design": answers.block.design,
            **{_column(name): _level(answers.block, name) for name in _factor_names(analysis.table)},
            "guess": None if answers.lapses_both_ways else answers.guess, "reversal_mean": answers.reversal_mean,
            "clipped": answers.clipped,
        }  # fmt: skip
        for name in ("mu", "sigma", "jnd", "lapse"):
            value: FittedValue = FittedValue(value=None) if fit is None else getattr(fit, name)
            row |= {name: value.value, f"{name}_low": value.low, f"{name}_high": value.high}
        row |= {
            "converged": fit is not None and fit.converged,
            "is_increasing": None if fit is None else fit.is_increasing,
            "goodness_p": None if fit is None else fit.goodness_p,
            "note": answers.reason if fit is None else fit.note,
        }
        rows.append(row)
    return _columns(rows)


def _columns(rows: Sequence[Mapping[str, Any]]) -> Columns:
    names = dict.fromkeys(name for row in rows for name in row)
    return {name: [row.get(name) for row in rows] for name in names}


def _factor_names(table: StudyTable) -> list[str]:
    return list(dict.fromkeys(name for block in table.plan.blocks for name in block.factors))


def _column(factor: str) -> str:
    """The column of a factor, which must not be that of the block's position."""
    return f"block_{factor}" if factor != "position" else "block_position_level"


def _level(block: PlannedBlock | None, factor: str) -> str | None:
    return None if block is None else _text(block.factors.get(factor))


def _text(level: Level | None) -> str | None:
    """A level as text, so that a column has one type though a plan may mix numbers and words."""
    return None if level is None else level if isinstance(level, str) else f"{level:g}"


# ---- the tables as files


Value = str | float | bool | None
"""A cell; None and nan are missing."""

_FORMULA = re.compile(r"'*[=+\-@\t\r]")  # what begins a formula in spreadsheets; OWASP, "CSV Injection"
_NUMBER = re.compile(r"[+-]?[0-9]+(\.[0-9]*)?(e[+-]?[0-9]+)?", re.IGNORECASE)
_INT_MOST = 1 << 63


def write_table(path: Path, columns: Mapping[str, Sequence[Any]]) -> None:
    """Write equally long columns as CSV, replacing an earlier file.

    A column with any text is text, else whole numbers, numbers or true and false. A text that a spreadsheet would
    compute gets a `'` in front. The file has one line of names and no comments, so that R, spreadsheets and statistics
    programs read it without options.

    Raises:
        RenderError: The file cannot be written; says why.
    """
    content = _csv_content({_clean(key): _cells_of(values) for key, values in columns.items()})
    try:
        write_file(path, content)
    except OSError as error:
        raise RenderError(f"{path}: cannot be written ({error.strerror or error})") from error


def _cells_of(values: Sequence[Any]) -> list[Value]:
    """Values of one kind, or None."""
    plain = [own.item() if hasattr(own, "item") else own for own in values]  # NumPy's scalars
    found = [None if isinstance(own, float) and math.isnan(own) else own for own in plain]
    kinds = {type(own) for own in found if own is not None}
    if kinds <= {bool} or (kinds == {int} and all(own is None or -_INT_MOST <= own < _INT_MOST for own in found)):
        return found
    if kinds <= {bool, int, float}:
        return [None if own is None else float(own) for own in found]
    return [None if own is None else _clean(own if isinstance(own, str) else _number_text(own)) for own in found]


def _clean(text: str) -> str:
    """A text that files can hold: null characters and halves of surrogate pairs as escapes."""
    return text.replace("\0", "\\x00").encode(errors="backslashreplace").decode()


def _number_text(value: Any) -> str:
    """TRUE and FALSE, as R reads them, and no others, like pandas and polars; the same text for 7 and 7.0."""
    if isinstance(value, bool):
        return str(value).upper()
    return str(int(value)) if isinstance(value, float) and value.is_integer() and abs(value) < 1e15 else str(value)


def _csv_content(columns: Mapping[str, Sequence[Value]]) -> memoryview:
    def cell(value: Value) -> str:
        if not isinstance(value, str):
            return "" if value is None else _number_text(value)
        text = f"'{value}" if _FORMULA.match(value) and not _NUMBER.fullmatch(value) else value
        # The csv module of Python 3.11 leaves a lone carriage return without quotes.
        return '"' + text.replace('"', '""') + '"' if not text or any(own in text for own in ',"#\r\n') else text

    rows = [list(columns), *zip(*columns.values(), strict=True)]
    return memoryview("".join(f"{','.join(map(cell, row))}\n" for row in rows).encode())
