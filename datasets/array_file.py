"""NumPy's files, .npy and .npz, within the budget: their headers are validated before an array is made, and objects of
Python, which run code as they are read, are never read."""

import zipfile
from collections.abc import Collection
from pathlib import Path
from typing import IO, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from .bounded_file import open_regular, require_bytes

ONLY = ""
"""Name of the array that an .npy file holds."""


def read_arrays(path: Path, wanted: Collection[str] | None = None) -> dict[str, NDArray[Any]]:
    """Arrays of an .npz file by name, or the one of an .npy file as `ONLY`; the content decides which of the two it is.

    wanted: which to read where they are there; None: all.

    Raises:
        FileBoundError: It is no regular file; it, or its arrays together, hold more than the budget.
        OSError: From the system.
        ValueError: It is none, damaged, or holds objects of Python.
    """
    with open_regular(path) as file:
        try:
            if not zipfile.is_zipfile(file):
                file.seek(0)
                return {ONLY: _array(file, path.stat().st_size, 0)[0]}
            return _read_members(file, wanted)
        except (OSError, MemoryError):
            raise
        except Exception as error:  # zipfile, zlib, the parsers of Python's literals: each with errors of its own
            raise ValueError(f"not a NumPy file of arrays ({error or type(error).__name__})") from error


def array_shape(path: Path, name: str) -> tuple[int, ...]:
    """Shape of an array by its header alone; () if it has none; `read_arrays` raises the error then.

    name: in an .npz file; an .npy file has one array only. Raises OSError as `read_arrays`.
    """
    with open_regular(path) as file:
        try:
            if not zipfile.is_zipfile(file):
                file.seek(0)
                return _header(file)[0]
            with zipfile.ZipFile(file) as archive, archive.open(f"{name}.npy") as stream:
                return _header(stream)[0]
        except OSError:
            raise
        except Exception:  # as in `read_arrays`, which the caller calls next
            return ()


def _read_members(file: BinaryIO, wanted: Collection[str] | None) -> dict[str, NDArray[Any]]:
    found: dict[str, NDArray[Any]] = {}
    taken = 0
    with zipfile.ZipFile(file) as archive:
        for member in archive.infolist():
            name = member.filename.removesuffix(".npy")
            if name == member.filename or (wanted is not None and name not in wanted):
                continue
            with archive.open(member) as stream:
                found[name], taken = _array(stream, member.file_size, taken)
    return found


def _array(stream: IO[bytes], size: int, taken: int) -> tuple[NDArray[Any], int]:
    """The array that a stream of so many bytes holds, and the bytes of all so far."""
    shape, dtype = _header(stream)
    count = 1
    for length in shape:
        count *= int(length)
    if dtype.hasobject:
        raise ValueError("holds Python objects, which are never loaded")
    if dtype.itemsize == 0 or count * dtype.itemsize > size:
        raise ValueError(
            f"an array of shape {list(shape)} and type {dtype} does not fit the {size} bytes that are there"
        )
    require_bytes(taken + count * dtype.itemsize, "what its arrays hold")
    stream.seek(0)
    return np.lib.format.read_array(stream, allow_pickle=False), taken + count * dtype.itemsize


def _header(stream: IO[bytes]) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Shape and type of the array that a stream of the .npy format starts with."""
    read = np.lib.format.read_array_header_1_0
    if np.lib.format.read_magic(stream) != (1, 0):  # 2.0 and 3.0 differ from each other in the names of fields only
        read = np.lib.format.read_array_header_2_0
    shape, _, dtype = read(stream)
    if any(length < 0 for length in shape):
        raise ValueError(f"shape {list(shape)} is negative")
    return shape, dtype
