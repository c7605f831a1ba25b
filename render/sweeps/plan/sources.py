"""What the `source` of an axis names: something built in, files, or functions; found, judged and hashed once.

| axis | built in | files | kinds |
|---|---|---|---|
| object | datasets/shapes | meshes, volumes, expressions, functions | built-in, mesh, volume, expression, function |
| hand | palm, planes, skin | meshes, volumes, expressions | palm, planes, skin, file |
| motion | exploration, random | poses, recordings of a hand | exploration, random, poses, recording |
| strategy, sampling | presets | JSON | preset, file |
| array | device/array | JSON of several and where they stand | built-in, file |

What only some sources need is imported where they are read: the parts of a finished sweep are to be known at once.
"""

import difflib
import glob
import os
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol, Self, TypeVar, cast

from pydantic import ValidationInfo

from ....datasets.errors import DatasetError
from ....datasets.recordings.alignment import alignment_pose
from ....datasets.shapes.built_in import shape_names
from ....device.errors import DeviceError, UnknownArrayError
from ....device.registry import array_names, canonical_name
from ...errors import RenderError
from ...objects.voxels.files import is_volume
from ...playback.placed_arrays import load_rig
from ...sampling.presets import PRESETS as SAMPLING_PRESETS
from ...sampling.presets import load_sampling
from ...sampling.strategy import GROUPS, SamplingStrategy
from ...stages.registry import Stage, find_stage
from ...strategies.intersection_strategy import PRESETS, IntersectionStrategy, draft_strategy, load_strategy
from ...strategies.user_stage_sources import require_unedited, stage_sources
from ...trust.permission import UNNAMED, AllowCode, Code, Namer
from ...validation import value_text
from .recipe import digest_source
from .values import Fault, Values, refuse

HANDS = ("palm", "planes", "skin")
MOTIONS = ("exploration", "random")
MOTION_SUFFIXES = (".csv", ".h5", ".hdf5", ".json", ".npz")
JOKERS = "*?["


class WithSource(Protocol):
    """A table of an axis."""

    source: Values

    def model_copy(self, *, update: dict[str, Any]) -> Self:
        """The same with other fields."""
        ...


T = TypeVar("T", bound=WithSource)


@dataclass(frozen=True)
class Source:
    """Something that an axis can have as its `source`."""

    kind: str
    source: str
    """Built-in name, absolute path, or name of a function."""
    name: str
    """Shown."""
    place: str = ""
    """Path as the plan has it, for where names are alike."""
    sha256: str | None = None
    loaded: Any = field(default=None, compare=False)
    """What was read of it: JSON of a strategy (in a draft without digests of stages), of a sampling strategy or of
    arrays; a function's name."""


@dataclass
class Shelf:
    """Where a plan's sources are: its folder, and digests of files, each read once for all plans together."""

    folder: Path
    digests: dict[str, str] = field(default_factory=dict)
    namer: Namer = UNNAMED
    """The plan."""
    allow_code: AllowCode | None = None
    """Whether code that is named may be run; None: a draft is made, for which none is."""
    code: list[Code] = field(default_factory=list)
    """All that was named."""

    def digest(self, source: str) -> str:
        """SHA-256, see `digest_source`."""
        if source not in self.digests:
            self.digests[source] = digest_source(source)
        return self.digests[source]

    def file(self, text: str) -> Path:
        """Absolute path of what a plan calls a file, not resolved through links."""
        return Path(text) if Path(text).is_absolute() else self.folder / text


def shelf_of(info: ValidationInfo) -> Shelf:
    """The context that models are validated in."""
    return cast(Shelf, info.context)


def sources_of(axis: str) -> Callable[[object, ValidationInfo], Values]:
    """What reads an axis's `source`; the validation's context is the plan's `Shelf`."""

    def read(value: object, info: ValidationInfo) -> Values:
        items = value if isinstance(value, list) else [value]
        if not items:
            refuse("must have at least one value, not []")
        kept: dict[str, Source] = {}
        repeated: list[int] = []
        for k, item in enumerate(items):
            found = _found(axis, item, shelf_of(info), (k,) if isinstance(value, list) else ())
            if all(source.source in kept for source in found):
                repeated.append(k)
            kept |= {source.source: source for source in found if source.source not in kept}
        return Values(tuple(kept.values()), tuple(repeated))

    return read


