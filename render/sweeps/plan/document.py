"""The text of PLAN.toml as tables, with overrides in place, and the faults that are found in it.

A fault is reported as `plan.toml:12: object.fit: must lie in ..., not ...`, or `--set object.fit=80: ...`.
"""

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, cast

from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationError, ValidationInfo

from ....datasets.bounded_file import read_text, require_parsable
from ....datasets.known_names import likely_file, likely_name
from ...errors import PlanError
from ...runtime.worker_devices import WORKERS_MOST
from ...user_warnings import warn_user
from ...validation import value_text
from .axes import KEYS
from .line_search import Place, line_of, parse_toml
from .recipe import KEPT, METRICS
from .sources import SourceIndex
from .tied_keys import AxisKeyName, read_zip
from .user_metric import find_metric
from .values import ChoiceCheck, PlanFault, checked_items, refuse

TABLES = (*KEYS, "sample", "exclude", "only")
"""Keys of a plan that have tables."""


def unknown_key(key: str, known: Sequence[str]) -> str:
    """The message of an unknown key: the known key that is meant, or the axis that has it."""
    owners = [axis for axis, keys in KEYS.items() if key in keys]
    meant = f" (it is a key of {' and '.join(owners)})" if owners else likely_name(key, known)
    return f"unknown key{meant}; known: {', '.join(known)}"


def put_override(tables: dict[str, Any], override: str, plain: Sequence[str]) -> Place:
    """Put one `--set` into a plan's tables; returns the place of its key.

    plain: keys of a plan beside its tables. Raises PlanFault for an invalid override.
    """
    key, equals, text = override.partition("=")
    place = tuple(part.strip() for part in key.split("."))
    if not equals or not all(place):
        refuse("must be key=value, such as motion.seed=3")
    top, known = place[0], [*plain, *TABLES]
    if top not in known or len(place) > (2 if top in (*KEYS, "sample") else 1):
        refuse(unknown_key(".".join(place), known))
    try:
        value = _value(text)
    except ValueError as error:
        fault = str(error).partition(" (at line")[0]
        refuse(f"not a TOML value ({fault}); texts may need quotes")
    if len(place) == 1:
        tables[top] = value
        return place
    inner = tables.setdefault(top, {})
    for table in inner if isinstance(inner, list) else [inner]:
        if isinstance(table, dict):
            table[place[1]] = value
    return place


def _value(text: str) -> Any:
    """A TOML value; a bare word is a text."""
    try:
        values = parse_toml(f"value = {text}")
    except ValueError:
        if re.fullmatch(r"[^\s\[\]{}\"'#=]+", text.strip()):
            return text.strip()
        raise
    if set(values) != {"value"}:
        raise ValueError("more than one value")
    return values["value"]


DEVICE = re.compile(r"auto|cpu|cuda(:\d+)?")


def _names(known: tuple[str, ...]) -> BeforeValidator:
    """Reads a list of names, each once."""

    def read(value: object) -> list[str]:
        if not isinstance(value, list):
            refuse(f"must be a list of {', '.join(known)}, not {value_text(value)}")
        return list(dict.fromkeys(checked_items(ChoiceCheck(known), value)))

    return BeforeValidator(read)


def _read_metrics(value: object, info: ValidationInfo) -> list[str]:
    """Groups of results: built-in ones, and those of the user's functions, each once."""
    index = cast(SourceIndex, info.context)
    known = ChoiceCheck(METRICS)
    if not isinstance(value, list):
        refuse(f"must be a list of {', '.join(METRICS)} and file.py:function, not {value_text(value)}")

    def read(item: object) -> str:
        return find_metric(item, index) if isinstance(item, str) and ":" in item else known(item)

    return list(dict.fromkeys(checked_items(read, value)))


def _read_flag(value: object) -> bool:
    if not isinstance(value, bool):
        refuse(f"must be true or false, not {value_text(value)}")
    return value


