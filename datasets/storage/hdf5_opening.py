"""Strict opening of HDF5 for reading: only what a caller names is opened, and each such object is validated first.

    with open_hdf5(path) as opened:
        opened.declared("/rows").shape         # the dataset's header; reads no data
        opened.read("/rows", first, stop)      # checked first: the rows are in the file and fit into memory
        opened.attribute("/", "format")        # a plain value of bounded size

Refused are soft, external and user-defined links on the way, as they lead to other names and other files; declarations
that palpate's files never have (hdf5_declared.py); rows that are not in the file (hdf5_chunks.py). Whatever else the
file holds is never opened. Refused content raises `Hdf5Error`; its message names the path inside the file, the value
and the bound, but not the file, which the caller prepends. Exceptions of h5py for damaged files (`hdf5.FAILURES`) pass
through.

HDF5 reads the file through a handle and not by name. It therefore takes no lock and does not notice that the same
process may have the file open in h5py, for reading or writing.
"""

from __future__ import annotations

import math
from os import PathLike
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ..errors import Hdf5Error
from .hdf5_chunks import require_chunks, require_room
from .hdf5_declared import Declared, declaration_of, h5py, require_attribute
from .hdf5_source import ByteSource

_h5a, _h5d, _h5g, _h5l, _h5o = h5py.h5a, h5py.h5d, h5py.h5g, h5py.h5l, h5py.h5o

MEMORY_MOST = 1 << 30
"""Most memory of one read [byte], plus 8 times the file's size, as compressed data grow when read."""
Attribute = str | int | float | NDArray[Any]
"""Value of an attribute."""


def open_hdf5(path: str | PathLike[str]) -> StrictFile:
    """Open a file.

    Raises:
        OSError: From the system: FileNotFoundError, IsADirectoryError, PermissionError.
        Hdf5Error: Not a regular file, or an empty file.
        Exception: From h5py for a foreign or damaged file (`hdf5.FAILURES`).
    """
    source = ByteSource(path)
    try:
        return StrictFile(source)
    except BaseException:
        source.close()
        raise


