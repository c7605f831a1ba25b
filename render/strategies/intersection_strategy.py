"""Intersection strategies: raw intersection -> pruning -> transformation, as data (Mulot et al. 2024, section 3)."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

from ...datasets.known_names import find_name
from ...kernels.patch import FLUSH_MOST
from ..errors import StrategyError, UntrustedCodeError
from ..stages.registry import ROLES, Stage, Value, find_stage, known_stages
from ..trust.permission import AllowCode, Code, Namer, require_permission
from ..trust.user_code import CodeSource, find_module, run_all
from ..validation import load_by_name, read_fields, require_number
from .stage_order import require_order

FIELDS = ("raw", "prune", "transform", "step", "flush", "modules")
STEP_LOWEST, STEP_HIGHEST = 1e-5, 0.1  # grid step of marching [m]
FLUSH_HIGHEST = float(FLUSH_MOST)  # [m]
STEPS_A_WIDTH = 4  # default: marching steps across the focal width


@dataclass(frozen=True)
class IntersectionStrategy:
    """A raw intersection and the stages that follow it; a stage is a name, or a `Stage` with options.

    | field | meaning | default |
    |---|---|---|
    | `raw` | the raw intersection of object and hand | section |
    | `prune` | stages that remove parts, in this order | none: the section of the whole plane |
    | `transform` | stages that change the rest, in this order | none |
    | `step` | grid step of marching [m] | a quarter of the focal width |
    | `flush` | distance at which a vertex counts as on a patch's plane or side [m] | 3 float32 spacings at the pose |
    | `modules` | Python modules that register user-defined stages, run with permission (`trust`) | none |

    A vertex on a patch's plane counts as on its +n side, one on a patch's side as outside. Hand meshes ignore `flush`.
    "close" needs raw "section" and "outside" before it. A stage may be listed again with other options.
    Raises StrategyError for an unknown stage, an option that is unknown or out of range, and an order of stages that
    makes no sense.

    >>> from palpate.render import IntersectionStrategy, render, static_pose
    >>> strategy = IntersectionStrategy(prune=("outside",), transform=("close", "circle"))
    >>> strategy.to_json()
    '{"raw": "section", "prune": ["outside"], "transform": ["close", "circle"]}'
    >>> render("cube", "palm", static_pose([0, 0, 0.2]), strategy).length().round(2)  # [m], of the square's area
    array([0.3], dtype=float32)
    """

    raw: "Stage | str" = Stage("section")  # noqa: RUF009  # a shared default is safe, because stages are frozen
    prune: "tuple[Stage | str, ...]" = ()
    transform: "tuple[Stage | str, ...]" = ()
    step: float | None = None
    flush: float | None = None
    modules: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """One line: `raw` and fields that are not the default, stages without options as their names."""

        def brief(value: object) -> object:
            if isinstance(value, Stage):
                return value if value.options else value.name
            return tuple(map(brief, value)) if isinstance(value, tuple) else value

        given = {field.name: getattr(self, field.name) for field in fields(self)}
        shown = [
            f"{f.name}={brief(given[f.name])!r}" for f in fields(self) if f.name == "raw" or given[f.name] != f.default
        ]
        return f"IntersectionStrategy({', '.join(shown)})"

    def __post_init__(self) -> None:
        """Turn names into stages, and check every stage."""
        object.__setattr__(self, "raw", Stage.read(self.raw, "raw"))
        for name in ("prune", "transform", "modules"):
            require_list(name, getattr(self, name))
        for module in self.modules:
            require_module(module)
        for role in ("prune", "transform"):
            object.__setattr__(self, role, tuple(Stage.read(stage, role) for stage in getattr(self, role)))
        object.__setattr__(self, "modules", tuple(self.modules))
        for role, stages in self.stages().items():
            listed: list[tuple[str, dict[str, Value]]] = []
            for stage in stages:
                entry = find_stage(role, stage.name)
                entry.check(stage)
                full = (stage.name, entry.defaults() | dict(stage.options))
                if full in listed:
                    raise StrategyError(f"{role}: stage {stage.described()!r} is listed twice with the same options")
                listed.append(full)
        if self.step is not None:
            require_number("step", self.step, STEP_LOWEST, STEP_HIGHEST, unit="m")
        if self.flush is not None:
            require_number("flush", self.flush, 0.0, FLUSH_HIGHEST, unit="m")
        self._require_order()
        require_order(self.raw_stage.name, *([s.name for s in self.stages()[role]] for role in ("prune", "transform")))

    def _require_order(self) -> None:
        """Raise StrategyError for a stage "close" that has nothing to close."""
        if not self.closes:
            return
        if not self.bounded:
            raise StrategyError('transform: "close" needs "outside" in prune, since it closes what the patch cuts open')
        if self.raw != "section":
            raise StrategyError(f'transform: "close" needs raw "section", not {self.raw_stage.described()!r}')
        if self.transform[0] != "close":
            raise StrategyError('transform: "close" must come first, since the raw intersection does it as it goes')

    @property
    def raw_stage(self) -> Stage:
        """The raw intersection."""
        return Stage.read(self.raw, "raw")

    def stages(self) -> dict[str, tuple[Stage, ...]]:
        """Stages by role."""
        return {"raw": (self.raw_stage,), "prune": self.prune_stages, "transform": self.transform_stages}

    @property
    def prune_stages(self) -> tuple[Stage, ...]:
        """Stages that remove parts, in order."""
        return tuple(Stage.read(stage, "prune") for stage in self.prune)

    @property
    def transform_stages(self) -> tuple[Stage, ...]:
        """Stages that change the rest, in order."""
        return tuple(Stage.read(stage, "transform") for stage in self.transform)

    @property
    def bounded(self) -> bool:
        """Whether patches end at their sides."""
        return "outside" in self.prune

    @property
    def closes(self) -> bool:
        """Whether contours are closed along the patches' boundary."""
        return "close" in self.transform

    @property
    def needs_closed(self) -> bool:
        """Whether inside and outside of the object must be defined."""
        return any(find_stage(role, s.name).needs_closed for role, stages in self.stages().items() for s in stages)

    def resolved(self, focal_width: float, *, marches: bool = False) -> "IntersectionStrategy":
        """The same strategy with every option of its stages as a number.

        focal_width: FWHM of p^2 across the focus [m]; options that are None become multiples of it.
        marches: whether the raw intersection uses a grid, so that `step` must be a number too.
        """
        require_number("focal width", focal_width, 1e-6, 1.0, unit="m")
        full = {
            role: tuple(Stage(s.name, find_stage(role, s.name).values(s, focal_width)) for s in stages)
            for role, stages in self.stages().items()
        }
        step = focal_width / STEPS_A_WIDTH if marches and self.step is None else self.step
        return replace(self, raw=full["raw"][0], prune=full["prune"], transform=full["transform"], step=step)

    def described(self) -> dict[str, Any]:
        """Description that a file stores as JSON; `step`, `flush` and `modules` only if they are set."""
        raw, prune, transform = ([stage.described() for stage in stages] for stages in self.stages().values())
        out: dict[str, Any] = {"raw": raw[0], "prune": prune, "transform": transform}
        if self.step is not None:
            out["step"] = self.step
        if self.flush is not None:
            out["flush"] = self.flush
        return {**out, "modules": list(self.modules)} if self.modules else out

    def to_json(self) -> str:
        """One line of JSON that `from_json` reads back."""
        return json.dumps(self.described())

    @classmethod
    def from_json(cls, text: str, *, allow_code: AllowCode = False) -> "IntersectionStrategy":
        """Read back what `to_json` wrote; missing fields take their defaults.

        allow_code: whether the modules that it names, found on Python's path, may run: see `load_strategy`.
        """
        return read_strategy(text, None, allow_code=allow_code)


