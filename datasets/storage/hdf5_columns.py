"""Named columns in HDF5, as tables and shards have them; images are built in memory: HDF5 never meets a full disk.

What goes wrong is a SweepStoreError that names the file.
"""

from __future__ import annotations

import secrets
import struct
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ..errors import Hdf5Error, SweepStoreError, name_nothing
from .checksum import lookup3
from .hdf5 import FAILURES, reason_of
from .hdf5_declared import h5py
from .hdf5_opening import StrictFile, open_hdf5

Values = Sequence[Any] | NDArray[Any]
"""A column: an array, or a list of str, float, int, bool and None."""

Columns = dict[str, NDArray[Any]]
"""Columns of equal length, by name."""

CHUNK_ROWS = 1 << 16
"""Rows of a chunk of a column, each with a checksum."""

BOOL = "bool"
"""Attribute `dtype` of a column of 0 and 1 that is true and false, as xarray has it."""

_FORMAT = ("v108", "v108")  # object headers with checksums, and files that every reader of today reads
_SUPERBLOCK_BYTES, _CHECKSUM_AT = 48, 44  # of version 2
_INT_LEAST, _INT_MOST = -(1 << 63), (1 << 63) - 1


def column_array(name: str, values: Values) -> NDArray[Any]:
    """A column as an array that both HDF5 and Parquet hold: bool, a number type, or object for text.

    | list has | becomes | None is |
    |---|---|---|
    | only bool | bool | - |
    | bool or int, with None | float64 | NaN |
    | int, bool | int64 | - |
    | float with any of these; None alone | float64 | NaN |
    | str | object, of str | "" |

    An array of numbers keeps its dtype.

    Raises:
        SweepStoreError: A mixture of text and numbers, an int beyond 64 bits, text with a null character or half a
            surrogate pair, or anything else; names the column.
    """
    array = np.asarray(values) if isinstance(values, np.ndarray) else None
    if array is not None and array.ndim != 1:
        raise SweepStoreError(f"column {name} has shape {list(array.shape)}; a column has one dimension")
    if array is not None and array.dtype.kind in "biuf":
        return array.astype(array.dtype.newbyteorder("="), copy=False)
    items = cast("list[Any]", array.tolist() if array is not None else list(values))
    return _list_array(name, items)


def _list_array(name: str, items: list[Any]) -> NDArray[Any]:
    kinds = {_kind_of(item) for item in items}
    if kinds == {"text"} or kinds == {"text", "none"}:
        return _text_array(name, ["" if item is None else str(item) for item in items])
    unknown = kinds - {"none", "bool", "int", "float"}
    if unknown:
        raise SweepStoreError(f"column {name} mixes {', '.join(sorted(kinds))}; one of text or numbers is a column")
    if kinds == {"bool"}:
        return np.array(items, np.bool_)
    if kinds and kinds <= {"bool", "int"}:
        beyond = next((item for item in items if not _INT_LEAST <= item <= _INT_MOST), None)
        if beyond is not None:
            raise SweepStoreError(f"column {name} has {beyond}, beyond 64 bits")
        return np.array(items, np.int64)
    return np.array([np.nan if item is None else float(item) for item in items], np.float64)


def _text_array(name: str, items: list[str]) -> NDArray[Any]:
    for number, item in enumerate(items):
        if "\0" in item or (not item.isascii() and any(0xD800 <= ord(sign) < 0xE000 for sign in item)):
            raise SweepStoreError(f"row {number} of column {name} is {item!r}, which is not text that files hold")
    texts = np.empty(len(items), object)
    texts[:] = items
    return texts


def _kind_of(item: Any) -> str:
    if item is None:
        return "none"
    if isinstance(item, bool | np.bool_):
        return "bool"
    if isinstance(item, int | np.integer):
        return "int"
    if isinstance(item, float | np.floating):
        return "float"
    return "text" if isinstance(item, str) else type(cast(object, item)).__name__


