"""The baseline of `palpate sweep --baseline`: read and refused before a sweep, compared or updated after it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from ...datasets.sweeps.table import PARQUET, SUFFIXES
from ..errors import PlanError, SweepError
from .job import SweepJob, require_pyarrow
from .plan.loading import Plan
from .plan.recipe import Recipe, function_of, is_user_metric
from .report.baseline import write_baseline
from .report.compare import Baseline, Comparison, Tolerance, compare_tables, load_baseline, parse_tolerances
from .report.table import METRICS, user_columns


@dataclass(frozen=True)
class BaselineCheck:
    """A baseline, and how far metrics may move from it."""

    path: Path
    old: Baseline | None
    """None for a file that is to be written for the first time."""
    tolerances: tuple[Tolerance, ...]
    is_updated: bool
    """Whether the sweep's table replaces it."""

    @classmethod
    def of(cls, job: SweepJob, path: Path) -> Self:
        """Read the baseline; raises PlanError for one that cannot be read, or not be updated if that is asked for."""
        if job.update_baseline:
            if path.suffix not in SUFFIXES or path.is_dir():
                raise PlanError(f"--baseline {path}: --update-baseline writes only {' or '.join(SUFFIXES)}")
            if path.suffix == PARQUET:
                require_pyarrow(f"--baseline {path}")
        try:
            old = None if job.update_baseline and not path.exists() else load_baseline(path)
            return cls(path, old, parse_tolerances(job.tolerances or ()), job.update_baseline)
        except SweepError as error:
            raise PlanError(str(error)) from error

    def require_recipes_of(self, plan: Plan) -> None:
        """Raise PlanError where a tolerance is of no metric, or no recipe is both in the plan and in the baseline.

        A baseline of another plan may be updated.
        """
        if self.old is None:
            return
        try:
            found = compare_tables(self.old, _columns_ahead(plan.recipes(), plan.groups), self.tolerances)
        except SweepError as error:
            raise PlanError(str(error)) from error
        if not found.recipe_count and not self.is_updated:
            raise PlanError(f"baseline {self.path} has no recipe in common with this plan: it is of another one")

    def compare(self, columns: Mapping[str, Any]) -> Comparison | None:
        """The comparison of the sweep's table with it; None for a file that is to be written for the first time."""
        return None if self.old is None else compare_tables(self.old, columns, self.tolerances)

    def update(self, columns: Mapping[str, Any]) -> None:
        """Have the sweep's table as baseline from now on."""
        write_baseline(self.path, columns, old=self.old, tolerances=self.tolerances)


def _columns_ahead(recipes: Sequence[Recipe], groups: Sequence[str]) -> dict[str, list[Any]]:
    """The sweep's table before it is made: every metric is missing."""
    rows = [recipe.columns() for recipe in recipes]
    columns: dict[str, list[Any]] = {name: [row[name] for row in rows] for name in (rows[0] if rows else ())}
    metrics = [name for group in groups for name in METRICS.get(group, ())]
    metrics += [name for group in groups if is_user_metric(group) for name in user_columns(function_of(group))]
    columns |= {name: [None] * len(rows) for name in metrics}
    return columns | {"complete": [False] * len(rows), "recipe_hash": [recipe.hash for recipe in recipes]}
