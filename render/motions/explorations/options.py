"""Options of synthetic explorations: the models, their defaults and bounds, and what is refused. Needs no Warp."""

import math
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ....datasets.bounded_file import FileBoundError, require_bytes
from ....datasets.errors import MotionError
from ....datasets.known_names import find_name, likely_name
from ....datasets.motions.hand_motion import require_shape
from ....datasets.shapes.built_in import shape
from .habits import require_whole

Array = NDArray[np.float64]

OVER_ARRAY, AROUND = "over-array", "around"
EXPLORATION_MODELS = (OVER_ARRAY, AROUND)
"""Models of explorations, the default first: a person over an array; a hand around the object, from every side."""
VERSIONS = {OVER_ARRAY: 1, AROUND: 1}
"""Of each model: another version makes other poses of the same numbers."""
DURATION, RATE, SEED = 30.0, 90.0, 1
EXPLORATION_DEFAULTS: Mapping[str, Any] = {"duration": DURATION, "rate": RATE, "seed": SEED}
"""Duration [s], rate [Hz] and seed of an exploration for which none are given."""
WORKSPACE = ((-0.125, -0.125, 0.135), (0.125, 0.125, 0.325))
"""Box in which a palm's centre stays by default, lowest and highest x y z [m]: the founding paper's 130 mm cube
200 mm above the array, and 60 mm around and above it, the reach of a palm of 85 mm (half its diagonal). A palm that
faces the array touches nothing from below the cube.
"""
OPTION_DEFAULTS: Mapping[str, Any] = {"explorer": 1, "facing": math.radians(60.0), "workspace": WORKSPACE}
"""Options of `over-array` alone."""
EXPLORATION_OPTIONS = (*EXPLORATION_DEFAULTS, "model", *OPTION_DEFAULTS)
"""Everything that can be chosen of an exploration."""
POSES_MOST = 1e9
"""Most poses of one exploration, whatever the memory budget."""
BOUNDS_FARTHEST = 100.0
"""Largest coordinate of the bounds of an exploration [m]; larger ones are probably in wrong units."""
FACING_LEAST, FACING_MOST = math.radians(5.0), math.radians(90.0)
WORKSPACE_THINNEST, WORKSPACE_FARTHEST = 0.02, 2.0  # [m]
MARGIN = 0.06  # around an object, the palm's centre stays within the bounds grown by this [m] ...
FLOOR = 0.06  # ... and this high above the array [m]
POSE_BYTES, SECOND_BYTES = 80, {OVER_ARRAY: 60, AROUND: 2_400}
"""Peak memory of making an exploration [byte], per pose and per second of its path; measured."""


@runtime_checkable
class HasBounds(Protocol):
    """An object of `palpate.render`."""

    @property
    def bounds(self) -> Array:
        """Lowest and highest coordinates [m], shape [2, 3]."""
        ...


class ModelOptions(NamedTuple):
    """Checked options of a model; those of `over-array` are None for `around`."""

    model: str
    explorer: int | None
    facing: float | None
    """Largest facing angle [rad]."""
    workspace: Array | None
    """Lowest and highest x y z of the palm's centre [m], shape [2, 3]."""


def check_options(
    model: str, explorer: int | None = None, facing: float | None = None, workspace: ArrayLike | None = None
) -> ModelOptions:
    """Options with their defaults; raises MotionError for values out of bounds, and options of another model."""
    known = find_name(model, EXPLORATION_MODELS)
    if known is None:
        meant = likely_name(str(model), EXPLORATION_MODELS)
        raise MotionError(f"model must be one of {', '.join(EXPLORATION_MODELS)}, not {model!r}{meant}")
    given = {"explorer": explorer, "facing": facing, "workspace": workspace}
    if known == AROUND:
        for name, value in given.items():
            if value is not None:
                raise MotionError(f"{name} is of the model {OVER_ARRAY}, not of {AROUND}")
        return ModelOptions(known, None, None, None)
    full: dict[str, Any] = {name: OPTION_DEFAULTS[name] if value is None else value for name, value in given.items()}
    require_whole("explorer", full["explorer"])
    asked = full["facing"]
    angle = float(asked) if isinstance(asked, int | float) and not isinstance(asked, bool) else math.nan
    if not FACING_LEAST <= angle <= FACING_MOST:  # a NaN compares false
        hint = f"; {angle:g} degrees are {math.radians(angle):.4g} rad" if 5.0 <= angle <= 90.0 else ""
        raise MotionError(f"facing must lie in {FACING_LEAST:.3g}..{FACING_MOST:.3g} rad, not {asked!r}{hint}")
    return ModelOptions(known, full["explorer"], angle, check_workspace(full["workspace"]))


