"""Rows of a manifest by which results of one code version count for another: a person stated that they are the same."""

from __future__ import annotations

from datetime import UTC, datetime

from .counted_versions import Statements
from .manifest import Manifest, row_digest

Maker = tuple[int, str]
"""Number and name of a code version in a manifest."""

_STATED = (
    "SELECT own.maker, other.maker, time, same_results.digest FROM same_results "
    "LEFT JOIN maker own ON own.id = same_results.maker LEFT JOIN maker other ON other.id = counted "
    "ORDER BY same_results.rowid DESC"
)


def statements_of(manifest: Manifest) -> Statements:
    """All statements of a manifest; raises SweepStoreError if one is damaged."""
    found: Statements = {}
    for own, other, time, digest in manifest.run(_STATED) if manifest.version > 2 else ():
        if row_digest(own, other, time) != digest:
            raise manifest.damaged(f"that results of {other} count for {own}")
        found.setdefault(str(own), []).append(str(other))
    return found


def add_statement(manifest: Manifest, own: Maker, other: Maker) -> None:
    """State that the results of another code version count for one. Stating it again does nothing."""
    time = datetime.now(UTC).isoformat(timespec="seconds")
    with manifest.transaction():
        manifest.add_same_results()
        values = (own[0], other[0], time, row_digest(own[1], other[1], time))
        manifest.run("INSERT OR IGNORE INTO same_results VALUES (?, ?, ?, ?)", values)


def latest_maker(manifest: Manifest, but: int) -> str | None:
    """The code version that recorded a result last, other than that of a number; None if there is no other."""
    rows = manifest.run(
        "SELECT maker.maker FROM part JOIN maker ON maker.id = part.maker WHERE part.maker != ? "
        "ORDER BY part.id DESC LIMIT 1",
        (but,),
    )
    return str(rows[0][0]) if rows else None
