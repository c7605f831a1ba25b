"""PLAN.toml as a `Plan`: read, validated whole before anything runs, and turned into recipes.

All faults of a plan are reported together, one on each line.
"""

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ....device.errors import DeviceError
from ...errors import PlanError, RenderError
from ...trust.permission import AllowCode, Code, Namer, require_permission
from ...validation import value_text
from .axes import (
    DEFAULT_SOURCES,
    KEYS,
    AxisPart,
    AxisTable,
    parts_of,
    read_key,
    require_agreement,
    require_playable,
    with_distinct_names,
)
from .document import TABLES, PlanDocument, PlanTable, parse_plan, read_plan, unknown_key
from .expansion import (
    Constraint,
    PartTuple,
    combine,
    constraint_of,
    distinct_names,
    distinct_parts,
    require_few,
    unique,
    unmatched,
)
from .line_search import Place
from .recipe import GROUPS, Recipe, RecipePart, groups_of, is_user_metric
from .sources import SourceIndex
from .tied_keys import DrawnRange, SampleTable, Ties, drawn_ranges, placed_tables, ties_of
from .user_metric import require_distinct_names
from .values import Values


@dataclass(frozen=True)
class Plan:
    """The recipes of a sweep: those of one plan, or of several together, each once."""

    name: str
    expanded: Sequence[Recipe] = field(repr=False)
    """Every recipe once."""
    groups: tuple[str, ...]
    """Groups of results that are made of each recipe: names of `recipe.GROUPS`."""
    device: str
    """As `--device` of `palpate render`: names with commas between them."""
    workers: int | None
    """On each device; None for as many as the machine suggests."""
    texts: Mapping[str, str]
    """Text of each plan file, by path."""
    overrides: tuple[str, ...] = ()
    code: tuple[Code, ...] = ()
    """Code that strategies, objects and metrics name."""
    is_draft: bool = False
    """Whether none of that code has been run, so that recipes that use it lack the digests of its stages."""
    user_metrics: Mapping[str, str] = field(default_factory=dict)
    """Source, `file.py:function`, of each group that a user's function computes."""

    def with_code(self, allow_code: AllowCode) -> "Plan":
        """The plan after the code that it names was run; the plan itself if it names none.

        Raises UntrustedCodeError, which lists all code, before any of it is run; PlanError if the plan is invalid.
        """
        if not self.code or not self.is_draft:
            return self
        require_permission(self.code, allow_code)
        documents = [parse_plan(Path(path), text, self.overrides, warns=False) for path, text in self.texts.items()]
        return _joined(documents, self.overrides, allow_code)

    @property
    def granted(self) -> frozenset[str]:
        """SHA-256 of the files of code that were run, which workers may run, too."""
        return frozenset() if self.is_draft else frozenset(sha256 for code in self.code for _, sha256 in code.files)

    @property
    def recipe_count(self) -> int:
        """Number of recipes."""
        return len(self.expanded)

    def recipes(self) -> Sequence[Recipe]:
        """Every recipe once, plan after plan."""
        return self.expanded

    @property
    def digest(self) -> str:
        """SHA-256 that differs whenever the recipes, their names or the groups differ."""
        parts = dict.fromkeys(part for recipe in self.expanded for part in recipe.parts)
        lines = [self.name, *self.groups, *self.overrides, *self.texts.values(), *(part.text for part in parts)]
        return hashlib.sha256(json.dumps(lines).encode()).hexdigest()


def load_plans(
    paths: str | Path | Sequence[str | Path], overrides: Sequence[str] = (), *, allow_code: AllowCode = False
) -> Plan:
    """Read one plan or several, validate them whole, and join them; code that they name is run last, if all is valid.

    overrides: "key=value" as `--set` takes them, for every plan: `motion.seed={first=1,count=5}`; values are TOML, a
    bare word is a text. allow_code: whether that code may be run, see `trust`.
    Warns (PalpateWarning) of values listed twice and of constraints that match nothing.
    Raises PlanError, one line for each fault with file, line and key, for invalid plans and plans without a recipe;
    UntrustedCodeError, which lists all such code, for code that may not be run.

    >>> from pathlib import Path
    >>> from palpate.render import load_plans
    >>> _ = Path("study.toml").write_text('object.source = ["cube", "tube"]')
    >>> load_plans("study.toml", ['strategy.source=["oc", "cc", "hatch"]']).recipe_count  # two objects, three ways
    6
    """
    return draft_plans([paths] if isinstance(paths, str | Path) else paths, overrides).with_code(allow_code)


