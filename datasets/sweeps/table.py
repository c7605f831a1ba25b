"""A sweep's tidy table as a file: HDF5 with one dimension `row`, Parquet, or text (`table_text`).

pandas, polars and xarray read them.
"""

from __future__ import annotations

import hashlib
import importlib
import json
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ..bounded_file import open_regular, require_bytes
from ..errors import SweepStoreError
from ..json_text import parse_json
from ..storage.content_digest import content_trailer, has_trailer, require_whole, text_digest
from ..storage.durable import Buffer, write_file
from ..storage.hdf5_columns import (
    Columns,
    Values,
    column_arrays,
    image_of,
    naming_failures,
    new_image,
    open_columns,
    put_column,
    take_columns,
)
from ..storage.hdf5_opening import StrictFile
from .table_text import CONSTANTS, CSV, constant_columns, read_csv, require_constants

FORMAT_NAME = "palpate table"
FORMAT_VERSION = 1
ROW = "row"
"""The dimension of all columns, and the dataset that numbers them; no column may have its name."""

PARQUET = ".parquet"
"""What the name of a Parquet file ends with; a name that ends otherwise, and not with `CSV`, is HDF5."""

DIGEST = "digest"
"""How a table's content is proven; tables that an earlier palpate wrote lack this attribute, and are believed."""
TRAILER = "BLAKE2b-256 behind the HDF5 file"
KIND = "table"


_METADATA, _METADATA_DIGEST = "palpate", "palpate.digest"
"""Keys of a Parquet schema's metadata: JSON of the attributes, and the digest of that and the units."""

Attributes = Mapping[str, Any]
"""What a table says of itself: text and numbers; anything else is kept as JSON."""


def write_table(
    path: str | Path,
    columns: Mapping[str, Values],
    attributes: Attributes | None = None,
    *,
    units: Mapping[str, str] | None = None,
) -> None:
    """Write a table as HDF5, whole or not at all, replacing an earlier one.

    columns: equally long, of one dimension (`column_array` lists the types, and what None becomes).
    units: of columns, kept as their attribute `units`.

    Raises:
        SweepStoreError: Columns are impossible, or the file cannot be written; nothing is left behind.

    >>> from palpate.datasets import load_table, write_table
    >>> write_table("own.h5", {"object": ["cube", "rock"], "length": [0.34, 0.26]}, units={"length": "m"})
    >>> load_table("own.h5")
    {'object': array(['cube', 'rock'], dtype=object), 'length': array([0.34, 0.26])}
    """
    path = Path(path)
    if path.suffix in (PARQUET, CSV):
        raise SweepStoreError(f"{path}: this writes HDF5, so that the name must not end in {path.suffix}; .h5 would do")
    arrays = _table_arrays(columns)
    with new_image() as file:
        for key, value in {**_described(attributes or {}), DIGEST: TRAILER}.items():
            file.attrs[key] = value
        count = len(next(iter(arrays.values()), ()))
        scale = put_column(file, ROW, np.arange(count, dtype=np.int64))
        scale.make_scale(ROW)
        for name, array in arrays.items():
            put_column(file, name, array, (units or {}).get(name, "")).dims[0].attach_scale(scale)
        image = image_of(file)
    _write(path, image, content_trailer(KIND, FORMAT_VERSION, image))


def write_parquet(
    path: str | Path,
    columns: Mapping[str, Values],
    attributes: Attributes | None = None,
    *,
    units: Mapping[str, str] | None = None,
) -> None:
    """Write a table as Parquet, whole or not at all, replacing an earlier one; arguments as `write_table`.

    Attributes are the schema's metadata, units the fields'.

    Raises:
        SweepStoreError: As `write_table`; or PyArrow is missing, which the extra `parquet` installs.

    >>> from palpate.datasets import load_table, write_parquet
    >>> write_parquet("own.parquet", {"length": [0.34, None], "polylines": [1, 0]}, {"hand": "palm"})
    >>> load_table("own.parquet")  # None among numbers is NaN
    {'length': array([0.34,  nan]), 'polylines': array([1, 0])}
    """
    path = Path(path)
    if path.suffix != PARQUET:
        raise SweepStoreError(f"{path}: this writes Parquet, so that the name must end in {PARQUET}")
    _write(path, parquet_content(columns, attributes or {}, units or {}))


