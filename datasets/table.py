"""A sweep's tidy table as a file: HDF5 with one dimension `row`, or Parquet; pandas, polars and xarray read them."""

from __future__ import annotations

import importlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np

from .errors import SweepStoreError
from .hdf5_columns import (
    Columns,
    Values,
    column_arrays,
    failures_named,
    image_of,
    new_image,
    open_columns,
    put_column,
    take_column,
    write_whole,
)
from .hdf5_opening import StrictFile
from .json_text import parse_json

FORMAT_NAME = "palpate table"
FORMAT_VERSION = 1
ROW = "row"
"""The dimension of all columns, and the dataset that numbers them; no column may have its name."""

PARQUET = ".parquet"
"""What the name of a Parquet file ends with; every other name is HDF5."""

_SCALE = (f"/{ROW}",)  # `TableWriter` gives the dimension a length and no values

_METADATA = "palpate"
"""Key of a Parquet schema's metadata, JSON of the attributes."""

Attributes = Mapping[str, Any]
"""What a table says of itself: text and numbers; anything else is kept as JSON."""


def write_table(
    path: str | Path, columns: Mapping[str, Values], attributes: Attributes, *, units: Mapping[str, str] | None = None
) -> None:
    """Write a table as HDF5, whole or not at all, replacing an earlier one.

    columns: equally long, of one dimension (`column_array` tells which types there are, and what None becomes).
    units: of columns, kept as their attribute `units`.

    Raises:
        SweepStoreError: Columns are impossible, or the file cannot be written; nothing is left behind.
    """
    path = Path(path)
    arrays = _table_arrays(columns)
    with new_image() as file:
        for key, value in described(attributes).items():
            file.attrs[key] = value
        count = len(next(iter(arrays.values()), ()))
        scale = put_column(file, ROW, np.arange(count, dtype=np.int64))
        scale.make_scale(ROW)
        for name, array in arrays.items():
            put_column(file, name, array, (units or {}).get(name, "")).dims[0].attach_scale(scale)
        image = image_of(file)
    _write(path, image)


def write_parquet(
    path: str | Path, columns: Mapping[str, Values], attributes: Attributes, *, units: Mapping[str, str] | None = None
) -> None:
    """Write a table as Parquet, whole or not at all, replacing an earlier one; arguments as `write_table`.

    Attributes are the schema's metadata, units the fields'.

    Raises:
        SweepStoreError: As `write_table`; or PyArrow is missing, which the extra `palpate[parquet]` installs.
    """
    path = Path(path)
    arrays = _table_arrays(columns)
    arrow, parquet = _pyarrow("pyarrow"), _pyarrow("pyarrow.parquet")
    fields: list[Any] = []
    for name, array in arrays.items():
        unit = (units or {}).get(name)
        kind: Any = arrow.string() if array.dtype.kind == "O" else arrow.from_numpy_dtype(array.dtype)
        fields.append(arrow.field(name, kind, metadata={"units": unit} if unit else None))
    schema: Any = arrow.schema(fields, metadata={_METADATA: json.dumps(described(attributes))})
    sink: Any = arrow.BufferOutputStream()
    parquet.write_table(arrow.table(list(arrays.values()), schema=schema), sink)
    _write(path, memoryview(sink.getvalue()))


def load_table(path: str | Path) -> Columns:
    """Columns of a table, HDF5 or Parquet: bool, numbers, and object arrays of str.

    Raises:
        SweepStoreError: It is missing, damaged, or no table.
    """
    path = Path(path)
    if path.suffix == PARQUET:
        table = _parquet_table(path)
        _parquet_attributes(path, table.schema)
        return {str(name): _numpy(table.column(name)) for name in table.column_names}
    with open_columns(path, unread=_SCALE) as file:
        _refuse_foreign(path, _attributes(file))
        columns = {own.path[1:]: take_column(file, own.path) for own in file.datasets.values() if own.path[1:] != ROW}
    if len({len(column) for column in columns.values()}) > 1 or any("/" in name for name in columns):
        found = ", ".join(f"{name}: {len(column)}" for name, column in list(columns.items())[:8])
        raise SweepStoreError(f"{path} is damaged: columns of a table have equally many rows, not {found}")
    return columns


