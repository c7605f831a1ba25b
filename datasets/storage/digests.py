"""Digests of a contour file's content: XXH3, which detects errors that Fletcher-32 misses (zeros, 0x0000 for 0xFFFF).

They detect accidents, not attacks: who changes a file can also change its digests.

| where                    | what                                                                              |
|--------------------------|-----------------------------------------------------------------------------------|
| rows of /digests/block   | XXH3-64 of a block of rows of a dataset: their bytes, little endian, uncompressed |
| root's `digests` (JSON)  | `datasets`, by path: first row there, XXH3-128 of path, shape and rows there      |
|                          | `attributes`, by group and name: XXH3-64 of UTF-8 text, or of a number's bytes    |
|                          | `block_rows`: rows of a block; a dataset's last block may be shorter              |
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import xxhash
from numpy.typing import NDArray

from ..json_text import parse_json

Digests = NDArray[np.uint64]
"""Shape [block]."""

ATTRIBUTE = "digests"
"""Attribute of the root."""


def block_digests(rows: NDArray[Any], block_rows: int) -> Digests:
    """XXH3-64 of each block of rows; empty if there is no element."""
    content = _rows_as_bytes(rows)
    firsts = range(0, len(content), block_rows)
    return np.array([xxhash.xxh3_64_intdigest(content[k : k + block_rows].data) for k in firsts], np.uint64)


class BlockDigester:
    """Computes digests of a dataset's blocks from rows that arrive in small batches."""

    def __init__(self, block_rows: int) -> None:
        self._block_rows = block_rows
        self._done: list[int] = []
        self._begun = xxhash.xxh3_64()
        self._count = 0

    def add(self, rows: NDArray[Any]) -> None:
        """Add the next rows."""
        content = _rows_as_bytes(rows)
        while len(content):
            taken = content[: self._block_rows - self._count]
            self._begun.update(taken.data)
            self._count += len(taken)
            content = content[len(taken) :]
            if self._count == self._block_rows:
                self._end_block()

    def finish(self) -> Digests:
        """Digests of all blocks."""
        if self._count:
            self._end_block()
        return np.array(self._done, np.uint64)

    def _end_block(self) -> None:
        self._done.append(self._begun.intdigest())
        self._begun = xxhash.xxh3_64()
        self._count = 0


def attribute_digest(value: str | int | float | NDArray[Any]) -> str:
    """XXH3-64 (hexadecimal) of an attribute."""
    if isinstance(value, str):
        return xxhash.xxh3_64_hexdigest(value.encode())
    numbers = np.asarray(value)
    return xxhash.xxh3_64_hexdigest(numbers.astype(numbers.dtype.newbyteorder("<")).tobytes())


def digests_text(
    datasets: Mapping[str, tuple[tuple[int, ...], Digests]],
    attributes: Mapping[str, Mapping[str, str | int | float | NDArray[Any]]],
    block_rows: int,
) -> str:
    """Text of the root's attribute `digests`; /digests/block has the rows of the datasets in this order."""
    first = 0
    described: dict[str, tuple[int, str]] = {}
    for path, (shape, digests) in datasets.items():
        described[path] = (first, _dataset_digest(path, shape, digests))
        first += len(digests)
    attribute_digests = {
        group: {key: attribute_digest(value) for key, value in values.items()} for group, values in attributes.items()
    }
    return json.dumps({"block_rows": block_rows, "datasets": described, "attributes": attribute_digests})


class DigestTable:
    """The root's attribute `digests`, parsed; raises ValueError if it is malformed."""

    def __init__(self, text: str) -> None:
        found: Any = parse_json(text)
        try:
            self.block_rows = int(found["block_rows"])
            datasets: dict[str, tuple[int, str]] = found["datasets"]
            self.datasets = {path: (int(first), str(digest)) for path, (first, digest) in datasets.items()}
            groups: dict[str, dict[str, str]] = found["attributes"]
            self.attributes = {group: {key: str(own) for key, own in keys.items()} for group, keys in groups.items()}
        except (TypeError, KeyError, AttributeError) as error:
            raise ValueError(f"not digests: {error}") from error
        if self.block_rows < 1 or any(first < 0 for first, _ in self.datasets.values()):
            raise ValueError(f"blocks of {self.block_rows} rows, or a negative row")

    def block_range(self, path: str, shape: tuple[int, ...]) -> tuple[int, int]:
        """Range (first, stop) of a dataset's rows in /digests/block."""
        first, _ = self.datasets[path]
        return first, first + (-(-shape[0] // self.block_rows) if 0 not in shape else 0)

    def is_dataset(self, path: str, shape: tuple[int, ...], digests: Digests) -> bool:
        """Whether a dataset's path, shape and rows of /digests/block match its stored digest."""
        return self.datasets[path][1] == _dataset_digest(path, shape, digests)


def _dataset_digest(path: str, shape: Iterable[int], digests: Digests) -> str:
    digest = xxhash.xxh3_128(json.dumps([path, [int(size) for size in shape]]).encode())
    digest.update(np.ascontiguousarray(digests, "<u8").data)
    return digest.hexdigest()


def _rows_as_bytes(rows: NDArray[Any]) -> NDArray[np.uint8]:
    """The rows' bytes, little endian, shape [row, byte]; no rows if there is no element."""
    if rows.size == 0:
        return np.zeros((0, 1), np.uint8)
    return np.ascontiguousarray(rows, rows.dtype.newbyteorder("<")).reshape(len(rows), -1).view(np.uint8)
