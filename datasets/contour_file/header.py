"""The header of a contour file: everything known before the first pose is rendered, and the recipe it makes."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from ..errors import ContourFileError
from ..json_text import parse_json
from ..storage.hdf5 import Attribute, Hdf5Reader, get_version
from ..storage.schema import (
    DIGESTS_SINCE,
    FORMAT_NAME,
    FORMAT_VERSION,
    HAND,
    LIVE,
    MOTION,
    OBJECT,
    Arrays,
    validate_fields,
)
from .header_hand import require_hand, require_quaternions
from .header_live import require_live


class TextSource(Protocol):
    """An object with text attributes."""

    @property
    def path(self) -> Path:
        """Path for error messages."""
        ...

    def text(self, name: str, key: str) -> str:
        """An attribute that must be there and be text."""
        ...


@dataclass(frozen=True)
class FileHeader:
    """Everything of a contour file that is known before the first pose is rendered.

    Arrays are kept as given and must have the file's dtypes: nothing is converted silently. They are not to be changed
    afterwards: their hashes are taken once.
    JSON means what `json.dumps` takes, without NaN and infinities.
    """

    pose: NDArray[np.float32]
    """Hand frame -> array frame: position [m], quaternion xyzw [1], shape [pose, 7]."""
    time: NDArray[np.float64] | None
    """Time of each pose [s], shape [pose], increasing; None where poses have no time."""
    object_name: str
    """A built-in name, or what the mesh file was called."""
    vertices: NDArray[np.float32]
    """The object's mesh where it was rendered, array frame [m], shape [vertex, 3]."""
    faces: NDArray[np.int32]
    """Triangles, offsets into `vertices`, shape [face, 3]."""
    hand: Mapping[str, Any]
    """JSON of the hand: its kind, its patches."""
    strategy: Mapping[str, Any]
    """JSON of the intersection strategy."""
    versions: Mapping[str, str]
    """Versions of the software that renders; `palpate` is required."""
    device: str
    """The Warp device that renders, as `cuda:0`."""
    placement: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """JSON of how the mesh was brought to where it is."""
    representation: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """JSON of what was rendered if not the mesh itself (voxels, a function), hash included; the mesh is its outline."""
    moved: NDArray[np.float32] | None = None
    """Where the middle of the object is at each pose, and how it is turned, as `pose`; None: as placed."""
    hand_arrays: Mapping[str, NDArray[Any]] = field(default_factory=dict[str, NDArray[Any]])
    """Arrays of /hand by name; `hand` must contain their hash."""
    object_attributes: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """JSON, anything else worth keeping of the object (source file, repairs while loading)."""
    time_offset: float = 0.0
    """What the recording's clock read at time 0 [s]."""
    seed: int | None = None
    """Seed of whatever was random."""
    inserted: int = 0
    """How many of the poses were put between two of the motion that was recorded or made."""
    provenance: Mapping[str, Any] | None = None
    """JSON, what made a synthetic motion; not in the recipe, which has the poses."""
    raw_error: float | None = None
    """How far the raw intersection can be from the exact one [m]; None where that is not known; not in the recipe."""
    live: Mapping[str, Any] | None = None
    """JSON of the live run that this is the recording of (`RecordedRun`); not in the recipe, which has the poses."""
    live_arrays: Mapping[str, NDArray[Any]] = field(default_factory=dict[str, NDArray[Any]])
    """Arrays of /live by name; empty for what is no live run."""
    created: str = field(default_factory=lambda: datetime.now(UTC).isoformat(timespec="microseconds"))
    """ISO 8601 time of creation; together with the recipe it identifies a run."""

    @property
    def pose_count(self) -> int:
        """Number of poses."""
        return int(self.pose.shape[0])

    @cached_property
    def object_hash(self) -> str:
        """SHA-256 (hexadecimal) of the vertices' bytes, then the faces' bytes, little endian."""
        return _digest(self.vertices, self.faces)

    @cached_property
    def motion_hash(self) -> str:
        """SHA-256 (hexadecimal) of the poses' bytes, then the times' bytes if any, little endian."""
        return _digest(self.pose, *([] if self.time is None else [self.time]))

    @cached_property
    def recipe(self) -> dict[str, str]:
        """Everything that determines the data, as text by field; runs with equal recipes may be joined.

        Left out: the device, dates, other software's versions, free attributes.
        """
        recipe = {
            "format": ".".join(map(str, FORMAT_VERSION)),
            "palpate": self.versions["palpate"],
            "object": f"{self.object_name} sha256:{self.object_hash}",
            "placement": json_text(self.placement, "placement"),
            "motion": f"{self.pose_count} poses sha256:{self.motion_hash}",
            "hand": json_text(self.hand, "hand"),
            "strategy": json_text(self.strategy, "strategy"),
        }
        if self.representation:
            recipe["representation"] = json_text(self.representation, "representation")
        if self.moved is not None:
            recipe["object motion"] = f"sha256:{_digest(self.moved)}"
        return recipe

    def validate(self) -> None:
        """Refuse what a file cannot hold.

        Raises:
            ContourFileError: An array of another dtype or shape, no pose, a motion that is not finite or not sorted,
                a face beyond the vertices, poses of the object or of patches without a rotation, arrays of a hand that
                do not fit its description, a text with NUL, something that is not JSON, `versions` without palpate.
        """
        arrays = self.arrays()
        if unknown := sorted(set(self.hand_arrays) - {spec.name for spec in HAND}):
            raise ContourFileError(f"/hand has no field {unknown[0]!r}")
        for group in (MOTION, OBJECT, HAND, LIVE):
            names = {spec.name for spec in group}
            validate_fields({name: array for name, array in arrays.items() if name in names}, group)
        if self.pose_count == 0:
            raise ContourFileError("/motion/pose has no rows, at least 1 pose is needed")
        if not np.isfinite(self.pose).all():
            row = int(np.flatnonzero(~np.isfinite(self.pose).all(axis=1))[0])
            raise ContourFileError(f"/motion/pose row {row} is not finite: {self.pose[row].tolist()}")
        if self.time is not None and not (np.isfinite(self.time).all() and (np.diff(self.time) > 0).all()):
            raise ContourFileError("/motion/time must be finite and increase from pose to pose")
        if self.faces.size and not (self.faces.min() >= 0 and self.faces.max() < len(self.vertices)):
            raise ContourFileError(
                f"/object/faces points at vertices {self.faces.min()} to {self.faces.max()} of {len(self.vertices)}"
            )
        if self.moved is not None:
            if len(self.moved) != self.pose_count:
                raise ContourFileError(f"/object/moved must be {self.pose_count} poses, as many as /motion/pose")
            require_quaternions("/object/moved", self.moved)
        require_hand(self.hand, self.hand_arrays, self.pose_count)
        require_live(self.live, {name: len(array) for name, array in self.live_arrays.items()}, self.pose_count)
        if self.raw_error is not None and not 0.0 <= self.raw_error < math.inf:
            raise ContourFileError(f"raw_error must be a finite length, not {self.raw_error!r} m")
        if not math.isfinite(self.time_offset):
            raise ContourFileError(f"time_offset must be finite, got {self.time_offset!r} s")
        if "palpate" not in self.versions:
            raise ContourFileError(f"versions must name palpate, but only has {sorted(self.versions)}")
        for name in ("object_name", "device", "created"):
            _check_text(getattr(self, name), name)
        for name in ("hand", "strategy", "versions", "placement", "representation", "object_attributes"):
            json_text(getattr(self, name), name)

    def arrays(self) -> Arrays:
        """The arrays of /motion, /object, /hand and /live by their names, those that are there."""
        arrays: Arrays = {"pose": self.pose, "vertices": self.vertices, "faces": self.faces, **self.hand_arrays}
        arrays |= self.live_arrays
        optional = {"time": self.time, "moved": self.moved}
        return arrays | {name: array for name, array in optional.items() if array is not None}


