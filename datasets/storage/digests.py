"""Digests of what an HDF5 file holds: XXH3-64, which detects what Fletcher-32 misses (zeros, 0x0000 for 0xFFFF).

They detect accidents, not attacks: who changes a file can also change its digests. They stand in the root's attribute
`digests`, a JSON object of two objects:

| name         | by                 | XXH3-64, hexadecimal, of                                    |
|--------------|--------------------|-------------------------------------------------------------|
| `datasets`   | path               | all rows' bytes, little endian, uncompressed                |
| `attributes` | path, then name    | a text's UTF-8, or a number's or an array's bytes, likewise |
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, NamedTuple, Self

import numpy as np
import xxhash
from numpy.typing import NDArray

from ..json_text import parse_json

ATTRIBUTE = "digests"
"""Attribute of the root."""

Value = str | int | float | NDArray[Any]
"""Of an attribute."""


class RowDigest:
    """Digest of a dataset whose rows come a few at a time."""

    def __init__(self) -> None:
        self._digest = xxhash.xxh3_64()

    def add(self, rows: NDArray[Any]) -> None:
        """Add the next rows."""
        self._digest.update(
            np.ascontiguousarray(rows, rows.dtype.newbyteorder("<")).data.cast("B") if rows.size else b""
        )

    def finish(self) -> str:
        """Of all rows, hexadecimal."""
        return self._digest.hexdigest()


class Digests(NamedTuple):
    """Digests of a file's datasets by path, and of attributes by the path of their group and by name."""

    datasets: Mapping[str, str]
    attributes: Mapping[str, Mapping[str, str]]

    def text(self) -> str:
        """JSON of both."""
        return json.dumps(self._asdict())

    @classmethod
    def from_text(cls, text: str) -> Self | None:
        """Read back what `text` gave; None for digests of blocks, which formats 1.2 to 1.4 have.

        Raises ValueError for anything else.
        """
        found: Any = parse_json(text)
        try:
            if "block_rows" in found.keys():  # noqa: SIM118 - a list or a text would be searched by `in` alone
                return None
            datasets = {path: str(digest) for path, digest in found["datasets"].items()}
            groups = found["attributes"].items()
            return cls(datasets, {group: {key: str(own) for key, own in keys.items()} for group, keys in groups})
        except (TypeError, KeyError, AttributeError) as error:
            raise ValueError(f"not digests: {error}") from error


def attribute_digests(attributes: Mapping[str, Mapping[str, Value]]) -> dict[str, dict[str, str]]:
    """Digests of attributes, by group and name."""
    return {group: {key: attribute_digest(value) for key, value in own.items()} for group, own in attributes.items()}


def attribute_digest(value: Value) -> str:
    """XXH3-64 (hexadecimal) of an attribute."""
    if isinstance(value, str):
        return xxhash.xxh3_64_hexdigest(value.encode())
    numbers = np.asarray(value)
    return xxhash.xxh3_64_hexdigest(numbers.astype(numbers.dtype.newbyteorder("<")).tobytes())
