"""Which code versions' results count for which other code version, as workers find it beside the manifest.

Workers do not open the manifest. Each parent writes this file again if it is missing or differs.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

from ..json_text import read_json
from ..storage.durable import write_file

FILE = "same-results.json"

Statements = dict[str, list[str]]
"""By code version: others whose results count for it, the last statement first."""


def counted_for(statements: Mapping[str, Sequence[str]], maker: str) -> tuple[str, ...]:
    """Code versions whose results count for one: those stated for it, then those stated for these, each once."""
    found = [maker]
    for own in found:  # it grows meanwhile
        found += [other for other in dict.fromkeys(statements.get(own, ())) if other not in found]
    return tuple(found[1:])


def write_statements(folder: Path, statements: Statements) -> None:
    """Write the file into a store's folder unless it is there; a full disk leaves none."""
    if _content(folder) != statements:
        with contextlib.suppress(OSError):
            write_file(folder / FILE, json.dumps(statements, indent=2).encode())


def read_counted(folder: Path, maker: str) -> tuple[str, ...]:
    """Code versions whose results count for one in a store's folder; none if the file is missing or damaged."""
    content = _content(folder)
    try:
        statements = {str(own): [str(other) for other in others] for own, others in content.items()}
    except (AttributeError, TypeError):
        return ()
    return counted_for(statements, maker)


def _content(folder: Path) -> dict[str, Any]:
    """What the file has; an empty object if it cannot be read."""
    try:
        return cast("dict[str, Any]", read_json(folder / FILE))
    except (OSError, ValueError):
        return {}