def recipe_differences(old: Mapping[str, str], new: Mapping[str, str]) -> list[str]:
    """Fields in which two recipes differ, one clause each with both values shortened; empty if there are none."""
    names = [*new, *(name for name in old if name not in new)]
    pairs = [(name, old.get(name, "absent"), new.get(name, "absent")) for name in names]
    return [f"{name} was {_short(a, b)} and is now {_short(b, a)}" for name, a, b in pairs if a != b]


def recipe_hash(recipe: Mapping[str, str]) -> str:
    """SHA-256 (hexadecimal) of a recipe; every block carries it, so that none of another run is taken for ours."""
    return hashlib.sha256(json_text(recipe, "recipe").encode()).hexdigest()


def json_text(value: Mapping[str, Any], name: str) -> str:
    """Canonical JSON of a mapping: sorted names, ASCII; `name` is what an error calls it.

    Raises:
        ContourFileError: The value is not JSON, or no reader would take it.
    """
    try:
        text = json.dumps(dict(value), sort_keys=True, allow_nan=False, ensure_ascii=True)
        parse_json(text)  # a reader must take it
        return text
    except (TypeError, ValueError, RecursionError) as error:
        raise ContourFileError(f"{name} cannot be stored as JSON: {error}") from error


def header_attributes(header: FileHeader) -> dict[str, dict[str, Attribute]]:
    """Attributes that a file stores for its header, by group."""
    root: dict[str, Attribute] = {
        "format": FORMAT_NAME,
        "version": np.array(FORMAT_VERSION, dtype="<i4"),
        "strategy": json_text(header.strategy, "strategy"),
        "versions": json_text(header.versions, "versions"),
        "recipe": json_text(header.recipe, "recipe"),
        "device": header.device,
        "created": header.created,
    }
    if header.seed is not None:
        root["seed"] = header.seed
    if header.raw_error is not None:
        root["raw_error"] = header.raw_error
    if header.inserted:
        root["poses_inserted"] = header.inserted
    placed: dict[str, Attribute] = {
        "name": header.object_name,
        "hash": header.object_hash,
        "placement": json_text(header.placement, "placement"),
        "attributes": json_text(header.object_attributes, "object_attributes"),
    }
    if header.representation:
        placed["representation"] = json_text(header.representation, "representation")
    hand = json_text(header.hand, "hand")
    motion: dict[str, Attribute] = {"offset": header.time_offset}
    if header.provenance is not None:
        motion["provenance"] = json_text(header.provenance, "provenance")
    groups: dict[str, dict[str, Attribute]] = {
        "/": root,
        "/motion": motion,
        "/hand": {"description": hand},
        "/object": placed,
    }
    if header.live is not None:
        groups["/live"] = {"run": json_text(header.live, "live")}
    return groups


