"""A sweep's table against an earlier one: what moved by more than a tolerance."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ....datasets.errors import SweepStoreError
from ....datasets.sweeps.table import TABLE, load_table
from ....datasets.sweeps.table_text import cell_text
from ...errors import RenderError, SweepError
from ..plan.recipe import PARTS, Recipe
from .table import UNITS, is_axis, is_metric, is_missing, plain_cell
from .table_axes import Axis, telling_axes


@dataclass(frozen=True)
class RowPairs:
    """Rows of an earlier table and of a new one that are of the same recipe."""

    pairs: Mapping[int, int]
    """Row of the earlier table by row of the new one, those of `renewed` included."""
    renewed: Mapping[int, int]
    """Of these the ones that agree in name only."""
    missing: tuple[int, ...]
    """Rows of the earlier table without a partner."""
    added: tuple[int, ...]
    """Rows of the new table without a partner."""


def pair_rows(old: Mapping[str, np.ndarray], new: Mapping[str, Sequence[Any] | np.ndarray]) -> RowPairs:
    """Match the rows of two tables by hash, and those that are left by name (`_renewed`)."""
    old_row = {str(key): i for i, key in enumerate(old["recipe_hash"]) if is_complete(old, i)}
    new_row = {str(key): i for i, key in enumerate(new["recipe_hash"])}
    pairs = {row: old_row[key] for key, row in new_row.items() if key in old_row}
    gone = [row for key, row in old_row.items() if key not in new_row]
    renewed = _renewed(old, gone, new, [row for row in new_row.values() if row not in pairs])
    pairs |= renewed
    found = set(pairs.values())
    missing = tuple(row for row in gone if row not in found)
    return RowPairs(pairs, renewed, missing, tuple(row for row in new_row.values() if row not in pairs))


def _renewed(
    old: Mapping[str, np.ndarray], gone: Sequence[int], new: Mapping[str, Any], added: Sequence[int]
) -> dict[int, int]:
    """Rows of a baseline by rows of a sweep that agree in all columns of the recipe: only hashes differ.

    gone, added: the rows that are looked at; those that several others agree with are left out. Values are compared as
    text, because a baseline that is text does not keep whether a name such as 7 is a number.
    """
    axes = [name for name in new if is_axis(name) and name in old]
    rows: list[dict[tuple[str, ...], list[int]]] = []
    for table, own in ((old, gone), (new, added)):
        alike: dict[tuple[str, ...], list[int]] = {}
        for row in own:
            alike.setdefault(tuple(cell_text(plain_cell(table[name][row])) for name in axes), []).append(row)
        rows.append(alike)
    before, now = rows
    return {now[key][0]: own[0] for key, own in before.items() if len(own) == 1 == len(now.get(key, ()))}


def is_complete(columns: Mapping[str, Sequence[Any] | np.ndarray], row: int) -> bool:
    """Whether a row has all results; so has every row of a table that does not say."""
    return "complete" not in columns or bool(columns["complete"][row])


DEFAULT = 1e-6
"""Relative. One machine gives the same bits again; other processors and compilers round the last bits of float32
contours (6e-8) otherwise, of which means keep about as much. What a change of a strategy does is far above."""

FLOORS = {"m": 1e-9, "m2": 1e-12, "Hz": 1e-6, "1": 1e-9}
"""By unit, changes that a relative tolerance other than 0 always lets pass: far below what can be felt or drawn, and
what is left of rounding where a metric is 0 otherwise."""

ROWS_SHOWN = 20
ABSOLUTE = "abs"
AXIS_OF = {"thing": "object"}  # parts of recipes that plans call otherwise


@dataclass(frozen=True)
class Tolerance:
    """How far a metric may move."""

    amount: float = DEFAULT
    is_absolute: bool = False
    """In the column's own unit; else a share of the greater of the two magnitudes."""
    columns: str = "*"
    """A column's name, or a pattern such as "removed_*"."""

    @classmethod
    def parse(cls, word: str) -> "Tolerance":
        """Read [COLUMN=]NUMBER[abs], such as 1e-6, length_mean=1e-4, area_*=1e-8abs, jumps_pose=0.

        Raises SweepError for anything else.
        """
        columns, equals, number = word.rpartition("=")
        is_absolute = number.endswith(ABSOLUTE)
        try:
            amount = float(number.removesuffix(ABSOLUTE))
        except ValueError:
            amount = math.nan
        if not 0 <= amount < math.inf or (equals and not columns):
            raise SweepError(
                f"--tolerance {word}: must be [COLUMN=]NUMBER[{ABSOLUTE}] with a number from 0 on, such as 1e-6, "
                "length_mean=1e-4 or area_mean=1e-8abs"
            )
        return cls(amount, is_absolute, columns or "*")

    def is_kept(self, old: np.ndarray, new: np.ndarray, unit: str = "") -> np.ndarray:
        """Whether values of a unit are near enough; what is not finite is near its like only.

        See FLOORS: without a unit, and for a tolerance that is absolute or 0, there is none.
        """
        floor = FLOORS.get(unit, 0.0) if self.amount and not self.is_absolute else 0.0
        with np.errstate(invalid="ignore"):  # inf - inf
            scale = 1.0 if self.is_absolute else np.maximum(np.abs(old), np.abs(new))
            near = np.abs(new - old) <= np.maximum(self.amount * scale, floor)
        near &= np.isfinite(old) & np.isfinite(new)
        return near | (new == old) | (np.isnan(old) & np.isnan(new))

    def __str__(self) -> str:
        return f"{self.amount:g}{' absolute' if self.is_absolute else ''}"


