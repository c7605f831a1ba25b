"""The six axes of a plan: their keys as pydantic models, and the recipe parts that their values make.

A key that is left out has one value, its default; one that a source has no use for is refused.
"""

import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from itertools import product
from typing import Annotated, Any, cast

from pydantic import BaseModel, BeforeValidator, ConfigDict, create_model

from ....datasets.motions.hand_motion import POSES_MOST, SEED_MOST
from ....kernels.driving.solve import POINTS_MOST
from ...errors import RenderError, StrategyError
from ...hands.hand import LARGEST, SMALLEST, Palm
from ...objects.mesh.solid_mesh import SIZE_LARGEST, SOLID_RULES, UP_AXES
from ...objects.voxels.files import UNITS
from ...objects.voxels.values import KINDS
from ...playback.drive import AMPLITUDES, SOLVERS, Driver, DriveStrategy
from ...playback.placed_arrays import load_rig
from ...sampling.strategy import SamplingStrategy
from ...strategies.intersection_strategy import FLUSH_HIGHEST, STEP_HIGHEST, STEP_LOWEST
from .recipe import RecipePart
from .sources import Source, alignments, sources_of
from .values import Check, Choice, Labels, Number, Text, Values, Vector, refuse, swept

COUNT_MOST = 10**15  # poses of one recipe
SIZE_SMALLEST = 1e-3  # [m] of an object
COORDINATE = Number(-1e6, 1e6)  # of a function's own, in any unit
PLACE = Number(-SIZE_LARGEST, SIZE_LARGEST, "m")
ANGLE = Number(-360.0, 360.0, "degree")


@dataclass(frozen=True)
class Key:
    """A key of an axis beside its `source`."""

    check: Check | None
    """None: files, read by a function of their own."""
    default: Any = None
    of: tuple[str, ...] = ()
    """Kinds of source that it belongs to; empty: all."""


KEYS: dict[str, dict[str, Key]] = {
    "object": {
        "scale": Key(Number(1e-9, 1e9), 1.0),
        "up": Key(Choice(UP_AXES), "z"),
        "fit": Key(Number(SIZE_SMALLEST, SIZE_LARGEST, "m")),
        "rotate": Key(Vector(3, ANGLE), [0.0, 0.0, 0.0]),
        "at": Key(Vector(3, PLACE)),
        "kind": Key(Choice(KINDS), of=("volume",)),
        "level": Key(Number(-1e300, 1e300), of=("volume",)),
        "label": Key(Labels(Number(0, 2**32, whole=True)), of=("volume",)),
        "inside": Key(Choice(("below", "above")), of=("volume",)),
        "spacing": Key(Vector(3, Number(1e-9, 1.0, "m")), of=("volume",)),
        "unit": Key(Choice(tuple(UNITS)), of=("volume",)),
        "bounds": Key(Vector(6, COORDINATE), of=("function",)),
        "solid": Key(Choice(SOLID_RULES), SOLID_RULES[0], of=("built-in", "mesh")),
        "weld": Key(Number(0.0, SIZE_LARGEST, "m"), 0.0, of=("built-in", "mesh")),
        "fill_holes": Key(Number(0.0, SIZE_LARGEST, "m"), 0.0, of=("built-in", "mesh")),
        "simplify": Key(Number(0.0, 0.1, "m"), of=("built-in", "mesh")),
    },
    "hand": {
        "palm": Key(Vector(2, Number(SMALLEST, LARGEST, "m")), of=("palm",)),
    },
    "motion": {
        "duration": Key(Number(1e-3, 1e9, "s"), of=("exploration",)),
        "rate": Key(Number(1e-3, 1e6, "Hz"), of=("exploration", "recording")),
        "seed": Key(Number(0, SEED_MOST, whole=True), of=("exploration", "random")),
        "count": Key(Number(1, COUNT_MOST, whole=True), of=("random",)),
        "size": Key(Number(SIZE_SMALLEST, SIZE_LARGEST, "m"), of=("random",)),
        "at": Key(Vector(3, PLACE), of=("random",)),
        "side": Key(Text(), of=("recording",)),
        "alignment": Key(None, of=("recording",)),
    },
    "strategy": {
        "step": Key(Number(STEP_LOWEST, STEP_HIGHEST, "m")),
        "flush": Key(Number(0.0, FLUSH_HIGHEST, "m")),
    },
    "sampling": {
        "speed": Key(Number(1e-3, 100.0, "m/s")),
        "update_rate": Key(Number(1.0, 40_000.0, "Hz")),
    },
    "array": {
        "amplitude": Key(Choice(AMPLITUDES)),
        "solver": Key(Choice(tuple(SOLVERS))),
        "gs_pat_iterations": Key(Number(1, 1000, whole=True)),
        "wgs_iterations": Key(Number(1, 1000, whole=True)),
        "slew": Key(Number(1e-6, 0.5, "turns a period")),
        "sound_speed": Key(Number(300.0, 400.0, "m/s")),
        "level_max": Key(Number(1e-3, 1.0)),
        "piston_radius": Key(Number(0.0, 5.5e-3, "m")),
    },
}
"""Keys of each axis in the order in which they vary, the last fastest. Bounds are those of what they are given to, or
narrower where a wider one could only be another unit."""
DEFAULT_SOURCES = {"hand": "palm", "motion": "exploration", "strategy": "cc", "sampling": "stm", "array": "emulator"}
"""Of axes that are left out; there is no default object."""
NEEDED = {("object", "function"): "bounds", ("motion", "random"): "count"}
"""Keys that a kind of source cannot do without."""
EXPLORATION_DEFAULTS = {"duration": 30.0, "rate": 90.0, "seed": 1}
"""As those of `palpate render`, whose module imports everything that can be rendered."""
RANDOM_SIZE, RANDOM_AT = 0.13, [0.0, 0.0, 0.2]
"""Cube in which random poses lie, and its middle [m]: about the built-in objects."""
PLACEMENT_KEYS = ("scale", "up", "fit", "rotate", "at")
MESH_KEYS = ("solid", "weld", "fill_holes")
VOLUME_KEYS = ("kind", "level", "label", "inside", "spacing", "unit")


