"""What a report consists of: sections with rows of comparison, tables and pictures; pages are made of these."""

from dataclasses import dataclass
from typing import NamedTuple


class ReportRow(NamedTuple):
    """One result of the paper beside palpate's."""

    what: str
    paper: str
    ours: str
    why: str
    """Why the two differ, or may."""


class ReportTable(NamedTuple):
    """Further numbers of palpate's."""

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


class ReportPicture(NamedTuple):
    """A picture that a page holds itself."""

    uri: str
    """A data URI of an SVG or a PNG."""
    alt: str
    """What the picture shows, for who cannot see it."""
    caption: str


@dataclass(frozen=True)
class ReportSection:
    """One figure or section of the paper."""

    title: str
    text: str
    """What was done, in a few sentences."""
    rows: tuple[ReportRow, ...] = ()
    tables: tuple[ReportTable, ...] = ()
    pictures: tuple[ReportPicture, ...] = ()
