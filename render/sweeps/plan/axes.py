"""The six axes of a plan: their keys, and the recipe parts that their values make.

A key that is left out has one value, its default; a key that does not apply to a source is refused.
"""

import math
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from itertools import product
from typing import Any, NamedTuple, cast

from ....datasets.errors import MotionError
from ....kernels.driving.solve import POINTS_MOST
from ...errors import RenderError, StrategyError
from ...hands.hand import LARGEST, SMALLEST, Palm
from ...motions.explorations.habits import NUMBER_MOST
from ...motions.explorations.options import (
    EXPLORATION_DEFAULTS,
    EXPLORATION_MODELS,
    FACING_LEAST,
    FACING_MOST,
    OPTION_DEFAULTS,
    POSES_MOST,
    VERSIONS,
    check_options,
)
from ...objects.mesh.placement import SIZE_LARGEST, UP_AXES
from ...objects.mesh.solid_mesh import SOLID_RULES
from ...objects.voxels.files import UNITS
from ...objects.voxels.grid import KINDS
from ...playback.drive import AMPLITUDES, SOLVERS, Driver, DriveStrategy
from ...playback.placed_arrays import load_rig
from ...strategies.intersection_strategy import FLUSH_HIGHEST, STEP_HIGHEST, STEP_LOWEST
from .recipe import RANDOM_AT, RANDOM_SIZE, RecipePart, model_of
from .sources import PlanSource, SourceIndex, described_sampling, read_alignments, read_sources
from .values import Check, ChoiceCheck, LabelCheck, NumberCheck, TextCheck, Values, VectorCheck, read_values, refuse

COUNT_MOST = 10**15  # poses of one recipe
SIZE_SMALLEST = 1e-3  # [m] of an object
COORDINATE = NumberCheck(-1e6, 1e6)  # of a function's own, in any unit
PLACE = NumberCheck(-SIZE_LARGEST, SIZE_LARGEST, "m")
ANGLE = NumberCheck(-360.0, 360.0, "degree")


@dataclass(frozen=True)
class AxisKey:
    """A key of an axis beside its `source`."""

    check: Check | None
    """None for files, which a function of their own reads."""
    default: Any = None
    of: tuple[str, ...] = ()
    """Kinds of source that it applies to; empty for all."""


