"""A sweep's outcome in Markdown, for pages that show it, such as the summary of a step in continuous integration."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ....datasets.storage.durable import open_own
from ...errors import SweepError
from ...terminal.foreign_text import visible
from ..run.sweep_run import clock_time
from .compare import ROWS_SHOWN, Comparison

if TYPE_CHECKING:
    from ..run.sweep_run import SweepReport
from ....datasets.sweeps.store import Failure


def failure_rows(failures: Sequence[Failure]) -> list[tuple[str, str]]:
    """Recipes that failed and why, one row a reason."""
    names: dict[str, list[str]] = {}
    for failure in failures:
        names.setdefault(failure.sentence.removeprefix(f"{failure.name}: "), []).append(failure.name)
    return [(own[0] + (f" and {len(own) - 1} more" if own[1:] else ""), why) for why, own in names.items()]


TEXT_MOST = 300  # characters of a text from outside
# Signs that could begin markup, HTML or a link; an underscore inside a word begins nothing.
_MARKUP = re.compile(r"[\\`*{}\[\]<>&|~#!$@]|(?<![A-Za-z0-9])_|_(?![A-Za-z0-9])|(?<=www)\.|:(?=//)", re.IGNORECASE)


def sweep_summary(name: str, report: SweepReport, comparison: Comparison | None, *, row_count: int = ROWS_SHOWN) -> str:
    """A sweep's counts, failures, and what moved against its baseline, as Markdown.

    name: of the plan. row_count: rows of each table at most; a line below it counts the others.
    """
    parts = [f"### Sweep {markdown_text(name)}", _counts(report)]
    failures = failure_rows(report.failures)
    parts += _section(f"{len(report.failures)} recipes could not be made", ("recipe", "why"), failures, row_count)
    if comparison is not None:
        parts += [markdown_text(f"{sentence}.") for sentence in comparison.sentences()]
        moved = comparison.rows(len(comparison.moved))
        parts += _section("What moved", ("recipe", "metric", "was", "is", "change"), moved, row_count)
        for title, names in (
            ("Recipes of the baseline that are missing", comparison.missing),
            ("Recipes without whole results", comparison.incomplete),
            ("New recipes", comparison.added),
        ):
            parts += _section(title, ("recipe",), [(own,) for own in names], row_count)
    return "\n\n".join(parts) + "\n"


def append_summary(path: Path, text: str) -> None:
    """Append Markdown to a file, which is made if it is not there; raises SweepError if it cannot be written."""
    try:
        handle = open_own(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        with os.fdopen(handle, "ab") as stream:
            stream.write(f"{chr(10) * 2 if os.fstat(handle).st_size else ''}{text}".encode())
    except OSError as error:
        raise SweepError(f"--summary {path} cannot be written: {error.strerror or error}") from error


def markdown_text(text: object) -> str:
    """A text from outside as Markdown that shows it on one line, and in which nothing is markup, HTML or a link."""
    line = visible(text).strip()
    line = line if len(line) <= TEXT_MOST else f"{line[: TEXT_MOST - 1]}…"
    return _MARKUP.sub(lambda match: f"&#{ord(match[0])};", line)


def _counts(report: SweepReport) -> str:
    values = {
        "recipes": f"{report.recipes:,}",
        "recipes failed": f"{len(report.failures):,}",
        "poses": f"{report.poses:,}",
        "poses rendered": f"{report.poses_rendered:,}",
        "time": clock_time(report.seconds),
        "executor": report.executor or "none",
    }
    return _table(list(values), [list(values.values())])


def _section(title: str, names: Sequence[str], rows: Sequence[Sequence[str]], row_count: int) -> list[str]:
    """A heading, a table of at most `row_count` rows, and how many rows it lacks; nothing without rows."""
    if not rows:
        return []
    more = [f"and {len(rows) - row_count:,} more"] if len(rows) > row_count else []
    return [f"#### {title}", _table(names, rows[:row_count]), *more]


def _table(names: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Every text from outside stands in a cell: Markdown begins no list, heading or block there."""
    lines = [names, ["---"] * len(names), *([markdown_text(cell) for cell in row] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
