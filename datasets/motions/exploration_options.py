"""Options of a synthetic exploration: which model makes it, and which person explores where."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import MotionError
from ..known_names import find_name, likely_name
from .exploration import VERSION as AROUND_VERSION
from .exploration import exploration_path
from .exploration_strokes import FLOOR, MARGIN, Progress
from .explorer_habits import explorer_habits, require_explorer
from .over_array import FACING, WORKSPACE, ExplorerTrial, over_array_path
from .over_array import VERSION as OVER_ARRAY_VERSION

OVER_ARRAY, AROUND = "over-array", "around"
EXPLORATION_MODELS = (OVER_ARRAY, AROUND)
"""Models of explorations, the default first: a person over an array; a hand around the object, from every side."""
VERSIONS = {OVER_ARRAY: OVER_ARRAY_VERSION, AROUND: AROUND_VERSION}
EXPLORER = 1
OPTION_DEFAULTS: Mapping[str, Any] = {"explorer": EXPLORER, "facing": float(FACING), "workspace": WORKSPACE}
"""Options of `over-array` alone."""
FACING_LEAST, FACING_MOST = math.radians(5.0), math.radians(90.0)
WORKSPACE_THINNEST, WORKSPACE_FARTHEST = 0.02, 2.0  # [m]
POSE_BYTES = {OVER_ARRAY: 100, AROUND: 100}
SECOND_BYTES = {OVER_ARRAY: 600, AROUND: 2_100}
"""Peak memory of making an exploration [byte], per pose and per second of its path; measured."""


@dataclass(frozen=True)
class ExplorationOptions:
    """Checked options of an exploration; those that do not apply to the model are None."""

    model: str
    explorer: int | None
    facing: float | None
    """Largest facing angle [rad]."""
    workspace: NDArray[np.float64] | None
    """Lowest and highest x y z of the palm's centre [m], shape [2, 3]."""

    def provenance(self, duration: float, rate: float, seed: int) -> dict[str, Any]:
        """What made a motion, as JSON."""
        own = {"explorer": self.explorer, "facing": self.facing}
        own |= {"workspace": None if self.workspace is None else self.workspace.tolist()}
        made = {"model": self.model, "version": VERSIONS[self.model], "duration": duration, "rate": rate, "seed": seed}
        return made | {name: value for name, value in own.items() if value is not None}

    def require_reachable(self, box: NDArray[np.float64]) -> None:
        """Raise MotionError for an object, by its bounds [2, 3], that no hand of this model can reach."""
        if self.workspace is None:
            if box[1, 2] + MARGIN <= FLOOR:
                raise MotionError(
                    f"the object's top at z = {box[1, 2]:g} m leaves a hand no room {FLOOR:g} m above the array"
                    + way_over_array(box)
                )
        elif (box[0] > self.workspace[1]).any() or (box[1] < self.workspace[0]).any():
            raise MotionError(
                f"bounds: the object's box {_box_text(box)} does not meet the workspace {_box_text(self.workspace)}, "
                f"in which the palm's centre stays{way_over_array(box)}{_way_around(box)}"
            )

    def path(self, box: NDArray[np.float64], time: NDArray[np.float64], seed: int, progress: Progress) -> Any:
        """Poses at times [s], shape [pose, 7]."""
        if self.explorer is None or self.workspace is None or self.facing is None:
            return exploration_path(box, time, seed, progress)
        trial = ExplorerTrial(self.explorer, seed, explorer_habits(self.explorer), self.workspace, self.facing)
        return over_array_path(trial, time, progress)


def check_options(
    model: str, explorer: int | None = None, facing: float | None = None, workspace: ArrayLike | None = None
) -> ExplorationOptions:
    """Options with their defaults; raises MotionError for values out of bounds, and options of another model."""
    known = find_name(model, EXPLORATION_MODELS) if isinstance(model, str) else None  # pyright: ignore[reportUnnecessaryIsInstance]
    if known is None:
        meant = likely_name(str(model), EXPLORATION_MODELS)
        raise MotionError(f"model must be one of {', '.join(EXPLORATION_MODELS)}, not {model!r}{meant}")
    given = {"explorer": explorer, "facing": facing, "workspace": workspace}
    if known == AROUND:
        for name, value in given.items():
            if value is not None:
                raise MotionError(f"{name} is of the model {OVER_ARRAY}, not of {AROUND}")
        return ExplorationOptions(known, None, None, None)
    full: dict[str, Any] = {name: OPTION_DEFAULTS[name] if value is None else value for name, value in given.items()}
    require_explorer(full["explorer"])
    asked = full["facing"]
    angle = float(asked) if isinstance(asked, int | float) and not isinstance(asked, bool) else math.nan
    if not FACING_LEAST <= angle <= FACING_MOST:  # a NaN compares false
        hint = f"; {angle:g} degrees are {math.radians(angle):.4g} rad" if 5.0 <= angle <= 90.0 else ""
        raise MotionError(f"facing must lie in {FACING_LEAST:.3g}..{FACING_MOST:.3g} rad, not {asked!r}{hint}")
    return ExplorationOptions(known, full["explorer"], angle, check_workspace(full["workspace"]))


def check_workspace(workspace: ArrayLike) -> NDArray[np.float64]:
    """Lowest and highest corner [m], shape [2, 3]; six numbers one after the other are read as these.

    Raises MotionError for a box that is no box, is thinner than 20 mm, or comes nearer to the array than 60 mm.
    """
    try:
        box = np.array(workspace, np.float64)
    except (TypeError, ValueError):
        raise MotionError(f"workspace must be numbers of shape [2, 3], got {workspace!r}") from None
    if box.shape not in ((2, 3), (6,)):
        raise MotionError(f"workspace must have shape [2, 3], got {list(box.shape)}")
    box = box.reshape(2, 3)
    if not (np.abs(box) <= WORKSPACE_FARTHEST).all():
        raise MotionError(f"workspace must be finite and within {WORKSPACE_FARTHEST:g} m, got {_box_text(box)}")
    if (box[1] - box[0] < WORKSPACE_THINNEST).any():
        raise MotionError(
            f"workspace must be lowest, then highest corner, {WORKSPACE_THINNEST:g} m apart at least along each axis, "
            f"got {_box_text(box)}"
        )
    if box[0, 2] < FLOOR:
        raise MotionError(f"workspace must begin at z = {FLOOR:g} m above the array or higher, got {box[0, 2]:g} m")
    return box


def way_over_array(box: NDArray[np.float64]) -> str:
    """The end of a message on an object that no hand reaches, by its box [m]: what places it; empty for no box."""
    is_box = bool(np.isfinite(box).all() and (box[0] <= box[1]).all())
    return "; at=(0, 0, 0.2) puts its middle over the array" if is_box else ""


def _way_around(box: NDArray[np.float64]) -> str:
    """The end of a message: the workspace around an object where it is; empty where none may be."""
    around = np.round([box[0] - MARGIN, box[1] + MARGIN], 3) + 0.0  # without -0
    around[0, 2] = max(around[0, 2], FLOOR)
    try:
        check_workspace(around)
    except MotionError:
        return ""
    return f", workspace=({', '.join(f'{value:g}' for value in around.ravel())}) the hand around it"


def _box_text(box: NDArray[np.float64]) -> str:
    """Two corners [m], as a message names them."""
    low, high = (" ".join(f"{value:g}" for value in corner) for corner in box)
    return f"({low}) to ({high}) m"
