"""Whether a file may be written where a command or a script wants it: asked before the work, and again for each way."""

import os
from collections.abc import Iterable
from pathlib import Path

from .errors import StrategyError


def require_output(out: Path, *, overwrite: bool, sources: Iterable[Path] = ()) -> None:
    """Refuse to write a file that is there, unless `overwrite`; a folder; one without a folder; and a source.

    sources: files that the new one is made from, which it never replaces, by whichever name or link. Raises
    StrategyError.
    """
    if os.path.lexists(out) and not overwrite:
        raise StrategyError(f"{out}: exists; overwrite=True replaces it")
    if out.is_dir():
        raise StrategyError(f"{out}: is a folder, not a file to write")
    if not out.parent.is_dir():
        raise StrategyError(f"{out}: cannot be written, as there is no folder {out.parent}")
    for source in sources:
        if source.exists() and out.exists() and source.samefile(out):
            raise StrategyError(f"{out}: is the file to read, which its result never replaces")