def alignments(value: object, info: ValidationInfo) -> Values:
    """What reads a recording's `alignment`: JSON files."""
    shelf = shelf_of(info)
    items = value if isinstance(value, list) else [value]
    if not items:
        refuse("must have at least one value, not []")
    out: dict[str, dict[str, str]] = {}
    for k, item in enumerate(items):
        place = (k,) if isinstance(value, list) else ()
        if not isinstance(item, str):
            refuse(f"must be the path of a JSON file, not {value_text(item)}", place)
        path = shelf.file(item)
        _refuse_bytes(str(path), place)
        try:
            alignment_pose(path)
            out[str(path)] = {"source": str(path), "name": path.name, "sha256": shelf.digest(str(path))}
        except (DatasetError, RenderError) as error:
            refuse(str(error), place)
    return Values(tuple(out.values()))


def _found(axis: str, item: object, shelf: Shelf, place: tuple[int, ...]) -> list[Source]:
    """What one entry of `source` names: one source, or all files of a pattern."""
    if not isinstance(item, str) or not item:
        refuse(f"must be a name, a path or a pattern of paths, not {value_text(item)}", place)
    texts = [item]
    if any(joker in item for joker in JOKERS) and not shelf.file(item).is_file():
        texts = sorted(glob.glob(item, root_dir=shelf.folder, recursive=True))
        texts = [text for text in texts if shelf.file(text).is_file()]
        if not texts:
            refuse(f"no file matches {item!r} in {shelf.folder}", place)
    for text in texts:
        _refuse_bytes(str(shelf.file(text)), place)
    try:
        return [FINDERS[axis](text, shelf) for text in texts]
    except Fault as fault:
        refuse(fault.sentence, place)
    except (RenderError, DatasetError, DeviceError) as error:
        refuse(str(error), place)


def _refuse_bytes(path: str, place: tuple[int, ...]) -> None:
    """Refuse a path that is no text: it could not be told in results."""
    try:
        path.encode()
    except UnicodeEncodeError:
        shown = os.fsencode(path).decode("utf-8", "backslashreplace")
        refuse(f"must be UTF-8, which the path {shown} is not: rename it", place)


def _file(text: str, shelf: Shelf, known: Sequence[str], what: str, kind: str) -> Source:
    """A file, or the fault that there is none and nothing built in either."""
    path = shelf.file(text)
    if not path.is_file():
        close = difflib.get_close_matches(text.lower(), known, 1, 0.6)
        meant = f" (did you mean {close[0]!r}?)" if close else ""
        refuse(f"{text!r} is no {what} ({', '.join(known)}) and no file in {shelf.folder}{meant}")
    return Source(kind, str(path), path.name, text, shelf.digest(str(path)))


def _object(text: str, shelf: Shelf) -> Source:
    names = shape_names()
    if text in names:
        return Source("built-in", text, text)
    if ":" in text and not shelf.file(text).is_file():
        from ...objects.functions.user_function import find_function_code, load_function

        where, _, function = text.rpartition(":")
        full = f"{shelf.file(where)}:{function}" if where.endswith(".py") else text
        shelf.code.append(find_function_code(full, shelf.namer).code)
        if shelf.allow_code is not None:
            load_function(full, allow_code=shelf.allow_code, namer=shelf.namer)
        return Source("function", full, function, text, shelf.digest(full), function)
    kind = "volume" if is_volume(text) else "expression" if text.endswith(".json") else "mesh"
    source = _file(text, shelf, names, "built-in object", kind)
    if kind == "expression":
        from ...objects.functions.expression_json import load_expression

        load_expression(source.source)
    return source


def _hand(text: str, shelf: Shelf) -> Source:
    if text in HANDS:
        return Source(text, text, text)
    return _file(text, shelf, HANDS, "hand", "file")


