"""Content of a file of contours or frames that its format does not name.

A newer minor version or another program may have added it: it is no error, and is never read.
"""

from __future__ import annotations

from collections.abc import Mapping, Set
from os import PathLike

from ..errors import ContourFileError
from ..focus_files.frame_reader import DRIVES, FOCAL_POINTS, WIRE_FRAMES
from ..storage.digests import ATTRIBUTE
from ..storage.hdf5 import Hdf5Reader
from ..storage.schema import DIGESTS, FIELDS, FORMAT_NAME

_OF_FIELDS = frozenset({"units", "frame"})
_CONTOURS: Mapping[str, Set[str]] = {
    "/": {"format", "version", "strategy", "versions", "recipe", "device", "created", "seed", "raw_error"}
    | {"poses_inserted", ATTRIBUTE},
    "/digests": set[str](),
    "/contours": set[str](),
    "/metrics": set[str](),
    "/motion": {"offset", "provenance"},
    "/object": {"name", "hash", "placement", "attributes", "representation"},
    "/hand": {"description"},
    "/live": {"run"},
    "/timing": {"stages"},
    **{spec.path: _OF_FIELDS for spec in (*FIELDS, DIGESTS)},
}
_OF_FRAMES = {"format", "version", "recipe", "maker", "sampling", ATTRIBUTE}
_PROOF: Mapping[str, Set[str]] = {"/digests": set[str](), DIGESTS.path: set[str]()}
_KNOWN: Mapping[str, Mapping[str, Set[str]]] = {
    FORMAT_NAME: _CONTOURS,
    FOCAL_POINTS: {
        "/": _OF_FRAMES,
        "/focus": {"update_rate", "frame"},
        **dict.fromkeys(("/focus/position", "/focus/intensity"), _OF_FIELDS),
        **_PROOF,
    },
    DRIVES: {
        "/": _OF_FRAMES,
        "/drive": {"update_rate", "strategy"},
        "/array": {"names", "identities", "transducers", "carrier"},
        **dict.fromkeys(("/drive/delay", "/drive/amplitude", "/array/position", "/array/normal"), _OF_FIELDS),
        **_PROOF,
    },
    WIRE_FRAMES: {
        "/": {"format", "version", "sampling", "drive", "versions", "device", ATTRIBUTE},
        "/wire": {"update_rate", "refused", "switched", "count"},
        "/wire/frames": _OF_FIELDS,
        "/array": {"names", "identities", "frame_bytes"},
        **_PROOF,
    },
}
"""Names of the attributes of each group and dataset, by format and path."""


def unknown_content(path: str | PathLike[str]) -> list[str]:
    """Groups, datasets and attributes that a file's format does not name, a sentence each; a group stands for its own.

    Empty for a file that is not sealed, or cannot be read: `check_file` and `check_frames` report that.
    """
    try:
        with Hdf5Reader(path) as file:
            known = _KNOWN.get(str(file.attribute("/", "format")))
            return [] if known is None else _find_unknown(file.structure.attributes, known)
    except ContourFileError:
        return []


def unproven_attributes(file: Hdf5Reader) -> list[str]:
    """Attributes of groups that the format names and no digest proves, though the file has digests; a sentence each."""
    known, table = _KNOWN.get(str(file.attribute("/", "format")), {}), file.digest_table
    found = {} if table is None else file.structure.attributes
    return [
        f"attribute {name} of {path} has no digest"
        for path in sorted(found.keys() & known.keys() - file.structure.datasets.keys())
        for name in sorted(found[path])
        if name in known[path] and name != ATTRIBUTE and table is not None
        if name not in table.attributes.get(path, {})
    ]


def _find_unknown(found: Mapping[str, tuple[str, ...]], known: Mapping[str, Set[str]]) -> list[str]:
    sentences: list[str] = []
    for path in sorted(found):
        parent = path.rpartition("/")[0] or "/"
        if path in known:
            names = [name for name in found[path] if name not in known[path]]
            sentences += [f"attribute {name} of {path} is not of this format" for name in sorted(names)]
        elif parent in known:
            sentences.append(f"{path} is not of this format")
    return sentences