def check_workspace(workspace: ArrayLike) -> Array:
    """Lowest and highest corner [m], shape [2, 3]; six numbers one after the other are read as these.

    Raises MotionError for a box that is no box, is thinner than 20 mm, or comes nearer to the array than 60 mm.
    """
    if np.shape(workspace) == (6,):
        workspace = np.reshape(workspace, (2, 3))
    box = require_shape(workspace, "workspace", (2, 3))
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


def check_bounds(bounds: ArrayLike | HasBounds | str) -> Array:
    """Lowest and highest x y z [m], shape [2, 3], of an object, of a built-in one by name, or given as numbers.

    Raises MotionError for other shapes, the name of a file, and numbers that bound no box within 100 m.
    """
    box: Any = bounds
    if isinstance(bounds, str | PathLike):
        if Path(bounds).suffix:
            raise MotionError(f"{bounds}: of a file, give the object: exploration(MeshObject.load({str(bounds)!r}))")
        vertices, _ = shape(str(bounds))
        box = vertices.min(axis=0), vertices.max(axis=0)
    elif isinstance(bounds, HasBounds):
        box = bounds.bounds
        if hasattr(box, "x_min"):  # PyVista's are x, x, y, y, z, z
            box = np.reshape(box, (3, 2)).T
    checked = require_shape(box, "bounds", (2, 3))
    if not (np.abs(checked) <= BOUNDS_FARTHEST).all() or (checked[0] > checked[1]).any():
        raise MotionError(
            f"bounds must be finite, minimum before maximum and within {BOUNDS_FARTHEST:g} m, got {checked.tolist()}"
            + _place_over_array(checked)
        )
    return checked


def require_reachable(box: Array, workspace: Array | None) -> None:
    """Raise MotionError for an object, by its bounds [2, 3], that no hand reaches; workspace: None for `around`."""
    if workspace is None:
        if box[1, 2] + MARGIN <= FLOOR:
            raise MotionError(
                f"the object's top at z = {box[1, 2]:g} m leaves a hand no room {FLOOR:g} m above the array"
                + _place_over_array(box)
            )
    elif (box[0] > workspace[1]).any() or (box[1] < workspace[0]).any():
        raise MotionError(
            f"bounds: the object's box {_box_text(box)} does not meet the workspace {_box_text(workspace)}, "
            f"in which the palm's centre stays{_place_over_array(box)}{_workspace_around(box)}"
        )


def count_poses(duration: float, rate: float, model: str) -> int:
    """Number of poses of an exploration; raises MotionError for times that are not above 0, and for too many poses."""
    for name, value in (("duration", duration), ("rate", rate)):
        if isinstance(value, str) or not (math.isfinite(value) and value > 0.0):
            raise MotionError(f"{name} must be finite and greater than 0, got {value!r}")
    if duration * rate > POSES_MOST:
        raise MotionError(f"{duration:g} s at {rate:g} Hz are more than {POSES_MOST:g} poses")
    count = max(1, math.ceil(duration * rate - 1e-9))  # 1e-9: 0.1 s x 30 Hz is three poses
    try:
        size = POSE_BYTES * count + SECOND_BYTES[model] * math.ceil(duration)
        require_bytes(size, f"a motion of {count} poses (duration {duration:g} s at rate {rate:g} Hz)")
    except FileBoundError as error:
        raise MotionError(str(error)) from error
    return count


def _place_over_array(box: Array) -> str:
    """The end of a message on an object that no hand reaches, by its box [m]: what places it; empty for no box."""
    is_box = bool(np.isfinite(box).all() and (box[0] <= box[1]).all())
    return "; at=(0, 0, 0.2) puts its middle over the array" if is_box else ""


def _workspace_around(box: Array) -> str:
    """The end of a message: the workspace around an object where it is; empty where none may be."""
    around = np.round([box[0] - MARGIN, box[1] + MARGIN], 3) + 0.0  # without -0
    around[0, 2] = max(around[0, 2], FLOOR)
    try:
        check_workspace(around)
    except MotionError:
        return ""
    return f", workspace=({', '.join(f'{value:g}' for value in around.ravel())}) the hand around it"


def _box_text(box: Array) -> str:
    """Two corners [m], as a message names them."""
    low, high = (" ".join(f"{value:g}" for value in corner) for corner in box)
    return f"({low}) to ({high}) m"
