"""Declarations of datasets and attributes: validated before anything is read of them.

| refused                                            | why                                                          |
|----------------------------------------------------|--------------------------------------------------------------|
| virtual datasets, external raw data                | they read other files                                        |
| filters beyond gzip, shuffle, Fletcher-32 and LZF  | others are plug-ins, which are code                          |
| types beyond integers and floats; text in datasets | palpate's files have none                                    |
| attributes and chunks out of bounds                | they would be held in memory whole                           |
"""

from __future__ import annotations

import importlib
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import Hdf5Error

# h5py has no type information, so all of it is `Any`.
h5py: Any = importlib.import_module("h5py")
_h5d, _h5s, _h5t, _h5z = h5py.h5d, h5py.h5s, h5py.h5t, h5py.h5z

RANK_MOST = 4
"""Dimensions of a dataset; palpate's have at most 3."""
CHUNK_BYTES_MOST = 1 << 25
"""[byte] of a chunk in memory: a chunk is decoded whole. palpate's have at most 512 KiB."""
ATTRIBUTE_BYTES_MOST = 1 << 24
"""[byte] of an attribute: a strategy's JSON."""

_FILTERS = {_h5z.FILTER_DEFLATE: "gzip", _h5z.FILTER_SHUFFLE: "shuffle", _h5z.FILTER_FLETCHER32: "fletcher32"}
_FILTERS[_h5z.FILTER_LZF] = "lzf"
_LAYOUTS = {_h5d.COMPACT: "compact", _h5d.CONTIGUOUS: "contiguous", _h5d.CHUNKED: "chunked"}
_FLOATS = {
    2: (_h5t.IEEE_F16LE, _h5t.IEEE_F16BE),
    4: (_h5t.IEEE_F32LE, _h5t.IEEE_F32BE),
    8: (_h5t.IEEE_F64LE, _h5t.IEEE_F64BE),
}
_CLASSES = {
    _h5t.TIME: "time",
    _h5t.BITFIELD: "bit field",
    _h5t.OPAQUE: "opaque",
    _h5t.COMPOUND: "compound",
    _h5t.REFERENCE: "reference",
    _h5t.ENUM: "enumeration",
    _h5t.VLEN: "variable-length array",
    _h5t.ARRAY: "array",
}


@dataclass(frozen=True)
class Declared:
    """A dataset as its header declares it."""

    path: str
    dtype: np.dtype[Any]
    shape: tuple[int, ...]
    layout: str
    """compact, contiguous or chunked."""
    chunk: tuple[int, ...]
    """Shape of a chunk; empty if it is not chunked."""
    filters: tuple[str, ...]
    """In the order in which writing applies them."""
    item_bytes: int
    """[byte] of an element in the file."""

    @property
    def nbytes(self) -> int:
        """[byte] of its elements, before filters."""
        return math.prod(self.shape) * self.item_bytes


def declaration_of(dataset: Any, path: str) -> Declared:
    """The header of a dataset, `h5py.h5d.DatasetID`; raises Hdf5Error for what palpate's files never have."""
    plist = dataset.get_create_plist()
    layout = int(plist.get_layout())
    if layout not in _LAYOUTS:
        what = "a virtual dataset: its data are in other files" if layout == _h5d.VIRTUAL else f"of layout {layout}"
        raise Hdf5Error(f"{path} is {what}, expected data of its own")
    if external := int(plist.get_external_count()):
        raise Hdf5Error(f"{path} has its data in {external} external files, expected them in this one")
    kind = dataset.get_type()
    if int(kind.get_class()) == _h5t.STRING:
        raise Hdf5Error(f"{path} is text, expected numbers")
    _require_plain(kind, path)
    shape = _shape(dataset.get_space())
    if shape is None or len(shape) > RANK_MOST:
        found = "no dataspace" if shape is None else f"{len(shape)} dimensions"
        raise Hdf5Error(f"{path} has {found}, expected at most {RANK_MOST} dimensions")
    chunk = tuple(map(int, plist.get_chunk())) if layout == _h5d.CHUNKED else ()
    own = Declared(
        path, np.dtype(kind.dtype), shape, _LAYOUTS[layout], chunk, _filters(plist, path), int(kind.get_size())
    )
    if math.prod(chunk) * own.item_bytes > CHUNK_BYTES_MOST:
        raise Hdf5Error(f"{path} has chunks of {list(chunk)} items, expected at most {CHUNK_BYTES_MOST} bytes each")
    return own


def _filters(plist: Any, path: str) -> tuple[str, ...]:
    names: list[str] = []
    for index in range(int(plist.get_nfilters())):
        code = int(plist.get_filter(index)[0])
        name = _FILTERS.get(code)
        # one that comes twice multiplies what a few bytes become
        if name is None or name in names or {"gzip", "lzf"} <= {name, *names}:
            known = "each of gzip or lzf, shuffle and fletcher32 once"
            raise Hdf5Error(f"{path} has filter {code} at place {index}, expected {known}")
        names.append(name)
    return tuple(names)


def _require_plain(kind: Any, path: str) -> None:
    """Raise Hdf5Error unless a dataset's or an attribute's type is a number or text."""
    if kind.committed():
        raise Hdf5Error(f"{path} has a type with a name of its own, expected a plain one")
    size, number_class = int(kind.get_size()), int(kind.get_class())
    if number_class == _h5t.STRING:
        if not 0 < size <= ATTRIBUTE_BYTES_MOST:
            raise Hdf5Error(f"{path} has texts of {size} bytes, expected 1 to {ATTRIBUTE_BYTES_MOST}")
        return
    whole = number_class == _h5t.INTEGER and size in (1, 2, 4, 8) and int(kind.get_precision()) == 8 * size
    if whole or (number_class == _h5t.FLOAT and any(kind.equal(known) for known in _FLOATS.get(size, ()))):
        return
    name = _CLASSES.get(number_class, "number" if number_class in (_h5t.INTEGER, _h5t.FLOAT) else "type")
    plain = "a whole number of 1 to 8 bytes, an IEEE float of 2 to 8, or text"
    raise Hdf5Error(f"{path} is of an HDF5 {name} of {size} bytes, expected {plain}")


def _shape(space: Any) -> tuple[int, ...] | None:
    """Lengths of the dimensions, none for a scalar; None where there is no value at all."""
    extent = int(space.get_simple_extent_type())
    if extent == _h5s.SCALAR:
        return ()
    return tuple(map(int, space.get_simple_extent_dims())) if extent == _h5s.SIMPLE else None


def require_attribute(attribute: Any, what: str) -> None:
    """Raise Hdf5Error unless an attribute, `h5py.h5a.AttrID`, is a plain value of bounded size."""
    _require_plain(attribute.get_type(), what)
    shape = _shape(attribute.get_space())
    if shape is None or len(shape) > 1:
        found = "no value" if shape is None else f"shape {list(shape)}"
        raise Hdf5Error(f"{what} has {found}, expected one value or a list of them")
    if shape and int(attribute.get_type().get_class()) == _h5t.STRING and attribute.get_type().is_variable_str():
        raise Hdf5Error(f"{what} is a list of texts of any length, expected one text")  # all may be the same bytes
    if (size := math.prod(shape) * int(attribute.get_type().get_size())) > ATTRIBUTE_BYTES_MOST:
        raise Hdf5Error(f"{what} has {size} bytes, expected at most {ATTRIBUTE_BYTES_MOST}")
