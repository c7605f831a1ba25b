"""Rows of an HDF5 file, each block of which is proven by its digest whenever it is read (digests.py)."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import Hdf5Error
from .digests import ATTRIBUTE, Digests, DigestTable, attribute_digest, block_digests
from .hdf5_opening import StrictFile
from .schema import DIGESTS


class ProvenRows:
    """Rows and attributes of an opened file; raises Hdf5Error where one is not what was written."""

    def __init__(self, opened: StrictFile) -> None:
        self._opened = opened
        self._digests: dict[str, Digests | None] = {}
        self._kept: dict[str, tuple[int, NDArray[Any]]] = {}  # of each dataset, the block that was read last

    @cached_property
    def table(self) -> DigestTable | None:
        """Digests that the file has; None where it has none."""
        text = self._opened.attribute("/", ATTRIBUTE)
        if text is None:
            return None
        try:
            return DigestTable(text if isinstance(text, str) else "")
        except (ValueError, RecursionError) as error:
            raise Hdf5Error(f"attribute {ATTRIBUTE} of / is damaged: {error}") from error

    def read(self, path: str, first: int, stop: int | None) -> NDArray[Any]:
        """Rows `first` to `stop` (all) of a dataset; those of a file without digests as they are."""
        digests = self._digests_of(path)
        if digests is None or not len(digests):
            return self._opened.read(path, first, stop)
        begin, end, _ = slice(first, stop).indices(self._opened.declared(path).shape[0])
        return self._read_blocks(path, digests, begin, max(begin, end))

    def require_attributes(self) -> None:
        """Refuse attributes that are not those which the file has digests of."""
        for group, digests in ({} if self.table is None else self.table.attributes).items():
            for key, digest in digests.items():
                value = self._opened.attribute(group, key)
                if value is None or attribute_digest(value) != digest:
                    raise Hdf5Error(f"attribute {key} of {group} is not what was written")

    def _read_blocks(self, path: str, digests: Digests, begin: int, end: int) -> NDArray[Any]:
        """Rows, read in whole blocks."""
        block_rows = 1 if self.table is None else self.table.block_rows
        first, stop = begin // block_rows, -(-end // block_rows)
        asked = slice(begin - first * block_rows, end - first * block_rows)
        kept = self._kept.get(path)
        if kept is not None and (kept[0], stop) == (first, first + 1):
            return kept[1][asked].copy()
        rows = self._opened.read(path, first * block_rows, stop * block_rows)
        differing = np.flatnonzero(block_digests(rows, block_rows) != digests[first:stop])
        if len(differing):
            row = (first + int(differing[0])) * block_rows
            last = min(row + block_rows, self._opened.declared(path).shape[0])
            raise Hdf5Error(f"{path} is damaged: rows {row} to {last} are not what was written, by their digest")
        if stop != first + 1:
            return rows[asked]
        self._kept[path] = first, rows
        return rows[asked].copy()

    def _digests_of(self, path: str) -> Digests | None:
        """Digests of a dataset's blocks; None where the file has no digests."""
        if path not in self._digests:
            self._digests[path] = self._read_digests(path)
        return self._digests[path]

    def _read_digests(self, path: str) -> Digests | None:
        table = self.table if path != DIGESTS.path else None
        shape = self._opened.declared(path).shape
        if table is None or not shape:
            return None
        if path not in table.datasets:
            raise Hdf5Error(f"{path} has no digest, which every dataset of a file with digests has")
        first, stop = table.block_range(path, shape)
        digests = np.asarray(self._opened.read(DIGESTS.path, first, stop), np.uint64)
        if not table.is_dataset(path, shape, digests):
            raise Hdf5Error(f"the digests of {path} are not what was written")
        return digests
