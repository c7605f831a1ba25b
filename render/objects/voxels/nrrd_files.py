"""NRRD files as volumes: their data unpacked within bounds, and their axes as those of a volume."""

import io
import math
from pathlib import Path
from typing import Any

import numpy as np

from ....datasets.bounded_file import file_beside, open_regular, read_content, read_limited, unpack
from ...errors import VoxelError
from .grid import affine_of
from .values import require_room
from .volume_file import UNIT_NAMES, UNITS, VolumeFile, without_ones

RIGHT_SIGNS = {  # of a NRRD space's axes, to those of NIfTI: right, front, head
    "right-anterior-superior": (1.0, 1.0, 1.0),
    "ras": (1.0, 1.0, 1.0),
    "left-anterior-superior": (-1.0, 1.0, 1.0),
    "las": (-1.0, 1.0, 1.0),
    "left-posterior-superior": (-1.0, -1.0, 1.0),
    "lps": (-1.0, -1.0, 1.0),
}
CODECS = {"gzip": "gzip", "gz": "gzip", "bzip2": "bzip2", "bz2": "bzip2"}  # by NRRD's encoding
NRRD_BYTES_MOST = 8  # of one value: float64, and integers of 64 bits
BY_AXIS = ("space directions", "spacings", "units", "kinds")
PLACE_KINDS = ("domain", "space", "???", "none")  # of an axis along which a place changes, or may change


def nrrd_units(header: Any, field: str, unit: str | None) -> np.ndarray:
    """Metres in the units that a NRRD header gives for the first three axes, mm where it gives none; shape [3]."""
    said = [str(x).strip('" ').lower() for x in header.get(field) or []][:3]
    said = [x for x in said if x not in ("", "none", "nan", "???")] and said
    if unit is None and not set(said) <= UNIT_NAMES.keys():
        names = ", ".join(dict.fromkeys(said))
        raise VoxelError(f"{field} {names} are not known: give unit, one of {', '.join(UNITS)}")
    names = [unit] * 3 if unit else [UNIT_NAMES[x] for x in said] or ["mm"] * 3
    if len(names) != 3:
        raise VoxelError(f"{field} {', '.join(said)} must be three: give unit, one of {', '.join(UNITS)}")
    return np.array([UNITS[name] for name in names])


def nrrd_affine(header: Any, unit: str | None) -> np.ndarray | None:
    """The affine map of a NRRD header; the axes of an anatomical space turned to right, front, head, as NIfTI's."""
    axes = header.get("space directions")
    if axes is None:
        if (spacings := header.get("spacings")) is None:
            return None
        return affine_of(np.asarray(spacings, np.float64)[:3] * nrrd_units(header, "units", unit), None, None, None)
    rows = [np.asarray(row, np.float64) for row in axes if row is not None and np.isfinite(row).all()]
    if len(rows) != 3 or any(row.shape != (3,) for row in rows):
        raise VoxelError(f"space directions must be three vectors of three, not {axes}")
    out = np.eye(4)
    out[:3, :3] = np.stack(rows, axis=1)
    out[:3, 3] = np.asarray(header.get("space origin", np.zeros(3)), np.float64)
    out[:3] *= np.array(RIGHT_SIGNS.get(str(header.get("space", "")).lower(), (1.0, 1.0, 1.0)))[:, None]
    out[:3] *= nrrd_units(header, "space units", unit)[:, None]
    return out


def nrrd_volume(nrrd: Any, path: Path, unit: str | None) -> VolumeFile:
    """A NRRD file, attached or detached header; its data within the budget, and in its own folder.

    nrrd: the module of pynrrd.
    """
    with open_regular(path) as file:
        header = nrrd.read_header(file)
        require_room(tuple(header["sizes"]))
        name = header.pop("data file", header.pop("datafile", None))
        data = read_limited(file, "its data") if name is None else read_content(file_beside(path, str(name)))
    content, header = nrrd_content(data, header)
    values = nrrd.read_data(header, content)
    if content.read(1):
        raise VoxelError(f"holds more data than its sizes {list(header['sizes'])} say")
    values, header = without_lists(values, header)
    return VolumeFile(without_ones(values), nrrd_affine(header, unit))


def without_lists(values: np.ndarray, header: Any) -> tuple[np.ndarray, Any]:
    """Without axes of one entry that are none of space, such as that of a segmentation of one layer.

    These are the axes whose space direction is none, or whose kind is another than that of a place. Raises VoxelError
    for fields that do not have an entry for each axis.
    """
    by_axis = {name: list(header[name]) for name in BY_AXIS if header.get(name) is not None}
    if wrong := [name for name, entries in by_axis.items() if len(entries) != values.ndim]:
        raise VoxelError(f"{wrong[0]} must have {values.ndim} entries, one for each axis, not {header[wrong[0]]}")
    directions = by_axis.get("space directions")
    lists = []
    for axis, size in enumerate(values.shape):
        if directions is not None:
            is_list = directions[axis] is None or bool(np.isnan(directions[axis]).all())
        else:
            is_list = by_axis.get("kinds", ["domain"] * values.ndim)[axis] not in PLACE_KINDS
        lists += [axis] if is_list and size == 1 else []
    if values.ndim - len(lists) < 3:
        return values, header
    kept = {name: [entry for axis, entry in enumerate(own) if axis not in lists] for name, own in by_axis.items()}
    return values.squeeze(tuple(lists)), {**header, **kept}


def nrrd_content(data: bytes, header: Any) -> tuple[io.BytesIO, Any]:
    """Data without the lines to skip, then unpacked; and the header without that. Bytes are left for pynrrd to skip."""
    data = after_lines(data, int(header.get("line skip", header.get("lineskip", 0))))
    kept = {key: value for key, value in header.items() if key not in ("line skip", "lineskip")}
    codec = CODECS.get(str(header.get("encoding", "")).lower())
    if codec is None:
        return io.BytesIO(data), kept
    skip = int(header.get("byte skip", header.get("byteskip", 0)))  # -1: whatever is before the last bytes
    declared = None if skip < 0 else skip + NRRD_BYTES_MOST * math.prod(int(size) for size in header["sizes"])
    return io.BytesIO(unpack(data, codec, declared)), {**kept, "encoding": "raw"}


def after_lines(data: bytes, count: int) -> bytes:
    """Data without their first lines."""
    most = data.count(b"\n")
    if not 0 <= count <= most:
        raise VoxelError(f"line skip must be 0 to {most}, as many lines as the data have, not {count}")
    content = io.BytesIO(data)
    for _ in range(count):
        content.readline()
    return content.read()
