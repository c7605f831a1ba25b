"""PLAN.toml: read, overridden by `--set`, judged whole before anything runs, and turned into recipes.

A fault is told as `plan.toml:12: object.fit: must lie in ..., not ...`, or `--set object.fit=80: ...`; several are told
together, one a line.
"""

import hashlib
import json
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationError

from ....datasets.bounded_file import parse_toml, read_text, require_parsable
from ....device.errors import DeviceError
from ...errors import PalpateWarning, PlanError, RenderError
from ...runtime.span_workers import WORKERS_MOST
from ...trust.permission import AllowCode, Code, Namer, require_permission
from ...validation import value_text
from .axes import DEFAULT_SOURCES, KEYS, MODELS, AxisTable, require_agreement, require_playable
from .constraint import Constraint, constraint_of
from .line_search import Place, line_of
from .overrides import CONSTRAINTS, put_override, unknown_key
from .product import Axis, Product, tell_apart
from .recipe import KEPT, METRICS, Recipe, groups_of
from .sources import Shelf, with_own_names
from .values import Choice, Fault, refuse

DEVICE = re.compile(r"auto|cpu|cuda(:\d+)?")


def _names(known: tuple[str, ...]) -> BeforeValidator:
    """Reads a list of names, each once."""

    def read(value: object) -> list[str]:
        if not isinstance(value, list):
            refuse(f"must be a list of {', '.join(known)}, not {value_text(value)}")
        out: list[str] = []
        for k, item in enumerate(value):
            try:
                out.append(Choice(known)(item))
            except Fault as fault:
                refuse(fault.sentence, (k,))
        return list(dict.fromkeys(out))

    return BeforeValidator(read)


def _read_flag(value: object) -> bool:
    if not isinstance(value, bool):
        refuse(f"must be true or false, not {value_text(value)}")
    return value


def _read_device(value: object) -> str:
    """The names of devices as `--device` takes them; whether they are there is seen when work begins."""
    names = value if isinstance(value, list) else str(value).split(",") if isinstance(value, str) else []
    names = [name.strip() if isinstance(name, str) else name for name in names]
    if not names or not all(isinstance(name, str) and DEVICE.fullmatch(name) for name in names):
        refuse(f"must be auto, cpu, cuda, cuda:0 or a list of these, not {value_text(value)}")
    if len(set(names)) < len(names) or (len(names) > 1 and {"auto", "cuda"} & set(names)):
        refuse(f"must name each device once, and auto or cuda alone, not {value_text(value)}")
    return ",".join(names)


def _read_workers(value: object) -> int | None:
    if value == "auto":
        return None
    if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= WORKERS_MOST:
        refuse(f"must be auto, or a number of workers in 1..{WORKERS_MOST}, not {value_text(value)}")
    return value


class PlanTable(BaseModel):
    """What a plan says beside its axes and constraints."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)
    metrics: Annotated[list[str], _names(METRICS)] = ["contours", "frequency"]
    per_pose: Annotated[bool, BeforeValidator(_read_flag)] = False
    keep: Annotated[list[str], _names(KEPT)] = []
    device: Annotated[str, BeforeValidator(_read_device)] = "auto"
    workers: Annotated[int | None, BeforeValidator(_read_workers)] = None


@dataclass
class _Document:
    """One plan's text, its tables after overrides, and the faults found so far."""

    path: Path
    text: str
    tables: dict[str, Any]
    warns: bool = True
    overrides: dict[Place, str] = field(default_factory=dict)
    """What `--set` said, by the key that it is about."""
    faults: list[str] = field(default_factory=list)

    def where(self, place: Place) -> str:
        """File and line, or override, and the key of a place."""
        keys = tuple(key for key in place if isinstance(key, str))
        said = next((self.overrides[keys[:k]] for k in range(len(keys), 0, -1) if keys[:k] in self.overrides), None)
        line = line_of(self.text, place)
        start = said or (f"{self.path}:{line}" if line else str(self.path))
        return f"{start}: {'.'.join(keys)}" if keys else start

    def fault(self, place: Place, sentence: str) -> None:
        """Note a fault."""
        self.faults.append(f"{self.where(place)}: {sentence}")

    def warn(self, place: Place, sentence: str) -> None:
        """Warn (PalpateWarning) of something that the sweep goes on with."""
        if self.warns:
            warnings.warn(f"{self.where(place)}: {sentence}", PalpateWarning, stacklevel=4)

    def validated(self, model: type[BaseModel], table: object, place: Place, shelf: Shelf | None = None) -> Any:
        """A table as its model has it; None, with its faults noted, if it is none."""
        if not isinstance(table, dict):
            return self.fault(place, f"must be a table, not {value_text(table)}")
        try:
            return model.model_validate(table, context=shelf)
        except ValidationError as error:
            for one in error.errors(include_url=False):
                own = one.get("ctx", {}).get("error")
                inner = own.place if isinstance(own, Fault) else ()
                self.fault((*place, *one["loc"], *inner), _sentence(one, own, model, place))
        return None