def parquet_content(
    columns: Mapping[str, Values], attributes: Attributes, units: Mapping[str, str], **options: Any
) -> memoryview:
    """The bytes of a table as Parquet; options: of `pyarrow.parquet.write_table`; raises as `write_parquet`."""
    arrays = _table_arrays(columns)
    arrow, parquet = _pyarrow("pyarrow"), _pyarrow("pyarrow.parquet")
    fields: list[Any] = []
    for name, array in arrays.items():
        unit = units.get(name)
        kind: Any = arrow.string() if array.dtype.kind == "O" else arrow.from_numpy_dtype(array.dtype)
        fields.append(arrow.field(name, kind, metadata={"units": unit} if unit else None))
    text = json.dumps(_described(attributes) | {DIGEST: _columns_digest(arrays)})
    own = _metadata_digest(text.encode(), [(name, units.get(name, "")) for name in arrays])
    schema: Any = arrow.schema(fields, metadata={_METADATA: text, _METADATA_DIGEST: own})
    sink: Any = arrow.BufferOutputStream()
    parquet.write_table(arrow.table(list(arrays.values()), schema=schema), sink, **options)
    return memoryview(sink.getvalue())


def load_table(path: str | Path, *, constants: bool = False, verify: bool = True) -> Columns:
    """Columns of a table, HDF5, Parquet or text: bool, numbers, and object arrays of str.

    constants: whether to add a column for each value that all rows share and that the file therefore holds once
    (`table_attributes(path)["constants"]`).
    verify: whether to prove its content by its digest before it is believed. Text has no digest, nor have tables that
    palpate wrote before it had digests (`has_digest`).

    Raises:
        SweepStoreError: It is missing, damaged, or no table.

    >>> from palpate.datasets import load_table, write_table
    >>> write_table("own.h5", {"length": [0.34, 0.26]}, {"constants": {"hand": "palm"}})
    >>> load_table("own.h5", constants=True)
    {'length': array([0.34, 0.26]), 'hand': array(['palm', 'palm'], dtype=object)}
    """
    path = Path(path)
    if path.suffix == CSV:
        columns, shared = read_csv(path)
    else:
        columns = _load_columns(path, verify)
        shared = _shared(path, table_attributes(path, verify=verify)) if constants else {}
    row_count = len(next(iter(columns.values()), ()))
    added = {name: value for name, value in shared.items() if constants and name not in columns}
    return columns | constant_columns(path, added, row_count)


def _load_columns(path: Path, verify: bool) -> Columns:
    """Columns of a table in HDF5 or Parquet, as they are in the file."""
    if path.suffix == PARQUET:
        table = _parquet_table(path)
        attributes = _parquet_attributes(path, table.schema)
        with naming_failures(path):
            columns = {str(name): _numpy(str(name), table.column(name)) for name in table.column_names}
        is_null = any(table.column(name).null_count for name in table.column_names)  # palpate writes none
        if verify and DIGEST in attributes and (is_null or attributes[DIGEST] != _columns_digest(columns)):
            raise SweepStoreError(f"{path} is damaged: the digest of its columns does not match")
        return columns
    with _opened(path, verify=verify) as file:
        paths = [path for path in file.members("/") if path[1:] != ROW]
        columns = {path[1:]: column for path, column in zip(paths, take_columns(file, paths), strict=True)}
    if len({len(column) for column in columns.values()}) > 1:
        found = ", ".join(f"{name}: {len(column)}" for name, column in list(columns.items())[:8])
        raise SweepStoreError(f"{path} is damaged: columns of a table have equally many rows, not {found}")
    return columns


