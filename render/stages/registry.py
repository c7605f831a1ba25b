"""Registry of the stages of intersection strategies: name, options and function of each.

Built-in stages are registered by the decorators `prune_stage` and `transform_stage`, user-defined ones by
`register_prune`, `register_transform` and `register_point_function` (`point_function`). A strategy refers to stages as
data (`Stage`).

| role | called as | returns |
|---|---|---|
| prune | f(batch, setting, **options) | the batch with segments removed, and the length removed [m], float32 [pose] |
| transform | f(batch, setting, **options) | another batch |

A stage registered with on="host" takes and returns NumPy arrays, one with on="device" Warp arrays on `setting.device`.
Several threads may call a stage at once, each with its own batch.
"""

import hashlib
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from importlib import import_module
from threading import RLock
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np

from ...datasets.known_names import unknown_name
from ..errors import StrategyError
from ..validation import number_text, require_choice, require_number
from .user_code_digest import caller_file, digest_of, file_digests, innermost, place_of

Value = float | int | str | bool | None
Function = TypeVar("Function", bound=Callable[..., Any])

ROLES = ("raw", "prune", "transform")
BY_RAW_KERNELS = ("outside", "close")  # stages that the raw intersection itself does
BUILT_IN = ("prune", "curves", "emphasis", "depth", "shapes", "fill")  # modules that register stages
PACKAGE = __name__.rpartition(".stages.")[0]  # palpate.render


@dataclass(frozen=True)
class Option:
    """An option of a stage: its default and what else it may be."""

    default: Value = None
    """None stands for `widths` focal widths."""
    low: float = -np.inf
    high: float = np.inf
    unit: str = ""
    choices: tuple[str, ...] = ()
    """Of a text."""
    widths: float = 1.0
    """What None is replaced by, in focal widths (FWHM of p^2 across the focus), within `low`..`high`."""

    def check(self, name: str, value: Value) -> None:
        """Refuse a value that this option cannot have; `name` is stage and option."""
        if value is None and self.default is None:
            return
        if isinstance(self.default, bool):
            if not isinstance(value, bool):
                raise StrategyError(f"{name} must be true or false, not {value!r}")
        elif isinstance(self.default, str):
            if self.choices:
                require_choice(name, value, self.choices)
            elif not isinstance(value, str):
                raise StrategyError(f"{name} must be a text, not {value!r}")
        else:
            require_number(name, value, self.low, self.high, unit=self.unit, whole=isinstance(self.default, int))
            if not abs(value or 0) <= sys.float_info.max:  # compared as it is: an int may be too large for a float
                raise StrategyError(f"{name} must be finite, not {number_text(value)}")

    def resolved(self, value: Value, focal_width: float) -> Value:
        """The value, or the number that None stands for [m]."""
        return min(max(self.widths * focal_width, self.low), self.high) if value is None else value


@dataclass(frozen=True, eq=False)
class Stage:
    """A stage as data: its name and the options that are given; others take their defaults.

    A stage without options equals its name: `"close" in strategy.transform`.

    >>> from palpate.render import IntersectionStrategy, Stage, render, static_pose
    >>> strategy = IntersectionStrategy(prune=("outside",), transform=("close", Stage("inset", {"distance": 0.005})))
    >>> render("cube", "palm", static_pose([0, 0, 0.2]), strategy).length().round(3)  # [m]; without the inset 0.34
    array([0.3], dtype=float32)
    >>> "close" in strategy.transform, "inset" in strategy.transform
    (True, False)
    """

    name: str
    options: Mapping[str, Value] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Copy the options, so that later changes do not matter."""
        object.__setattr__(self, "options", MappingProxyType(dict(self.options)))

    def __repr__(self) -> str:
        """One line."""
        return f"Stage({self.name!r}{f', {dict(self.options)}' if self.options else ''})"

    def __eq__(self, other: object) -> bool:
        """Compare by name and options; a text equals the stage of that name without options."""
        if isinstance(other, str):
            return self.name == other and not self.options
        return isinstance(other, Stage) and self.name == other.name and self.options == other.options

    def __hash__(self) -> int:
        """Hash of the name, because a stage may equal its name."""
        return hash(self.name)

    def __reduce__(self) -> tuple[type["Stage"], tuple[str, dict[str, Value]]]:
        """Pickle options as a dict, because a mapping proxy cannot be pickled."""
        return Stage, (self.name, dict(self.options))

    def described(self) -> str | dict[str, Value]:
        """For JSON: the name, or {"stage": name, option: value, ...}."""
        return {"stage": self.name, **self.options} if self.options else self.name

    @classmethod
    def read(cls, value: object, role: str) -> "Stage":
        """Stage from the output of `described`, or the stage itself; role: the strategy's field, for errors."""
        if isinstance(value, Stage):
            return value
        if isinstance(value, str):
            return cls(value)
        if isinstance(value, Mapping) and isinstance(value.get("stage"), str):
            return cls(value["stage"], {name: v for name, v in value.items() if name != "stage"})
        raise StrategyError(f'{role}: a stage is a name or {{"stage": name, option: value, ...}}, not {value!r}')


