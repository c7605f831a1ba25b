"""What of `palpate sweep`'s options can be seen to mean nothing before anything is made."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterable, Sequence
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...datasets.sweeps.store import SweepStore
from ...datasets.sweeps.table import SUFFIXES
from ..errors import PlanError, SweepError
from .plan.code_version import code_version
from .plan.loading import Plan
from .plan.recipe import Recipe, function_of, is_user_metric

if TYPE_CHECKING:
    from .report.compare import Baseline, Tolerance

RECIPES_FIRST = 1000  # of a plan; a baseline of the same plan has some of these


def refuse_tables(tables: Sequence[Path], *, overwrite: bool) -> None:
    """Raise PlanError for a table that cannot be written: of another form, there already, Parquet without PyArrow."""
    for table in tables:
        if table.suffix not in SUFFIXES:
            raise PlanError(f"--table {table}: a table must end in {' or '.join(SUFFIXES)}")
        if table.is_dir():
            raise PlanError(f"--table {table}: is a folder")
        if table.exists() and not overwrite:
            raise PlanError(f"--table {table}: exists; --overwrite replaces it")
        _require_pyarrow("--table", table)


def other_code_version(folder: Path) -> str:
    """The other code version that last recorded results in a store; raises PlanError if there is none."""
    if not folder.exists():
        raise PlanError(f"--same-results: there is no store {folder}, so it has no results that could be kept")
    with SweepStore(folder, own := code_version()) as store:
        other = next((code for code, count in reversed(store.code_versions().items()) if count and code != own), None)
    if other is None:
        raise PlanError(f"--same-results: {folder} has no results of another code version than this one's")
    return other


def refuse_baseline_file(path: Path | None) -> None:
    """Raise PlanError for a baseline that `--update-baseline` cannot write; None if no baseline is given."""
    if path is None:
        raise PlanError("--update-baseline needs --baseline FILE, the file to write")
    if path.suffix not in SUFFIXES or path.is_dir():
        raise PlanError(f"--baseline {path}: a baseline to update must be a file that ends in {' or '.join(SUFFIXES)}")
    _require_pyarrow("--baseline", path)


def refuse_summary(path: Path | None) -> None:
    """Raise PlanError for a summary that cannot be written."""
    if path is not None and (path.is_dir() or not path.absolute().parent.is_dir()):
        raise PlanError(f"--summary {path}: must be a file in a folder that exists")


def refuse_poses(plan: Plan) -> None:
    """Raise PlanError for a plan with `per_pose` if PyArrow, which writes its rows, is not installed."""
    if "poses" in plan.groups:
        _require_module(f"{plan.name}: per_pose = true")


def _require_pyarrow(option: str, path: Path) -> None:
    if path.suffix == ".parquet":
        _require_module(f"{option} {path}")


def _require_module(what: str) -> None:
    if importlib.util.find_spec("pyarrow") is None:
        raise PlanError(f"{what}: Parquet needs PyArrow: pip install -e '.[parquet]' in palpate's folder")


def refuse_baseline(
    baseline: Baseline, tolerances: Sequence[Tolerance], plan: Plan, *, needs_match: bool = True
) -> None:
    """Raise PlanError where a tolerance is of no metric of a plan or baseline, or no recipe is of both.

    needs_match: whether a baseline of another plan is refused; one that is to be replaced is not.
    """
    from .report.compare import compare_tables

    for count in (RECIPES_FIRST, plan.recipe_count):
        columns = _columns_ahead(islice(plan.recipes(), count), plan.groups)
        try:
            found = compare_tables(baseline, columns, tolerances)
        except SweepError as error:
            raise PlanError(str(error)) from error
        if found.recipe_count or not needs_match:
            return
    raise PlanError(f"baseline {baseline.path} has no recipe in common with this plan: it is of another one")


def _columns_ahead(recipes: Iterable[Recipe], groups: Sequence[str]) -> dict[str, list[Any]]:
    """A table as it will be, all of whose results are still to come."""
    from .report.table import METRICS, user_columns

    made = list(recipes)
    rows = [recipe.columns() for recipe in made]
    columns: dict[str, list[Any]] = {name: [row[name] for row in rows] for name in (rows[0] if rows else ())}
    metrics = [name for group in groups for name in METRICS.get(group, ())]
    metrics += [name for group in groups if is_user_metric(group) for name in user_columns(function_of(group))]
    columns |= {name: [None] * len(rows) for name in metrics} | {"complete": [False] * len(rows)}
    return columns | {"recipe_hash": [recipe.hash for recipe in made]}