@dataclass(frozen=True)
class Moved:
    """One value that is not what it was."""

    recipe_hash: str
    recipe: str
    """Values that distinguish it from the others of the sweep."""
    metric: str
    old: float | None
    new: float | None
    change: float | None
    """Relative to the greater of the two magnitudes; None where one of them is missing or infinite."""
    tolerance: str

    @property
    def rank(self) -> float:
        """For sorting: what is missing altogether comes first."""
        return math.inf if self.change is None else abs(self.change)


@dataclass(frozen=True)
class Baseline:
    """An earlier sweep's table."""

    path: str
    columns: Mapping[str, np.ndarray]


@dataclass(frozen=True)
class _Names:
    """Names of a table's rows, made once there is something to say of one."""

    columns: Mapping[str, Sequence[Any] | np.ndarray]

    def __getitem__(self, row: int) -> str:
        return self._all[row]

    @cached_property
    def _all(self) -> list[str]:
        return row_names(self.columns)


@dataclass(frozen=True)
class Comparison:
    """What came of a comparison."""

    baseline: str
    recipe_count: int
    """Recipes on both sides, those of `changed` included."""
    value_count: int
    """Values compared."""
    moved: tuple[Moved, ...] = ()
    """Largest change first."""
    missing: tuple[str, ...] = ()
    """Recipes of the baseline that the sweep does not have."""
    incomplete: tuple[str, ...] = ()
    """Recipes on both sides that the sweep has no whole results of."""
    added: tuple[str, ...] = ()
    """Recipes that the baseline lacks, or has in part: they are reported, and no failure."""
    columns_missing: tuple[str, ...] = ()
    """Metrics of the baseline that the sweep does not have."""
    columns_added: tuple[str, ...] = ()
    """Metrics that the baseline lacks: they are reported, and no failure."""
    changed: tuple[str, ...] = ()
    """Recipes with another hash that are compared with the baseline's of the same name: reported, and no failure."""
    sources: tuple[str, ...] = ()
    """What has changed behind its name in those, such as "strategy mine.json", if the baseline keeps recipes."""
    makers: tuple[str, str] = field(default=("", ""))
    """Who made the baseline, "" if it does not say so, and who the sweep."""

    @property
    def is_kept(self) -> bool:
        """Whether everything that the baseline has is still so, and it has something."""
        return self.recipe_count > 0 and not (self.moved or self.missing or self.incomplete or self.columns_missing)

    def sentences(self) -> list[str]:
        """What to say of it, in words; what moved stands in `rows`."""
        kept = "nothing moved" if not self.moved else f"{len(self.moved)} of {self.value_count} values moved"
        out = [f"{kept} in {self.recipe_count} recipes compared with {self.baseline}"]
        if not self.recipe_count:
            out = [f"no recipe in common with {self.baseline}: it is of another plan"]
        if self.changed:
            count = "1 recipe is" if len(self.changed) == 1 else f"{len(self.changed)} recipes are"
            why = "the file behind this name" if self.sources else "a file behind their names"
            out.append(f"{count} compared by name: {why} has changed: {_few(self.sources or self.changed)}")
        for names, one in (
            (self.missing, "recipe of the baseline is not in this plan"),
            (self.incomplete, "recipe has no whole results here"),
            (self.columns_missing, "metric of the baseline is not measured here"),
            (self.added, "recipe is new, and compared with nothing"),
            (self.columns_added, "metric is new, and compared with nothing"),
        ):
            noun, _, rest = one.partition(" ")
            several = f"{noun}s {rest}".replace(" is ", " are ").replace(" has ", " have ")
            if names:
                out.append(f"{len(names)} {one if len(names) == 1 else several}: {_few(names)}")
        if self.makers[0] and self.makers[0] != self.makers[1]:
            out.append(f"the baseline was made by {self.makers[0]}, this by {self.makers[1]}")
        return out

    def rows(self, count: int = ROWS_SHOWN) -> list[tuple[str, str, str, str, str]]:
        """What moved most, as words: recipe, metric, old, new, change."""
        return [(m.recipe, m.metric, _number(m.old), _number(m.new), _change(m)) for m in self.moved[:count]]

    def to_dict(self) -> dict[str, Any]:
        """All of it, as JSON has it."""
        moved = [vars(m) for m in self.moved]
        return {name: list(v) if isinstance(v, tuple) else v for name, v in vars(self).items()} | {
            "kept": self.is_kept,
            "moved": moved,
        }


