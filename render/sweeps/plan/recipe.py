"""One recipe of a sweep as data: its six parts, the keys under which its results are stored, and its columns.

Keys are made like this, so that any program can make them again:

1. Canonical JSON of each part: keys sorted, no blanks, non-ASCII as it is (UTF-8), whole numbers without a decimal
   point; without `name`, and without `source` if `sha256` or `described` is present; of a sampling strategy and a
   drive without the fields that have their default, so that a new field changes no key.
2. Its digest: SHA-256, hexadecimal.
3. The key of a group: the first 32 digits of the SHA-256 of the line "palpate recipe 1" and, for each part that the
   group depends on, a line of the part's name, a blank and its digest; lines end in a line feed.
"""

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import unquote

from ....datasets.bounded_file import file_beside, open_regular, read_content
from ....datasets.json_text import parse_json, read_json
from ...errors import PlanError
from ...motions.explorations.options import AROUND

FORMAT = "palpate recipe 1"
RANDOM_SIZE, RANDOM_AT = 0.13, (0.0, 0.0, 0.2)
"""Side of the cube in which random poses lie by default, and its centre [m]: around the built-in objects."""
PARTS = ("thing", "hand", "motion", "strategy", "sampling", "array")
_PLACE = {name: place for place, name in enumerate(PARTS)}
RENDERING, SAMPLED, DRIVEN = PARTS[:4], PARTS[:5], PARTS
GROUPS: dict[str, tuple[str, ...]] = {
    "contours": RENDERING,
    "frequency": SAMPLED,
    "poses": SAMPLED,
    "sampling": SAMPLED,
    "noise": DRIVEN,
    "pressure": DRIVEN,
    "keep-contours": RENDERING,
    "keep-focal-points": SAMPLED,
    "keep-drives": DRIVEN,
}
"""Groups of results, and the parts of a recipe that each depends on."""
_PART_OF = {
    "object": "thing",
    **dict.fromkeys(("hand", "palm"), "hand"),
    **dict.fromkeys(("strategy", "step", "flush"), "strategy"),
    **dict.fromkeys(("sampling", "speed", "update", "foci"), "sampling"),
    **dict.fromkeys(("array", "drive"), "array"),
}  # by the first word of a column; every other column is of the motion
WHOLE_GROUPS = ("sampling", "noise", "pressure", "keep-contours", "keep-focal-points", "keep-drives")
"""Groups that are made of a whole recipe at once."""
USER_METRIC = "metric "
"""What the name of a group begins with whose numbers a user's function computes of contours (`user_metric`)."""
METRICS = ("contours", "frequency", "sampling", "noise", "pressure")
KEPT = ("contours", "focal-points", "drives")
KEY_DIGITS = 32
CANONICAL = json.JSONEncoder(sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)


@dataclass(frozen=True, eq=False)
class RecipePart:
    """One of a recipe's six parts; its text and digest are computed once for all recipes that have it."""

    content: dict[str, Any]

    @cached_property
    def text(self) -> str:
        """Its JSON, as recipes have it."""
        return json.dumps(self.content, ensure_ascii=False)

    @cached_property
    def digest(self) -> str:
        """SHA-256 of its canonical JSON, without its name, and without its source if more is known."""
        return hashlib.sha256(canonical(_without_defaults(_unnamed(self.content))).encode()).hexdigest()