def table_attributes(path: str | Path) -> dict[str, Any]:
    """What a table says of itself, as it was given to the writer; raises SweepStoreError as `load_table`."""
    path = Path(path)
    if path.suffix == PARQUET:
        return _parquet_attributes(path, _parquet_schema(path))
    with open_columns(path, unread=_SCALE) as file:
        attributes = _attributes(file)
    _refuse_foreign(path, attributes)
    return attributes


def column_units(path: str | Path) -> dict[str, str]:
    """Units of those columns of a table that have one; raises SweepStoreError as `load_table`."""
    path = Path(path)
    if path.suffix == PARQUET:
        fields: list[Any] = list(_parquet_schema(path))
        return {str(own.name): own.metadata[b"units"].decode() for own in fields if b"units" in (own.metadata or {})}
    with open_columns(path, unread=_SCALE) as file:
        _refuse_foreign(path, _attributes(file))
        units = {name[1:]: file.attribute(name, "units") for name in file.datasets}
    return {name: unit for name, unit in units.items() if isinstance(unit, str)}


def _attributes(file: StrictFile) -> dict[str, Any]:
    return {key: file.attribute("/", key) for key in file.structure.attributes["/"]}


def _write(path: Path, content: memoryview) -> None:
    try:
        write_whole(path, content)
    except OSError as error:
        raise SweepStoreError(f"{path} cannot be written: {error.strerror or error}") from error


def _table_arrays(columns: Mapping[str, Values]) -> Columns:
    if ROW in columns:
        raise SweepStoreError(f"a column cannot be called {ROW!r}: the rows' numbers are")
    return column_arrays(columns)


def described(attributes: Attributes) -> dict[str, str | int | float]:
    """Attributes of a table's file: format, version, then what it says of itself, text and numbers as they are."""
    own = {key: value if type(value) in (str, int, float) else json.dumps(value) for key, value in attributes.items()}
    return {"format": FORMAT_NAME, "version": FORMAT_VERSION, **own}


def _refuse_foreign(path: Path, attributes: Any) -> None:
    found, version = attributes.get("format"), attributes.get("version")
    if not isinstance(found, str) or found != FORMAT_NAME:  # an array would be compared number by number
        raise SweepStoreError(f"{path} is not a {FORMAT_NAME}: its attribute format is {found!r}")
    if not isinstance(version, int) or version < 1:
        raise SweepStoreError(f"{path} is damaged: its attribute version is {version!r}, expected 1 or more")
    if version > FORMAT_VERSION:
        raise SweepStoreError(
            f"{path} has format version {version}, this palpate reads up to {FORMAT_VERSION}: a newer one wrote it"
        )


def _pyarrow(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise SweepStoreError("Parquet needs PyArrow: pip install 'palpate[parquet]'") from error


def _parquet_table(path: Path) -> Any:
    parquet = _pyarrow("pyarrow.parquet")
    with failures_named(path):
        return parquet.read_table(path)


def _parquet_schema(path: Path) -> Any:
    parquet = _pyarrow("pyarrow.parquet")
    with failures_named(path):
        return parquet.read_schema(path)


def _parquet_attributes(path: Path, schema: Any) -> dict[str, Any]:
    with failures_named(path):
        metadata = cast("dict[bytes, bytes]", schema.metadata or {})
        attributes = cast("dict[str, Any]", parse_json(metadata.get(_METADATA.encode(), b"{}"), allow_nan=True))
    _refuse_foreign(path, attributes)
    return attributes


def _numpy(column: Any) -> Any:
    values: Any = column.to_numpy(zero_copy_only=False)
    return np.asarray(values)
