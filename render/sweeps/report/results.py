"""Files that a sweep makes of its results: the store's table, rows of poses and picture, and tables elsewhere."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ....datasets.json_text import read_json
from ....datasets.storage.durable import discard, write_file
from ....datasets.storage.schema import PRUNED_NAMES, removed_name
from ....datasets.sweeps.store import SweepStore
from ....datasets.sweeps.table import POSES, TABLE, write_blocks, write_table
from ...errors import RenderError, SweepError
from ...terminal import console
from ..plan.code_version import code_version
from .compare import row_names
from .table import column_units, pose_blocks, tidy_columns

if TYPE_CHECKING:
    from ..plan.loading import Plan

FIGURE, STAMP = "summary.png", "table.json"
LENGTHS = ("length", *(f"length_{kind}" for kind in ("object", "hand", "made", "intensity")))
FREQUENCIES = ("draw_frequency_nominal", "draw_frequency_actual")
POSE_UNITS = dict.fromkeys((*LENGTHS, *map(removed_name, PRUNED_NAMES)), "m") | dict.fromkeys(FREQUENCIES, "Hz")
POSE_UNITS |= {"area": "m2"}
NAMED_MOST = 3  # recipes without contact that a warning names


class Results:
    """Tables and picture of a run.

    Those in the store are written unless they are there and this run made nothing: table.json names the plan, the code
    version and the size of the table that the store has.
    """

    def __init__(self, plan: Plan, folder: Path, *, is_complete: bool, has_news: bool) -> None:
        """is_complete: whether every recipe could be made; has_news: whether any chunk was made just now."""
        self._plan, self._folder, self._is_complete = plan, folder, is_complete
        self._stamp = {"plan": plan.digest, "code_version": code_version()}
        self._has_poses = "poses" in plan.groups
        self._is_fresh = is_complete and not has_news and self._is_stamped()
        self.files: dict[str, str] = {}
        """Written files by their use."""

    @cached_property
    def columns(self) -> dict[str, Any]:
        """Columns of the table, made when first asked for."""
        with SweepStore(self._folder, code_version()) as store:
            return tidy_columns(self._plan.recipes(), store, self._plan.groups)

    def write(self, tables: Sequence[Path], *, figure: bool) -> None:
        """Write what the store lacks, and the table into `tables` too. figure: draw one, too."""
        picture, cannot_write = self._folder / FIGURE, not os.access(self._folder, os.W_OK)
        if cannot_write and not self._is_fresh:
            console.warn(f"{self._folder} cannot be written, and its own table is of another plan: see --table")
        else:
            if not self._is_fresh:
                self._write_own()
            if figure and not cannot_write and not picture.exists():
                self._draw(picture)
            self.files["table"] = str(self._folder / TABLE)
            self.files |= {"poses_table": str(self._folder / POSES)} if self._has_poses else {}
            self.files |= {"figure": str(picture)} if picture.exists() else {}
        for path in tables:
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise SweepError(f"{path.parent} cannot be made: {error.strerror or error}") from error
            write_table(path, self.columns, units=column_units(self.columns))

    def _is_stamped(self) -> bool:
        """Whether the store's table is that of this plan and code version, and whole."""
        try:
            found = read_json(self._folder / STAMP)
            size = (self._folder / TABLE).stat().st_size
        except (OSError, ValueError):
            return False
        return found == self._stamp | {"bytes": size} and (self._folder / POSES).exists() == self._has_poses

    def _write_own(self) -> None:
        """Write the store's table; the stamp comes last, so that a kill before it has all of them written again."""
        for name in (STAMP, FIGURE, *(() if self._has_poses else (POSES,))):  # of other results
            discard(self._folder / name)
        size = write_table(self._folder / TABLE, self.columns)
        if (text := contactless_text(self.columns)) is not None:
            console.warn(text)
        if self._has_poses:
            # Open for writing, so that damaged rows are removed and made again by the next run.
            with SweepStore(self._folder, code_version(), mode="write") as store:
                write_blocks(self._folder / POSES, pose_blocks(self._plan.recipes(), store), units=POSE_UNITS)
        if self._is_complete:
            with contextlib.suppress(OSError):  # without the stamp all are written again
                write_file(self._folder / STAMP, json.dumps(self._stamp | {"bytes": size}).encode())

    def _draw(self, picture: Path) -> None:
        """Draw the picture; a warning says why there is none, as results are worth more than their picture."""
        from .figure import draw_sweep  # matplotlib

        try:
            draw_sweep(self.columns, picture, name=self._plan.name)
        except (RenderError, OSError) as error:
            console.warn(f"no figure: {error}")
        except Exception as error:  # matplotlib's, of names or numbers that nobody thought of
            console.warn(f"no figure: {type(error).__name__}: {str(error).strip().partition(chr(10))[0]}")


def contactless_text(columns: Mapping[str, Sequence[Any]]) -> str | None:
    """A sentence on recipes whose hand never meets the object, as ratios and frequencies of these are NaN; or None."""
    lengths = columns.get("length_mean", ())
    empty = [row for row, length in enumerate(lengths) if length == 0]
    if not empty:
        return None
    names = row_names(columns)
    listed = "; ".join(names[row] for row in empty[:NAMED_MOST])
    listed += f"; and {len(empty) - NAMED_MOST:,} more" if len(empty) > NAMED_MOST else ""
    return (
        f"in {len(empty):,} of {len(lengths):,} recipes the hand never meets the object, so their length is 0, and "
        f"r, draw frequencies and predictions are empty (NaN): {listed}. object.at moves an object to the hand, "
        "motion.alignment a recording from its tracker's frame to the array's"
    )