@dataclass(frozen=True)
class Recipe:
    """Six parts, each a JSON object with every default filled in (docs/guide/sweep-plan.md).

    `source` is a built-in name or an absolute path (`path.py:function`, `package.module:function`), `name` is
    shown. Lengths in metres, times in seconds, rotations in degree.
    """

    thing: dict[str, Any]
    hand: dict[str, Any]
    motion: dict[str, Any]
    strategy: dict[str, Any]
    sampling: dict[str, Any]
    array: dict[str, Any]

    @classmethod
    def of(cls, parts: Sequence[RecipePart]) -> "Recipe":
        """A recipe of six parts, which it may share with others."""
        recipe = cls(*(part.content for part in parts))
        vars(recipe)["parts"] = tuple(parts)  # instead of new ones by the cached property
        return recipe

    @cached_property
    def parts(self) -> tuple[RecipePart, ...]:
        """The six parts, whose digests recipes share."""
        return tuple(RecipePart(getattr(self, name)) for name in PARTS)

    def to_json(self) -> str:
        """One line of JSON that `from_json` reads back."""
        return "{" + ", ".join(f'"{name}": {part.text}' for name, part in zip(PARTS, self.parts, strict=True)) + "}"

    @classmethod
    def from_json(cls, text: str) -> "Recipe":
        """The recipe that `to_json` wrote; raises PlanError for any other text."""
        try:
            values = parse_json(text)
        except ValueError as error:
            raise PlanError(f"recipe: not JSON ({error})") from error
        if not isinstance(values, dict) or set(values) != set(PARTS):
            raise PlanError(f"recipe: must be a JSON object of {', '.join(PARTS)}, not {text[:60]!r}")
        return cls(**values)

    def digest(self, names: Iterable[str]) -> str:
        """Key of some parts together, 32 hexadecimal digits; work is shared between recipes of equal keys."""
        parts = self.parts
        lines = [f"{name} {parts[_PLACE[name]].digest}\n" for name in names]
        return hashlib.sha256(f"{FORMAT}\n{''.join(lines)}".encode()).hexdigest()[:KEY_DIGITS]

    def key(self, group: str) -> str:
        """Key under which a group's results are stored, 32 hexadecimal digits; groups: `GROUPS`, and user metrics."""
        if group not in self._keys:
            if group not in GROUPS and not is_user_metric(group):
                raise PlanError(f"unknown group {group!r}; known: {', '.join(GROUPS)}")
            self._keys[group] = self.digest(GROUPS.get(group, RENDERING))
        return self._keys[group]

    @cached_property
    def _keys(self) -> dict[str, str]:
        """Keys that were asked for, by group: every chunk asks."""
        return {}

    @property
    def hash(self) -> str:
        """Key of all six parts."""
        return self.digest(PARTS)

    @property
    def title(self) -> str:
        """Object, hand, motion, strategy and sampling, for messages."""
        motion = self.motion["name"] + (f" seed {self.motion['seed']}" if self.motion.get("seed") is not None else "")
        names = [self.thing["name"], self.hand["name"], motion, self.strategy["name"], self.sampling["name"]]
        return ", ".join(names)

    def columns(self) -> dict[str, str | float | int | bool | None]:
        """The recipe as one row of a table: the same columns for every recipe, None where one does not apply."""
        thing, volume, motion, array = self.thing, self.thing["volume"], self.motion, self.array
        sampling, drive = self.sampling["described"], array["described"]["drive"]
        return {
            "object": thing["name"],
            "object_scale": thing["scale"],
            "object_up": thing["up"],
            "object_fit": thing["fit"],
            **_spread("object_rotate", thing["rotate"]),
            **_spread("object_at", thing["at"]),
            "object_simplify": thing["simplify"],
            **{f"object_{name}": thing.get("mesh", {}).get(name) for name in ("solid", "weld", "fill_holes")},
            "object_bounds": _written(thing["bounds"]),
            **{f"object_{name}": volume.get(name) for name in ("kind", "level", "inside", "unit")},
            "object_label": _written(volume.get("label")),
            **_spread("object_spacing", volume.get("spacing")),
            "hand": self.hand["name"],
            **_spread("palm", self.hand["palm"], ("width", "length")),
            "motion": motion["name"],
            **{name: motion.get(name) for name in ("duration", "rate", "seed", "count", "size")},
            **_spread("motion_at", motion.get("at")),
            "model": model_of(motion),
            **{name: motion.get(name) for name in ("explorer", "facing")},
            "workspace": _written(motion.get("workspace")),
            "side": motion.get("side"),
            "alignment": (motion.get("alignment") or {}).get("name"),
            "strategy": self.strategy["name"],
            "step": self.strategy["step"],
            "flush": self.strategy["described"].get("flush"),
            "sampling": self.sampling["name"],
            **{name: sampling[name] for name in ("speed", "update_rate", "foci")},
            "array": array["name"],
            **{f"drive_{name}": drive[name] for name in drive},
        }