def parse_tolerances(words: Sequence[str]) -> tuple[Tolerance, ...]:
    """The tolerances of `--tolerance`, given any number of times; for each column the last that names it counts.

    A column without one has 1e-6, relative. Raises SweepError for a word that is none.
    """
    return (Tolerance(), *(Tolerance.parse(word) for word in words))


def load_baseline(path: str | Path) -> Baseline:
    """An earlier sweep: its store's folder, which has a table, or a table of its own (.csv, .parquet).

    Raises SweepError where there is none, or it is no sweep's table.
    """
    given = Path(path)
    file = given / TABLE if given.is_dir() else given
    if not file.exists():
        why = f"has no {TABLE}: a sweep that ends writes one" if given.is_dir() else "does not exist"
        raise SweepError(f"baseline {given} {why}")
    try:
        columns = load_table(file)
    except SweepStoreError as error:
        raise SweepError(f"baseline {error}") from error
    if "recipe_hash" not in columns or not any(map(is_metric, columns)):
        raise SweepError(f"baseline {file} is no table of a sweep: it has no recipe_hash, or no metric")
    if len(set(map(str, columns["recipe_hash"]))) < len(columns["recipe_hash"]):
        raise SweepError(f"baseline {file} has a recipe more than once")
    for name in filter(is_metric, columns):
        if columns[name].dtype.kind not in "fiub" and any(columns[name] != ""):
            raise SweepError(f"baseline {file}: the metric {name} has text, expected numbers")
    return Baseline(str(given), columns)


