"""A row of a sweep's store: the result of one chunk, encoded and given its digests where it is made."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Self, cast

import numpy as np
import xxhash

from ..errors import SweepStoreError
from ..json_text import parse_json

Columns = Mapping[str, np.ndarray[Any, np.dtype[Any]]]
"""Arrays of equal length by name, such as one value a pose."""


@dataclass(frozen=True)
class ResultRow:
    """The result of one chunk.

    >>> from palpate.datasets import ResultRow
    >>> ResultRow.of("own code 1.0", "contours", "a1b2", 0, {"length": 0.34})
    ResultRow(group='contours', key='a1b2', chunk=0, payload='{"length":0.34}')
    """

    group: str
    """The metrics, or the kind of file that was kept."""
    key: str
    """Hash of all that the result depends on, but for the code."""
    chunk: int
    """Number of the chunk among the recipe's poses, from 0."""
    payload: str
    """JSON of sums, seconds, or the path and size of a kept file."""
    digest: int = field(repr=False)
    """XXH3-64 of the code version, the three above and the payload, as a signed number."""
    columns: bytes | None = field(default=None, repr=False)
    """Arrays of one value a pose, in NumPy's .npz format without compression."""
    columns_digest: int | None = field(default=None, repr=False)
    """The same digest of the columns."""

    @classmethod
    def of(
        cls, code: str, group: str, key: str, chunk: int, payload: Mapping[str, Any], columns: Columns | None = None
    ) -> Self:
        """Encode a result of a code version. Raises SweepStoreError for a payload that JSON does not hold."""
        text = json.dumps(payload, separators=(",", ":"), default=_plain)
        digest = digest_of(code, group, key, chunk, text.encode())
        if columns is None:
            return cls(group, key, chunk, text, digest)
        if taken := {"file", "allow_pickle"} & set(columns):  # names of numpy.savez's own
            raise SweepStoreError(f"a column cannot have the name {min(taken)!r}")
        np.savez(stream := io.BytesIO(), **cast("Any", columns))
        blob = stream.getvalue()
        return cls(group, key, chunk, text, digest, blob, digest_of(code, group, key, chunk, blob))

    def is_whole(self, code: str) -> bool:
        """Whether the row has the digests that it got when this code version made it."""
        place = code, self.group, self.key, self.chunk
        # A hostile store may hold other types.
        if not (isinstance(self.chunk, int) and self.chunk >= 0 and isinstance(self.payload, str)):  # pyright: ignore[reportUnnecessaryIsInstance]
            return False
        if digest_of(*place, self.payload.encode(errors="surrogateescape")) != self.digest:
            return False
        is_blob = isinstance(self.columns, bytes) and digest_of(*place, self.columns) == self.columns_digest
        return self.columns is None or is_blob


def _plain(value: object) -> object:
    if isinstance(value, np.generic):
        return cast("Any", value).item()
    raise SweepStoreError(f"a payload holds what JSON holds, not {type(value).__name__}")


def digest_of(code: str, group: str, key: str, chunk: int, content: bytes) -> int:
    """XXH3-64 of a result's identity and content, as the signed number that SQLite holds."""
    head = f"{code}\n{group}\n{key}\n{chunk}\n".encode(errors="surrogateescape")
    number = xxhash.xxh3_64_intdigest(head + content)
    return number - (1 << 64) if number >> 63 else number


def payload_of(text: str) -> dict[str, Any]:
    """A payload decoded; raises ValueError for a text that is no JSON object."""
    value: object = parse_json(text, allow_nan=True)
    if not isinstance(value, dict):
        raise ValueError(f"a payload is a JSON object, not {text:.80}")
    return cast("dict[str, Any]", value)


def columns_of(blob: bytes) -> dict[str, np.ndarray[Any, np.dtype[Any]]]:
    """Columns decoded; raises ValueError for what `ResultRow.of` never writes, such as compressed or nested arrays."""
    try:
        with zipfile.ZipFile(io.BytesIO(blob)) as file:
            if any(entry.file_size > len(blob) for entry in file.infolist()):  # compressed: of any size once unpacked
                raise ValueError("columns are never compressed")
        with np.load(io.BytesIO(blob), allow_pickle=False) as arrays:
            found: dict[str, np.ndarray[Any, np.dtype[Any]]] = {name: arrays[name] for name in arrays.files}
    except (zipfile.BadZipFile, KeyError, OSError, EOFError) as error:
        raise ValueError(f"columns cannot be read: {error}") from error
    if any(array.ndim != 1 for array in found.values()) or len({len(array) for array in found.values()}) > 1:
        raise ValueError("columns are one-dimensional and equally long")
    return found