def column_arrays(columns: Mapping[str, Values]) -> Columns:
    """All columns as arrays; raises SweepStoreError where lengths or names are impossible."""
    arrays = {name: column_array(name, values) for name, values in columns.items()}
    counts = {len(array) for array in arrays.values()}
    if len(counts) > 1:
        shown = ", ".join(f"{name}: {len(array)}" for name, array in list(arrays.items())[:8])
        raise SweepStoreError(f"columns of a table have equally many rows, not {shown}")
    for name in arrays:
        if not name or "/" in name or name == "." or not name.isprintable():
            raise SweepStoreError(f"{name!r} cannot name a column: it is empty, or has a slash or a control character")
    return arrays


def put_column(group: Any, name: str, array: NDArray[Any], unit: str = "") -> Any:
    """Write a column into an open HDF5 group, with checksums where HDF5 can; the dataset."""
    text = array.dtype.kind == "O"
    chunked: dict[str, Any] = {"chunks": (min(len(array), CHUNK_ROWS),), "fletcher32": True} if len(array) else {}
    stored = array.astype(np.int8) if array.dtype.kind == "b" else array
    dataset: Any = group.create_dataset(
        name,
        data=stored,
        track_times=False,
        **({"dtype": h5py.string_dtype("utf-8")} if text else chunked),
    )
    if array.dtype.kind == "b":
        dataset.attrs["dtype"] = BOOL
    if unit:
        dataset.attrs["units"] = unit
    return dataset


def take_columns(file: StrictFile, paths: Sequence[str]) -> list[NDArray[Any]]:
    """Columns of an open HDF5 file, as `column_array` gave them; raises Hdf5Error for what are none, or too much."""
    file.require_memory(paths)
    return [_take_column(file, path) for path in paths]


def _take_column(file: StrictFile, path: str) -> NDArray[Any]:
    if len(shape := file.declared(path).shape) != 1:
        raise Hdf5Error(f"{path} has shape {list(shape)}, expected one dimension")
    array = file.read(path)
    stored_dtype = file.attribute(path, "dtype")
    return array.astype(np.bool_) if isinstance(stored_dtype, str) and stored_dtype == BOOL else array


@contextmanager
def new_image() -> Generator[Any, None, None]:
    """An HDF5 file in memory, open for writing."""
    file: Any = h5py.File(
        f"image-{secrets.token_hex(8)}",  # two of one name cannot be open at once, and workers may be threads
        "w",
        driver="core",
        backing_store=False,
        block_size=1 << 20,
        libver=_FORMAT,
        track_order=True,
    )
    try:
        yield file
    finally:
        file.close()


def image_of(file: Any) -> memoryview:
    """The bytes of an image so far.

    libhdf5 before version 2.0 clears the flag of a file that is being written in the copy that it gives, and leaves a
    checksum of the flag set, so that no reader opens the copy: the checksum is computed again.
    """
    file.flush()
    image: bytes = file.id.get_file_image()
    head = image[:_CHECKSUM_AT]
    superblock = head + struct.pack("<I", lookup3(head))
    return memoryview(image if image.startswith(superblock) else superblock + image[_SUPERBLOCK_BYTES:])


@contextmanager
def open_columns(path: Path, content: bytes | None = None) -> Generator[StrictFile, None, None]:
    """An HDF5 file open for reading, see `open_hdf5`; failures within name it (SweepStoreError)."""
    with naming_failures(path), open_hdf5(path, content) as file:
        yield file


@contextmanager
def naming_failures(path: Path) -> Generator[None, None, None]:
    """Turns what h5py and the system raise for a bad file into one sentence."""
    try:
        yield
    except SweepStoreError:
        raise
    except FileNotFoundError:
        raise name_nothing(SweepStoreError(f"{path} does not exist")) from None
    except Hdf5Error as error:
        raise SweepStoreError(f"{path}: {error}") from None
    except FAILURES as error:
        raise SweepStoreError(f"{path} {reason_of(error, 'read')}") from error
