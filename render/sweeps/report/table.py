"""Results of a sweep as a tidy table: one row a recipe, in the plan's order; and one row a pose where asked."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any, NamedTuple, Protocol

import numpy as np

from ....datasets.motions.facing import SHARE_ANGLES
from ....datasets.storage.schema import PRUNED_NAMES, removed_name
from ....datasets.sweeps.store import SweepStore
from ...reports.file_summary import length_ratio
from ..make import histogram
from ..make.poses import chunk_count
from ..plan.recipe import WHOLE_GROUPS, Recipe, function_of, is_user_metric

NOISE = 1e-6
"""A standard deviation below this share of the root mean square is rounding, and stands as 0: sums of squares are
float64 sums of up to 768 terms a part, right to about 1e-13, and sqrt(1e-13) of it is what their difference leaves."""


class Statistic(NamedTuple):
    """Of one metric over all poses to which it applies."""

    number: int
    """Of poses."""
    total: float
    squares: float
    least: float
    greatest: float

    @classmethod
    def merged(cls, parts: Iterable[Sequence[float]]) -> "Statistic":
        """From parts' [count, sum, sum of squares, least, greatest]: the same whatever their order."""
        used = [part for part in parts if part[0]]
        if len(used) < 2:  # most recipes have one part, and not every metric
            return cls(int(used[0][0]), *used[0][1:5]) if used else NOTHING
        return cls(
            sum(int(part[0]) for part in used),
            math.fsum(part[1] for part in used),
            math.fsum(part[2] for part in used),
            min(part[3] for part in used),
            max(part[4] for part in used),
        )

    @property
    def mean(self) -> float | None:
        """None without a pose."""
        return self.total / self.number if self.number else None

    @property
    def std(self) -> float | None:
        """Of the population; see NOISE for what counts as 0."""
        if not self.number:
            return None
        variance = math.fsum((self.squares, -self.total * (self.total / self.number))) / self.number
        return math.sqrt(variance) if variance > NOISE**2 * self.squares / self.number else 0.0

    @property
    def most(self) -> float | None:
        """None without a pose."""
        return self.greatest if self.number else None


NOTHING = Statistic(0, 0.0, 0.0, math.nan, math.nan)


CHUNK = 4096  # recipes whose results are looked up at once

PERCENTS = (5, 50, 95)
"""Quantiles of the length, as percentages of the poses."""

CONTOUR_METRICS: dict[str, str] = {
    "poses": "1",
    "poses_drawn": "1",
    "length_mean": "m",
    "length_std": "m",
    "length_max": "m",
    **{f"length_p{percent:02}": "m" for percent in PERCENTS},
    "length_object_mean": "m",
    "length_hand_mean": "m",
    "length_made_mean": "m",
    "length_intensity_mean": "m",
    "intensity_mean": "1",
    "r": "1",
    **{f"facing_share_{degrees}": "1" for degrees in SHARE_ANGLES},
    "polylines_mean": "1",
    "polylines_max": "1",
    "area_mean": "m2",
    "area_max": "m2",
    **{f"removed_{stage}_mean": "m" for stage in PRUNED_NAMES},
}
FREQUENCY_METRICS: dict[str, str] = {"draw_frequency_nominal": "Hz", "draw_frequency_actual": "Hz"}
SAMPLING_METRICS: dict[str, str] = {
    "jumps_polyline": "1",
    "jumps_order": "1",
    "jumps_pose": "1",
    "jumps_reentry": "1",
    "jump_length": "m",
    "jumps_per_second": "Hz",
    "hops_per_second": "Hz",
    "step_longest": "m",
    "silent_share": "1",
    "revisit_rate": "Hz",
    "draw_frequency": "Hz",
    "dwell_spread": "1",
    "dwell_area": "m2",
    "samples": "1",
}
METRICS: dict[str, dict[str, str]] = {
    "contours": CONTOUR_METRICS,
    "frequency": FREQUENCY_METRICS,
    "sampling": SAMPLING_METRICS,
    "noise": {f"noise_{name}": "dB" for name in ("db_40_300", "db_300_10k", "dba", "rms", "peak")},
    "pressure": {
        "pressure_focus_pressure": "Pa",
        "pressure_force": "N",
        "pressure_share_on_contour": "1",
        "pressure_unevenness": "1",
        "pressure_elsewhere": "1",
        "pressure_speed_factor": "1",
    },
}
"""Columns of each group, with their units; lengths and areas are means over all poses, empty ones included."""