def table_attributes(path: str | Path, *, verify: bool = True) -> dict[str, Any]:
    """What a table says of itself: what was given to the writer, its format, and how its content is proven.

    Text and numbers are as they were given, anything else is JSON; of a table as text only `constants`. Arguments and
    errors as `load_table`.

    >>> from palpate.datasets import table_attributes, write_table
    >>> write_table("own.h5", {"length": [0.34, 0.26]}, {"hand": "palm", "seeds": [1, 2]})
    >>> found = table_attributes("own.h5")
    >>> found["format"], found["hand"], found["seeds"]
    ('palpate table', 'palm', '[1, 2]')
    """
    path = Path(path)
    if path.suffix == CSV:
        return {CONSTANTS: json.dumps(read_csv(path)[1])}
    if path.suffix == PARQUET:
        return _parquet_attributes(path, _parquet_schema(path))
    with _opened(path, verify=verify) as file:
        return _attributes(file)


def _shared(path: Path, attributes: Attributes) -> dict[str, Any]:
    """Constants of a table, from its attributes."""
    try:
        return require_constants(path, parse_json(attributes.get(CONSTANTS, "{}"), allow_nan=True))
    except (ValueError, TypeError) as error:
        raise SweepStoreError(f"{path}: its attribute {CONSTANTS} is not JSON: {error}") from error


def column_units(path: str | Path, *, verify: bool = True) -> dict[str, str]:
    """Units of those columns of a table that have one, none in text; arguments and errors as `load_table`."""
    path = Path(path)
    if path.suffix == CSV:
        return {}
    if path.suffix == PARQUET:
        schema = _parquet_schema(path)
        _parquet_attributes(path, schema)
        return {name: unit for name, unit in _parquet_units(path, schema) if unit}
    with _opened(path, verify=verify) as file:
        units = {name[1:]: file.attribute(name, "units") for name in file.members("/")}
    return {name: unit for name, unit in units.items() if isinstance(unit, str)}


def _attributes(file: StrictFile) -> dict[str, Any]:
    return {key: file.attribute("/", key) for key in file.attribute_names("/")}


def is_table(path: str | Path) -> bool:
    """Whether a file is a table by its suffix (Parquet), or ends like one or says that it is one (HDF5)."""
    path = Path(path)
    if path.suffix == PARQUET:
        return path.is_file()
    try:
        if has_trailer(path, KIND):
            return True
        with open_columns(path) as file:
            name = file.attribute("/", "format")
            return isinstance(name, str) and name == FORMAT_NAME
    except SweepStoreError:
        return False


def has_digest(path: str | Path) -> bool:
    """Whether a table carries a digest, so that `load_table` proves it; raises SweepStoreError as that."""
    return DIGEST in table_attributes(path)


@contextmanager
def _opened(path: Path, *, verify: bool) -> Generator[StrictFile, None, None]:
    """A table of HDF5, open and of a version that can be read; proven before libhdf5 sees it, if it can be."""
    is_proven = verify and has_trailer(path, KIND)
    if is_proven:
        require_whole(path, KIND, FORMAT_VERSION)
    with open_columns(path) as file:
        attributes = _attributes(file)
        _refuse_foreign(path, attributes)
        if verify and not is_proven and DIGEST in attributes:
            raise SweepStoreError(
                f"{path} is damaged, or was changed: it was written with a digest behind it, which is gone"
            )
        yield file


def _write(path: Path, *content: Buffer) -> None:
    try:
        write_file(path, *content)
    except OSError as error:
        raise SweepStoreError(f"{path} cannot be written: {error.strerror or error}") from error


def _table_arrays(columns: Mapping[str, Values]) -> Columns:
    if ROW in columns:
        raise SweepStoreError(f"a column cannot be called {ROW!r}: the rows' numbers are")
    return column_arrays(columns)


def _described(attributes: Attributes) -> dict[str, str | int | float]:
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
        raise SweepStoreError("Parquet needs PyArrow: pip install -e '.[parquet]' in palpate's folder") from error