def get_header(file: Hdf5Reader, *, with_live: bool = True) -> FileHeader:
    """Read the header back, arrays included; raises ContourFileError where it is missing or damaged.

    with_live: whether what is known of a live run is read, too, which may be many arrays of a hundred megabytes.
    """
    return FileHeader(
        pose=file.read("/motion/pose"),
        time=file.read("/motion/time") if "/motion/time" in file else None,
        object_name=file.text("/object", "name"),
        vertices=file.read("/object/vertices"),
        faces=file.read("/object/faces"),
        hand=get_json(file, "/hand", "description"),
        strategy=get_json(file, "/", "strategy"),
        versions=get_texts(file, "/", "versions"),
        device=file.text("/", "device"),
        placement=get_json(file, "/object", "placement"),
        representation=get_representation(file),
        moved=file.read("/object/moved") if "/object/moved" in file else None,
        hand_arrays={spec.name: file.read(spec.path) for spec in HAND if spec.path in file},
        object_attributes=get_json(file, "/object", "attributes"),
        time_offset=file.number("/motion", "offset") or 0.0,
        seed=file.whole("/", "seed"),
        inserted=file.whole("/", "poses_inserted") or 0,
        provenance=get_provenance(file),
        raw_error=file.number("/", "raw_error"),
        live=get_live(file) if with_live else None,
        live_arrays={spec.name: file.read(spec.path) for spec in LIVE if with_live and spec.path in file},
        created=file.text("/", "created"),
    )


