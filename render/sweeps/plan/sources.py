"""The sources of axes: built in, files, or functions; found, validated and hashed once.

| axis | built in | files | kinds |
|---|---|---|---|
| object | datasets/shapes | meshes, volumes, expressions, functions | built-in, mesh, volume, expression, function |
| hand | palm, planes, skin | meshes, volumes, expressions | palm, planes, skin, file |
| motion | exploration, random | poses, recordings of a hand | exploration, random, poses, recording |
| strategy, sampling | presets | JSON | preset, file |
| array | device/array | JSON of several and where they stand | built-in, file |

Modules that only some sources need are imported where these are read, so that a finished sweep is recognised at once.
"""

import glob
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from ....datasets.errors import DatasetError
from ....datasets.known_names import find_name, likely_file, likely_name
from ....datasets.recordings.alignment import NAMES as ALIGNMENT_NAMES
from ....datasets.recordings.alignment import UNITY, split_alignment
from ....datasets.recordings.files import JOINT_SUFFIXES
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
from ...strategies.intersection_strategy import (
    PRESETS,
    IntersectionStrategy,
    draft_strategy,
    load_strategy,
    strategy_name,
)
from ...strategies.user_stage_sources import require_unedited, stage_sources
from ...trust.permission import UNNAMED, AllowCode, Code, Namer
from ...validation import value_text
from .recipe import digest_source
from .values import Values, checked_items, refuse, unique

JOKERS = "*?["
DEEP = "**"
FOLDERS_MOST = 10_000
"""Folders that one pattern may look into: about a second on a local disk."""


def has_jokers(text: str) -> bool:
    """Whether a text may be a pattern."""
    return any(joker in text for joker in JOKERS)


def match_files(pattern: str, folder: Path) -> list[str]:
    """Files that match a pattern, sorted, as the pattern spells their folders; relative ones start from `folder`.

    `**` stands for any folders in between, hidden ones and symbolic links to folders left out. Refused: `**` twice, and
    a pattern that looks into more than FOLDERS_MOST folders.
    """
    head, deep, rest = _split(pattern)
    if not deep:
        found = glob.iglob(pattern, root_dir=folder)
    else:
        if DEEP in rest.split("/"):
            refuse(f"may have {DEEP} once in a pattern, not as in {pattern!r}")
        found = (
            os.path.join(inner, name)
            for inner in _folders_below(head, folder, pattern)
            for name in glob.iglob(rest or "*", root_dir=folder / inner)
        )
    return sorted(text for text in found if (folder / text).is_file())


def _split(pattern: str) -> tuple[str, bool, str]:
    """What stands before the first `**`, whether there is one, and what stands after it."""
    parts = pattern.split("/")
    if DEEP not in parts:
        return pattern, False, ""
    place = parts.index(DEEP)
    head = "/".join(parts[:place])
    return "/" if place == 1 and not head else head, True, "/".join(parts[place + 1 :])


def _folders_below(head: str, folder: Path, pattern: str) -> Iterator[str]:
    """Each folder that matches `head`, and each below it, as paths that start like `head`."""
    starts = glob.iglob(head, root_dir=folder) if has_jokers(head) else [head]
    count = 0
    for start in starts:
        top = str(folder / start)
        for inner, names, _ in os.walk(top):
            names[:] = [name for name in names if not name.startswith(".")]
            count += 1
            if count > FOLDERS_MOST:
                refuse(
                    f"{pattern!r} looks into more than {FOLDERS_MOST:,} folders below {top}: name the folder of the "
                    "files more exactly"
                )
            below = os.path.relpath(inner, top)
            yield start if below == "." else os.path.join(start, below)


HANDS = ("palm", "planes", "skin")
MOTIONS = ("exploration", "random")
MOTION_SUFFIXES = (".csv", ".h5", ".hdf5", *JOINT_SUFFIXES)


@dataclass(frozen=True)
class PlanSource:
    """One value of an axis's `source`."""

    kind: str
    source: str
    """Built-in name, absolute path, or name of a function."""
    name: str
    """Shown."""
    written: str = ""
    """Path as the plan has it, shown where names are alike."""
    sha256: str | None = None
    loaded: Any = field(default=None, compare=False)
    """JSON of a strategy (of a draft without stages' digests) or of arrays; a sampling strategy; a function's name."""


