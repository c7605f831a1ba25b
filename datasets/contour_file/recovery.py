"""Taking over the parts of a rendering that stopped: intact rows are kept, and damage is reported."""

from __future__ import annotations

from pathlib import Path

from ..errors import ContourFileError
from ..storage.durable import append_at
from .parts import LOG_SUFFIX, ROWS_SUFFIX, FilePart, part_logs, read_part, verify_part

_KINDS = (LOG_SUFFIX, ROWS_SUFFIX, ".h5")  # .h5: parts as palpate wrote them before they grew


def part_files(folder: Path) -> list[Path]:
    """Every file of a part, logs first: rows without a log are nothing."""
    found = [path for path in folder.glob("poses-*") if path.suffix in _KINDS]
    return sorted(found, key=lambda path: (_KINDS.index(path.suffix), path.name))


def take_over_parts(folder: Path, recipe: str) -> tuple[list[FilePart], tuple[str, ...]]:
    """Parts in pose order, cut to what is whole, and a sentence for each that lost something; raises OSError.

    recipe: SHA-256 that a part must be of.
    """
    parts: list[FilePart] = []
    repairs: list[str] = []
    for log in part_logs(folder):
        reached = parts[-1].stop if parts else 0
        try:
            part = verify_part(read_part(log))
        except ContourFileError as error:
            _drop(log)
            repairs.append(f"{error}: dropped, its poses are rendered again")
            continue
        if part.recipe != recipe:
            _drop(log)
            repairs.append(f"{log.name} is of another rendering: dropped, its poses are rendered again")
        elif part.commits and part.first < reached:
            _drop(log)
            repairs.append(f"{log.name} overlaps others: dropped")
        else:
            if part.problem:
                repairs.append(f"{log.name} {part.problem} after pose {part.stop}: the others are rendered again")
            _keep(part, parts)
    for path in part_files(folder):
        if path.suffix == ROWS_SUFFIX and not path.with_suffix(LOG_SUFFIX).exists():
            path.unlink()  # begun, and killed before its log
        elif path.suffix not in (LOG_SUFFIX, ROWS_SUFFIX):
            path.unlink()
            repairs.append(f"{path.name} is of an older palpate: dropped, its poses are rendered again")
    return parts, tuple(repairs)


def _keep(part: FilePart, parts: list[FilePart]) -> None:
    """Cut the files to what the part is; one without poses goes."""
    if part.stop == part.first:
        _drop(part.log)
        return
    append_at(part.log, part.log_end, [])
    parts.append(part)


def _drop(log: Path) -> None:
    log.unlink()
    log.with_suffix(ROWS_SUFFIX).unlink(missing_ok=True)
