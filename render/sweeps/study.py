"""A sweep from Python, `sweep("study.toml", set={"motion.seed": [1, 2]})`, and its table in other libraries' types."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...datasets.sweeps.store import Failure, SweepStore
from ...datasets.sweeps.table_text import column_arrays
from ..errors import PlanError, SweepError
from ..trust.permission import AllowCode
from .job import STORE_SUFFIX
from .plan.code_version import code_version
from .plan.loading import Plan, load_plans
from .report.table import column_units, is_metric, plain_cell, tidy_columns
from .run.estimate import refuse_too_large
from .run.sweep_run import SweepReport, run_sweep

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


@dataclass(frozen=True)
class SweepResult:
    """The table of a sweep, with one row per recipe, and what its run did.

    >>> from pathlib import Path
    >>> from palpate.render import static_pose, sweep
    >>> path = static_pose([0, 0, 0.2]).save("still.csv", overwrite=True)
    >>> _ = Path("study.toml").write_text('object.source = "cube"')
    >>> palms = {"motion.source": "still.csv", "hand.palm": [[0.05, 0.05], [0.1, 0.1]]}  # both fit inside the cube
    >>> sweep("study.toml", palms, device="cpu", workers=1).columns["length_mean"].round(3)  # round each palm [m]
    array([0.2, 0.4])
    """

    plan: Plan
    store: Path
    """Folder of the results."""
    report: SweepReport

    def __repr__(self) -> str:
        """One line: how many recipes, where they are kept."""
        return f"SweepResult({len(self.columns['recipe'])} recipes, {len(self.failures)} failed, {str(self.store)!r})"

    @property
    def failures(self) -> tuple[Failure, ...]:
        """Recipes that could not be made, and why; their metrics are missing in the table."""
        return self.report.failures

    @cached_property
    def columns(self) -> dict[str, np.ndarray]:
        """Every column of the table, those that have one value in all rows included; a missing value is NaN or ""."""
        with SweepStore(self.store, code_version()) as store:
            return dict(column_arrays(tidy_columns(self.plan.recipes(), store, self.plan.groups)))

    @property
    def units(self) -> dict[str, str]:
        """Units of the columns that have one; "1" is a number."""
        return column_units(self.columns)

    def to_pandas(self) -> pd.DataFrame:
        """The table as a DataFrame. Raises SweepError if pandas is not installed."""
        try:
            import pandas as pd
        except ImportError as error:
            raise SweepError("a DataFrame needs pandas: pip install pandas") from error
        return pd.DataFrame(self.columns)

    def to_xarray(self) -> xr.Dataset:
        """The metrics as a Dataset whose dimensions are the axes that vary (`report.grid`), with units as attributes.

        Raises SweepError if xarray is not installed.
        """
        from .report.grid import dataset_of

        return dataset_of(self.columns)

    def best(self, metric: str, *, largest: bool = True) -> dict[str, Any]:
        """The row with the largest or the smallest value of a metric, the first of equal ones, as a dict.

        Values that do not apply are None. Raises SweepError for a column that is no metric, and if no row has a value.
        """
        if metric not in self.columns or not is_metric(metric):
            known = ", ".join(filter(is_metric, self.columns))
            raise SweepError(f"{metric!r} is no metric of this table; known: {known}")
        values = self.columns[metric].astype(np.float64)
        if np.isnan(values).all():
            raise SweepError(f"no recipe has a value of {metric}; {len(self.failures)} of {len(values)} have failed")
        row = int(np.nanargmax(values) if largest else np.nanargmin(values))
        return {name: plain_cell(column[row]) for name, column in self.columns.items()}


def sweep(
    plan: str | Path | Sequence[str | Path],
    set: Mapping[str, Any] | None = None,
    *,
    store: str | Path | None = None,
    device: str | None = None,
    workers: int | None = None,
    executor: Executor | None = None,
    allow_code: AllowCode = False,
    yes: bool = False,
) -> SweepResult:
    """Make everything of a plan, or of several, that its store lacks, as `palpate sweep` does, and give the table.

    set: values by key, which replace those of the plan: {"motion.seed": [1, 2], "object.fit": 0.1}. store: folder, by
    default beside the first plan, with the suffix .sweep. device, workers, executor: see `run_sweep`, by
    default the plan's. allow_code: whether code that the plan names may be run. yes: also makes sweeps that the command
    would refuse without --yes, because they are very large. Writes no table and no picture into the store.
    Recipes that fail are in `failures`. Raises PlanError, UntrustedCodeError as `load_plans`, and SweepError and
    SweepStoreError as `run_sweep`.

    >>> from pathlib import Path
    >>> from palpate.render import sweep
    >>> _ = Path("study.toml").write_text('object.source = ["cube", "tube"]')
    >>> sweep("study.toml", {"motion.duration": 0.1, "strategy.source": ["oc", "cc"]}, device="cpu", workers=1)
    SweepResult(4 recipes, 0 failed, 'study.sweep')
    """
    paths = [Path(plan)] if isinstance(plan, str | Path) else [Path(own) for own in plan]
    loaded = load_plans(
        paths, [f"{key}={toml_text(key, value)}" for key, value in (set or {}).items()], allow_code=allow_code
    )
    folder = paths[0].with_suffix(STORE_SUFFIX) if store is None else Path(store)
    report = run_sweep(
        loaded,
        folder,
        executor,
        device=device or loaded.device,
        workers=loaded.workers if workers is None else workers,
        approve=(lambda counts: None) if yes else partial(refuse_too_large, loaded, folder),
    )
    return SweepResult(loaded, folder, report)


def toml_text(key: str, value: Any) -> str:
    """A value as TOML; raises PlanError, naming its key, for one that TOML does not have."""
    value = value.tolist() if isinstance(value, np.generic | np.ndarray) else value
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, str | Path):
        return json.dumps(str(value), ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{toml_text(key, str(k))} = {toml_text(key, v)}" for k, v in value.items()) + "}"
    if isinstance(value, list | tuple | range):
        return "[" + ", ".join(toml_text(key, item) for item in value) + "]"
    raise PlanError(f"set: {key}: must be a number, a text, a list or a dict of these, not {value!r:.60}")