def open_contour() -> IntersectionStrategy:
    """OC: the part of the section that lies inside the patch (strategy A of Martinez et al. 2019).

    >>> from palpate.render import open_contour, render, static_pose
    >>> over_the_side = static_pose([0.065, 0, 0.2])  # half of the palm is in the cube
    >>> render("cube", "palm", over_the_side, open_contour()).length().round(3)  # [m], the cube's side only
    array([0.085], dtype=float32)
    """
    return IntersectionStrategy(prune=("outside",))


def closed_contour() -> IntersectionStrategy:
    """CC: the boundary of section ∩ patch; its segments of kind object are OC.

    >>> from palpate.render import closed_contour, render, static_pose
    >>> over_the_side = static_pose([0.065, 0, 0.2])  # half of the palm is in the cube
    >>> render("cube", "palm", over_the_side, closed_contour()).length().round(3)  # [m], around that half
    array([0.255], dtype=float32)
    """
    return IntersectionStrategy(prune=("outside",), transform=("close",))


def closed_then(*transform: Stage | str) -> Callable[[], IntersectionStrategy]:
    """A preset: CC and what is made of it."""
    return partial(IntersectionStrategy, prune=("outside",), transform=("close", *transform))


# Martinez et al. 2019 compared ten strategies by letters; only theirs, A, is fully published: no preset has a letter.
_PRESETS: dict[str, tuple[str, Callable[[], IntersectionStrategy]]] = {
    "oc": ("open contours: the object's outline on the skin (Martinez et al. 2019, A)", open_contour),
    "cc": ("closed contours: the contact's outline, hand edges too (Mulot et al. 2024)", closed_contour),
    "whole": ("the object's whole outline in the hand's plane, on the skin or not", IntersectionStrategy),
    "mammoth": (
        "a path over skin inside the object (after Maunsbach et al. 2024)",
        partial(IntersectionStrategy, raw="contact"),
    ),
    "corners": ("closed contours, strong at corners (after Martinez et al. 2019)", closed_then("corners")),
    "corner-pauses": (
        "closed contours, the focal point pausing 20 ms at corners",
        closed_then(Stage("corners", {"level": 1.0, "dwell": 0.02})),
    ),
    "edges": ("closed contours, the object's edges strong, the hand's weak", closed_then("edges")),
    "simplified": ("closed contours without vertices that nobody feels", closed_then("simplify")),
    "smooth": ("closed contours with rounded corners", closed_then("smooth")),
    "inset": ("outline of the contact, half a focal width farther in", closed_then("inset")),
    "hatch": ("the contact filled with parallel lines", closed_then("hatch")),
    "inset-hatch": (
        "the contact, half a focal width farther in, filled with lines",
        closed_then("inset", "hatch"),
    ),
    "ellipse": ("an ellipse of the contact's area and direction", closed_then("ellipse")),
    "pca-ellipse": (
        "an ellipse of 1.5 standard deviations of each contact (after shinolab)",
        closed_then(Stage("ellipse", {"of": "moments", "scale": 0.75})),
    ),
    "circle": ("a circle of the contact's area", closed_then("circle")),
    "centroid": ("a point at the contact's centroid, circling by 3 mm", closed_then("centroid")),
    "depth": ("closed contours, the stronger the deeper the skin is in the object", closed_then("depth")),
    "depth-hatch": (
        "the contact filled with lines, each point as strong as it is deep",
        closed_then("hatch", Stage("depth", {"at": "point"})),
    ),
}
PRESETS = {name: make for name, (_, make) in _PRESETS.items()}
"""Functions that make strategies, by name."""
PRESET_LINES = {name: line for name, (line, _) in _PRESETS.items()}
"""What each preset draws, in one line."""
CONTOURS = ("-contour", "-contours")
OTHERS = "; how contours are sampled, such as stm, is for sample and play"
WORDS = {f"{word}{more}": name for word, name in (("open", "oc"), ("closed", "cc")) for more in ("", *CONTOURS)}
"""Other words for presets."""


