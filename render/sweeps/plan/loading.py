"""PLAN.toml as a `Plan`: read, validated whole before anything runs, and turned into recipes.

All faults of a plan are reported together, one on each line.
"""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ....device.errors import DeviceError
from ...errors import PlanError, RenderError
from ...trust.permission import AllowCode, Code, Namer, require_permission
from ...validation import value_text
from .axes import (
    DEFAULT_SOURCES,
    KEYS,
    MODELS,
    AxisTable,
    require_agreement,
    require_playable,
    with_distinct_names,
)
from .constraint import Constraint, constraint_of
from .document import PlanDocument, PlanTable, parse_plan, read_plan
from .line_search import Place
from .overrides import TABLES
from .product import PlanAxis, Product, show_distinct_names
from .recipe import GROUPS, Recipe, groups_of, is_user_metric
from .sources import SourceIndex
from .tied_keys import SampleTable, Ties, drawn_numbers, drawn_places, placed_tables, ties_of, valid_number
from .user_metric import require_distinct_names


@dataclass(frozen=True)
class Plan:
    """The recipes of a sweep: those of one plan, or of several together, each once."""

    name: str
    products: tuple[Product, ...]
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
        """Number of recipes; an upper bound if not `is_exact`."""
        return sum(product.recipe_count for product in self.products)

    @property
    def is_exact(self) -> bool:
        """Whether `recipe_count` is the number, not a bound: several plans may have the same recipes."""
        return len(self.products) == 1 and self.products[0].is_exact

    def recipes(self) -> Iterator[Recipe]:
        """Every recipe once, plan after plan, made when it is asked for; of one plan without memory of those before."""
        if len(self.products) == 1:
            yield from self.products[0].recipes()
            return
        seen: set[bytes] = set()
        for product in self.products:
            for recipe in product.recipes():
                key = bytes.fromhex(recipe.hash)
                if key not in seen:
                    seen.add(key)
                    yield recipe

    def described(self) -> dict[str, Any]:
        """For JSON: the plans' texts, overrides, the number of parts of each axis, and a digest of all that.

        The digest differs whenever the recipes, their names, or the groups differ.
        """
        out = {
            "name": self.name,
            "groups": list(self.groups),
            "overrides": list(self.overrides),
            "plans": [{"file": Path(path).name, "text": text} for path, text in self.texts.items()],
            "axes": [{axis.name: axis.part_count for axis in product.axes} for product in self.products],
        }
        parts = [axis.digest for product in self.products for axis in product.axes]
        digest = hashlib.sha256(json.dumps([out, parts]).encode()).hexdigest()
        return {**out, "device": self.device, "recipe_count": self.recipe_count, "is_exact": self.is_exact} | {
            "digest": digest
        }


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
    tables = [pair[0] for pair in read if pair is not None]
    products = [pair[1] for pair in read if pair is not None]
    if not faults:
        empty = [d for d, product in zip(documents, products, strict=True) if not product.recipe_count]
        faults = [f"{document.path}: its constraints leave no recipe" for document in empty]
    if faults:
        raise PlanError(*dict.fromkeys(faults))
    if len(products) > 1:
        show_distinct_names(products)
    groups = dict.fromkeys(group for t in tables for group in groups_of(t.metrics, t.per_pose, t.keep))
    metrics = [pair for index in indices for pair in index.metrics.items()]
    require_distinct_names(metrics)
    return Plan(
        name="+".join(document.path.stem for document in documents),
        products=tuple(products),
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


def _read(document: PlanDocument, index: SourceIndex) -> tuple[PlanTable, Product] | None:
    """A plan's keys and its recipes; None with faults noted."""
    rest = {key: value for key, value in document.tables.items() if key not in TABLES}
    table = document.validated(PlanTable, rest, (), index)
    if table is not None and not (table.metrics or table.per_pose or table.keep):
        document.fault(("metrics",), "is empty, and there is nothing to keep either: the sweep would make nothing")
    drawn = _draw(document)
    axes = {axis: _axis_tables(document, axis, index) for axis in KEYS}
    constraints = {name: _constraints(document, name, index.folder) for name in ("exclude", "only")}
    product = None
    if table is not None and not document.faults:
        with document.noting():
            product = _product(document, axes, ties_of(table.zip, drawn, axes), constraints)
    if document.faults or product is None or table is None:
        return None
    if "drives" in table.keep:
        _require_playable(document, product, "keep", "drives of {} cannot be played")
    if predicted := [group for group in ("noise", "pressure") if group in table.metrics]:
        _require_playable(document, product, "metrics", " and ".join(predicted) + " of {} cannot be predicted")
    for k in product.unmatched():
        excluding = len(constraints["exclude"])
        place: Place = ("exclude", k) if k < excluding else ("only", k - excluding)
        document.warn(place, "matches nothing that the axes have")
    return table, product


def _draw(document: PlanDocument) -> list[Place]:
    """Put drawn numbers in place of the ranges of `[sample]`; returns their places."""
    given = document.tables.get("sample")
    if given is None:
        return []
    places = drawn_places(document.tables)
    sample = document.validated(SampleTable, given, ("sample",))
    points = np.zeros((0, len(places)))
    if not places:
        document.fault(("sample",), "needs a range of from and to, without count or step, to draw numbers from")
    elif sample is not None:
        with document.noting("sample"):
            points = sample.points(len(places))
    for shares, place in zip(points.T, places, strict=True):
        table = document.tables[place[0]]
        table = table[place[1]] if len(place) == 3 else table
        key = str(place[-1])
        value, table[key] = table[key], [valid_number(place)]  # so that a fault here causes no other
        with document.noting():
            table[key] = drawn_numbers(place, value, shares.tolist()) or table[key]
    return places


def _product(
    document: PlanDocument,
    tables: Mapping[str, Sequence[AxisTable]],
    ties: Ties,
    constraints: Mapping[str, Sequence[Constraint]],
) -> Product | None:
    """The recipes of valid tables; None with faults noted. Warns (PalpateWarning) of values listed twice."""
    for axis, own in tables.items():
        given = [place for place, _ in placed_tables(axis, document.tables.get(axis))]
        for place, table, tied in zip(given, own, ties[axis], strict=True):
            with document.noting(*place):
                require_agreement(axis, table, tied)
            for key, values in table.given().items():
                for k in values.repeated if key not in tied else ():
                    document.warn((*place, key, k), "is listed before, and taken once")
    if document.faults:
        return None
    axes = [PlanAxis(axis, with_distinct_names(own), ties[axis]) for axis, own in tables.items()]
    return Product(axes, constraints["exclude"], constraints["only"])


def _require_playable(document: PlanDocument, product: Product, key: str, fault: str) -> None:
    """Note update rates and foci of recipes at which their array cannot be driven.

    key: of the plan, which asks for what needs drives. fault: with {} for the name of the sampling strategy.
    """
    if any(axis.listed is None for axis in product.axes[-2:]):
        return
    reported: set[tuple[float, int, str]] = set()
    for sampling, array in product.endings(2):
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
    """The tables of one axis; invalid ones are left out, and their faults noted."""
    given = document.tables.get(axis)
    if given == []:
        document.fault((axis,), "must have at least one table, not []")
    out: list[AxisTable] = []
    for place, table in placed_tables(axis, given):
        if isinstance(table, dict) and axis in DEFAULT_SOURCES:
            table = {"source": DEFAULT_SOURCES[axis], **table}
        model = document.validated(MODELS[axis], table, place, index)
        out += [] if model is None else [model]
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