@dataclass(frozen=True)
class StageEntry:
    """A registered stage."""

    name: str
    role: str
    line: str
    """What it does, in one line."""
    options: Mapping[str, Option]
    function: Callable[..., Any] | None
    """None: the raw intersection does it."""
    on: str = "host"
    needs_closed: bool = False
    digest: str = ""
    """SHA-256 of a user-defined function when it was registered (`digest_of`) and of the file that registered it."""
    files: Mapping[str, str] = field(default_factory=dict)
    """Files that define and register a user-defined function, with the SHA-256 of each at that time."""

    @property
    def own(self) -> bool:
        """Whether it belongs to palpate; the output of other stages is checked at each call."""
        module = getattr(self.function, "__module__", None) or ""  # None for code run from a text
        return self.function is None or module.startswith(f"{PACKAGE}.")

    def check(self, stage: Stage) -> None:
        """Raise StrategyError for options that are unknown or out of range."""
        for name, value in stage.options.items():
            if name not in self.options:
                known = ", ".join(self.options) or "none"
                raise StrategyError(f"{self.role}: stage {self.name!r} has no option {name!r}; known: {known}")
            self.options[name].check(f"{self.role}: {self.name}.{name}", value)

    def defaults(self) -> dict[str, Value]:
        """Default of every option."""
        return {name: option.default for name, option in self.options.items()}

    def values(self, stage: Stage, focal_width: float) -> dict[str, Value]:
        """Options for the function: given or default; None becomes the option's multiple of the focal width [m]."""
        return {
            name: option.resolved(stage.options.get(name, option.default), focal_width)
            for name, option in self.options.items()
        }


_LOCK = RLock()
_ENTRIES: dict[str, StageEntry] = {}
_LOADED: set[str] = set()


def load_built_in() -> None:
    """Import the modules that register the built-in stages; no lock is held meanwhile."""
    for name in BUILT_IN:
        if name not in _LOADED:
            import_module(f"{__package__}.{name}")
            _LOADED.add(name)


def known_stages(role: str) -> dict[str, StageEntry]:
    """Registered stages of one role ("raw", "prune", "transform") by name, in the order they were registered."""
    load_built_in()
    with _LOCK:
        return {name: entry for name, entry in _ENTRIES.items() if entry.role == role}


def find_stage(role: str, name: str) -> StageEntry:
    """A registered stage; raises StrategyError, listing the known names, for an unknown one."""
    known = known_stages(role)
    if name not in known:
        raise StrategyError(f"{role}: " + unknown_name("stage", name, known))
    return known[name]


def register_stage(entry: StageEntry) -> None:
    """Register a stage; raises StrategyError for a name that another stage has.

    A function that is defined again, as in a notebook or by a reload, replaces its former definition.
    """
    if not entry.name or not isinstance(entry.name, str):
        raise StrategyError(f"a stage's name must be a text of one character at least, not {entry.name!r}")
    require_choice(f"stage {entry.name!r}: on", entry.on, ("host", "device"))
    with _LOCK:
        present = _ENTRIES.get(entry.name)
        if present is not None and (
            present.role != entry.role or origin_of(present.function) != origin_of(entry.function)
        ):
            raise StrategyError(f"there is a {present.role} stage {entry.name!r} already: {present.line}")
        if not entry.own:  # its function and files have their SHA-256 taken now, before values in it change
            files = file_digests([place_of(entry.function), caller_file()])
            texts = [digest_of(entry.function), *sorted(set(files.values()))]
            entry = replace(entry, digest=hashlib.sha256("\0".join(texts).encode()).hexdigest(), files=files)
        _ENTRIES[entry.name] = entry