def strategy_name(text: str) -> str | None:
    """The preset that is called so, in any case, or by one of WORDS; None if there is none."""
    return find_name(WORDS.get((find_name(text, WORDS) or ""), text), PRESETS)


def require_list(name: str, value: object) -> None:
    """Raise StrategyError for a value that is not a list; a text is not one."""
    if not isinstance(value, list | tuple):
        raise StrategyError(f"{name} must be a list, not {value!r}")


def require_module(name: object) -> str:
    """Return the name of a module; raises StrategyError for another value."""
    if not isinstance(name, str) or not all(part.isidentifier() for part in name.split(".")):
        raise StrategyError(f"modules: must be names of Python modules, not {name!r}")
    return name


def strategy_code(text: str, folder: Path | None, path: str = "") -> list[CodeSource]:
    """Modules named by a strategy's JSON: located, not run. The rest of the JSON is checked first.

    folder: the file's, searched first. path: the file's, for messages.
    Raises StrategyError for a text that is no strategy, and for a module that is not found.
    """
    values = read_fields(text, FIELDS, "strategy")
    for field in ("prune", "transform", "modules"):
        require_list(f"strategy: {field}", values.get(field, []))
    names = [require_module(name) for name in values.get("modules", ())]
    if names:
        _require_readable(values)
    found: list[CodeSource] = []
    for name in names:
        try:
            found.append(find_module(name, folder, Namer.of(path, text)))
        except (ImportError, OSError) as error:
            raise StrategyError(f"modules: cannot import {name!r} ({type(error).__name__}: {error})") from error
    return found