def _sentence(error: Any, own: object, model: type[BaseModel], place: Place) -> str:
    """What is wrong, of one of pydantic's errors."""
    if error["type"] == "extra_forbidden":
        return unknown_key(str(error["loc"][-1]), [*model.model_fields, *([] if place else [*KEYS, *CONSTRAINTS])])
    if error["type"] == "missing":
        return "is missing"
    return own.sentence if isinstance(own, Fault) else str(error["msg"])


@dataclass(frozen=True)
class Plan:
    """What a sweep is to make: the recipes of one plan, or of several together, each once."""

    name: str
    products: tuple[Product, ...]
    groups: tuple[str, ...]
    """What is made of each recipe: names of `recipe.GROUPS`."""
    device: str
    """As `--device` of `palpate render`: names with commas between them."""
    workers: int | None
    """On each device; None: by the machine."""
    texts: Mapping[str, str]
    """Text of each plan file, by path."""
    overrides: tuple[str, ...] = ()
    code: tuple[Code, ...] = ()
    """That strategies and objects name."""
    is_draft: bool = False
    """Whether none of it has been run, so that the recipes it is for are not known whole."""

    def with_code(self, allow_code: AllowCode) -> "Plan":
        """The plan once the code that it names was run; itself if there is none.

        Raises UntrustedCodeError, which lists all code, before any of it is run; PlanError if it is no good.
        """
        if not self.code or not self.is_draft:
            return self
        require_permission(self.code, allow_code)
        documents = [_document(Path(path), text, self.overrides, warns=False) for path, text in self.texts.items()]
        return _joined(documents, self.overrides, allow_code)

    @property
    def granted(self) -> frozenset[str]:
        """SHA-256 of the files of code that were run, which workers may run, too."""
        return frozenset() if self.is_draft else frozenset(sha256 for code in self.code for _, sha256 in code.files)

    @property
    def recipe_count(self) -> int:
        """How many recipes there are, without going through them; at most so many if not `is_exact`."""
        return sum(product.recipe_count for product in self.products)

    @property
    def is_exact(self) -> bool:
        """Whether `recipe_count` is, not a bound: recipes of several plans may be the same."""
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
        """For JSON: the plans' texts, what `--set` changed, how many parts each axis has, and a digest of it all.

        The digest is another whenever the recipes, what they are called, or the groups are.
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


def load_plans(paths: Sequence[str | Path], overrides: Sequence[str] = (), *, allow_code: AllowCode = False) -> Plan:
    """Read plans, check them whole, and join them; code that they name is run in the end, if all else is in order.

    overrides: "key=value" as `--set` takes them, for every plan: `motion.seed={first=1,count=5}`; values are TOML, a
    bare word is a text. allow_code: whether that code may be run, see `trust`.
    Warns (PalpateWarning) of values listed twice and of constraints that match nothing.
    Raises PlanError, one line a fault with file, line and key, for plans that cannot be, and for ones that leave no
    recipe; UntrustedCodeError, which lists all of it, for code that may not be run.
    """
    return draft_plans(paths, overrides).with_code(allow_code)


def draft_plans(paths: Sequence[str | Path], overrides: Sequence[str] = ()) -> Plan:
    """The same without running any code that the plans name: a strategy with stages of such code is not judged whole.

    So its recipes have other keys than those that are made; raises PlanError as `load_plans` does.
    """
    if not paths:
        raise PlanError("no plan given: a sweep needs at least one PLAN.toml")
    return _joined([_document(Path(path), _text(Path(path)), overrides) for path in paths], overrides, None)


def _joined(documents: Sequence[_Document], overrides: Sequence[str], allow_code: AllowCode | None) -> Plan:
    """One plan of all; None: of which no code is run."""
    digests: dict[str, str] = {}
    shelves = [
        Shelf(d.path.absolute().parent, digests, Namer.of(d.path.resolve(), d.text), allow_code) for d in documents
    ]
    read = [_judged(document, shelf) for document, shelf in zip(documents, shelves, strict=True)]
    faults = [fault for document in documents for fault in document.faults]
    tables = [pair[0] for pair in read if pair is not None]
    products = [pair[1] for pair in read if pair is not None]
    if not faults:
        faults = [_no_recipe(d) for d, product in zip(documents, products, strict=True) if product.is_empty]
    if faults:
        raise PlanError(*dict.fromkeys(faults))
    if len(products) > 1:
        tell_apart(products)
    groups = {group for t in tables for group in groups_of(t.metrics, t.per_pose, t.keep)}
    return Plan(
        name="+".join(document.path.stem for document in documents),
        products=tuple(products),
        groups=tuple(group for group in groups_of(METRICS, True, KEPT) if group in groups),
        device=_agreed("device", tables, documents),
        workers=_agreed("workers", tables, documents),
        texts={str(document.path): document.text for document in documents},
        overrides=tuple(overrides),
        code=tuple(dict.fromkeys(code for shelf in shelves for code in shelf.code)),
        is_draft=allow_code is None,
    )


def _no_recipe(document: _Document) -> str:
    return f"{document.path}: its constraints leave no recipe"


def _agreed(name: str, tables: Sequence[PlanTable], documents: Sequence[_Document]) -> Any:
    """What the plans that say something of a key say; they may not differ."""
    said = {d.path: getattr(t, name) for t, d in zip(tables, documents, strict=True) if name in t.model_fields_set}
    if len(set(said.values())) > 1:
        shown = " and ".join(f"{value} in {path}" for path, value in said.items())
        raise PlanError(f"{name}: plans that are run together must agree, not {shown}; --set {name}=... decides")
    return next(iter(said.values()), PlanTable.model_fields[name].default)


def _text(path: Path) -> str:
    """A plan's text."""
    try:
        text = read_text(path)
        require_parsable(text)
        return text
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", None) or error
        raise PlanError(f"{path}: cannot be read ({why}){_hint_of_quotes(path)}") from error


