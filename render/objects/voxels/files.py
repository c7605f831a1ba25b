"""Volumes from files and into files: NumPy, NRRD, NIfTI, NanoVDB; their data unpacked within bounds."""

import gzip
import io
import logging
import math
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
import warp as wp

from ....datasets.array_file import ONLY, array_shape, read_arrays
from ....datasets.bounded_file import (
    FileBoundError,
    file_beside,
    open_regular,
    read_content,
    read_limited,
    require_bytes,
    unpack,
)
from ....datasets.errors import name_nothing
from ....datasets.known_names import likely_file
from ....datasets.storage.durable import NewFile
from ....kernels.solids.voxelise import gather_volume
from ...errors import VoxelError
from ...file_kinds import VOLUME_SUFFIXES
from ...user_warnings import warn_user
from ...validation import value_text
from .grid import affine_of, require_room

UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}  # [m]
UNIT_SPELLINGS = {
    "m": ("m", "meter", "metre"),
    "cm": ("cm", "centimeter", "centimetre"),
    "mm": ("mm", "millimeter", "millimetre"),
    "um": ("um", "µm", "micron", "micrometer", "micrometre"),
}
UNIT_NAMES = {name: unit for unit, names in UNIT_SPELLINGS.items() for name in names}


class VolumeFile(NamedTuple):
    """What a file says about a volume."""

    values: np.ndarray
    """Of any type, shape [i, j, k]."""
    affine: np.ndarray | None
    """Indices to coordinates [m], shape [4, 4]; None if the file has none."""
    kind: str | None = None
    """What the values mean, if the file says so."""
    level: float | None = None
    """Value on the surface, likewise."""


def scaled(affine: np.ndarray, unit: str) -> np.ndarray:
    """An affine map in metres."""
    out = np.array(affine, np.float64)
    out[:3] *= UNITS[unit]
    return out


def without_ones(values: np.ndarray) -> np.ndarray:
    """Without axes of length 1 beyond the third, which some writers add."""
    while values.ndim > 3 and values.shape[-1] == 1:
        values = values[..., 0]
    return values


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


def imported(module: str, package: str) -> Any:
    """A reader that palpate does not bring along."""
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        raise VoxelError(f"needs the package {package}: pip install {package}") from error


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


def read_nrrd(path: Path, unit: str | None) -> VolumeFile:
    """A NRRD file, attached or detached header; its data within the budget, and in its own folder."""
    nrrd = imported("nrrd", "pynrrd")
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


GRID_CLASS = 632  # byte of a NanoVDB grid that says what it holds
TREE = 672  # byte where its tree starts: offsets of leaves, lower and upper nodes and root, which starts with its box
LEVEL_SET, FOG = 1, 2
GRID_BYTES = 16  # byte where the first grid's metadata give its size, unpacked
ZIPPED = b"\x01\x00"  # NanoVDB's codec for zlib
NIFTI2 = (struct.pack("<i", 540), struct.pack(">i", 540))  # how files of NIfTI-2 begin
NIFTI_BEGIN = 540  # bytes of the longest header
SCALED_BYTES = 8  # of a value that a NIfTI file has a factor for: it becomes float64
CLASS_KINDS = {LEVEL_SET: ("distance", 0.0), FOG: ("intensity", 0.5)}


def is_volume(path: str | Path) -> bool:
    """Whether a file's name ends as that of a volume."""
    return str(path).lower().endswith(VOLUME_SUFFIXES)


def grid_of(arrays: Any, unit: str) -> np.ndarray | None:
    """The affine map that an .npz file's arrays give."""
    given = {name: arrays[name] for name in ("affine", "spacing", "origin", "direction") if name in arrays}
    if "affine" not in given and "spacing" not in given:
        return None
    return scaled(affine_of(**{"spacing": None, "origin": None, "direction": None, "affine": None, **given}), unit)


