"""Volumes from files and into files: NumPy, NRRD, NIfTI, NanoVDB."""

import gzip
import io
import logging
import math
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np
import warp as wp

from ....datasets.array_file import ONLY, array_shape, read_arrays
from ....datasets.bounded_file import (
    FileBoundError,
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
from .grid import affine_of
from .nrrd_files import nrrd_volume
from .values import require_room
from .volume_file import UNIT_NAMES, UNITS, VolumeFile, scaled, without_ones

if TYPE_CHECKING:
    from .voxel_object import VoxelObject

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


def read_nrrd(path: Path, unit: str | None) -> VolumeFile:
    """A NRRD file, see `nrrd_volume`."""
    return nrrd_volume(imported("nrrd", "pynrrd"), path, unit)


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


def imported(module: str, package: str) -> Any:
    """A reader that palpate does not bring along."""
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        raise VoxelError(f"needs the package {package}: pip install {package}") from error


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


def signed_or_occupied(voxels: "VoxelObject") -> tuple[np.ndarray, str]:
    """Values to store and what they mean: 0 and 1 where nothing is between, else signed."""
    plain = voxels.rule.kind in ("occupancy", "label") and not voxels.rule.smooth
    return ((voxels.values < 0).astype(np.uint8), "occupancy") if plain else (np.array(voxels.values), "distance")


def write_npz(voxels: "VoxelObject", temporary: Path) -> None:
    """Values, affine [m] and kind."""
    values, kind = signed_or_occupied(voxels)
    np.savez_compressed(temporary, values=values, affine=voxels.affine, kind=np.array(kind))


def write_npy(voxels: "VoxelObject", temporary: Path) -> None:
    """Values alone."""
    np.save(temporary, signed_or_occupied(voxels)[0])


def write_nrrd(voxels: "VoxelObject", temporary: Path) -> None:
    """Values with directions and origin in millimetres."""
    header = {
        "space": "right-anterior-superior",
        "space directions": voxels.affine[:3, :3].T * 1e3,
        "space origin": voxels.affine[:3, 3] * 1e3,
        "space units": ["mm"] * 3,
        "encoding": "gzip",
    }
    imported("nrrd", "pynrrd").write(str(temporary), signed_or_occupied(voxels)[0], header)


def write_nifti(voxels: "VoxelObject", temporary: Path) -> None:
    """Values with the affine map in millimetres, which NIfTI holds in float32."""
    nibabel = imported("nibabel", "nibabel")
    affine = voxels.affine.copy()
    affine[:3] *= 1e3
    image = nibabel.Nifti1Image(signed_or_occupied(voxels)[0], affine)
    image.header.set_xyzt_units("mm")
    content = image.to_bytes()  # nibabel leaves a file open that it cannot write
    temporary.write_bytes(gzip.compress(content, 1, mtime=0) if temporary.suffix == ".gz" else content)


def write_nanovdb(voxels: "VoxelObject", temporary: Path) -> None:
    """Signed values as a level set of float; Warp writes grids along the axes only."""
    step = np.diag(voxels.affine)[:3]
    if not (step > 0).all() or not np.allclose(voxels.affine[:3, :3], np.diag(step), rtol=0, atol=1e-9 * step.max()):
        raise VoxelError("a turned or mirrored grid cannot be written as .nvdb; .npz, .nrrd and .nii can")
    values = np.array(voxels.values)
    volume = wp.Volume.load_from_numpy(
        values, tuple(voxels.affine[:3, 3]), tuple(step), float(np.abs(values).max()), device="cpu"
    )
    grid = volume.array().numpy()  # the volume's own memory
    grid[GRID_CLASS : GRID_CLASS + 4].view(np.uint32)[0] = LEVEL_SET
    volume.save_to_nvdb(str(temporary), codec="zip")


WRITERS: dict[str, Callable[["VoxelObject", Path], None]] = {
    ".npz": write_npz,
    ".npy": write_npy,
    ".nrrd": write_nrrd,
    ".nii": write_nifti,
    ".nii.gz": write_nifti,
    ".nvdb": write_nanovdb,
}


def save_voxels(voxels: "VoxelObject", path: str | Path, *, overwrite: bool = False) -> None:
    """Write voxels, as placed: .npz, .npy (values only), .nrrd, .nii, .nii.gz, or .nvdb (along the axes only).

    Values that are signed are written as they are, occupancy and labels as 0 and 1. Raises VoxelError for another name,
    for what the format cannot hold, and for a file that is there unless `overwrite`, which replaces it once the new one
    is whole.

    >>> from palpate.render import MeshObject, VoxelObject, save_voxels, voxelise
    >>> save_voxels(voxelise(MeshObject.load("cube"), spacing=0.02), "cube.npz")
    >>> VoxelObject.load("cube.npz")
    VoxelObject('cube.npz', 216 voxels inside, 130 x 130 x 130 mm at (0, 0, 0.2) m)
    """
    path = Path(path)
    end = next((end for end in WRITERS if path.name.lower().endswith(end)), None)
    if end is None:
        raise VoxelError(f"{path}: voxels are written to {', '.join(WRITERS)}")
    if path.exists() and not overwrite:
        raise VoxelError(f"{path}: exists; overwrite=True replaces it")
    try:
        with NewFile(path, end) as new:
            WRITERS[end](voxels, new.temporary)
    except VoxelError as error:
        raise VoxelError(f"{path}: {error}") from error
    except OSError as error:
        raise VoxelError(f"{path}: cannot be written ({error.strerror or f'the disk may be full: {error}'})") from error
    if end == ".npy":
        warn_user(f"{path}: an .npy file holds no spacing, origin or kind; .npz does")
