"""Rows of poses as a folder of Parquet files, which polars, DuckDB, Dask and pandas read as one table.

A file's name holds its number and the number of all files, so a missing file is noticed; sorted names give the order of
the rows. A folder is written under another name first, so readers never see files of two plans beside each other.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import numpy as np

from ..errors import SweepStoreError
from ..storage.durable import discard_tree, sync, temporary_name, write_file
from ..storage.hdf5_columns import Columns, Values, column_arrays
from .table import PARQUET, Attributes, load_table, parquet_content, table_attributes

POSES = "poses"
"""Folder of a store that holds one row per pose."""

ROWS = 1 << 20
"""Of a file; the last one has fewer."""

GROUP_ROWS = 1 << 17
"""Of a row group, which a reader may skip, or decode on a core of its own."""

NUMBER = "file"
"""Attribute of a file: its number, from 0, which its digest covers."""


def write_pose_files(
    folder: Path, blocks: Iterable[Mapping[str, Values]], attributes: Attributes, *, units: Mapping[str, str]
) -> int:
    """Write blocks of rows as a folder, whole or not at all, replacing an earlier folder; returns the number of rows.

    blocks: columns of bool and numbers, the same names and types in each; at most one file's rows are in memory.
    Without rows the folder is empty. An exception, also one of the caller's blocks, leaves the earlier folder.

    Raises:
        SweepStoreError: Blocks differ, PyArrow is missing, or a file cannot be written.
    """
    temporary = temporary_name(folder)
    try:
        temporary.mkdir()
        count = _write_files(temporary, blocks, attributes, units)
        _replace(folder, temporary)
    except OSError as error:
        raise SweepStoreError(f"{folder} cannot be written: {error.strerror or error}") from error
    finally:
        discard_tree(temporary)
    return count


def pose_files(folder: Path) -> list[Path]:
    """Files of a folder in the order of their rows; raises SweepStoreError if one is missing or superfluous."""
    paths = sorted(folder.glob(f"*{PARQUET}"))
    expected = [_name(number, len(paths)) for number in range(len(paths))]
    for path, name in zip(paths, expected, strict=True):
        if path.name != name:
            raise SweepStoreError(f"{folder} is damaged: {path.name} stands where {name} is expected")
    return paths


def load_pose_table(folder: str | Path, *, verify: bool = True) -> Columns:
    """Columns of all rows of a folder of poses (`study.sweep/poses`), in the order of the sweep's table.

    verify: whether to prove the files by their digests. polars, DuckDB, Dask and pandas read the files without that.

    Raises:
        SweepStoreError: The folder or a file is missing or damaged, or PyArrow is missing.

    >>> from pathlib import Path
    >>> from palpate.datasets import load_pose_table, write_parquet
    >>> Path("study.sweep/poses").mkdir(parents=True)  # `palpate sweep` makes it, and files such as this one
    >>> write_parquet("study.sweep/poses/000000-of-000001.parquet", {"length": [0.26, 0.34]}, {"file": 0})
    >>> load_pose_table("study.sweep/poses")
    {'length': array([0.26, 0.34])}
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise SweepStoreError(f"{folder} does not exist, or is not a folder")
    parts = [_load_file(path, number, verify) for number, path in enumerate(pose_files(folder))]
    return _joined(parts) if parts else {}


def pose_file_problems(folder: Path) -> list[str]:
    """One sentence for each damage of a folder of rows; every file is read and proven."""
    try:
        paths = pose_files(folder)
    except SweepStoreError as error:
        return [str(error)]
    problems: list[str] = []
    for number, path in enumerate(paths):
        try:
            _load_file(path, number, verify=True)
        except SweepStoreError as error:
            problems.append(str(error))
    return problems


def _load_file(path: Path, number: int, verify: bool) -> Columns:
    """Columns of one file; raises SweepStoreError for a file that has the name of another one."""
    columns = load_table(path, verify=verify)
    found = table_attributes(path, verify=verify).get(NUMBER)
    if found != number:
        raise SweepStoreError(f"{path} is damaged: its attribute {NUMBER} is {found!r}, expected {number}")
    return columns


def _write_files(
    folder: Path, blocks: Iterable[Mapping[str, Values]], attributes: Attributes, units: Mapping[str, str]
) -> int:
    """Write files under their numbers, then give them their names; returns the number of rows."""
    numbered: list[Path] = []
    row_count = 0
    for columns in _files_of(folder, blocks):
        content = parquet_content(
            columns,
            {**attributes, NUMBER: len(numbered)},
            units,
            row_group_size=GROUP_ROWS,
            compression="zstd",
            compression_level=1,
            use_dictionary=["recipe"],  # values of other columns hardly repeat
        )
        numbered.append(folder / f"{len(numbered)}{PARQUET}")
        write_file(numbered[-1], content)
        row_count += len(next(iter(columns.values())))
    for number, path in enumerate(numbered):
        os.replace(path, folder / _name(number, len(numbered)))
    sync(folder)
    return row_count


def _files_of(folder: Path, blocks: Iterable[Mapping[str, Values]]) -> Iterator[Columns]:
    """Columns of each file."""
    held: list[Columns] = []
    held_count = row_count = 0
    kinds: dict[str, str] | None = None
    for block in blocks:
        arrays = column_arrays(block)
        found = {name: array.dtype.str for name, array in arrays.items()}
        kinds = found if kinds is None else kinds
        if found != kinds:
            raise SweepStoreError(f"{folder}: rows from {row_count} on have columns {found}; the first have {kinds}")
        count, first = len(next(iter(arrays.values()), ())), 0
        row_count += count
        while first < count:
            some = {name: array[first : first + ROWS - held_count] for name, array in arrays.items()}
            taken = min(count - first, ROWS - held_count)
            held.append(some)
            held_count, first = held_count + taken, first + taken
            if held_count == ROWS:
                yield _joined(held)
                held, held_count = [], 0
    if held:
        yield _joined(held)


def _joined(blocks: list[Columns]) -> Columns:
    return {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}


def _replace(folder: Path, temporary: Path) -> None:
    """Give a folder its name; the earlier one gets a temporary name before, and is removed."""
    old = temporary_name(folder)
    with contextlib.suppress(FileNotFoundError):
        os.replace(folder, old)
    os.replace(temporary, folder)
    sync(folder.parent)
    discard_tree(old)


def _name(number: int, count: int) -> str:
    return f"{number:06}-of-{count:06}{PARQUET}"