def read_numpy(path: Path, unit: str | None) -> VolumeFile:
    """An .npy file (values), or an .npz file with values and spacing, origin, direction or affine, and kind, level."""
    require_room(array_shape(path, "values"))
    found = read_arrays(path)
    if ONLY in found:
        return VolumeFile(found[ONLY], None)
    if "values" not in found:
        raise VoxelError(f"has no array 'values' (but {', '.join(found) or 'nothing'})")
    return VolumeFile(
        found["values"],
        grid_of(found, unit or "m"),
        str(found["kind"]) if "kind" in found else None,
        float(found["level"]) if "level" in found else None,
    )


def read_nifti(path: Path, unit: str | None) -> VolumeFile:
    """A NIfTI file, as its sform or qform says; without both, by method 1 of NIfTI-1: indices times spacings.

    nibabel would then turn x over and put the centre at 0, as files of Analyze 7.5 are often meant.
    """
    nibabel = imported("nibabel", "nibabel")
    with open_regular(path) as file, silenced(nibabel.imageglobals.logger):
        content: IO[bytes] = file
        if path.name.lower().endswith(".gz"):
            content = io.BytesIO(unpacked_nifti(nibabel, read_limited(file, "it")))
        kind = nibabel.Nifti2Image if content.read(4) in NIFTI2 else nibabel.Nifti1Image
        content.seek(0)
        image = kind.from_file_map({"image": nibabel.FileHolder(fileobj=content)})
        require_room(image.shape)
        scaling = image.dataobj.slope, image.dataobj.inter
        itemsize = image.get_data_dtype().itemsize if scaling == (1, 0) else SCALED_BYTES
        require_bytes(math.prod(image.shape) * itemsize, "what its values hold")
        values = np.asanyarray(image.dataobj)
        if isinstance(values, np.memmap):  # a file that is cut off while it is mapped kills the process
            values = np.array(values)
    affine = image.affine
    if not (int(image.header["sform_code"]) or int(image.header["qform_code"])):
        affine = np.diag([*np.abs(np.asarray(image.header["pixdim"], np.float64)[1:4]), 1.0])
    said = image.header.get_xyzt_units()[0]
    return VolumeFile(without_ones(values), scaled(affine, unit or UNIT_NAMES.get(said, "mm")))


def unpacked_nifti(nibabel: Any, content: bytes) -> bytes:
    """A NIfTI file unpacked by gzip, no longer than its header says; raises FileBoundError for one that goes on."""
    begin = unpack(content, "gzip", begin=NIFTI_BEGIN)
    kind = nibabel.Nifti2Header if begin[:4] in NIFTI2 else nibabel.Nifti1Header
    size = kind.sizeof_hdr
    if len(begin) < size:
        raise VoxelError(f"has {len(begin)} bytes, less than its header of {size}")
    header = kind(begin[:size], check=False)
    values = math.prod(int(count) for count in header.get_data_shape()) * header.get_data_dtype().itemsize
    return unpack(content, "gzip", max(int(header.get_data_offset()), size + 4) + values)


@contextmanager
def silenced(logger: logging.Logger) -> Iterator[None]:
    """Without what a library logs: nibabel's checks print what a header holds, control characters too."""
    before, logger.disabled = logger.disabled, True
    try:
        yield
    finally:
        logger.disabled = before


def nanovdb_content(content: bytes) -> bytes:
    """A NanoVDB file of one grid with nothing packed, within the budget; others as they are."""
    # Warp unpacks at one go whatever there is: https://www.openvdb.org/documentation/doxygen/NanoVDB_MainPage.html
    if len(content) < 192 or content[14:16] == b"\0\0":
        return content
    if content[14:16] != ZIPPED:
        raise VoxelError("is packed by a codec other than zip: nanovdb_convert --zip packs it anew")
    if (grids := struct.unpack_from("<H", content, 12)[0]) != 1:
        raise VoxelError(f"has {grids} grids; a file with one is needed")
    begin = 192 + struct.unpack_from("<I", content, 152)[0]
    if begin + 8 > len(content):
        raise VoxelError("ends before its grid")
    packed = content[begin + 8 : begin + 8 + struct.unpack_from("<Q", content, begin)[0]]
    unpacked = unpack(packed, "zlib", struct.unpack_from("<Q", content, GRID_BYTES)[0])
    front = bytearray(content[:begin])
    struct.pack_into("<H", front, 14, 0)
    struct.pack_into("<Q", front, 24, len(unpacked))
    return bytes(front) + unpacked


