"""A shard: what one task of a sweep leaves, an HDF5 file with its own checksum behind it.

`/rows` is UTF-8 JSON, a list of [group, key, part]; `/payloads` has the payload of each, one line of JSON after
another, as the manifest takes them; `/columns/<number of the row>/<name>` are per-pose columns. Behind the HDF5 file
comes a trailer (`content_digest.py`); a shard that a store keeps is named by its digest.
"""

from __future__ import annotations

import json
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, cast

import numpy as np

from ..errors import Hdf5Error, SweepStoreError
from ..json_text import parse_json
from ..storage.content_digest import content_trailer, read_whole, require_whole
from ..storage.durable import write_file
from ..storage.hdf5_columns import (
    Columns,
    Values,
    column_arrays,
    image_of,
    new_image,
    open_columns,
    put_column,
    take_columns,
)
from ..storage.hdf5_opening import StrictFile

FORMAT_NAME = "palpate shard"
FORMAT_VERSION = 1
DAMAGED_SUFFIX = ".damaged"
"""Ends the name of a shard, or of a kept file, that was set aside."""

_KIND = "shard"
_PARTS_MOST = 1 << 63  # what SQLite holds
_ROWS_MOST = 1 << 28  # [byte] of /rows: millions of parts


@dataclass(frozen=True)
class ShardRow:
    """A row of a shard: a finished part of a recipe, and what came of it.

    >>> from palpate.datasets import ShardRow
    >>> ShardRow("contours", "a1b2", 0, {"length": 0.34})
    ShardRow(group='contours', key='a1b2', part=0, payload={'length': 0.34})
    """

    group: str
    """Which metrics, or what was kept."""
    key: str
    """Hash of all that it depends on."""
    part: int
    """Which part of the recipe's poses, from 0."""
    payload: Mapping[str, Any]
    """What came of it, as JSON holds it: sums, seconds, or where a file lies."""


@dataclass(frozen=True)
class Shard:
    """Content of a shard."""

    maker: str | None
    """Which code made it; None if it does not say."""
    places: tuple[tuple[str, str, int], ...]
    """Group, key and part of each row."""
    payloads: tuple[str, ...]
    """Payload of each row, as JSON."""
    columns: tuple[Columns | None, ...]
    """Per-pose columns of each row; None for a row that has none, or if they were not asked for."""
    with_columns: tuple[bool, ...]
    """Which rows have columns."""
    digest: str
    """BLAKE2b-256 of the content."""

    @cached_property
    def rows(self) -> tuple[ShardRow, ...]:
        """The rows with their payloads decoded."""
        return tuple(ShardRow(*place, _payload(text)) for place, text in zip(self.places, self.payloads, strict=True))


def write_shard(
    path: str | Path,
    rows: Sequence[ShardRow],
    columns: Sequence[Mapping[str, Values] | None] | None = None,
    *,
    maker: str | None = None,
) -> None:
    """Write a shard such that its name never shows a part of it; written twice, also at once, the last one stays.

    It outlives this process, but a power cut only once it is recorded: waiting for the disk would cost more than
    making its parts again.

    columns: of each row, or None for all; of one row equally long. maker: which code made it; without it a shard that a
    killed parent has left is not taken over (`SweepStore.recover`).

    Raises:
        SweepStoreError: Columns are impossible, or do not go with the rows.
        OSError: As the system says (ENOSPC, EFBIG, ...); nothing is left behind.

    >>> from palpate.datasets import ShardRow, SweepStore, write_shard
    >>> with SweepStore("study.sweep", maker="own code 1.0") as store:
    ...     write_shard("study.sweep/shards/0.h5", [ShardRow("poses", "a1b2", 0, {})], [{"length": [0.34, 0.26]}])
    ...     recorded = store.record("shards/0.h5")
    ...     store.columns("a1b2")
    {'length': array([0.34, 0.26])}
    """
    path = Path(path)
    if columns is not None and len(columns) != len(rows):
        raise SweepStoreError(f"{path}: {len(rows)} rows have columns for {len(columns)}")
    with new_image() as file:
        file.attrs["format"], file.attrs["version"] = FORMAT_NAME, FORMAT_VERSION
        if maker is not None:
            file.attrs["maker"] = maker
        places = json_text([[row.group, row.key, row.part] for row in rows])
        payloads = "\n".join([json_text(row.payload) for row in rows])  # JSON has no newline of its own
        file["rows"] = np.frombuffer(places.encode(), np.uint8)
        file["payloads"] = np.frombuffer(payloads.encode(), np.uint8)
        for number, own in enumerate(columns or ()):
            if own is not None:
                group: Any = file.create_group(f"columns/{number}", track_order=True)
                for name, array in column_arrays(own).items():
                    put_column(group, name, array)
        image = image_of(file)
    write_file(path, image, content_trailer(_KIND, FORMAT_VERSION, image), durable=False)  # the parent syncs it


def json_text(value: Any) -> str:
    """Compact JSON; NumPy's numbers are numbers."""
    return _ENCODER.encode(value)


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic):
        return cast("Any", value.item())
    if isinstance(value, np.ndarray):
        return value.tolist()
    raise SweepStoreError(f"a payload holds what JSON holds, not {type(value).__name__}")