def _motion(text: str, shelf: Shelf) -> Source:
    if text in MOTIONS:
        return Source(text, text, text)
    source = _file(text, shelf, MOTIONS, "motion", "poses")
    if Path(text).suffix.lower() not in MOTION_SUFFIXES:
        refuse(f"{text!r}: a motion is one of {', '.join(MOTION_SUFFIXES)}, or of {', '.join(MOTIONS)}")
    from ...intersection.named_inputs import is_recording

    return replace(source, kind="recording") if is_recording(source.source) else source


def _strategy(text: str, shelf: Shelf) -> Source:
    if text.lower() in PRESETS:
        source = Source("preset", text.lower(), text.lower())
    else:
        source = _file(text, shelf, tuple(PRESETS), "strategy", "file")
        draft, code = draft_strategy(source.source)
        shelf.code += code
        if code and shelf.allow_code is None:
            return replace(source, loaded=draft)
    return replace(
        source, loaded=described_strategy(load_strategy(source.source, allow_code=shelf.allow_code or False))
    )


def _sampling(text: str, shelf: Shelf) -> Source:
    if text.lower() in SAMPLING_PRESETS:
        source = Source("preset", text.lower(), text.lower())
    else:
        source = _file(text, shelf, tuple(SAMPLING_PRESETS), "sampling", "file")
    return replace(source, loaded=described_sampling(load_sampling(source.source)))


def _array(text: str, shelf: Shelf) -> Source:
    try:
        name = canonical_name(text)
        source = Source("built-in", name, name)
    except UnknownArrayError:
        source = _file(text, shelf, array_names(), "array", "file")
    models = [entry.model for entry in load_rig(source.source)]  # arrays alike may differ in where they can focus
    identity = "+".join(model.identity() for model in models)
    return replace(source, loaded={"arrays": [model.name for model in models], "identity": identity})


FINDERS: dict[str, Callable[[str, Shelf], Source]] = {
    "object": _object,
    "hand": _hand,
    "motion": _motion,
    "strategy": _strategy,
    "sampling": _sampling,
    "array": _array,
}


def described_strategy(strategy: IntersectionStrategy) -> dict[str, Any]:
    """JSON of a strategy of which there is one for each meaning: options that are the default are left out.

    A user's own stages are told by digests of their source; StrategyError if that has changed since it was imported.
    """
    require_unedited(strategy)
    stages = {role: tuple(_shortest(role, stage) for stage in listed) for role, listed in strategy.stages().items()}
    shortest = replace(strategy, raw=stages["raw"][0], prune=stages["prune"], transform=stages["transform"])
    sources = stage_sources(strategy)
    return {**shortest.described(), **({"sources": sources} if sources else {})}


def _shortest(role: str, stage: Stage) -> Stage:
    defaults = find_stage(role, stage.name).defaults()
    return Stage(stage.name, {name: value for name, value in stage.options.items() if value != defaults[name]})


def described_sampling(strategy: SamplingStrategy) -> dict[str, Any]:
    """JSON of a sampling strategy, numbers as floats where they need not be whole."""
    defaults = {**asdict(SamplingStrategy()), **{name: asdict(group()) for name, group in GROUPS.items()}}
    return _as_default(asdict(strategy), defaults)


def _as_default(values: dict[str, Any], defaults: dict[str, Any]) -> dict[str, Any]:
    out: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, dict):
            out[name] = _as_default(value, defaults[name])
        else:
            out[name] = float(value) if isinstance(defaults[name], float) and isinstance(value, int) else value
    return out


def with_own_names(tables: Sequence[T]) -> list[T]:
    """Tables of an axis in which sources that would be shown alike are shown with their paths."""
    paths: dict[str, set[str]] = {}
    for table in tables:
        for source in table.source:
            paths.setdefault(source.name, set()).add(source.source)
    out: list[T] = []
    for table in tables:
        named = [replace(s, name=s.place) if len(paths[s.name]) > 1 and s.place else s for s in table.source]
        out.append(table.model_copy(update={"source": replace(table.source, items=tuple(named))}))
    return out
