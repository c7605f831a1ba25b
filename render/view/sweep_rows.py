"""A sweep's table as a viewer shows it: rows in an order, a page at a time; a row's rendering as a contour file."""

from collections.abc import Callable, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ...datasets.sweeps.table import TABLE, load_table
from ..errors import ViewError
from ..intersection.file_recording import record
from ..sweeps.make.keep import CONTOURS
from ..sweeps.make.poses import pose_count
from ..sweeps.make.rendering import read_recipe, recipe_cache
from ..sweeps.report.table import is_axis, is_metric
from ..trust.permission import AllowCode

POSES_MOST = 2_000_000  # of a row that is rendered again to be looked at
HIDDEN = ("recipe", "recipe_hash", "complete")


class SweepRows:
    """The table of a sweep's store; raises ViewError for a folder without one, SweepStoreError for a damaged one."""

    def __init__(self, store: Path) -> None:
        self.store = store
        self._made: dict[int, Path] = {}
        file = store / TABLE
        if not file.is_file():
            raise ViewError(f"{store} has no {TABLE}: a sweep that ends writes one")
        self.columns = load_table(file)
        """Values by column, each of shape [row]."""
        if "recipe" not in self.columns:
            raise ViewError(f"{file} has no column recipe, so that its rows cannot be opened as renderings")

    @property
    def count(self) -> int:
        """Number of rows."""
        return len(self.columns["recipe"])

    @cached_property
    def axes(self) -> list[str]:
        """Columns that say what was varied."""
        axes = [name for name in self.columns if is_axis(name) and name not in HIDDEN]
        return [name for name in axes if self._varies(name)] or axes[:1]

    @cached_property
    def metrics(self) -> list[str]:
        """Columns of results that are not the same in all rows, times apart."""
        names = [name for name in self.columns if is_metric(name) and not name.startswith("seconds")]
        return [name for name in names if self.columns[name].dtype.kind in "fiub" and self._varies(name)]

    def _varies(self, name: str) -> bool:
        return name not in HIDDEN and len({str(value) for value in self.columns[name]}) > 1

    def ordered(self, by: str | None = None, *, falling: bool = False, containing: str = "") -> np.ndarray:
        """Numbers of rows whose axes contain each word of a text, sorted by a column; missing values come last."""
        rows = np.arange(self.count)
        if words := containing.lower().split():
            titles = [self.title(int(row)).lower() for row in rows]
            rows = np.array([row for row in rows if all(word in titles[row] for word in words)], np.int64)
        if by is None or not len(rows):
            return rows
        values = self.columns[by][rows]
        if values.dtype.kind not in "fiub":
            order = np.argsort(np.array([str(value) for value in values]), kind="stable")
            return rows[order[::-1] if falling else order]
        numbers = values.astype(np.float64)
        order = np.argsort(-numbers if falling else numbers, kind="stable")  # NaN is last both ways
        return rows[order]

    def title(self, row: int) -> str:
        """What a row is of: the values of the axes that vary."""
        return ", ".join(f"{name} {cell_text(self.columns[name][row])}" for name in self.axes) or f"row {row}"

    def file_of(
        self,
        row: int,
        folder: Path,
        *,
        device: str = "cpu",
        allow_code: AllowCode = frozenset(),
        progress: Callable[[int, int], None] | None = None,
    ) -> Path:
        """The contour file of a row: the one that the sweep kept, or one that is rendered into `folder` once.

        progress: called with the poses that are done, and all. Raises what rendering raises, UntrustedCodeError for a
        recipe that names code, and ViewError for more than two million poses.
        """
        recipe = read_recipe(str(self.columns["recipe"][row]))
        key = recipe.key("contours")
        for found in (self._made.get(row), self.store / CONTOURS / f"{key}.h5"):
            if found is not None and found.is_file():
                return found
        count = pose_count(recipe)
        if count > POSES_MOST:
            raise ViewError(f"row {row} has {count} poses, {POSES_MOST} at most are rendered again to be looked at")
        made = recipe_cache(device).rendering(recipe, allow_code=allow_code)
        path = folder / f"row-{row}.h5"
        scene = made.scene
        record(
            path,
            scene.solid,
            scene.hand,
            made.poses.motion,
            scene.strategy,
            object_pose=scene.object_pose,
            mode="overwrite",
            device=device,
            progress=progress,
        )
        self._made[row] = path
        return path


def cell_text(value: Any) -> str:
    """A value of a table in few characters; nothing for one that is missing."""
    if isinstance(value, float | np.floating):
        return "" if np.isnan(value) else f"{float(value):.4g}"
    return str(value)


def default_metrics(names: Sequence[str]) -> list[str]:
    """The metrics that a table shows first."""
    usual = ("length_mean", "r", "draw_frequency_actual", "jumps_per_second", "noise_dba", "pressure_force")
    found = [name for name in usual if name in names]
    return found or list(names[:3])