class AxisTable(BaseModel):
    """One table of an axis: its source, and what was given of its keys, each as `Values`."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, arbitrary_types_allowed=True)
    source: Values

    def given(self) -> dict[str, Values]:
        """Values by key, those of keys that were given."""
        return {name: value for name in type(self).model_fields if (value := getattr(self, name)) is not None}

    @property
    def combination_count(self) -> int:
        """How many parts its values make."""
        return math.prod(len(values) for values in self.given().values())


def _model(axis: str) -> type[AxisTable]:
    """The model of an axis."""
    fields: dict[str, Any] = {
        name: (Annotated[Values | None, BeforeValidator(alignments if key.check is None else swept(key.check))], None)
        for name, key in KEYS[axis].items()
    }
    source = Annotated[Values, BeforeValidator(sources_of(axis))]
    return create_model(f"{axis.capitalize()}Axis", __base__=AxisTable, source=(source, ...), **fields)


MODELS: dict[str, type[AxisTable]] = {axis: _model(axis) for axis in KEYS}
"""By axis; validated with a `Shelf` as context."""


def require_agreement(axis: str, table: AxisTable) -> None:
    """Refuse keys that one of the sources has no use for, and values that do not go together."""
    given = table.given()
    for source in table.source:
        for name in given:
            kinds = KEYS[axis][name].of if name != "source" else ()
            if kinds and source.kind not in kinds:
                others = f"; give it an [[{axis}]] of its own" if len(table.source) > 1 else ""
                refuse(f"is of {' or '.join(kinds)}, which {source.source} is not{others}", (name,))
        needed = NEEDED.get((axis, source.kind))
        if needed and needed not in given:
            refuse(f"is missing, which {source.source} needs", (needed,))
    for k, box in enumerate(given.get("bounds", ())):
        if not all(low < high for low, high in zip(box[:3], box[3:], strict=True)):
            refuse(f"must be lowest x, y, z, then highest x, y, z, not {box}", ("bounds", k))
    if axis == "motion" and "exploration" in {source.kind for source in table.source}:
        _require_poses(given)
    if axis in JUDGES:
        for values in _corners(given):
            try:
                JUDGES[axis](values)
            except RenderError as error:
                refuse(str(error))


def _require_poses(given: Mapping[str, Values]) -> None:
    """Refuse explorations that are longer than the library makes them."""
    most = {
        name: max(_ends(given[name])) if name in given else EXPLORATION_DEFAULTS[name] for name in ("duration", "rate")
    }
    if most["duration"] * most["rate"] > POSES_MOST:
        text = f"{most['duration']:g} s at {most['rate']:g} Hz"
        refuse(f"must give at most {POSES_MOST:g} poses with rate, not {text}", ("duration",))


def _ends(values: Values) -> tuple[Any, ...]:
    """The least and the greatest of numbers; all of anything else."""
    if not isinstance(values.items, tuple):
        return values.items[0], values.items[-1]
    is_number = isinstance(values.items[0], int | float)
    return (min(values.items), max(values.items)) if is_number else values.items


def _corners(given: Mapping[str, Values]) -> Iterator[dict[str, Any]]:
    """Combinations that all can be judged by: what cannot be together depends on the ends of ranges."""
    for combination in product(*(_ends(values) for values in given.values())):
        yield dict(zip(given, combination, strict=True))


def variants(axis: str, table: AxisTable) -> Iterator[RecipePart]:
    """The parts that a table stands for, made one after the other; ranges are not spelt out."""
    given = table.given()
    names, columns = list(given), list(given.values())

    def chosen(depth: int, values: dict[str, Any]) -> Iterator[RecipePart]:
        if depth == len(names):
            yield part_of(axis, values)
            return
        for value in columns[depth]:
            values[names[depth]] = value
            yield from chosen(depth + 1, values)

    return chosen(0, {})


def part_of(axis: str, values: Mapping[str, Any]) -> RecipePart:
    """The part of a recipe that one value of each given key makes."""
    return RecipePart(CONTENTS[axis](values["source"], values))


def _object(source: Source, values: Mapping[str, Any]) -> dict[str, Any]:
    full = {name: values.get(name, key.default) for name, key in KEYS["object"].items()}
    repair = {name: full[name] for name in MESH_KEYS if full[name] != KEYS["object"][name].default}
    return {
        **_whence(source),
        "function": source.loaded,
        **{name: full[name] for name in PLACEMENT_KEYS},
        "volume": {name: full[name] for name in VOLUME_KEYS if full[name] is not None},
        **({"mesh": repair} if repair else {}),  # without it, keys are those of before it was there
        "bounds": full["bounds"],
        "simplify": full["simplify"],
    }


def _hand(source: Source, values: Mapping[str, Any]) -> dict[str, Any]:
    palm = None
    if source.kind == "palm":
        own = Palm(*values["palm"]) if "palm" in values else Palm()
        palm = [own.width, own.length]
    return {**_whence(source), "palm": palm}


def _motion(source: Source, values: Mapping[str, Any]) -> dict[str, Any]:
    out = _whence(source)
    if source.kind == "exploration":
        return out | {name: values.get(name, default) for name, default in EXPLORATION_DEFAULTS.items()}
    if source.kind == "random":
        defaults = {"seed": EXPLORATION_DEFAULTS["seed"], "size": RANDOM_SIZE, "at": RANDOM_AT}
        return out | {name: values.get(name, defaults.get(name)) for name in ("count", "seed", "size", "at")}
    if source.kind == "recording":
        return out | {name: values.get(name) for name in ("side", "alignment", "rate")}
    return out


def _strategy(source: Source, values: Mapping[str, Any]) -> dict[str, Any]:
    described = source.loaded | {name: values[name] for name in KEYS["strategy"] if name in values}
    return {**_named(source), "described": described, "step": described.get("step")}


def _sampling(source: Source, values: Mapping[str, Any]) -> dict[str, Any]:
    changes = {name: values[name] for name in KEYS["sampling"] if name in values}
    return {**_named(source), "described": source.loaded | changes}


def _array(source: Source, values: Mapping[str, Any]) -> dict[str, Any]:
    drive = _drive(values)
    counts = {"gs_pat_iterations": drive.iterations[0] or None, "wgs_iterations": drive.iterations[1] or None}
    return {**_named(source), "described": {**source.loaded, "drive": {**asdict(drive), **counts}}}


def _drive(values: Mapping[str, Any]) -> DriveStrategy:
    return DriveStrategy(**{name: values[name] for name in KEYS["array"] if name in values})


def _named(source: Source) -> dict[str, Any]:
    return {"source": source.source, "name": source.name}


def _whence(source: Source) -> dict[str, Any]:
    return {**_named(source), "sha256": source.sha256}


CONTENTS: dict[str, Callable[[Source, Mapping[str, Any]], dict[str, Any]]] = {
    "object": _object,
    "hand": _hand,
    "motion": _motion,
    "strategy": _strategy,
    "sampling": _sampling,
    "array": _array,
}

JUDGES: dict[str, Callable[[Mapping[str, Any]], object]] = {
    "sampling": lambda values: SamplingStrategy.from_json(json.dumps(_sampling(values["source"], values)["described"])),
    "array": _drive,
}
"""What refuses values of different keys that do not go together, by RenderError; those of other axes always do."""


def require_playable(sampling: RecipePart, array: RecipePart) -> None:
    """Raise RenderError or DeviceError unless drives of these focal points can be made and played by the array."""
    asked, described = sampling.content["described"], array.content["described"]
    rate = asked["update_rate"]
    if asked["foci"] > POINTS_MOST:
        raise StrategyError(f"foci must be at most {POINTS_MOST} to be solved for an array, not {asked['foci']}")
    models = [entry.model for entry in load_rig(array.content["source"])]
    for model in models:
        model.divider(rate)
    Driver(models, DriveStrategy(**described["drive"]), update_rate=rate)


def value_of(axis: str, key: str, content: Mapping[str, Any]) -> Any:
    """What a part has of a plan's key; None where it does not apply."""
    described = cast(Mapping[str, Any], content.get("described", {}))
    if axis == "object" and key in VOLUME_KEYS:
        return content["volume"].get(key)
    if axis == "array" and key != "source":
        return described["drive"][key]
    if axis == "sampling" and key != "source":
        return described[key]
    return content["name"] if key == "source" else content.get(key)