def _read_device(value: object) -> str:
    """The names of devices as `--device` takes them; whether they exist is checked when work begins."""
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
    """The keys of a plan beside its tables."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)
    metrics: Annotated[list[str], BeforeValidator(_read_metrics)] = ["contours", "frequency"]
    per_pose: Annotated[bool, BeforeValidator(_read_flag)] = False
    keep: Annotated[list[str], _names(KEPT)] = []
    device: Annotated[str, BeforeValidator(_read_device)] = "auto"
    workers: Annotated[int | None, BeforeValidator(_read_workers)] = None
    zip: Annotated[list[list[AxisKeyName]], BeforeValidator(read_zip)] = []


@dataclass
class PlanDocument:
    """One plan's text, its tables after overrides, and the faults found so far."""

    path: Path
    text: str
    tables: dict[str, Any]
    warns: bool = True
    overrides: dict[Place, str] = field(default_factory=dict)
    """Each `--set`, by the place of its key."""
    faults: list[str] = field(default_factory=list)

    def where(self, place: Place) -> str:
        """File and line, or override, and the key of a place."""
        keys = tuple(key for key in place if isinstance(key, str))
        starts = (keys[:k] for k in range(len(keys), 0, -1))
        start = next((self.overrides[own] for own in starts if own in self.overrides), None)
        if start is None:
            line = line_of(self.text, place)
            start = f"{self.path}:{line}" if line else str(self.path)
        return f"{start}: {'.'.join(keys)}" if keys else start

    def fault(self, place: Place, sentence: str) -> None:
        """Note a fault."""
        self.faults.append(f"{self.where(place)}: {sentence}")

    @contextmanager
    def noting(self, *place: str | int) -> Iterator[None]:
        """Note a PlanFault that is raised in it, and go on after it."""
        try:
            yield
        except PlanFault as fault:
            self.fault((*place, *fault.place), fault.sentence)

    def warn(self, place: Place, sentence: str) -> None:
        """Warn (PalpateWarning) of something that does not stop the sweep."""
        if self.warns:
            warn_user(f"{self.where(place)}: {sentence}")

    def validated(self, model: type[BaseModel], table: object, place: Place, index: SourceIndex | None = None) -> Any:
        """A table as an instance of its model; None, with its faults noted, if it is invalid."""
        if not isinstance(table, dict):
            return self.fault(place, f"must be a table, not {value_text(table)}")
        try:
            return model.model_validate(table, context=index)
        except ValidationError as error:
            for one in error.errors(include_url=False):
                own = one.get("ctx", {}).get("error")
                inner = own.place if isinstance(own, PlanFault) else ()
                self.fault((*place, *one["loc"], *inner), _sentence(one, own, model, place))
        return None


def _sentence(error: Any, own: object, model: type[BaseModel], place: Place) -> str:
    """The message of one of pydantic's errors."""
    if error["type"] == "extra_forbidden":
        return unknown_key(str(error["loc"][-1]), [*model.model_fields, *([] if place else TABLES)])
    if error["type"] == "missing":
        return "is missing"
    return own.sentence if isinstance(own, PlanFault) else str(error["msg"])


def read_plan(path: Path) -> str:
    """The text of a plan; raises PlanError if it cannot be read."""
    try:
        text = read_text(path)
        require_parsable(text)
        return text
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", None) or error
        meant = "" if path.exists() else likely_file(path)
        raise PlanError(
            f"{path}: cannot be read ({why}){meant or _hint_of_quotes(path)}; a plan is a TOML file"
        ) from error


def parse_plan(path: Path, text: str, overrides: Sequence[str], *, warns: bool = True) -> PlanDocument:
    """A plan's tables with overrides in place; raises PlanError for a text that is not TOML."""
    try:
        tables = parse_toml(text)
    except ValueError as error:
        fault, _, at = str(error).partition(" (at ")
        found = re.match(r"line (\d+)", at)
        line = found[1] if found else str(text.count("\n") + 1)
        raise PlanError(f"{path}:{line}: not TOML: {fault} ({at or 'somewhere)'}") from error
    document = PlanDocument(path, text, tables, warns=warns)
    for override in overrides:
        try:
            document.overrides[put_override(tables, override, list(PlanTable.model_fields))] = f"--set {override}"
        except PlanFault as fault:
            document.faults.append(f"--set {override}: {fault.sentence}")
    return document


def _hint_of_quotes(path: Path) -> str:
    """A hint for the name of a missing plan that is a piece of a `--set`, which the shell has split at its braces."""
    key = str(path).partition("=")[0]
    if path.exists() or "=" not in str(path) or key.split(".")[0] not in (*PlanTable.model_fields, *TABLES):
        return ""
    return f"; a --set with braces or blanks needs quotes, or the shell splits it: --set '{key}={{...}}'"
