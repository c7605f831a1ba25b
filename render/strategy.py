"""Intersection strategies: raw intersection -> pruning -> transformation, as data (Mulot et al. 2024, section 3)."""

import json
import sys
from collections.abc import Callable, Iterable, Iterator, MutableMapping
from dataclasses import dataclass, replace
from importlib import import_module
from importlib.machinery import PathFinder
from pathlib import Path
from threading import RLock
from typing import Any

from ..kernels.patch import FLUSH_MOST
from .errors import StrategyError
from .fields import load_by_name, read_fields, require_number
from .stage_option import Value
from .stages import Stage, find_stage, load_built_in
from .transform_order import require_order

FIELDS = ("raw", "prune", "transform", "step", "flush", "modules")
STEP_LOWEST, STEP_HIGHEST = 1e-5, 0.1  # of marching [m]
FLUSH_HIGHEST = float(FLUSH_MOST)  # [m]
STEPS_A_WIDTH = 4  # marching steps across the focus where none is given


@dataclass(frozen=True)
class IntersectionStrategy:
    """A raw intersection and the stages that follow it; a stage is a name, or a `Stage` with options.

    | field | says | default |
    |---|---|---|
    | `raw` | how object and hand meet | section |
    | `prune` | what is removed, in this order | nothing: the whole section of the plane |
    | `transform` | what is made of the rest, in this order | nothing |
    | `step` | grid step of marching [m] | a quarter of the focal width |
    | `flush` | how near to a patch's plane or side counts as on it [m] | three float32 spacings at the pose |
    | `modules` | Python modules that register stages of one's own | none |

    On a patch's plane counts as on its +n side, on a patch's side as outside. `flush` is of planes: a skin has none.
    "close" needs raw "section" and "outside" before it. A stage may be listed again with other options.
    Raises StrategyError for an unknown stage, an option that it does not have or that is out of range, and an order
    that means nothing.
    """

    raw: "Stage | str" = Stage("section")  # noqa: RUF009  # frozen, so one for all is none too few
    prune: "tuple[Stage | str, ...]" = ()
    transform: "tuple[Stage | str, ...]" = ()
    step: float | None = None
    flush: float | None = None
    modules: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Take names as stages, and check every one."""
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
        """Refuse what closes nothing."""
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
        """What is removed."""
        return tuple(Stage.read(stage, "prune") for stage in self.prune)

    @property
    def transform_stages(self) -> tuple[Stage, ...]:
        """What is made of the rest."""
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

        focal_width: FWHM of p^2 across the focus [m], by which options that are None are scaled.
        marches: whether a grid is marched over, so that `step` needs a number too.
        """
        require_number("focal width", focal_width, 1e-6, 1.0, unit="m")
        full = {
            role: tuple(Stage(s.name, find_stage(role, s.name).values(s, focal_width)) for s in stages)
            for role, stages in self.stages().items()
        }
        step = focal_width / STEPS_A_WIDTH if marches and self.step is None else self.step
        return replace(self, raw=full["raw"][0], prune=full["prune"], transform=full["transform"], step=step)

    def described(self) -> dict[str, Any]:
        """What a file says about the strategy, for JSON; `step`, `flush` and `modules` only where they are given."""
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
    def from_json(cls, text: str) -> "IntersectionStrategy":
        """Read back what `to_json` wrote; missing fields take their defaults. Imports the modules that it names."""
        values = read_fields(text, FIELDS, "strategy")
        for field in ("prune", "transform", "modules"):
            require_list(f"strategy: {field}", values.get(field, []))
        import_modules(values.get("modules", ()))
        return cls(**{name: tuple(value) if isinstance(value, list) else value for name, value in values.items()})


def open_contour() -> IntersectionStrategy:
    """OC: what of the section lies inside the patch (strategy A of Martinez et al. 2019)."""
    return IntersectionStrategy(prune=("outside",))


def closed_contour() -> IntersectionStrategy:
    """CC: the boundary of section ∩ patch; holds OC as its object-kind segments."""
    return IntersectionStrategy(prune=("outside",), transform=("close",))


class Presets(MutableMapping[str, Callable[[], IntersectionStrategy]]):
    """Strategies by name, all there at the first look; a loop over them goes on while a module adds its own."""

    def __init__(self, **own: Callable[[], IntersectionStrategy]) -> None:
        """Those of this module."""
        self._own = own

    def __getitem__(self, name: str) -> Callable[[], IntersectionStrategy]:
        """What makes a strategy."""
        load_built_in()
        return self._own[name]

    def __iter__(self) -> Iterator[str]:
        """Names as they are now."""
        load_built_in()
        return iter(list(self._own))

    def __len__(self) -> int:
        """How many there are now."""
        load_built_in()
        return len(self._own)

    def __setitem__(self, name: str, make: Callable[[], IntersectionStrategy]) -> None:
        """Add one, as modules of stages do while they are imported."""
        self._own[name] = make

    def __delitem__(self, name: str) -> None:
        """Take one out."""
        del self._own[name]


PRESETS = Presets(oc=open_contour, cc=closed_contour)
"""By name; modules of stages may add theirs."""

_PATH_LOCK = RLock()  # a module may load a strategy while it is imported


def require_list(name: str, value: object) -> None:
    """Refuse what is no list, a text for one."""
    if not isinstance(value, list | tuple):
        raise StrategyError(f"{name} must be a list, not {value!r}")


def require_module(name: object) -> str:
    """A module's name, or StrategyError."""
    if not isinstance(name, str) or not name:
        raise StrategyError(f"modules: must be names of Python modules, not {name!r}")
    return name


def import_modules(names: Iterable[object], folder: Path | None = None) -> None:
    """Import modules that register stages, looked for in a folder first.

    Raises StrategyError, naming the module, for one that cannot be imported, and for one whose name a module of another
    file has already.
    """
    for name in map(require_module, names):
        with _PATH_LOCK:
            path = [] if folder is None else [str(folder)]
            _refuse_another(name, path)
            sys.path[:0] = path
            try:
                import_module(name)
            except StrategyError:
                raise
            except (Exception, SystemExit) as error:  # whatever a user's module raises
                raise StrategyError(f"modules: cannot import {name!r} ({type(error).__name__}: {error})") from error
            finally:
                for entry in path:
                    if entry in sys.path:  # the module may have taken it out
                        sys.path.remove(entry)


def _refuse_another(name: str, path: list[str]) -> None:
    """Raise StrategyError if a module of this name is there already, but not from the file that is meant."""
    top = name.partition(".")[0]
    loaded = getattr(sys.modules.get(top), "__file__", None)
    meant = None if not path else PathFinder.find_spec(top, path)
    if loaded is None or meant is None or meant.origin is None:
        return
    if Path(loaded).resolve() != Path(meant.origin).resolve():
        raise StrategyError(f"modules: {name!r} is {meant.origin} here, but {loaded} has that name already: rename one")


def load_strategy(source: str) -> IntersectionStrategy:
    """A strategy by preset name (oc, cc, ...) or from a JSON file.

    Modules that the file names are looked for beside it, then on Python's path.
    Raises StrategyError for what is neither, or no strategy.
    """
    load_built_in()
    folder = Path(source).resolve().parent

    def read(text: str) -> IntersectionStrategy:
        modules = read_fields(text, FIELDS, "strategy").get("modules", ())
        if isinstance(modules, list):
            import_modules(modules, folder)
        return IntersectionStrategy.from_json(text)

    return load_by_name(source, PRESETS, read, "strategy")