def _require_readable(values: Mapping[str, Any]) -> None:
    """Raise StrategyError for values that no module could make valid, so that modules of a bad strategy do not run."""
    for role in ROLES:
        given = values.get(role, "section" if role == "raw" else [])
        for stage in [Stage.read(one, role) for one in ([given] if role == "raw" else given)]:
            if entry := known_stages(role).get(stage.name):
                entry.check(stage)
    for name, low, high in (("step", STEP_LOWEST, STEP_HIGHEST), ("flush", 0.0, FLUSH_HIGHEST)):
        if values.get(name) is not None:
            require_number(name, values[name], low, high, unit="m")


def read_strategy(
    text: str, folder: Path | None, *, allow_code: AllowCode = False, path: str = ""
) -> "IntersectionStrategy":
    """Strategy from JSON, after its modules have run; arguments: see `strategy_code`, errors: see `load_strategy`."""
    sources = strategy_code(text, folder, path)
    require_permission([source.code for source in sources], allow_code)
    for source in sources:
        try:
            run_all([source], allow_code)
        except (StrategyError, UntrustedCodeError):
            raise
        except (Exception, SystemExit) as error:  # a user's module may raise anything
            name = source.code.name
            raise StrategyError(f"modules: cannot import {name!r} ({type(error).__name__}: {error})") from error
    values = read_fields(text, FIELDS, "strategy")
    return IntersectionStrategy(
        **{name: tuple(value) if isinstance(value, list) else value for name, value in values.items()}
    )


def load_strategy(source: str, *, allow_code: AllowCode = False) -> IntersectionStrategy:
    """A strategy by preset name (oc, cc, ...) or from a JSON file.

    Modules that the file names are looked for beside it, then on Python's path.
    allow_code: which of them may run, see `trust.permission`; False: those that `palpate trust` has accepted.
    Raises UntrustedCodeError for modules without permission, StrategyError for a source that is neither a preset nor
    a file with a strategy.

    >>> from palpate.render import load_strategy
    >>> load_strategy("hatch").transform
    (Stage('close'), Stage('hatch'))
    """

    def read(text: str) -> IntersectionStrategy:
        path = Path(source).resolve()
        return read_strategy(text, path.parent, allow_code=allow_code, path=str(path))

    name = strategy_name(source) if isinstance(source, str) else None  # pyright: ignore[reportUnnecessaryIsInstance]
    return load_by_name(name or source, PRESETS, read, "strategy", WORDS, OTHERS)


def strategy_of(strategy: IntersectionStrategy | str | Path) -> IntersectionStrategy:
    """The strategy itself, or the one that `load_strategy` gives for a name or file."""
    return load_strategy(str(strategy)) if isinstance(strategy, str | Path) else strategy


def draft_strategy(path: str) -> tuple[dict[str, Any], list[Code]]:
    """Strategy of a file without running its modules, in the form of `described`, and the code of the modules.

    Raises StrategyError for a file that is no strategy.
    """

    def read(text: str) -> tuple[dict[str, Any], list[Code]]:
        place = Path(path).resolve()
        code = [source.code for source in strategy_code(text, place.parent, str(place))]
        values = read_fields(text, FIELDS, "strategy")
        stages = {
            role: [Stage.read(stage, role).described() for stage in values.get(role, [])]
            for role in ("prune", "transform")
        }
        raw = Stage.read(values.get("raw", "section"), "raw").described()
        return {**values, "raw": raw, **stages}, code

    return load_by_name(path, {}, read, "strategy")