class StrictFile:
    """An open HDF5 file whose objects are validated when they are first asked for; a context manager."""

    def __init__(self, source: ByteSource) -> None:
        self._source = source
        if source.size == 0:
            raise Hdf5Error("the file is empty")
        with source.bounded():
            self._file: Any = h5py.File(source, "r")
            self._objects: dict[str, Any] = {"/": _h5g.open(self._file.id, b"/")}
            self._paths = {int(_h5o.get_info(self._objects["/"]).addr): "/"}
        self._declared: dict[str, Declared] = {}
        self._datasets: dict[str, Any] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; closing twice does nothing."""
        self._datasets.clear()
        self._objects.clear()
        self._file.close()
        self._source.close()

    def state(self) -> tuple[int, int]:
        """Size [byte] and modification time [ns] of the opened file."""
        return self._source.state()

    def __contains__(self, path: str) -> bool:
        """Whether a group or dataset is there; raises Hdf5Error where a link on the way leads elsewhere."""
        return self._object(path) is not None

    def _object(self, path: str) -> Any:
        """The opened group or dataset; None if there is none."""
        if path not in self._objects:
            if path == "/":
                raise Hdf5Error("the file was closed")
            parent, _, name = path.rpartition("/")
            group = self._object(parent or "/")
            if group is None:
                return None
            if not isinstance(group, _h5g.GroupID):
                raise Hdf5Error(f"{parent} is a dataset, expected a group")
            with self._source.bounded():
                if not group.links.exists(name.encode()):
                    return None
                if (kind := int(group.links.get_info(name.encode()).type)) != _h5l.TYPE_HARD:
                    kinds = {_h5l.TYPE_SOFT: "a soft link", _h5l.TYPE_EXTERNAL: "a link to another file"}
                    what = kinds.get(kind, f"a link of type {kind}")
                    raise Hdf5Error(f"{path} is {what}, expected an object of this file")
                found = _h5o.open(group, name.encode())
                known = self._paths.setdefault(int(_h5o.get_info(found).addr), path)
                if known != path:  # the same bytes would count twice
                    raise Hdf5Error(f"{path} is {known} once more, expected one name for an object")
                self._objects[path] = found
        return self._objects[path]

    def declared(self, path: str) -> Declared:
        """Declaration of a dataset; raises Hdf5Error if there is none, or it declares what palpate's never have."""
        if path not in self._declared:
            dataset = self._object(path)
            if not isinstance(dataset, _h5d.DatasetID):
                raise Hdf5Error(f"{path} is missing or not a dataset")
            with self._source.bounded():
                own = declaration_of(dataset, path)
                require_room(dataset, own, self._source.size)
            self._declared[path] = own
        return self._declared[path]

    def dataset(self, path: str) -> Any:
        """The `h5py.Dataset` of a path; raises Hdf5Error if it does not exist or is not completely in the file."""
        if path not in self._datasets:  # cached: opening a dataset takes longer than reading one pose from it
            own, found = self.declared(path), self._object(path)
            require_chunks(found, own, self._source.size)
            self._datasets[path] = h5py.Dataset(found)
        return self._datasets[path]

    def read(self, path: str, first: int = 0, stop: int | None = None) -> NDArray[Any]:
        """Rows `first` to `stop` (default: all) of a dataset, in native byte order.

        Raises Hdf5Error as `dataset`, for a scalar, and if the rows would take too much memory.
        """
        dataset, own = self.dataset(path), self.declared(path)
        if not own.shape:
            raise Hdf5Error(f"{path} is one value, expected rows")
        rows = len(range(*slice(first, stop).indices(own.shape[0])))
        size, most = rows * own.nbytes // max(own.shape[0], 1), MEMORY_MOST + 8 * self._source.size
        if size > most:
            raise Hdf5Error(f"{path} takes {size} bytes for {rows} rows, expected at most {most}")
        values: NDArray[Any] = np.asarray(dataset[first:stop])
        return values.astype(values.dtype.newbyteorder("="), copy=False)

    def attribute(self, path: str, key: str) -> Attribute | None:
        """An attribute of a group or dataset; None if it does not exist.

        Raises Hdf5Error for text that is not UTF-8, and for what is no plain value of bounded size.
        """
        owner = self._object(path)
        if owner is None:
            return None
        with self._source.bounded():
            if not _h5a.exists(owner, key.encode()):
                return None
            require_attribute(_h5a.open(owner, key.encode()), f"attribute {key} of {path}")
            bound: Any = h5py.Group if isinstance(owner, _h5g.GroupID) else h5py.Dataset
            stored: Any = bound(owner).attrs[key]
        value: Any = stored.item() if hasattr(stored, "item") and stored.ndim == 0 else stored
        try:
            if isinstance(value, bytes):
                value = value.decode()
            elif isinstance(value, str):
                value.encode()  # h5py decodes bytes that are not UTF-8 to lone surrogates, which cannot be printed
        except (UnicodeDecodeError, UnicodeEncodeError) as error:
            raise Hdf5Error(f"attribute {key} of {path} is not UTF-8: {error.reason} at {error.start}") from None
        return value

    def number(self, path: str, key: str) -> float | None:
        """A finite number from an attribute; None if it does not exist. Raises Hdf5Error for any other value."""
        value = self.attribute(path, key)
        if value is not None and not (isinstance(value, int | float) and math.isfinite(value)):
            raise Hdf5Error(f"attribute {key} of {path} is {_brief(value)}, expected a finite number")
        return None if value is None else float(value)

    def whole(self, path: str, key: str) -> int | None:
        """An integer from an attribute; None if it does not exist. Raises Hdf5Error for any other value."""
        value = self.attribute(path, key)
        if value is not None and not isinstance(value, int):
            raise Hdf5Error(f"attribute {key} of {path} is {_brief(value)}, expected a whole number")
        return value


def _brief(value: object) -> str:
    shown = repr(value)
    return shown if len(shown) <= 80 else f"{shown[:80]}..."