_ENCODER = json.JSONEncoder(separators=(",", ":"), default=_plain, ensure_ascii=False)


def read_shard(path: str | Path, *, columns: bool = True) -> Shard:
    """Read a shard, every byte of it checked.

    columns: whether to read the per-pose columns, too.

    Raises:
        SweepStoreError: It is missing, damaged, no shard, or of a newer version.
    """
    path = Path(path)
    content, digest = read_whole(path, _KIND, FORMAT_VERSION)
    with open_columns(path, content) as file:
        maker = file.attribute("/", "maker")
        if not isinstance(maker, str | None):
            raise Hdf5Error(f"/ has the attribute maker {str(maker)[:80]}, expected text")
        places = tuple(_places(file))
        payloads = tuple(_text(file, "/payloads").split("\n")) if places else ()
        if len(payloads) != len(places):
            raise SweepStoreError(f"{path} is damaged: {len(places)} rows have {len(payloads)} payloads")
        known = {"/rows", "/payloads", "/columns", *(f"/columns/{number}" for number in range(len(places)))}
        found = [*file.members("/"), *(file.members("/columns") if "/columns" in file else [])]
        if unknown := next((path for path in found if path not in known), None):
            raise Hdf5Error(f"{unknown} is nothing that a shard of {len(places)} rows has")
        with_columns = tuple([f"/columns/{number}" in file for number in range(len(places))])
        own = [_columns(file, number) if has and columns else None for number, has in enumerate(with_columns)]
        return Shard(maker, places, payloads, tuple(own), with_columns, digest)


def _places(file: StrictFile) -> list[tuple[str, str, int]]:
    """Group, key and part of each row."""
    try:
        rows: Any = parse_json(_text(file, "/rows"), text_most=_ROWS_MOST)
    except Hdf5Error:
        raise
    except ValueError as error:
        raise Hdf5Error(f"/rows is not JSON: {error}") from error
    if not isinstance(rows, list):
        raise Hdf5Error(f"/rows is {type(rows).__name__}, expected a list of [group, key, part]")
    return [_place(row, number) for number, row in enumerate(cast("list[Any]", rows))]


def _place(row: Any, number: int) -> tuple[str, str, int]:
    match row:
        case [str() as group, str() as key, int() as part] if not isinstance(part, bool) and 0 <= part < _PARTS_MOST:
            return group, key, part
        case _:
            shown = str(cast(object, row))[:80]
            raise Hdf5Error(f"/rows has {shown} at place {number}, expected group, key, and part below {_PARTS_MOST}")


def _text(file: StrictFile, path: str) -> str:
    """A text that is stored as its UTF-8 bytes."""
    own = file.declared(path)
    if own.dtype != np.uint8 or len(own.shape) != 1:
        raise Hdf5Error(f"{path} is {own.dtype} {list(own.shape)}, expected bytes in one dimension")
    return file.read(path).tobytes().decode()


def _payload(text: str) -> Mapping[str, Any]:
    """A row's payload; raises SweepStoreError, without a file's name."""
    try:
        value: Any = parse_json(text, allow_nan=True)
    except ValueError as error:
        raise SweepStoreError(f"a shard's payload is not JSON: {error}") from None
    if not isinstance(value, dict):
        raise SweepStoreError(f"a shard's payload is no JSON object, but {type(value).__name__}")
    return cast("dict[str, Any]", value)


def _columns(file: StrictFile, number: int) -> Columns:
    group = f"/columns/{number}/"
    paths = file.members(group[:-1])
    columns = {path.removeprefix(group): column for path, column in zip(paths, take_columns(file, paths), strict=True)}
    count = len(next(iter(columns.values()), ()))
    for name, column in columns.items():
        if len(column) != count:
            raise Hdf5Error(f"{group}{name} has {len(column)} rows, expected {count} as the first column")
    return columns


@contextmanager
def shard_columns(path: Path) -> Generator[ColumnReader, None, None]:
    """Columns of a shard of a store, row by row, without decoding the others; `require_named` proves it before.

    Raises:
        SweepStoreError: It is missing or damaged.
    """
    with open_columns(path) as file:
        yield ColumnReader(path, file)


def require_named(path: Path) -> None:
    """Prove a shard of a store, every byte of it, by the digest that is its name; raises SweepStoreError."""
    digest = require_whole(path, _KIND, FORMAT_VERSION)
    if path.stem != digest:
        raise SweepStoreError(f"{path} is damaged: its content has the digest {digest}, not the one that names it")


class ColumnReader:
    """Columns of an open shard."""

    def __init__(self, path: Path, file: StrictFile) -> None:
        self._path = path
        self._file = file
        self._places = _places(file)

    def columns(self, number: int, group: str, key: str, part: int) -> Columns:
        """Columns of a row, by its number in the shard and what it must be of."""
        if number >= len(self._places) or self._places[number] != (group, key, part):
            raise SweepStoreError(f"{self._path} is damaged: its row {number} is not part {part} of {group} {key}")
        return _columns(self._file, number)