def _document(path: Path, text: str, overrides: Sequence[str], *, warns: bool = True) -> _Document:
    """A plan's tables with overrides in place."""
    try:
        tables = parse_toml(text)
    except ValueError as error:
        fault, _, at = str(error).partition(" (at ")
        found = re.match(r"line (\d+)", at)
        line = found[1] if found else str(text.count("\n") + 1)
        raise PlanError(f"{path}:{line}: not TOML: {fault} ({at or 'somewhere)'}") from error
    document = _Document(path, text, tables, warns)
    for override in overrides:
        try:
            document.overrides[put_override(tables, override, list(PlanTable.model_fields))] = f"--set {override}"
        except Fault as fault:
            document.faults.append(f"--set {override}: {fault.sentence}")
    return document


def _hint_of_quotes(path: Path) -> str:
    """What to say of a plan that is not there, where its name is a piece of a `--set` that the shell took apart."""
    key = str(path).partition("=")[0]
    if path.exists() or "=" not in str(path) or key.split(".")[0] not in (*PlanTable.model_fields, *KEYS, *CONSTRAINTS):
        return ""
    return f"; of --set it needs quotes, or the shell takes braces and blanks apart: --set '{key}={{...}}'"


def _judged(document: _Document, shelf: Shelf) -> tuple[PlanTable, Product] | None:
    """A plan's own table and its recipes; None with faults noted."""
    rest = {key: value for key, value in document.tables.items() if key not in (*KEYS, *CONSTRAINTS)}
    table = document.validated(PlanTable, rest, ())
    if table is not None and not (table.metrics or table.per_pose or table.keep):
        document.fault(("metrics",), "is empty, and there is nothing to keep either: the sweep would make nothing")
    axes = {axis: _axis_tables(document, axis, shelf) for axis in KEYS}
    constraints = {name: _constraints(document, name, shelf.folder) for name in CONSTRAINTS}
    if document.faults or table is None:
        return None
    product = Product([Axis(axis, tables) for axis, tables in axes.items()], *constraints.values())
    if "drives" in table.keep:
        _judge_drives(document, product)
    for k in product.unmatched():
        excluding = len(constraints["exclude"])
        place: Place = ("exclude", k) if k < excluding else ("only", k - excluding)
        document.warn(place, "matches nothing that the axes have")
    return table, product


