"""NumPy's files, .npy and .npz, within the budget: their headers are validated before an array is made, and objects of
Python, which run code as they are read, are never read."""

import math
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from .bounded_file import open_regular, require_bytes

ONLY = ""
"""Name of the array that an .npy file holds."""


def read_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """Arrays of an .npz file by name, or the one of an .npy file as `ONLY`; the content decides which of the two it is.

    Raises:
        FileBoundError: It is no regular file; it, or its arrays together, hold more than the budget.
        OSError: From the system.
        ValueError: It is none, damaged, or holds objects of Python.
    """
    found: dict[str, NDArray[Any]] = {}
    taken = 0
    try:
        for name, stream, size in _members(path):
            shape, dtype = _header(stream)
            if dtype.hasobject:
                raise ValueError("holds Python objects, which are never loaded")
            count = math.prod(shape) * dtype.itemsize
            if dtype.itemsize == 0 or count > size:
                raise ValueError(
                    f"an array of shape {list(shape)} and type {dtype} does not fit the {size} bytes that are there"
                )
            taken += count
            require_bytes(taken, "what its arrays hold")
            stream.seek(0)
            found[name] = np.lib.format.read_array(stream, allow_pickle=False)
    except (OSError, MemoryError):
        raise
    except Exception as error:  # zipfile, zlib, the parsers of Python's literals: each with errors of its own
        raise ValueError(f"not a NumPy file of arrays ({error or type(error).__name__})") from error
    return found


def array_shape(path: Path, name: str) -> tuple[int, ...]:
    """Shape of an array by its header alone; () if it has none; `read_arrays` raises the error then.

    name: in an .npz file; an .npy file has one array only. Raises OSError as `read_arrays`.
    """
    try:
        return next(_header(stream)[0] for own, stream, _ in _members(path) if own in (name, ONLY))
    except OSError:
        raise
    except Exception:  # as in `read_arrays`, which the caller calls next
        return ()


def _members(path: Path) -> Iterator[tuple[str, IO[bytes], int]]:
    """Name, stream and size [byte] of each array."""
    with open_regular(path) as file:
        if not zipfile.is_zipfile(file):
            file.seek(0)
            yield ONLY, file, path.stat().st_size
            return
        with zipfile.ZipFile(file) as archive:
            for member in archive.infolist():
                if member.filename.endswith(".npy"):
                    with archive.open(member) as stream:
                        yield member.filename.removesuffix(".npy"), stream, member.file_size


def _header(stream: IO[bytes]) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Shape and type of the array that a stream of the .npy format starts with."""
    read = np.lib.format.read_array_header_1_0
    if np.lib.format.read_magic(stream) != (1, 0):  # 2.0 and 3.0 differ from each other in the names of fields only
        read = np.lib.format.read_array_header_2_0
    shape, _, dtype = read(stream)
    if any(length < 0 for length in shape):
        raise ValueError(f"shape {list(shape)} is negative")
    return shape, dtype
