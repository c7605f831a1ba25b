"""Rows of the reproduction: one result of the paper beside palpate's; a section begins with a table of these."""

from collections.abc import Sequence
from typing import NamedTuple

from ..reports.report_pages import ReportTable

ROW_HEAD = ("result", "paper", "palpate", "why they differ")


class ReportRow(NamedTuple):
    """One result of the paper beside palpate's."""

    what: str
    paper: str
    ours: str
    why: str
    """Why the two differ, or may."""


def compared(rows: Sequence[ReportRow]) -> ReportTable:
    """The table of these rows, without a title: it stands right below the section's text."""
    return ReportTable("", ROW_HEAD, tuple(rows), "compare")