def _parquet_table(path: Path) -> Any:
    """A table within the budget: as it declares its pages, and 8 bytes a value, however few bytes repeat it."""
    arrow, parquet = _pyarrow("pyarrow"), _pyarrow("pyarrow.parquet")
    with naming_failures(path), open_regular(path) as stream:
        schema = parquet.read_schema(stream)
        texts = [str(field.name) for field in schema if arrow.types.is_string(field.type)]  # kept once each
        file = parquet.ParquetFile(stream, read_dictionary=texts)
        facts: Any = file.metadata
        pages = sum(facts.row_group(group).total_byte_size for group in range(facts.num_row_groups))
        require_bytes(pages + 8 * facts.num_rows * facts.num_columns, "its table")
        return file.read()


def _parquet_schema(path: Path) -> Any:
    parquet = _pyarrow("pyarrow.parquet")
    with naming_failures(path), open_regular(path) as stream:
        return parquet.read_schema(stream)


def _parquet_units(path: Path, schema: Any) -> list[tuple[str, str]]:
    """Name and unit, or "", of each column."""
    with naming_failures(path):
        units: list[tuple[str, dict[bytes, bytes]]] = [(str(own.name), own.metadata or {}) for own in schema]
        return [(name, metadata.get(b"units", b"").decode()) for name, metadata in units]


def _parquet_attributes(path: Path, schema: Any) -> dict[str, Any]:
    """What a Parquet table says of itself, proven if it carries a digest of that."""
    metadata = cast("dict[bytes, bytes]", schema.metadata or {})
    text = metadata.get(_METADATA.encode(), b"{}")
    try:
        attributes: Any = parse_json(text, allow_nan=True)
    except ValueError as error:
        raise SweepStoreError(f"{path}: {_METADATA} in its metadata is not JSON: {error}") from error
    if not isinstance(attributes, dict):
        raise SweepStoreError(f"{path}: {_METADATA} in its metadata is {type(attributes).__name__}, expected an object")
    own = metadata.get(_METADATA_DIGEST.encode())
    if (own is not None or DIGEST in attributes) and own != _metadata_digest(text, _parquet_units(path, schema)):
        raise SweepStoreError(f"{path} is damaged: the digest of its metadata does not match")
    _refuse_foreign(path, attributes)
    return cast("dict[str, Any]", attributes)


def _metadata_digest(text: bytes, units: Sequence[tuple[str, str]]) -> bytes:
    """Of a Parquet table's attributes, and of its columns' names and units, as hexadecimal text."""
    return text_digest([text, json.dumps(units).encode()]).hex().encode()


def _columns_digest(columns: Columns) -> str:
    """Of columns, their names, types and values, as hexadecimal text; without a copy of the numbers."""
    digest = hashlib.blake2b(digest_size=16)
    before = b""
    for name, array in columns.items():
        is_text = array.dtype.kind == "O"
        digest.update(before + f"{name} {'text' if is_text else array.dtype.str[1:]} {len(array)}\n".encode())
        stored = np.ascontiguousarray(array, array.dtype if is_text else array.dtype.newbyteorder("<"))
        digest.update("\0".join(stored).encode() if is_text else stored.view(np.uint8).data)
        before = b"\n"
    return digest.hexdigest()


def _numpy(name: str, column: Any) -> Any:
    types = _pyarrow("pyarrow").types
    kind = column.type.value_type if types.is_dictionary(column.type) else column.type
    if not any(own(kind) for own in (types.is_boolean, types.is_integer, types.is_floating, types.is_string)):
        raise ValueError(f"column {name} is of {column.type}, expected bool, numbers or text")
    parts: list[NDArray[Any]] = []
    for chunk in cast("list[Any]", column.chunks):
        if hasattr(chunk, "dictionary"):  # rows that say the same share one text
            texts: list[Any] = [*chunk.dictionary.to_pylist(), None]
            parts.append(np.array(texts, dtype=object)[chunk.indices.fill_null(-1).to_numpy(zero_copy_only=False)])
        else:
            parts.append(np.asarray(chunk.to_numpy(zero_copy_only=False)))
    return np.concatenate(parts) if parts else np.asarray(column.to_numpy(zero_copy_only=False))
