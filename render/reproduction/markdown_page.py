"""A report as Markdown, without pictures: the page docs/measured/paper.md is made so."""

import textwrap
from collections.abc import Sequence

from .html_page import ROW_HEAD
from .sections import ReportSection

WIDTH = 120
"""Characters of a line of text."""


def markdown_page(title: str, introduction: str, sections: Sequence[ReportSection], footer: str) -> str:
    """The page; rows of tables stay on one line, however long."""
    parts = [f"# {title}", _wrapped(introduction)]
    for section in sections:
        parts += [f"## {section.title}", _wrapped(section.text)]
        if section.rows:
            parts.append(_table(ROW_HEAD, section.rows))
        for table in section.tables:
            parts += [_wrapped(f"{table.title}:"), _table(table.head, table.rows)]
    return "\n\n".join([*parts, _wrapped(footer)]) + "\n"


def _wrapped(text: str) -> str:
    return textwrap.fill(text, WIDTH, break_long_words=False, break_on_hyphens=False)


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [_line(head), "|" + "---|" * len(head), *(_line(row) for row in rows)]
    return "\n".join(lines)


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