@dataclass
class SourceIndex:
    """Finds a plan's sources; reads each file once for all plans together, and collects the code that they name."""

    folder: Path
    digests: dict[str, str] = field(default_factory=dict)
    namer: Namer = UNNAMED
    """Names the plan as the one that names code."""
    allow_code: AllowCode | None = None
    """Whether code may be run; None for a draft, which runs none."""
    code: list[Code] = field(default_factory=list)
    metrics: dict[str, str] = field(default_factory=dict)
    """Source of each group that a user's function computes."""

    def digest(self, source: str) -> str:
        """SHA-256, see `digest_source`."""
        if source not in self.digests:
            self.digests[source] = digest_source(source)
        return self.digests[source]

    def file(self, text: str) -> Path:
        """Absolute path of a path in the plan; links are not resolved."""
        return Path(text) if Path(text).is_absolute() else self.folder / text


def read_sources(axis: str, value: object, index: SourceIndex) -> Values:
    """The values of an axis's `source`; raises PlanFault."""
    return _read_listed(value, lambda item: _found(axis, item, index), lambda source: source.source)


def read_alignments(value: object, index: SourceIndex) -> Values:
    """The values of a recording's `alignment`, words and JSON files; raises PlanFault."""
    return _read_listed(value, lambda item: _alignment(item, index), lambda found: found["source"])


def _read_listed(value: object, find: Callable[[object], Sequence[Any]], identity: Callable[[Any], str]) -> Values:
    """A value or a list of them, each of which may stand for several."""
    if value == []:
        refuse("must have at least one value, not []")
    found = checked_items(find, value) if isinstance(value, list) else [find(value)]
    known: set[str] = set()
    repeated: list[int] = []
    for k, some in enumerate(found):
        own = {identity(one) for one in some}
        repeated += [k] if own <= known else []
        known |= own
    listed = [one for some in found for one in some]
    return replace(unique(listed, [identity(one) for one in listed]), repeated=tuple(repeated))


def _alignment(item: object, index: SourceIndex) -> list[dict[str, str]]:
    """A word, by which alone its digest differs from others, or a file, whose content does so."""
    if not isinstance(item, str):
        refuse(f"must be {ALIGNMENT_NAMES[0]}, {UNITY} or the path of a JSON file, not {value_text(item)}")
    if find_name(item, (*ALIGNMENT_NAMES, UNITY)):
        word = find_name(item, (UNITY,)) or ALIGNMENT_NAMES[0]
        return [{"source": word, "name": word}]
    path = index.file(item)
    _require_utf8(str(path))
    try:
        split_alignment(path)
        return [{"source": str(path), "name": path.name, "sha256": index.digest(str(path))}]
    except (DatasetError, RenderError) as error:
        refuse(str(error))


def _found(axis: str, item: object, index: SourceIndex) -> list[PlanSource]:
    """One source by its name or path, or all files of a pattern."""
    if not isinstance(item, str) or not item:
        refuse(f"must be a name, a path or a pattern of paths, not {value_text(item)}")
    texts = [item]
    if has_jokers(item) and not index.file(item).is_file():
        texts = match_files(item, index.folder)
        if not texts:
            refuse(f"no file matches {item!r} in {index.folder}")
    for text in texts:
        _require_utf8(str(index.file(text)))
    try:
        return [FINDERS[axis](text, index) for text in texts]
    except (RenderError, DatasetError, DeviceError) as error:
        refuse(str(error))


def _require_utf8(path: str) -> None:
    """Refuse a path that is not UTF-8, because results could not name it."""
    try:
        path.encode()
    except UnicodeEncodeError:
        shown = os.fsencode(path).decode("utf-8", "backslashreplace")
        refuse(f"must be UTF-8, which the path {shown} is not: rename it")


def _file(text: str, index: SourceIndex, known: Sequence[str], what: str, kind: str) -> PlanSource:
    """A file; refused if there is none, since nothing built in has this name either."""
    path = index.file(text)
    if not path.is_file():
        meant = likely_name(text, known) or likely_file(path)
        refuse(f"{text!r} is no {what} ({', '.join(known)}) and no file in {index.folder}{meant}")
    return PlanSource(kind, str(path), path.name, text, index.digest(str(path)))