KEYS: dict[str, dict[str, AxisKey]] = {
    "object": {
        "scale": AxisKey(NumberCheck(1e-9, 1e9), 1.0),
        "up": AxisKey(ChoiceCheck(UP_AXES), "z"),
        "fit": AxisKey(NumberCheck(SIZE_SMALLEST, SIZE_LARGEST, "m")),
        "rotate": AxisKey(VectorCheck(3, ANGLE), [0.0, 0.0, 0.0]),
        "at": AxisKey(VectorCheck(3, PLACE)),
        "kind": AxisKey(ChoiceCheck(KINDS), of=("volume",)),
        "level": AxisKey(NumberCheck(-1e300, 1e300), of=("volume",)),
        "label": AxisKey(LabelCheck(NumberCheck(0, 2**32, whole=True)), of=("volume",)),
        "inside": AxisKey(ChoiceCheck(("below", "above")), of=("volume",)),
        "spacing": AxisKey(VectorCheck(3, NumberCheck(1e-9, 1.0, "m")), of=("volume",)),
        "unit": AxisKey(ChoiceCheck(tuple(UNITS)), of=("volume",)),
        "bounds": AxisKey(VectorCheck(6, COORDINATE), of=("function",)),
        "solid": AxisKey(ChoiceCheck(SOLID_RULES), SOLID_RULES[0], of=("built-in", "mesh")),
        "weld": AxisKey(NumberCheck(0.0, SIZE_LARGEST, "m"), 0.0, of=("built-in", "mesh")),
        "fill_holes": AxisKey(NumberCheck(0.0, SIZE_LARGEST, "m"), 0.0, of=("built-in", "mesh")),
        "simplify": AxisKey(NumberCheck(0.0, 0.1, "m"), of=("built-in", "mesh")),
    },
    "hand": {
        "palm": AxisKey(VectorCheck(2, NumberCheck(SMALLEST, LARGEST, "m")), of=("palm",)),
    },
    "motion": {
        "duration": AxisKey(NumberCheck(1e-3, 1e9, "s"), of=("exploration",)),
        "rate": AxisKey(NumberCheck(1e-3, 1e6, "Hz"), of=("exploration", "recording")),
        "seed": AxisKey(NumberCheck(0, NUMBER_MOST, whole=True), of=("exploration", "random")),
        "model": AxisKey(ChoiceCheck(EXPLORATION_MODELS), EXPLORATION_MODELS[0], of=("exploration",)),
        "explorer": AxisKey(NumberCheck(0, NUMBER_MOST, whole=True), of=("exploration",)),
        "facing": AxisKey(NumberCheck(FACING_LEAST, FACING_MOST, "rad"), of=("exploration",)),
        "workspace": AxisKey(VectorCheck(6, PLACE), of=("exploration",)),
        "count": AxisKey(NumberCheck(1, COUNT_MOST, whole=True), of=("random",)),
        "size": AxisKey(NumberCheck(SIZE_SMALLEST, SIZE_LARGEST, "m"), of=("random",)),
        "at": AxisKey(VectorCheck(3, PLACE), of=("random",)),
        "side": AxisKey(TextCheck(), of=("recording",)),
        "alignment": AxisKey(None, of=("recording",)),
    },
    "strategy": {
        "step": AxisKey(NumberCheck(STEP_LOWEST, STEP_HIGHEST, "m")),
        "flush": AxisKey(NumberCheck(0.0, FLUSH_HIGHEST, "m")),
    },
    "sampling": {
        "speed": AxisKey(NumberCheck(1e-3, 100.0, "m/s")),
        "update_rate": AxisKey(NumberCheck(1.0, 40_000.0, "Hz")),
    },
    "array": {
        "amplitude": AxisKey(ChoiceCheck(AMPLITUDES)),
        "solver": AxisKey(ChoiceCheck(tuple(SOLVERS))),
        "gs_pat_iterations": AxisKey(NumberCheck(1, 1000, whole=True)),
        "wgs_iterations": AxisKey(NumberCheck(1, 1000, whole=True)),
        "slew": AxisKey(NumberCheck(1e-6, 0.5, "turns a period")),
        "sound_speed": AxisKey(NumberCheck(300.0, 400.0, "m/s")),
        "level_max": AxisKey(NumberCheck(1e-3, 1.0)),
        "piston_radius": AxisKey(NumberCheck(0.0, 5.5e-3, "m")),
    },
}
"""Keys of each axis in the order in which they vary, the last fastest. Bounds are those of the code that uses a value,
or narrower where a value beyond them could only have another unit."""
DEFAULT_SOURCES = {"hand": "palm", "motion": "exploration", "strategy": "cc", "sampling": "stm", "array": "emulator"}
"""Sources of axes that are left out; an object has none."""
NEEDED = {("object", "function"): "bounds", ("motion", "random"): "count"}
"""Keys that a kind of source requires."""
PLACEMENT_KEYS = ("scale", "up", "fit", "rotate", "at")
MESH_KEYS = ("solid", "weld", "fill_holes")
VOLUME_KEYS = ("kind", "level", "label", "inside", "spacing", "unit")


class Tie(NamedTuple):
    """Marks a key whose values go together with those of other keys."""

    group: int
    """Number of a group, which all of its keys have."""
    row: int
    """Row of the first value that the key's table lists."""


class AxisPart(NamedTuple):
    """A part that a table stands for."""

    part: RecipePart
    rows: dict[int, int]
    """The row of its values in each group of tied keys."""


AxisTable = Mapping[str, Values]
"""The values of an axis's source and of the keys that one of its tables has, in the order of `KEYS`."""


def read_key(axis: str, key: str, value: object, index: SourceIndex) -> Values:
    """The values that a key of an axis stands for; raises PlanFault."""
    if key == "source":
        return read_sources(axis, value, index)
    check = KEYS[axis][key].check
    return read_alignments(value, index) if check is None else read_values(value, check)