def get_json(file: TextSource, name: str, key: str) -> dict[str, Any]:
    """A JSON object kept in an attribute; raises ContourFileError where it is missing or not one."""
    try:
        value: Any = parse_json(file.text(name, key))
    except ValueError as error:
        raise ContourFileError(f"{file.path}: attribute {key} of {name} is not JSON: {error}") from error
    if not isinstance(value, dict):
        raise ContourFileError(f"{file.path}: attribute {key} of {name} is not a JSON object")
    return cast(dict[str, Any], value)


def get_provenance(file: Hdf5Reader) -> dict[str, Any] | None:
    """What made a synthetic motion; None for another, and for a file older than 1.3."""
    is_there = file.attribute("/motion", "provenance") is not None
    return get_json(file, "/motion", "provenance") if is_there else None


def get_live(file: Hdf5Reader) -> dict[str, Any] | None:
    """JSON of the live run that a file is the recording of; None for any other file."""
    return get_json(file, "/live", "run") if file.attribute("/live", "run") is not None else None


def get_texts(file: TextSource, name: str, key: str) -> dict[str, str]:
    """A JSON object of texts kept in an attribute; raises ContourFileError as `get_json`."""
    values = get_json(file, name, key)
    if odd := next((key for key, value in values.items() if not isinstance(value, str)), None):
        raise ContourFileError(f"{file.path}: attribute {key} of {name} has no text for {odd!r}")
    return values


def get_representation(file: Hdf5Reader) -> dict[str, Any]:
    """JSON of what was rendered if not the mesh itself; empty for a mesh."""
    known = file.attribute("/object", "representation") is not None
    return get_json(file, "/object", "representation") if known else {}


_OTHER_FILES = {
    "palpate focal points": "focal points, which palpate play plays, and palpate info tells of",
    "palpate drives": "drives of arrays, of which palpate info tells; what can be played are contours and focal points",
    "palpate wire frames": "wire bytes of arrays, which palpate play plays, and palpate info tells of",
}


def refuse_foreign(file: Hdf5Reader) -> None:
    """Raise ContourFileError unless the file is a contour file of a version that this reader understands."""
    found = file.attribute("/", "format")
    if not isinstance(found, str) or found != FORMAT_NAME:  # an array would be compared number by number
        description = _OTHER_FILES.get(found) if isinstance(found, str) else None
        what = f"it holds {description}" if description else f"its root has no format {FORMAT_NAME!r}"
        raise ContourFileError(f"{file.path} is HDF5, but not a contour file: {what}")
    major, minor = get_version(file)
    if major > FORMAT_VERSION[0]:
        raise ContourFileError(
            f"{file.path} has format version {major}.{minor}, newer than this palpate reads ({FORMAT_VERSION[0]}.x)"
        )
    if (major, minor) >= DIGESTS_SINCE and file.digests is None:
        raise ContourFileError(f"{file.path}: attribute digests of / has no digests of whole datasets, as 1.5 has")


def _digest(*arrays: NDArray[Any]) -> str:
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<")).data)
    return digest.hexdigest()


def _short(text: str, other: str, *, width: int = 60) -> str:
    """The part of a text where it begins to differ from another, with a little before it."""
    differing = (index for index, (a, b) in enumerate(zip(text, other, strict=False)) if a != b)
    common = next(differing, min(len(text), len(other)))
    first = 0 if len(text) <= width else max(0, common - width // 3)
    part = text[first : first + width]
    return f"{'...' if first else ''}{part}{'...' if first + width < len(text) else ''}"


def _check_text(text: str, name: str) -> None:
    try:
        encoded = text.encode()
    except UnicodeEncodeError as error:
        raise ContourFileError(f"{name} {text!r} is not valid Unicode") from error
    if b"\0" in encoded:
        raise ContourFileError(f"{name} {text!r} contains a NUL character")