def draft_plans(paths: Sequence[str | Path], overrides: Sequence[str] = ()) -> Plan:
    """The same, but without running code that the plans name; raises PlanError as `load_plans` does.

    Strategies with user-defined stages are not validated whole, and their recipes have other keys than later results.
    """
    if not paths:
        raise PlanError("no plan given: a sweep needs at least one PLAN.toml")
    return _joined([parse_plan(Path(path), read_plan(Path(path)), overrides) for path in paths], overrides, None)


def _joined(documents: Sequence[PlanDocument], overrides: Sequence[str], allow_code: AllowCode | None) -> Plan:
    """One plan of all; allow_code: None for a draft."""
    digests: dict[str, str] = {}
    indices = [
        SourceIndex(d.path.absolute().parent, digests, Namer.of(d.path.resolve(), d.text), allow_code)
        for d in documents
    ]
    read = [_read(document, index) for document, index in zip(documents, indices, strict=True)]
    faults = [fault for document in documents for fault in document.faults]
    if faults:
        raise PlanError(*dict.fromkeys(faults))
    tables = [own.table for own in read if own is not None]
    recipes = _united([own for own in read if own is not None])
    groups = dict.fromkeys(group for t in tables for group in groups_of(t.metrics, t.per_pose, t.keep))
    metrics = [pair for index in indices for pair in index.metrics.items()]
    require_distinct_names(metrics)
    return Plan(
        name="+".join(document.path.stem for document in documents),
        expanded=recipes,
        groups=(*(group for group in GROUPS if group in groups), *filter(is_user_metric, groups)),
        device=_agreed("device", tables, documents),
        workers=_agreed("workers", tables, documents),
        texts={str(document.path): document.text for document in documents},
        overrides=tuple(overrides),
        code=tuple(dict.fromkeys(code for index in indices for code in index.code)),
        is_draft=allow_code is None,
        user_metrics=dict(metrics),
    )


def _agreed(name: str, tables: Sequence[PlanTable], documents: Sequence[PlanDocument]) -> Any:
    """The value of a key on which all plans that have it agree."""
    given = {d.path: getattr(t, name) for t, d in zip(tables, documents, strict=True) if name in t.model_fields_set}
    if len(set(given.values())) > 1:
        shown = " and ".join(f"{value} in {path}" for path, value in given.items())
        raise PlanError(f"{name}: plans that are run together must agree, not {shown}; --set {name}=... decides")
    return next(iter(given.values()), PlanTable.model_fields[name].default)


class _ReadPlan(NamedTuple):
    """What one plan stands for."""

    table: PlanTable
    axes: Mapping[str, Sequence[AxisPart]]
    combinations: Sequence[PartTuple]
    """The parts of each recipe."""


def _united(plans: Sequence[_ReadPlan]) -> Sequence[Recipe]:
    """The recipes of all plans, each once; sources that have one name in different plans have longer names."""
    if len(plans) == 1:
        return tuple(map(Recipe.of, plans[0].combinations))
    names = distinct_names([own.axes for own in plans])
    renamed: dict[RecipePart, RecipePart] = {}

    def with_name(part: RecipePart) -> RecipePart:
        name = names.get((part.content["source"], part.content["name"]))
        return part if name is None else renamed.setdefault(part, RecipePart(part.content | {"name": name}))

    combinations = unique(tuple(map(with_name, parts)) for own in plans for parts in own.combinations)
    return tuple(map(Recipe.of, combinations))


def _read(document: PlanDocument, index: SourceIndex) -> _ReadPlan | None:
    """A plan's keys and its recipes; None with faults noted."""
    rest = {key: value for key, value in document.tables.items() if key not in TABLES}
    table = document.validated(PlanTable, rest, (), index)
    if table is not None and not (table.metrics or table.per_pose or table.keep):
        document.fault(("metrics",), "is empty, and there is nothing to keep either: the sweep would make nothing")
    drawn = _draw(document)
    tables = {axis: _axis_tables(document, axis, index) for axis in KEYS}
    exclude, only = (_constraints(document, name, index.folder) for name in ("exclude", "only"))
    if table is None or document.faults:
        return None
    axes: Mapping[str, Sequence[AxisPart]] = {}
    combinations: Sequence[PartTuple] = ()
    with document.noting():
        axes = _expanded_axes(document, tables, ties_of(table.zip, drawn, tables), is_whole=not (exclude or only))
        combinations = combine(axes, exclude, only) if not document.faults else ()
    if document.faults:
        return None
    pairs = dict.fromkeys(parts[-2:] for parts in combinations)
    if "drives" in table.keep:
        _require_playable(document, pairs, "keep", "drives of {} cannot be played")
    if predicted := [group for group in ("noise", "pressure") if group in table.metrics]:
        _require_playable(document, pairs, "metrics", " and ".join(predicted) + " of {} cannot be predicted")
    if not combinations:
        document.faults.append(f"{document.path}: its constraints leave no recipe")
    for k in unmatched(axes, (*exclude, *only)):
        place: Place = ("exclude", k) if k < len(exclude) else ("only", k - len(exclude))
        document.warn(place, "matches nothing that the axes have")
    return _ReadPlan(table, axes, combinations)