class SweepPlan(Protocol):
    """The attributes of a `Plan` that a run uses."""

    @property
    def name(self) -> str:
        """Name for the log."""
        ...

    @property
    def groups(self) -> tuple[str, ...]:
        """Groups of results that are made of each recipe."""
        ...

    @property
    def recipe_count(self) -> int:
        """Number of recipes."""
        ...

    @property
    def granted(self) -> frozenset[str]:
        """SHA-256 of the files of code that its recipes name and workers may run."""
        ...

    @property
    def user_metrics(self) -> Mapping[str, str]:
        """Source of each group that a user's function computes."""
        ...

    def recipes(self) -> Iterable[Recipe]:
        """Every recipe once."""
        ...


def is_user_metric(group: str) -> bool:
    """Whether a user's function computes a group."""
    return group.startswith(USER_METRIC)


def function_of(group: str) -> str:
    """Name of the function that computes a group."""
    return group.rpartition(" ")[2]


def model_of(motion: Mapping[str, Any]) -> str | None:
    """The model of an exploration; a part that names none is of the first one. None for another motion."""
    return motion.get("model", AROUND) if motion["source"] == "exploration" else None


def part_of(column: str) -> str:
    """Which of PARTS a column of `Recipe.columns` describes."""
    return _PART_OF.get(column.partition("_")[0], "motion")


def _spread(name: str, values: Sequence[float] | None, ends: tuple[str, ...] = ("x", "y", "z")) -> dict[str, Any]:
    """One column for each number of a list."""
    return {f"{name}_{end}": None if values is None else values[k] for k, end in enumerate(ends)}


def _written(values: object) -> str | None:
    """A list of any length in one column."""
    return None if values is None else json.dumps(values)


def _unnamed(content: Mapping[str, Any]) -> dict[str, Any]:
    """Without `name`, and without `source` if `sha256` or `described` is present; the same in a motion's alignment."""
    known = any(content.get(identity) is not None for identity in ("sha256", "described"))
    out = {key: value for key, value in content.items() if key != "name" and not (known and key == "source")}
    if isinstance(out.get("alignment"), Mapping):
        out["alignment"] = _unnamed(out["alignment"])
    return out


def _without_defaults(content: dict[str, Any]) -> dict[str, Any]:
    """Without fields of a sampling strategy or a drive that have their default.

    | `described` has | is of | fields |
    |---|---|---|
    | `raw` | an intersection strategy, in which they are left out already | |
    | `drive` | an array | of `drive` |
    | else | a sampling strategy | of it |
    """
    described = content.get("described")
    if described is None or "raw" in described:
        return content
    if "drive" in described:
        given = {name: value for name, value in described["drive"].items() if value is not None}  # None is a default
        own = _changed(given, _drive_defaults(given.get("solver")))
        return content | {"described": described | {"drive": own}}
    return content | {"described": _changed(described, *_sampling_defaults())}


def _changed(
    values: Mapping[str, Any], defaults: Mapping[str, Any], groups: Mapping[str, Mapping[str, Any]] | None = None
) -> dict[str, Any]:
    """Fields that do not have their default; of a group that differs, only its own such fields."""
    out = {name: value for name, value in values.items() if name not in defaults or value != defaults[name]}
    for name, group in (groups or {}).items():
        if isinstance(out.get(name), Mapping):
            out[name] = _changed(out[name], group)
    return out