def require_agreement(axis: str, table: AxisTable) -> None:
    """Refuse keys that do not apply to one of the sources."""
    for source in table["source"]:
        for key in table:
            kinds = KEYS[axis][key].of if key != "source" else ()
            if kinds and source.kind not in kinds:
                others = f"; give it an [[{axis}]] of its own" if len(table["source"]) > 1 else ""
                refuse(f"is of {' or '.join(kinds)}, which {source.source} is not{others}", (key,))
        needed = NEEDED.get((axis, source.kind))
        if needed and needed not in table:
            refuse(f"is missing, which {source.source} needs", (needed,))
    for k, box in enumerate(table.get("bounds", ())):
        if not all(low < high for low, high in zip(box[:3], box[3:], strict=True)):
            refuse(f"must be lowest x, y, z, then highest x, y, z, not {box}", ("bounds", k))


class _Column(NamedTuple):
    """Keys of one table that vary together: a key alone, or those of a group."""

    values: dict[str, Sequence[Any]]
    """By key, of one length."""
    tie: Tie | None

    @property
    def places(self) -> range:
        """Places of the values."""
        return range(len(next(iter(self.values.values()))))


def _columns(table: AxisTable, ties: Mapping[str, Tie]) -> list[_Column]:
    """The columns of a table, in the order in which they vary."""
    columns: dict[str | int, _Column] = {}
    for key, values in table.items():
        tie = ties.get(key)
        column = columns.setdefault(tie.group if tie else key, _Column({}, tie))
        column.values[key] = values.listed if tie else values.items
    return list(columns.values())


def part_count(table: AxisTable, ties: Mapping[str, Tie]) -> int:
    """Number of parts that a table stands for."""
    return math.prod(len(column.places) for column in _columns(table, ties))


def parts_of(axis: str, table: AxisTable, ties: Mapping[str, Tie]) -> Iterator[AxisPart]:
    """The parts that a table stands for, the last key fastest; raises PlanFault for values that do not go together."""
    columns = _columns(table, ties)
    for places in product(*(column.places for column in columns)):
        cells = list(zip(columns, places, strict=True))
        values = {key: own[k] for column, k in cells for key, own in column.values.items()}
        try:
            part = RecipePart(CONTENTS[axis](values["source"], values))
        except RenderError as error:
            refuse(str(error))
        yield AxisPart(part, {column.tie.group: column.tie.row + k for column, k in cells if column.tie})


def with_distinct_names(tables: Sequence[AxisTable]) -> list[AxisTable]:
    """Tables of an axis in which sources of one name are shown with their paths."""
    paths: dict[str, set[str]] = defaultdict(set)
    for source in (source for table in tables for source in table["source"]):
        paths[source.name].add(source.source)

    def named(source: PlanSource) -> PlanSource:
        return replace(source, name=source.written) if len(paths[source.name]) > 1 and source.written else source

    return [{**table, "source": table["source"].mapped(named)} for table in tables]


def _object(source: PlanSource, values: Mapping[str, Any]) -> dict[str, Any]:
    full = {name: values.get(name, key.default) for name, key in KEYS["object"].items()}
    repair = {name: full[name] for name in MESH_KEYS if full[name] != KEYS["object"][name].default}
    return {
        **_identified(source),
        "function": source.loaded,
        **{name: full[name] for name in PLACEMENT_KEYS},
        "volume": {name: full[name] for name in VOLUME_KEYS if full[name] is not None},
        **({"mesh": repair} if repair else {}),  # without it, keys are those of before it was there
        "bounds": full["bounds"],
        "simplify": full["simplify"],
    }


def _hand(source: PlanSource, values: Mapping[str, Any]) -> dict[str, Any]:
    palm = None
    if source.kind == "palm":
        own = Palm(*values["palm"]) if "palm" in values else Palm()
        palm = [own.width, own.length]
    return {**_identified(source), "palm": palm}


def _motion(source: PlanSource, values: Mapping[str, Any]) -> dict[str, Any]:
    out = _identified(source)
    if source.kind == "exploration":
        return out | _exploration(values)
    if source.kind == "random":
        defaults = {"seed": EXPLORATION_DEFAULTS["seed"], "size": RANDOM_SIZE, "at": list(RANDOM_AT)}
        return out | {name: values.get(name, defaults.get(name)) for name in ("count", "seed", "size", "at")}
    if source.kind == "recording":
        return out | {name: values.get(name) for name in ("side", "alignment", "rate")}
    return out