def _draw(document: PlanDocument) -> list[DrawnRange]:
    """Put drawn numbers in place of the ranges of `[sample]`; returns these ranges."""
    given = document.tables.get("sample")
    if given is None:
        return []
    ranges = drawn_ranges(document.tables)
    sample = document.validated(SampleTable, given, ("sample",))
    points = np.zeros((0, len(ranges)))
    if not ranges:
        document.fault(("sample",), "needs a range of from and to, without count or step, to draw numbers from")
    elif sample is not None:
        with document.noting("sample"):
            points = sample.points(len(ranges))
    for shares, own in zip(points.T, ranges, strict=True):
        numbers: list[float] = []
        with document.noting(*own.place):
            numbers = own.numbers(shares.tolist())
        own.table[str(own.place[-1])] = numbers or [own.check.low]  # so that a fault here causes no other
    return ranges


def _expanded_axes(
    document: PlanDocument, tables: Mapping[str, Sequence[AxisTable]], ties: Ties, *, is_whole: bool
) -> dict[str, Sequence[AxisPart]]:
    """The parts of each axis of valid tables; faults are noted. Warns (PalpateWarning) of values listed twice.

    is_whole: whether there are no constraints. Raises PlanFault for too many recipes.
    """
    require_few(tables, ties, is_whole=is_whole)
    out: dict[str, list[AxisPart]] = {axis: [] for axis in tables}
    for axis, own in tables.items():
        given = placed_tables(axis, document.tables.get(axis))
        for (place, _), table, tied in zip(given, with_distinct_names(own), ties[axis], strict=True):
            with document.noting(*place):
                require_agreement(axis, table)
                out[axis] += parts_of(axis, table, tied)
            for key, values in table.items():
                for k in values.repeated if key not in tied else ():
                    document.warn((*place, key, k), "is listed before, and taken once")
    if document.faults:
        return {}
    return {axis: distinct_parts(axis, tables[axis], own) for axis, own in out.items()}


def _require_playable(document: PlanDocument, pairs: Iterable[PartTuple], key: str, fault: str) -> None:
    """Note update rates and foci of recipes at which their array cannot be driven.

    pairs: the sampling and the array of recipes. key: of the plan, which asks for what needs drives. fault: with {} for
    the name of the sampling strategy.
    """
    reported: set[tuple[float, int, str]] = set()
    for sampling, array in pairs:
        described = sampling.content["described"]
        case = described["update_rate"], described["foci"], array.digest
        if case in reported:
            continue
        reported.add(case)
        try:
            require_playable(sampling, array, keeps_drives=key == "keep")
        except (RenderError, DeviceError) as error:
            document.fault((key,), f"{fault.format(sampling.content['name'])}: {error}")


def _axis_tables(document: PlanDocument, axis: str, index: SourceIndex) -> list[AxisTable]:
    """The tables of one axis; faults are noted."""
    given = document.tables.get(axis)
    if given == []:
        document.fault((axis,), "must have at least one table, not []")
    return [_axis_table(document, axis, place, table, index) for place, table in placed_tables(axis, given)]


def _axis_table(document: PlanDocument, axis: str, place: Place, table: object, index: SourceIndex) -> AxisTable:
    """The valid keys of one table of an axis; faults of the others are noted."""
    if not isinstance(table, dict):
        document.fault(place, f"must be a table, not {value_text(table)}")
        return {}
    known = ("source", *KEYS[axis])
    for key in table:
        if key not in known:
            document.fault((*place, key), unknown_key(key, known))
    given = {"source": DEFAULT_SOURCES[axis], **table} if axis in DEFAULT_SOURCES else table
    if "source" not in given:
        document.fault((*place, "source"), "is missing")
    out: dict[str, Values] = {}
    for key in known:
        with document.noting(*place, key):
            out |= {key: read_key(axis, key, given[key], index)} if key in given else {}
    return out


def _constraints(document: PlanDocument, name: str, folder: Path) -> list[Constraint]:
    """Constraints of one kind."""
    given = document.tables.get(name, [])
    if not isinstance(given, list):
        document.fault((name,), f"must be tables, [[{name}]], not {value_text(given)}")
        return []
    out: list[Constraint] = []
    for k, table in enumerate(given):
        with document.noting(name, k):
            out.append(constraint_of(table, folder))
    return out