def read_nanovdb(path: Path, unit: str | None) -> VolumeFile:
    """The grid of a NanoVDB file: the box of its active voxels and a layer around it, looked up voxel by voxel."""
    volume = wp.Volume.load_from_nvdb(nanovdb_content(read_content(path)), device="cpu")
    info = volume.get_grid_info()
    if info.grid_count > 1:
        raise VoxelError(f"has {info.grid_count} grids; a file with one is needed")
    if volume.is_index or volume.dtype is not wp.float32:
        raise VoxelError(f"grid {info.name!r} holds {info.type_str}; float is needed")
    stored = volume.array().numpy()
    root = struct.unpack_from("<4q", stored, TREE)[3]
    box = np.array(struct.unpack_from("<6i", stored, TREE + root), np.int64).reshape(2, 3)
    low, high = box[0] - 1, box[1] + 1
    if (high - low < 2).any():
        raise VoxelError(f"grid {info.name!r} has no active voxels")
    shape = tuple(int(n) for n in high - low + 1)
    require_room(shape)
    affine = np.eye(4)
    affine[:3, :3] = np.array(info.transform_matrix, np.float64).reshape(3, 3)
    affine[:3, 3] = np.array(info.translation, np.float64) + affine[:3, :3] @ low
    kind, level = CLASS_KINDS.get(struct.unpack_from("<I", stored, GRID_CLASS)[0], (None, None))
    return VolumeFile(gather_volume(volume, low, shape), scaled(affine, unit or "m"), kind, level)


READERS: dict[str, Callable[[Path, str | None], VolumeFile]] = {
    ".npy": read_numpy,
    ".npz": read_numpy,
    ".nrrd": read_nrrd,
    ".nhdr": read_nrrd,
    ".nii": read_nifti,
    ".nii.gz": read_nifti,
    ".nvdb": read_nanovdb,
}


def read_volume(path: str | Path, unit: str | None = None) -> VolumeFile:
    """A volume as a file has it; raises VoxelError, naming the path, for one that cannot be read.

    unit: of the file's lengths, "m", "cm", "mm" or "um"; None: as the file says, else mm for NRRD and NIfTI, else m.
    """
    path = Path(path)
    if unit is not None and not (isinstance(unit, str) and unit in UNITS):
        raise VoxelError(f"unit must be one of {', '.join(UNITS)}, not {value_text(unit)}")
    reader = next((read for end, read in READERS.items() if path.name.lower().endswith(end)), None)
    if reader is None:
        way = " (OpenVDB's nanovdb_convert makes .nvdb of .vdb)" if path.suffix == ".vdb" else ""
        raise VoxelError(f"{path}: is no volume by its name, which should end in {', '.join(VOLUME_SUFFIXES)}{way}")
    if not path.exists():
        raise name_nothing(VoxelError(f"{path}: no such file{likely_file(path)}"))
    try:
        return reader(path, unit)
    except (VoxelError, FileBoundError) as error:
        raise VoxelError(f"{path}: {error}") from error
    except Exception as error:  # readers of many formats, each with errors of its own
        what = " ".join([f"{type(error).__name__}:", *str(error).split()]).removesuffix(":")
        raise VoxelError(f"{path}: cannot be read as a volume ({what})") from error