def _exploration(values: Mapping[str, Any]) -> dict[str, Any]:
    """The keys of an exploration; refused are options of another model, and more poses than palpate makes."""
    explorer, facing, workspace = (values.get(name) for name in OPTION_DEFAULTS)
    model = values.get("model", EXPLORATION_MODELS[0])
    options = _model_options(model, explorer, facing, None if workspace is None else tuple(workspace))
    timing = {name: values.get(name, default) for name, default in EXPLORATION_DEFAULTS.items()}
    duration, rate = timing["duration"], timing["rate"]
    if duration * rate > POSES_MOST:
        refuse(f"must give at most {POSES_MOST:g} poses with rate, not {duration:g} s at {rate:g} Hz", ("duration",))
    return timing | options


@lru_cache
def _model_options(
    model: str, explorer: int | None, facing: float | None, workspace: tuple[float, ...] | None
) -> dict[str, Any]:
    """A model's name and options as recipes have them; cached, because most parts differ in their seeds alone."""
    try:
        options = check_options(model, explorer, facing, workspace)
    except MotionError as error:
        refuse(str(error), next(((name,) for name in OPTION_DEFAULTS if str(error).startswith(name)), ()))
    if options.workspace is None:  # recipes of `around` do not name their model: they are older than the other model
        return {}
    box = options.workspace.ravel().tolist()
    own = {"explorer": options.explorer, "facing": options.facing, "workspace": box}
    return {"model": options.model, "version": VERSIONS[options.model], **own}


def _strategy(source: PlanSource, values: Mapping[str, Any]) -> dict[str, Any]:
    described = source.loaded | {name: values[name] for name in KEYS["strategy"] if name in values}
    return {**_named(source), "described": described, "step": described.get("step")}


def _sampling(source: PlanSource, values: Mapping[str, Any]) -> dict[str, Any]:
    given = {name: values[name] for name in KEYS["sampling"] if name in values}
    replace(source.loaded, **given)  # raises StrategyError for values that do not go together
    return {**_named(source), "described": described_sampling(source.loaded) | given}


def _array(source: PlanSource, values: Mapping[str, Any]) -> dict[str, Any]:
    drive = DriveStrategy(**{name: values[name] for name in KEYS["array"] if name in values})
    counts = {"gs_pat_iterations": drive.iterations[0] or None, "wgs_iterations": drive.iterations[1] or None}
    return {**_named(source), "described": {**source.loaded, "drive": {**asdict(drive), **counts}}}


def _named(source: PlanSource) -> dict[str, Any]:
    return {"source": source.source, "name": source.name}


def _identified(source: PlanSource) -> dict[str, Any]:
    return {**_named(source), "sha256": source.sha256}


CONTENTS: dict[str, Callable[[PlanSource, Mapping[str, Any]], dict[str, Any]]] = {
    "object": _object,
    "hand": _hand,
    "motion": _motion,
    "strategy": _strategy,
    "sampling": _sampling,
    "array": _array,
}
"""Content of each axis's part, by its source and the values of its keys; raises RenderError or PlanFault."""


def require_playable(sampling: RecipePart, array: RecipePart, *, keeps_drives: bool) -> None:
    """Raise RenderError or DeviceError unless the array can play drives of these focal points.

    keeps_drives: whether the drives themselves are asked for, which an array of focal points finds by itself.
    """
    asked, described = sampling.content["described"], array.content["described"]
    rate = asked["update_rate"]
    if asked["foci"] > POINTS_MOST:
        raise StrategyError(f"foci must be at most {POINTS_MOST} to be solved for an array, not {asked['foci']}")
    models = [entry.model for entry in load_rig(array.content["source"])]
    for model in models:
        model.divider(rate)
        if keeps_drives and model.takes_points:
            raise StrategyError(
                f"array {model.name} takes focal points, and its own driver finds the drives, which palpate does not "
                'know: keep "focal-points" instead'
            )
    Driver(models, DriveStrategy(**described["drive"]), update_rate=rate)


def value_of(axis: str, key: str, content: Mapping[str, Any]) -> Any:
    """The value that a recipe's part has for a key, the part itself for source; None where the key does not apply."""
    if key == "source":
        return content
    if axis in ("array", "sampling"):
        described = cast(Mapping[str, Any], content["described"])
        return (described["drive"] if axis == "array" else described)[key]
    if axis == "object" and key in VOLUME_KEYS:
        return content["volume"].get(key)
    return model_of(content) if axis == "motion" and key == "model" else content.get(key)