def _object(text: str, index: SourceIndex) -> PlanSource:
    names = shape_names()
    if found := find_name(text, names):
        return PlanSource("built-in", found, found)
    if ":" in text and not index.file(text).is_file():
        from ...objects.functions.user_function import find_function_code, load_function

        where, _, function = text.rpartition(":")
        full = f"{index.file(where)}:{function}" if where.endswith(".py") else text
        index.code.append(find_function_code(full, index.namer).code)
        if index.allow_code is not None:
            load_function(full, allow_code=index.allow_code, namer=index.namer)
        return PlanSource("function", full, function, text, index.digest(full), function)
    kind = "volume" if is_volume(text) else "expression" if text.endswith(".json") else "mesh"
    source = _file(text, index, names, "built-in object", kind)
    if kind == "expression":
        from ...objects.functions.expression import load_expression

        load_expression(source.source)
    return source


def _hand(text: str, index: SourceIndex) -> PlanSource:
    if found := find_name(text, HANDS):
        return PlanSource(found, found, found)
    return _file(text, index, HANDS, "hand", "file")


def _motion(text: str, index: SourceIndex) -> PlanSource:
    if found := find_name(text, MOTIONS):
        return PlanSource(found, found, found)
    source = _file(text, index, MOTIONS, "motion", "poses")
    if Path(text).suffix.lower() not in MOTION_SUFFIXES:
        refuse(f"{text!r}: a motion is one of {', '.join(MOTION_SUFFIXES)}, or of {', '.join(MOTIONS)}")
    from ...intersection.named_inputs import is_recording

    return replace(source, kind="recording") if is_recording(source.source) else source


def _strategy(text: str, index: SourceIndex) -> PlanSource:
    if found := strategy_name(text):
        source = PlanSource("preset", found, found)
    else:
        source = _file(text, index, tuple(PRESETS), "strategy", "file")
        draft, code = draft_strategy(source.source)
        index.code += code
        if code and index.allow_code is None:
            return replace(source, loaded=draft)
    return replace(
        source, loaded=described_strategy(load_strategy(source.source, allow_code=index.allow_code or False))
    )


def _sampling(text: str, index: SourceIndex) -> PlanSource:
    if found := find_name(text, SAMPLING_PRESETS):
        source = PlanSource("preset", found, found)
    else:
        source = _file(text, index, tuple(SAMPLING_PRESETS), "sampling", "file")
    return replace(source, loaded=load_sampling(source.source))


def _array(text: str, index: SourceIndex) -> PlanSource:
    try:
        name = canonical_name(text)
        source = PlanSource("built-in", name, name)
    except UnknownArrayError:
        source = _file(text, index, array_names(), "array", "file")
    models = [entry.model for entry in load_rig(source.source)]  # arrays alike may differ in where they can focus
    identity = "+".join(model.identity() for model in models)
    return replace(source, loaded={"arrays": [model.name for model in models], "identity": identity})


FINDERS: dict[str, Callable[[str, SourceIndex], PlanSource]] = {
    "object": _object,
    "hand": _hand,
    "motion": _motion,
    "strategy": _strategy,
    "sampling": _sampling,
    "array": _array,
}


def described_strategy(strategy: IntersectionStrategy) -> dict[str, Any]:
    """Canonical JSON of a strategy: options that have their default are left out, user-defined stages have digests.

    Raises StrategyError if the source of a user-defined stage has changed since it was imported.
    """
    require_unedited(strategy)
    stages = {role: tuple(_shortest(role, stage) for stage in listed) for role, listed in strategy.stages().items()}
    shortest = replace(strategy, raw=stages["raw"][0], prune=stages["prune"], transform=stages["transform"])
    sources = stage_sources(strategy)
    return {**shortest.described(), **({"sources": sources} if sources else {})}


def _shortest(role: str, stage: Stage) -> Stage:
    defaults = find_stage(role, stage.name).defaults()
    return Stage(stage.name, {name: value for name, value in stage.options.items() if value != defaults[name]})


@lru_cache
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