class WrittenVolume(NamedTuple):
    """What a file of voxels holds."""

    values: np.ndarray
    """0 and 1, or signed values below 0 inside, shape [i, j, k]."""
    kind: str
    """"occupancy" or "distance"."""
    affine: np.ndarray
    """Indices to coordinates [m], shape [4, 4]."""
    signed: np.ndarray
    """Signed values, also of an occupancy, float32."""


def write_npz(volume: WrittenVolume, temporary: Path) -> None:
    """Values, affine [m] and kind."""
    np.savez_compressed(temporary, values=volume.values, affine=volume.affine, kind=np.array(volume.kind))


def write_npy(volume: WrittenVolume, temporary: Path) -> None:
    """Values alone."""
    np.save(temporary, volume.values)


def write_nrrd(volume: WrittenVolume, temporary: Path) -> None:
    """Values with directions and origin in millimetres."""
    header = {
        "space": "right-anterior-superior",
        "space directions": volume.affine[:3, :3].T * 1e3,
        "space origin": volume.affine[:3, 3] * 1e3,
        "space units": ["mm"] * 3,
        "encoding": "gzip",
    }
    imported("nrrd", "pynrrd").write(str(temporary), volume.values, header)


def write_nifti(volume: WrittenVolume, temporary: Path) -> None:
    """Values with the affine map in millimetres, which NIfTI holds in float32."""
    nibabel = imported("nibabel", "nibabel")
    affine = volume.affine.copy()
    affine[:3] *= 1e3
    image = nibabel.Nifti1Image(volume.values, affine)
    image.header.set_xyzt_units("mm")
    content = image.to_bytes()  # nibabel leaves a file open that it cannot write
    temporary.write_bytes(gzip.compress(content, 1, mtime=0) if temporary.suffix == ".gz" else content)


def write_nanovdb(volume: WrittenVolume, temporary: Path) -> None:
    """Signed values as a level set of float; Warp writes grids along the axes only."""
    step = np.diag(volume.affine)[:3]
    if not (step > 0).all() or not np.allclose(volume.affine[:3, :3], np.diag(step), rtol=0, atol=1e-9 * step.max()):
        raise VoxelError("a turned or mirrored grid cannot be written as .nvdb; .npz, .nrrd and .nii can")
    low, most = tuple(volume.affine[:3, 3]), float(np.abs(volume.signed).max())
    sparse = wp.Volume.load_from_numpy(volume.signed, low, tuple(step), most, device="cpu")
    grid = sparse.array().numpy()  # the volume's own memory
    grid[GRID_CLASS : GRID_CLASS + 4].view(np.uint32)[0] = LEVEL_SET
    sparse.save_to_nvdb(str(temporary), codec="zip")


WRITERS: dict[str, Callable[[WrittenVolume, Path], None]] = {
    ".npz": write_npz,
    ".npy": write_npy,
    ".nrrd": write_nrrd,
    ".nii": write_nifti,
    ".nii.gz": write_nifti,
    ".nvdb": write_nanovdb,
}


def write_volume(volume: WrittenVolume, path: Path, *, overwrite: bool) -> None:
    """Write voxels in the format that a file's name ends with; errors as for `save_voxels`."""
    end = next((end for end in WRITERS if path.name.lower().endswith(end)), None)
    if end is None:
        raise VoxelError(f"{path}: voxels are written to {', '.join(WRITERS)}")
    if path.exists() and not overwrite:
        raise VoxelError(f"{path}: exists; overwrite=True replaces it")
    try:
        with NewFile(path, end) as new:
            WRITERS[end](volume, new.temporary)
    except VoxelError as error:
        raise VoxelError(f"{path}: {error}") from error
    except OSError as error:
        raise VoxelError(f"{path}: cannot be written ({error.strerror or f'the disk may be full: {error}'})") from error
    if end == ".npy":
        warn_user(f"{path}: an .npy file holds no spacing, origin or kind; .npz does")