def origin_of(function: Any) -> tuple[str, str]:
    """Module and qualified name of a function, also of one inside a partial or a Warp function."""
    function = innermost(function)
    return getattr(function, "__module__", None) or "", getattr(function, "__qualname__", repr(function))


def first_line(function: Callable[..., Any]) -> str:
    """The first line of a docstring, without its full stop."""
    return (function.__doc__ or "").strip().partition("\n")[0].rstrip(".") or "without description"


def options_of(name: str, defaults: Mapping[str, Value | Option]) -> dict[str, Option]:
    """Options from defaults: an Option as it is, else a value that later ones are like; None: one focal width."""
    for option, default in defaults.items():
        if not isinstance(default, Option | float | int | str | None):
            raise StrategyError(f"stage {name!r}: option {option!r} cannot default to {default!r}")
    return {key: value if isinstance(value, Option) else Option(value) for key, value in defaults.items()}


def register_prune(name: str, function: Callable[..., Any], *, on: str = "host", **defaults: Value | Option) -> None:
    """Register a user-defined prune stage: f(batch, setting, **options) -> batch, or (batch, removed [pose]).

    on: "host" for NumPy arrays, "device" for Warp arrays. defaults: its options with their defaults; None means one
    focal width, and an `Option` also has range and unit. Raises StrategyError for a name that another stage has.

    >>> from palpate.render import IntersectionStrategy, cut_batch, register_prune, render, static_pose
    >>> def left_of(batch, setting, x):
    ...     "Remove the segments that start at the right of x."
    ...     return cut_batch(batch, batch.points[:, 0] < x)
    >>> register_prune("example-left-of", left_of, x=0.0)
    >>> strategy = IntersectionStrategy(prune=("outside", "example-left-of"), transform=("close",))
    >>> render("cube", "palm", static_pose([0, 0, 0.2]), strategy).removed["example-left-of"].round(3)  # [m]
    array([0.17], dtype=float32)
    """
    register_stage(StageEntry(name, "prune", first_line(function), options_of(name, defaults), function, on))


def register_transform(
    name: str,
    function: Callable[..., Any],
    *,
    on: str = "host",
    needs_closed: bool = False,
    **defaults: Value | Option,
) -> None:
    """Register a user-defined transform stage: f(batch, setting, **options) -> batch; see `register_prune`.

    needs_closed: whether inside and outside of the object must be defined, so that open meshes are refused.

    >>> from dataclasses import replace
    >>> from palpate.render import IntersectionStrategy, register_transform, render, static_pose
    >>> def raised(batch, setting, by):
    ...     "Every contour higher."
    ...     return replace(batch, points=batch.points + [0, 0, by])
    >>> register_transform("example-raised", raised, by=0.05)
    >>> strategy = IntersectionStrategy(prune=("outside",), transform=("close", "example-raised"))
    >>> render("cube", "palm", static_pose([0, 0, 0.2]), strategy).points[0]
    array([-0.0425, -0.0425,  0.25  ], dtype=float32)
    """
    options = options_of(name, defaults)
    register_stage(StageEntry(name, "transform", first_line(function), options, function, on, needs_closed))


def prune_stage(name: str, *, on: str = "host", **defaults: Value | Option) -> Callable[[Function], Function]:
    """Decorator: register a prune stage under a name, see `register_prune`."""

    def registered(function: Function) -> Function:
        register_prune(name, function, on=on, **defaults)
        return function

    return registered


def transform_stage(
    name: str, *, on: str = "host", needs_closed: bool = False, **defaults: Value | Option
) -> Callable[[Function], Function]:
    """Decorator: register a transform stage under a name, see `register_transform`."""

    def registered(function: Function) -> Function:
        register_transform(name, function, on=on, needs_closed=needs_closed, **defaults)
        return function

    return registered


def _register_kernel_stages() -> None:
    """Register the stages that the raw intersection itself does, see `Scene`."""
    point_options = {
        "separation": Option(None, 1e-4, 1.0, "m", widths=0.8),
        "closes": Option(True),
    }
    for role, name, line, needs_closed, options in (
        ("raw", "section", "curves in which the object's surface meets the hand's patches or skin", False, {}),
        ("raw", "contact", "a path through points of skin inside the object (after MAMMOTH)", True, point_options),
        ("prune", "outside", "remove what lies outside the patch or on its sides", False, {}),
        ("transform", "close", "add the patch's own boundary where it lies inside the object", True, {}),
    ):
        register_stage(StageEntry(name, role, line, options, None, "device", needs_closed))


_register_kernel_stages()