@cache
def _sampling_defaults() -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
    """Defaults of a sampling strategy, and of each of its groups that is present."""
    from ...sampling.strategy import GROUPS as KINDS
    from ...sampling.strategy import SamplingStrategy

    return asdict(SamplingStrategy()), {name: asdict(kind()) for name, kind in KINDS.items()}


@cache
def _drive_defaults(solver: str | None) -> dict[str, Any]:
    """Defaults of a drive; the iterations are those of its solver."""
    from ...playback.drive import SOLVERS, DriveStrategy  # Warp

    defaults = asdict(DriveStrategy())
    gs_pat, wgs = SOLVERS.get(defaults["solver"] if solver is None else solver, (0, 0))
    return defaults | {"gs_pat_iterations": gs_pat or None, "wgs_iterations": wgs or None}


def canonical(value: Any) -> str:
    """Canonical JSON, as the module describes it."""
    return CANONICAL.encode(_plain(value))


def _plain(value: Any) -> Any:
    """Whole numbers as integers, so that 7 and 7.0 are the same."""
    if isinstance(value, float) and value.is_integer() and abs(value) < 2**53:
        return int(value)
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value


def groups_of(metrics: Iterable[str], per_pose: bool, keep: Iterable[str]) -> tuple[str, ...]:
    """Groups that a plan's `metrics`, `per_pose` and `keep` ask for, in the order of `GROUPS`, user metrics last."""
    metrics = list(metrics)
    asked = {*metrics, *(["poses"] if per_pose else []), *(f"keep-{name}" for name in keep)}
    own = dict.fromkeys(filter(is_user_metric, metrics))
    if unknown := asked - {*GROUPS, *own}:
        raise PlanError(f"unknown groups {', '.join(sorted(unknown))}; known: {', '.join(GROUPS)}")
    return (*(group for group in GROUPS if group in asked), *own)


def digest_source(source: str) -> str:
    """SHA-256 of a recipe's source on disk: of the file, or of the digests of its files.

    source: as in a recipe, an absolute path, `path.py:function` or `package.module:function`. A .gltf counts with its
    buffers, a .nhdr with its data; files that a Python file imports do not count.
    Raises PlanError for a file that cannot be read.
    """
    path = Path(path_of(source))
    try:
        digests = [_digest_file(file) for file in (path, *_companions(path))]
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise PlanError(f"{path}: the files that hold its data are unknown ({error})") from error
    except OSError as error:
        raise PlanError(f"{error.filename or path}: cannot be read ({error.strerror or error})") from error
    return digests[0] if len(digests) == 1 else hashlib.sha256("".join(digests).encode()).hexdigest()


def path_of(source: str) -> str:
    """The file of a source: that of a function without the function's name."""
    where, colon, function = source.rpartition(":")
    if not colon or not function.isidentifier():
        return source
    if where.endswith(".py"):
        return where
    from ...trust.permission import UNNAMED
    from ...trust.user_code import find_installed

    try:
        files = find_installed(where, UNNAMED).code.files
    except (ImportError, OSError, ValueError, AttributeError) as error:
        raise PlanError(f"{source}: there is no module {where!r} ({error})") from error
    if not files:
        raise PlanError(f"{source}: there is no module {where!r} with a file")
    return files[-1][0]


def _digest_file(path: Path) -> str:
    with open_regular(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _companions(path: Path) -> list[Path]:
    """Files that hold a part of another file's data; raises ValueError if they are unknown."""
    if path.suffix.lower() == ".gltf":
        buffers = read_json(path)["buffers"]
        names = [buffer.get("uri", "data:") for buffer in buffers]
        return [file_beside(path, unquote(name)) for name in names if not name.startswith("data:")]
    if path.suffix.lower() == ".nhdr":
        for line in read_content(path).decode("ascii", errors="replace").splitlines():
            field, _, name = (text.strip() for text in line.partition(":"))
            if field.lower() in ("data file", "datafile"):  # "LIST" is no file: no reader takes one
                return [file_beside(path, name)]
    return []