KEPT: dict[str, str] = {
    "keep-contours": "kept_contours",
    "keep-focal-points": "kept_focal_points",
    "keep-drives": "kept_drives",
}
"""Columns that name kept files, relative to the store."""

AXIS_UNITS: dict[str, str] = {
    **dict.fromkeys(("object_fit", "object_simplify", "object_weld", "object_fill_holes"), "m"),
    **dict.fromkeys(("palm_width", "palm_length", "size", "step", "flush"), "m"),
    **{f"{name}_{axis}": "m" for name in ("object_at", "object_spacing", "motion_at") for axis in "xyz"},
    **{f"object_rotate_{axis}": "degree" for axis in "xyz"},
    **dict.fromkeys(("object_scale", "seed", "count", "explorer", "foci", "drive_level_max"), "1"),
    "facing": "rad",
    "duration": "s",
    "rate": "Hz",
    "speed": "m/s",
    "update_rate": "Hz",
    "drive_slew": "turn",
    "drive_sound_speed": "m/s",
    "drive_piston_radius": "m",
}
"""Unit of the recipe's own columns that have one."""

USER_COLUMN = "metric_"
"""What columns of metrics begin with that a user's function computes; they have no unit."""
USER_STATISTICS = ("mean", "std", "max", "count")

UNITS: dict[str, str] = {name: unit for metrics in METRICS.values() for name, unit in metrics.items()}
"""Unit of each metric column; "1" is a number."""

ALWAYS = ("object", "hand", "motion", "strategy")
"""Columns of the recipe that a table has even if their value is the same in all rows: people group by them."""

OTHERS = ("recipe", "recipe_hash", "maker", "complete", *KEPT.values())
"""Columns that are neither of the recipe nor metrics; nor are those of time, which begin with "seconds"."""

Key = tuple[str, str]
"""Group and key."""

Columns = dict[str, list[Any]]
"""Of a table: the name and the values, one a row; None where it does not apply."""


class ResultStore(Protocol):
    """What the table needs of a store."""

    @property
    def code(self) -> str:
        """The code version whose results it gives."""
        ...

    def results(self, keys: Sequence[tuple[str, str]], /) -> Iterable[tuple[str, str, int, Mapping[str, Any]]]:
        """Group, key, part and payload of what has been made."""
        ...


def is_metric(column: str) -> bool:
    """Whether a table's column is a result that depends on nothing but the recipe (so not on time)."""
    return column in UNITS or is_user_column(column)


def is_user_column(column: str) -> bool:
    """Whether a table's column is a metric that a user's function computes."""
    return column.startswith(USER_COLUMN)


def is_axis(column: str) -> bool:
    """Whether a table's column is a part of the recipe."""
    return not (is_metric(column) or column in OTHERS or column.startswith("seconds"))


def tidy_columns(recipes: Iterable[Recipe], store: ResultStore, groups: Sequence[str]) -> Columns:
    """A sweep's table: one row a recipe, in their order.

    Columns, in this order: the recipe's own, metrics of the groups asked for (`METRICS`), `kept_...` paths, "complete",
    "recipe" (JSON), "recipe_hash", "maker", "seconds" and "seconds_..." by stage [s]. None where a column does not
    apply, and in all metrics of a group that is not there whole; then "complete" is False.

    groups: to look up, and to be complete.

    >>> from pathlib import Path
    >>> from palpate.datasets import SweepStore
    >>> from palpate.render import sweep, tidy_columns
    >>> _ = Path("study.toml").write_text('object.source = "cube"')
    >>> plan = sweep("study.toml", {"motion.duration": [0.1, 0.2]}, device="cpu", workers=1).plan  # at 90 poses/s
    >>> with SweepStore("study.sweep", mode="read") as store: tidy_columns(plan.recipes(), store, plan.groups)["poses"]
    [9, 18]
    """
    table: Columns = {}
    seconds: list[dict[str, float]] = []
    has_user_metrics = any(map(is_user_metric, groups))  # whose columns are known by results only
    left = iter(recipes)
    while chunk := list(islice(left, CHUNK)):
        keys = [[(group, recipe.key(group)) for group in groups] for recipe in chunk]
        made = _made(chunk, keys, store)
        rows: list[dict[str, Any]] = []
        for recipe, own in zip(chunk, keys, strict=True):
            parts = [made[key] for key in own]
            row: dict[str, Any] = recipe.columns()
            for part in parts:
                row |= part.columns
            row["complete"] = all(part.is_whole for part in parts)
            row |= {"recipe": recipe.to_json(), "recipe_hash": recipe.hash, "maker": store.code}
            rows.append(row)
            merged = _merged_seconds([part.seconds for part in parts])
            by_stage = {f"seconds_{stage}": value for stage, value in merged.items() if stage}
            seconds.append({"seconds": math.fsum(merged.values())} | by_stage if merged else {})
        count = len(next(iter(table.values()), ()))
        for name in dict.fromkeys(
            (*table, *(name for row in (rows if has_user_metrics else rows[:1]) for name in row))
        ):
            table.setdefault(name, [None] * count).extend([row.get(name) for row in rows])
    stages = sorted({name for took in seconds for name in took})
    return table | {name: [took.get(name) for took in seconds] for name in stages}