def compare_tables(
    baseline: Baseline, columns: Mapping[str, Sequence[Any] | np.ndarray], tolerances: Sequence[Tolerance] = ()
) -> Comparison:
    """Compare a sweep's table (`tidy_columns`) with an earlier one, recipe by recipe.

    Recipes are matched by hash, and those that are left by name (`_renewed`), so that a file that was edited is
    compared with what it was. Metrics only: never time, maker, or where files are. tolerances: for each column the last
    that names it counts.
    Raises SweepError for a tolerance that names no metric of either.
    """
    old, tolerances = baseline.columns, (Tolerance(), *tolerances)
    olds, news = (tuple(name for name in table if is_metric(name)) for table in (old, columns))
    known = set(olds) | set(news)
    for tolerance in tolerances:
        if not any(fnmatchcase(name, tolerance.columns) for name in known):
            raise SweepError(f"--tolerance {tolerance.columns}: no such metric; known: {', '.join(sorted(known))}")
    rows = pair_rows(old, columns)
    names, old_names = _Names(columns), _Names(old)
    whole = [row for row in sorted(rows.pairs) if is_complete(columns, row)]
    before, now = np.array([rows.pairs[row] for row in whole], int), np.array(whole, int)
    moved: list[Moved] = []
    compared = [name for name in olds if name in news]
    for metric in compared:
        tolerance = tolerance_of(metric, tolerances)
        was, here = as_floats(old[metric])[before], as_floats(columns[metric])[now]
        for i in np.flatnonzero(~tolerance.is_kept(was, here, UNITS.get(metric, "1"))).tolist():
            key, one, two = str(columns["recipe_hash"][whole[i]]), float(was[i]), float(here[i])
            is_measured = math.isfinite(one) and math.isfinite(two)
            change = (two - one) / max(abs(one), abs(two)) if is_measured else None
            former, current = (None if math.isnan(value) else value for value in (one, two))
            moved.append(Moved(key, names[whole[i]], metric, former, current, change, str(tolerance)))
    return Comparison(
        baseline.path,
        len(rows.pairs),
        len(whole) * len(compared),
        tuple(sorted(moved, key=lambda m: -m.rank)),
        missing=tuple(old_names[row] for row in rows.missing),
        incomplete=tuple(names[row] for row in sorted(rows.pairs) if not is_complete(columns, row)),
        added=tuple(names[row] for row in rows.added),
        columns_missing=tuple(name for name in olds if name not in news),
        columns_added=tuple(name for name in news if name not in olds),
        changed=tuple(names[row] for row in sorted(rows.renewed)),
        sources=_sources(old, columns, rows.renewed),
        makers=(_maker(old), _maker(columns)),
    )


def tolerance_of(metric: str, tolerances: Sequence[Tolerance]) -> Tolerance:
    """The last of several tolerances that names a metric."""
    return next(own for own in reversed(tolerances) if fnmatchcase(metric, own.columns))


def _sources(old: Mapping[str, np.ndarray], new: Mapping[str, Any], pairs: Mapping[int, int]) -> tuple[str, ...]:
    """Parts of recipes that have the same name and another content, by the recipes' JSON."""
    found: dict[str, None] = {}
    for row, was in pairs.items():
        try:
            one, other = (Recipe.from_json(str(table["recipe"][k])) for table, k in ((new, row), (old, was)))
            parts = [part for part in PARTS if one.digest([part]) != other.digest([part])]
        except (RenderError, KeyError, TypeError, AttributeError):  # of another version
            continue
        found |= {f"{AXIS_OF.get(part, part)} {getattr(one, part).get('name', '')}": None for part in parts}
    return tuple(found)


def row_names(columns: Mapping[str, Sequence[Any] | np.ndarray]) -> list[str]:
    """Values that distinguish each row's recipe from the others, with the column's name before a number."""
    axes = telling_axes({name: list(values) for name, values in columns.items()})
    words = [[_word(axis, k) for k in range(len(axis.values))] for axis in axes]
    hashes = [str(key)[:12] for key in columns["recipe_hash"]]
    named = [[own[axis.code[i]] for own, axis in zip(words, axes, strict=True)] for i in range(len(hashes))]
    return [" ".join(filter(None, name)) or key for name, key in zip(named, hashes, strict=True)]


def _word(axis: Axis, k: int) -> str:
    value = axis.values[k]
    return "" if is_missing(value) else str(value) if isinstance(value, str) else f"{axis.name}={value:g}"


def as_floats(values: Sequence[Any] | np.ndarray) -> np.ndarray:
    """A column as a new array of float64; NaN for None."""
    if isinstance(values, np.ndarray) and values.dtype.kind in "fiub":
        return values.astype(np.float64)
    return np.array([np.nan if v is None or v == "" else v for v in values], np.float64)


def _maker(columns: Mapping[str, Sequence[Any] | np.ndarray]) -> str:
    return ", ".join(sorted({str(maker) for maker in columns.get("maker", ())}))


def _few(names: Sequence[str], most: int = 3) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return "; ".join(names[:most]) + more


def _number(value: float | None) -> str:
    return "none" if value is None else f"{value:.9g}"


def _change(moved: Moved) -> str:
    """Relative to the baseline's value: in per cent, or as a factor from 2 on."""
    if moved.old is None or moved.new is None or not moved.old or moved.change is None:
        return ""
    ratio = moved.new / moved.old
    return f"x {ratio:.3g}" if ratio >= 2.0 else f"{100 * (ratio - 1.0) * (1.0 if moved.old > 0.0 else -1.0):+.3g} %"
