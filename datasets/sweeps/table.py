"""A sweep's tidy table as a file: CSV, or Parquet where PyArrow is installed. Tables are made from results again."""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..bounded_file import open_regular, require_bytes
from ..errors import SweepStoreError
from ..storage.durable import NewFile, write_file
from .table_text import Columns, Constant, Values, column_arrays, csv_content, naming_failures, read_csv

CSV, PARQUET = SUFFIXES = (".csv", ".parquet")
TABLE, POSES = "table.csv", "poses.parquet"
"""Files of a store: one row a recipe, and one row a pose where the plan asks for it."""

GROUP_ROWS = 1 << 17
"""Rows of a group in a Parquet file, which a reader may skip, or decode on a core of its own."""


def write_table(
    path: str | Path,
    columns: Mapping[str, Values],
    *,
    units: Mapping[str, str] | None = None,
    constants: Mapping[str, Constant] | None = None,
) -> int:
    """Write a table, whole or not at all, replacing an earlier one; its suffix chooses the format. Returns its bytes.

    columns: equally long, of one dimension (`column_arrays` lists the types, and what None becomes). units: of columns,
    which Parquet keeps with them. constants: values that all rows share, which a CSV has in lines above the names, for
    people who compare two tables; Parquet has columns of them.

    Raises:
        SweepStoreError: Columns are impossible, the suffix is another one, the file cannot be written, or PyArrow is
            missing. Nothing is left behind.

    >>> from palpate.datasets import load_table, write_table
    >>> write_table("own.csv", {"object": ["cube", "rock"], "length": [0.34, None]})
    30
    >>> load_table("own.csv")
    {'object': array(['cube', 'rock'], dtype=object), 'length': array([0.34,  nan])}
    """
    path = Path(path)
    _require_suffix(path)
    arrays = column_arrays(columns)
    if path.suffix == PARQUET:
        count = len(next(iter(arrays.values()), ()))
        shared = column_arrays({name: [value] for name, value in (constants or {}).items()})
        write_blocks(path, [arrays | {name: array.repeat(count) for name, array in shared.items()}], units=units)
        return path.stat().st_size
    content = csv_content(arrays, constants)
    try:
        write_file(path, content)
    except OSError as error:
        raise SweepStoreError(f"{path} cannot be written: {error.strerror or error}") from error
    return len(content)


def write_blocks(path: Path, blocks: Iterable[Mapping[str, Values]], *, units: Mapping[str, str] | None = None) -> None:
    """Write blocks of rows as one Parquet file; arguments and errors as `write_table`.

    blocks: the same names and types in each; at most GROUP_ROWS and one block are in memory.
    """
    arrow, parquet = _pyarrow("pyarrow"), _pyarrow("pyarrow.parquet")
    tables = (_arrow_table(arrow, column_arrays(block), units or {}) for block in blocks)
    try:
        with NewFile(path) as new:
            first = next(tables, arrow.table({}))
            with parquet.ParquetWriter(new.temporary, first.schema, compression="zstd") as writer:
                for group in _groups(arrow, first, tables):
                    writer.write_table(group, row_group_size=GROUP_ROWS)
    except (OSError, ValueError) as error:  # ValueError: blocks differ
        raise SweepStoreError(f"{path} cannot be written: {getattr(error, 'strerror', None) or error}") from error


def load_table(path: str | Path) -> Columns:
    """Columns of a table, CSV or Parquet: bool, numbers, and object arrays of str; constants are columns, too.

    Raises:
        SweepStoreError: It is missing, damaged or larger than the budget, ends otherwise, or PyArrow is missing.

    >>> from palpate.datasets import load_table, write_table
    >>> write_table("own.parquet", {"length": [0.34, 0.26]}, units={"length": "m"}) < 1000  # bytes
    True
    >>> load_table("own.parquet")
    {'length': array([0.34, 0.26])}
    """
    path = Path(path)
    _require_suffix(path)
    if path.suffix == CSV:
        return read_csv(path)
    arrow, parquet = _pyarrow("pyarrow"), _pyarrow("pyarrow.parquet")
    with naming_failures(path), open_regular(path) as stream:
        schema = parquet.read_schema(stream)
        texts = [str(field.name) for field in schema if arrow.types.is_string(field.type)]  # kept once each
        file = parquet.ParquetFile(stream, read_dictionary=texts)
        facts: Any = file.metadata
        # However few bytes repeat a value, an array of it takes 8 bytes a row.
        pages = sum(facts.row_group(group).total_byte_size for group in range(facts.num_row_groups))
        require_bytes(pages + 8 * facts.num_rows * facts.num_columns, "its table")
        table = file.read()
        return column_arrays({str(name): _numpy(table.column(name)) for name in table.column_names})


def _numpy(column: Any) -> NDArray[Any]:
    whole = column.combine_chunks()
    if not hasattr(whole, "dictionary"):
        return column.to_numpy()
    texts = np.array([*whole.dictionary.to_pylist(), ""], object)  # rows that have the same text share it
    return texts[whole.indices.fill_null(-1).to_numpy(zero_copy_only=False)]


def _arrow_table(arrow: Any, arrays: Columns, units: Mapping[str, str]) -> Any:
    fields: list[Any] = []
    for name, array in arrays.items():
        kind: Any = arrow.string() if array.dtype.kind == "O" else arrow.from_numpy_dtype(array.dtype)
        fields.append(arrow.field(name, kind, metadata={"units": units[name]} if name in units else None))
    return arrow.table(list(arrays.values()), schema=arrow.schema(fields))


def _groups(arrow: Any, first: Any, others: Iterator[Any]) -> Iterator[Any]:
    """Tables joined until each has at least GROUP_ROWS rows, but for the last one."""
    held = [first]
    for table in others:
        if sum(own.num_rows for own in held) >= GROUP_ROWS:
            yield arrow.concat_tables(held)
            held = []
        held.append(table)
    yield arrow.concat_tables(held)


def _require_suffix(path: Path) -> None:
    if path.suffix not in SUFFIXES:
        raise SweepStoreError(f"{path}: the name of a table must end in {' or '.join(SUFFIXES)}")


def _pyarrow(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise SweepStoreError("Parquet needs PyArrow: pip install -e '.[parquet]' in palpate's folder") from error