def _judge_drives(document: _Document, product: Product) -> None:
    """Note update rates and foci that an array cannot be driven at, where the constraints let them come together."""
    samplings, arrays = (axis for axis in product.axes if axis.name in ("sampling", "array"))
    if samplings.is_lazy or arrays.is_lazy:
        return
    reported: set[tuple[float, int, str]] = set()
    for sampling in samplings.parts():
        described = sampling.content["described"]
        for array in arrays.parts():
            case = described["update_rate"], described["foci"], array.digest
            if case in reported or not product.has({"sampling": sampling, "array": array}):
                continue
            reported.add(case)
            try:
                require_playable(sampling, array)
            except (RenderError, DeviceError) as error:
                document.fault(("keep",), f"drives of {sampling.content['name']} cannot be played: {error}")


def _axis_tables(document: _Document, axis: str, shelf: Shelf) -> list[AxisTable]:
    """The tables of one axis; those with faults are left out."""
    given = document.tables.get(axis, {})
    if isinstance(given, list) and not given:
        document.fault((axis,), "must have at least one table, not []")
    out: list[AxisTable] = []
    for k, table in enumerate(given if isinstance(given, list) else [given]):
        place: Place = (axis, k) if isinstance(given, list) else (axis,)
        if isinstance(table, dict) and axis in DEFAULT_SOURCES:
            table = {"source": DEFAULT_SOURCES[axis], **table}
        model = document.validated(MODELS[axis], table, place, shelf)
        if model is None:
            continue
        try:
            require_agreement(axis, model)
        except Fault as fault:
            document.fault((*place, *fault.place), fault.sentence)
        for key, values in model.given().items():
            for k_repeated in values.repeated:
                document.warn((*place, key, k_repeated), "is listed before, and taken once")
        out.append(model)
    return with_own_names(out)


def _constraints(document: _Document, name: Literal["exclude", "only"] | str, folder: Path) -> list[Constraint]:
    """Constraints of one kind."""
    given = document.tables.get(name, [])
    if not isinstance(given, list):
        document.fault((name,), f"must be tables, [[{name}]], not {value_text(given)}")
        return []
    out: list[Constraint] = []
    for k, table in enumerate(given):
        try:
            out.append(constraint_of(table, folder))
        except Fault as fault:
            document.fault((name, k, *fault.place), fault.sentence)
    return out