def split_constants(columns: Mapping[str, Sequence[Any] | np.ndarray]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Columns of a table that vary, are metrics or stand in ALWAYS; and the one value of each of the others.

    A value that does not apply is None. A table without rows keeps all columns.
    """
    constants: dict[str, Any] = {}
    for name, values in columns.items():
        if (is_axis(name) or name == "maker") and name not in ALWAYS and len(values) and not differs(values):
            constants[name] = plain_cell(values[0])
    return {name: values for name, values in columns.items() if name not in constants}, constants


def differs(values: Sequence[Any] | np.ndarray) -> bool:
    """Whether the cells of a column, of which there is at least one, are not all alike."""
    first = plain_cell(values[0])
    return any(plain_cell(value) != first for value in values)


def is_missing(value: Any) -> bool:
    """Whether a cell says that its column does not apply."""
    return value is None or value == "" or (isinstance(value, float) and math.isnan(value))


def plain_cell(value: Any) -> Any:
    """A cell as Python's own type, None if it does not apply: the same from a file and from a new table."""
    plain = value.item() if isinstance(value, np.generic) else value
    return None if is_missing(plain) else plain


def column_units(columns: Iterable[str]) -> dict[str, str]:
    """Units of those of a table's columns that have one; "1" is a number."""
    known = AXIS_UNITS | UNITS
    units = {name: "s" if name.startswith("seconds") else known.get(name) for name in columns}
    return {name: unit for name, unit in units.items() if unit is not None}


@dataclass(frozen=True)
class _Made:
    """What there is of a group under a key."""

    is_whole: bool
    columns: dict[str, Any]
    seconds: dict[str, float]
    """By stage; nothing if it is not whole."""


def _made(recipes: Sequence[Recipe], keys: Sequence[Sequence[Key]], store: ResultStore) -> dict[Key, _Made]:
    """Results of some recipes, each key's merged once however many recipes share it."""
    owner = {key: recipe for recipe, own in zip(recipes, keys, strict=True) for key in own}
    found: dict[Key, dict[int, Mapping[str, Any]]] = {key: {} for key in owner}
    for group, key, part, payload in store.results(list(owner)):
        found[group, key][part] = payload
    out: dict[Key, _Made] = {}
    for key, parts in found.items():
        is_whole = _is_whole(owner[key], key[0], parts)
        payloads = [parts[part] for part in sorted(parts)] if is_whole else []
        took = _merged_seconds(_seconds(payload) for payload in payloads)
        out[key] = _Made(is_whole, _columns(owner[key], key[0], payloads), took)
    return out


def _columns(recipe: Recipe, group: str, payloads: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """A group's columns; None in all without payloads."""
    if group == "contours":
        return _contours(payloads, closes(recipe.strategy))
    if group == "frequency":
        return {name: _statistic(payloads, name).mean for name in FREQUENCY_METRICS}
    if group in ("sampling", "noise", "pressure"):
        return {name: payloads[0].get(name) if payloads else None for name in METRICS[group]}
    if is_user_metric(group):
        return _user_columns(function_of(group), payloads)
    return {KEPT[group]: payloads[0].get("path") if payloads else None} if group in KEPT else {}


def _is_whole(recipe: Recipe, group: str, parts: Mapping[int, Mapping[str, Any]]) -> bool:
    """Whether all of a group's parts are there."""
    if not parts or group in WHOLE_GROUPS:
        return 0 in parts
    return len(parts) == chunk_count(recipe)


def closes(strategy: Mapping[str, Any]) -> bool:
    """Whether a recipe's strategy closes contours, so that r is |CC| over |OC|."""
    stages = strategy["described"].get("transform", ())
    return any((stage if isinstance(stage, str) else stage.get("stage")) == "close" for stage in stages)


def _statistic(payloads: Sequence[Mapping[str, Any]], name: str) -> Statistic:
    return Statistic.merged(payload["stat"][name] for payload in payloads if name in payload["stat"])


def _contours(payloads: Sequence[Mapping[str, Any]], closing: bool) -> dict[str, Any]:
    """Columns of `CONTOUR_METRICS`."""
    length, on_object = _statistic(payloads, "length"), _statistic(payloads, "length_object")
    weighted = _statistic(payloads, "length_intensity")
    polylines, area = _statistic(payloads, "polylines"), _statistic(payloads, "area")
    return {
        "poses": sum(payload["poses"] for payload in payloads) if payloads else None,
        "poses_drawn": sum(payload["poses_drawn"] for payload in payloads) if payloads else None,
        "length_mean": length.mean,
        "length_std": length.std,
        "length_max": length.most,
        **_length_quantiles(payloads, length),
        "length_object_mean": on_object.mean,
        "length_hand_mean": _statistic(payloads, "length_hand").mean,
        "length_made_mean": _statistic(payloads, "length_made").mean,
        "length_intensity_mean": weighted.mean,
        "intensity_mean": length_ratio(weighted.total, length.total) if weighted.number else None,
        "r": length_ratio(length.total, on_object.total) if closing else None,
        **{f"facing_share_{degrees}": _statistic(payloads, f"facing_{degrees}").mean for degrees in SHARE_ANGLES},
        "polylines_mean": polylines.mean,
        "polylines_max": polylines.most,
        "area_mean": area.mean,
        "area_max": area.most,
        **{f"removed_{stage}_mean": _statistic(payloads, f"removed_{stage}").mean for stage in PRUNED_NAMES},
    }


def _length_quantiles(payloads: Sequence[Mapping[str, Any]], length: Statistic) -> dict[str, float | None]:
    """Columns of PERCENTS; None if results of an earlier code version count that have no histogram."""
    names = [f"length_p{percent:02}" for percent in PERCENTS]
    known = [payload["histogram"]["length"] for payload in payloads if "histogram" in payload]
    if not length.number or len(known) < len(payloads):
        return dict.fromkeys(names)
    values = histogram.quantiles(histogram.merge(known), PERCENTS, length.least, length.greatest)
    return dict(zip(names, values, strict=True))


def user_columns(function: str, key: str = "") -> list[str]:
    """Names of the columns of a user's function, or of one key of the dict that it returns."""
    name = f"{USER_COLUMN}{function}.{key}" if key else f"{USER_COLUMN}{function}"
    return [f"{name}_{statistic}" for statistic in USER_STATISTICS]


def _user_columns(function: str, payloads: Sequence[Mapping[str, Any]]) -> dict[str, float | int | None]:
    """Columns of USER_STATISTICS for each key that the function returns; none without payloads."""
    out: dict[str, float | int | None] = {}
    for key in dict.fromkeys(key for payload in payloads for key in payload["stat"]):
        own = _statistic(payloads, key)
        values = (own.mean, own.std, own.most, own.number)
        out |= zip(user_columns(function, key), values, strict=True)
    return out


def _seconds(payload: Mapping[str, Any]) -> Mapping[str, float]:
    """Time by stage of a payload, which may have one figure only."""
    seconds = payload.get("seconds") or {}
    return seconds if isinstance(seconds, Mapping) else {"": seconds}


def _merged_seconds(parts: Iterable[Mapping[str, float]]) -> dict[str, float]:
    """Sums by stage."""
    stages: dict[str, list[float]] = {}
    for part in parts:
        for stage, value in part.items():
            stages.setdefault(stage, []).append(value)
    return {stage: math.fsum(values) for stage, values in stages.items()}


def pose_blocks(recipes: Iterable[Recipe], store: SweepStore) -> Iterator[dict[str, np.ndarray]]:
    """The per-pose table, part by part: "recipe" (row of the sweep's table), then the store's columns.

    All blocks have the same columns in the same order: what a recipe's strategy does not remove is NaN. Recipes of
    which nothing is there give no rows. Raises SweepStoreError for a damaged file.
    """
    for number, recipe in enumerate(recipes):
        for _, columns in store.column_chunks(recipe.key("poses")):
            count = len(next(iter(columns.values()), ()))
            block = {"recipe": np.full(count, number, np.int64), **columns}
            for name in map(removed_name, PRUNED_NAMES):
                block[name] = block.pop(name, np.full(count, np.nan, np.float32))
            yield block
