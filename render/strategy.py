"""Intersection strategies: raw intersection -> pruning -> transformation, as data (Mulot et al. 2024, section 3)."""

import json
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from threading import Lock
from typing import Any

from .errors import StrategyError
from .fields import load_by_name, read_fields, require_number
from .stages import Stage, find_stage, load_built_in
from .transform_order import require_order

FIELDS = ("raw", "prune", "transform", "step", "modules")
STEP_LOWEST, STEP_HIGHEST = 1e-5, 0.1  # of marching [m]
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
    | `modules` | Python modules that register stages of one's own | none |

    "close" needs raw "section" and "outside" before it. A stage may be listed again with other options.
    Raises StrategyError for an unknown stage, an option that it does not have or that is out of range, and an order
    that means nothing.
    """

    raw: "Stage | str" = Stage("section")  # noqa: RUF009  # frozen, so one for all is none too few
    prune: "tuple[Stage | str, ...]" = ()
    transform: "tuple[Stage | str, ...]" = ()
    step: float | None = None
    modules: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Take names as stages, and check every one."""
        object.__setattr__(self, "raw", Stage.read(self.raw, "raw"))
        for role in ("prune", "transform"):
            object.__setattr__(self, role, tuple(Stage.read(stage, role) for stage in getattr(self, role)))
        object.__setattr__(self, "modules", tuple(self.modules))
        for role, stages in self.stages().items():
            for k, stage in enumerate(stages):
                find_stage(role, stage.name).check(stage)
                if stage in stages[:k]:
                    raise StrategyError(f"{role}: stage {stage.described()!r} is listed twice with the same options")
        if self.step is not None:
            require_number("step", self.step, STEP_LOWEST, STEP_HIGHEST, unit="m")
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
        """What a file says about the strategy, for JSON; `step` and `modules` only where they are given."""
        raw, prune, transform = ([stage.described() for stage in stages] for stages in self.stages().values())
        out: dict[str, Any] = {"raw": raw[0], "prune": prune, "transform": transform}
        if self.step is not None:
            out["step"] = self.step
        return {**out, "modules": list(self.modules)} if self.modules else out

    def to_json(self) -> str:
        """One line of JSON that `from_json` reads back."""
        return json.dumps(self.described())

    @classmethod
    def from_json(cls, text: str) -> "IntersectionStrategy":
        """Read back what `to_json` wrote; missing fields take their defaults. Imports the modules that it names."""
        values = read_fields(text, FIELDS, "strategy")
        for field in ("prune", "transform", "modules"):
            if not isinstance(values.get(field, []), list):
                raise StrategyError(f"strategy: {field} must be a list, not {values[field]!r}")
        import_modules(values.get("modules", ()))
        return cls(**{name: tuple(value) if isinstance(value, list) else value for name, value in values.items()})


def open_contour() -> IntersectionStrategy:
    """OC: what of the section lies inside the patch (strategy A of Martinez et al. 2019)."""
    return IntersectionStrategy(prune=("outside",))


def closed_contour() -> IntersectionStrategy:
    """CC: the boundary of section ∩ patch; holds OC as its object-kind segments."""
    return IntersectionStrategy(prune=("outside",), transform=("close",))


PRESETS: dict[str, Callable[[], IntersectionStrategy]] = {"oc": open_contour, "cc": closed_contour}
"""By name; modules of stages may add theirs."""

_PATH_LOCK = Lock()


def import_modules(names: Iterable[object], folder: Path | None = None) -> None:
    """Import modules that register stages, looked for in a folder first.

    Raises StrategyError, naming the module, for one that cannot be imported.
    """
    for name in names:
        if not isinstance(name, str) or not name:
            raise StrategyError(f"modules: must be names of Python modules, not {name!r}")
        with _PATH_LOCK:
            path = [] if folder is None else [str(folder)]
            sys.path[:0] = path
            try:
                import_module(name)
            except StrategyError:
                raise
            except Exception as error:  # whatever a user's module raises
                raise StrategyError(f"modules: cannot import {name!r} ({type(error).__name__}: {error})") from error
            finally:
                for entry in path:
                    sys.path.remove(entry)


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
