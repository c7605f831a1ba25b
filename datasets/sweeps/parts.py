"""Parts of a manifest as they are read: each row is proven by its digest, and no part of a key is missing.

How many parts a key has is counted twice, in two trees of the file: rows under the index, and `tally`. One that was
damaged or shortened disagrees with the other. Manifests of version 1 have neither digests nor tally.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from typing import Any, NamedTuple, cast

from ..errors import SweepStoreError
from ..json_text import parse_json
from .manifest import Manifest, row_digest


class PartRow(NamedTuple):
    """A part of a key."""

    id: int
    key: str
    part: int
    payload: bytes
    """UTF-8 JSON."""
    file: bytes | None
    """Name of the file of its columns; None if it has none."""
    row: int | None
    """In that file."""
    digest: bytes | None


_COLUMNS = "part.id, part.key, part.part, CAST(part.payload AS BLOB), CAST(column_file.name AS BLOB), part.column_row"
_JOINED = "LEFT JOIN column_file ON column_file.id = part.column_file"
_OF_KEYS = (
    "SELECT {}, {} FROM part INDEXED BY part_of {} "
    'WHERE part.maker = {} AND part."group" = ? AND part.key IN ({{}}) ORDER BY part.key, part.part'
)
_TALLY = 'SELECT key, parts FROM tally WHERE maker = {} AND "group" = ? AND key IN ({{}})'
_ALL = (
    f'SELECT part.maker, maker.maker, part."group", {_COLUMNS}, part.digest '
    f"FROM part NOT INDEXED JOIN maker ON maker.id = part.maker {_JOINED}"
)


class Parts:
    """Parts of some makers in a manifest; every method raises SweepStoreError.

    makers: number and name; of a part that several have, the first one's counts.
    """

    def __init__(self, manifest: Manifest, makers: Sequence[tuple[int, str]]) -> None:
        self._manifest, self._makers = manifest, [maker.encode() for _, maker in makers]
        self.are_proven = manifest.version > 1
        """Whether rows carry digests."""
        digest = "part.digest" if self.are_proven else "NULL"
        self._statements: list[str] = []
        for number, _ in makers:
            self._statements.append(_OF_KEYS.format(_COLUMNS, digest, _JOINED, number))
            self._statements += [_TALLY.format(number)] * self.are_proven

    def of(self, group: str, keys: Sequence[str]) -> Iterator[tuple[list[PartRow], list[PartRow]]]:
        """Rows of some keys, a batch of keys at a time, by key and part: those that are whole, and damaged ones.

        Raises:
            SweepStoreError: A key has fewer or more parts than were counted.
        """
        for found in self._manifest.among(self._statements, (group,), keys):
            if not self.are_proven:
                yield _joined([[PartRow(*values) for values in rows] for rows in found]), []
                continue
            each = [
                self._proven(maker, group, rows, tally)
                for maker, rows, tally in zip(self._makers, found[::2], found[1::2], strict=True)
            ]
            yield _joined([whole for whole, _ in each]), [row for _, damaged in each for row in damaged]

    def _proven(
        self, maker: bytes, group: str, values: Sequence[tuple[Any, ...]], tally: Sequence[tuple[Any, ...]]
    ) -> tuple[list[PartRow], list[PartRow]]:
        """One maker's rows that are whole, and damaged ones."""
        rows = [PartRow(*own) for own in values]
        self._refuse_missing(group, Counter(row.key for row in rows), dict(tally))
        whole = [row for row in rows if _digest_of(maker, group, row) == row.digest]
        return whole, [row for row in rows if row not in whole] if len(whole) < len(rows) else []

    def forget(self, rows: Sequence[PartRow]) -> None:
        """Remove rows, unless another process has just replaced them."""
        if rows:
            with self._manifest.transaction():
                statement = "DELETE FROM part WHERE id = ? AND CAST(payload AS BLOB) IS ? AND digest IS ?"
                self._manifest.changed_by(statement, [(row.id, row.payload, row.digest) for row in rows])

    def _refuse_missing(self, group: str, found: Mapping[str, int], counted: Mapping[str, int]) -> None:
        if found != counted:
            key = next(key for key in {**found, **counted} if found.get(key) != counted.get(key))
            what = f"{group} {key} has {found.get(key, 0)} parts, and {counted.get(key, 0)} were recorded"
            raise self._manifest.damaged(what)


def _joined(each: Sequence[list[PartRow]]) -> list[PartRow]:
    """Rows of several makers, each part once, by key and part."""
    if len(each) == 1:
        return each[0]
    found: dict[tuple[str, int], PartRow] = {}
    for row in chain.from_iterable(each):
        found.setdefault((row.key, row.part), row)
    return [found[place] for place in sorted(found)]


def _digest_of(maker: str | bytes, group: str, row: PartRow) -> bytes:
    _, key, part, payload, file, place, _ = row
    return row_digest(maker, group, key, part, file, place, payload)


def payload_of(row: PartRow, where: object) -> dict[str, Any]:
    """A row's payload decoded; raises SweepStoreError, naming `where` it lies, for one that is no JSON object."""
    try:
        payload: Any = parse_json(row.payload, allow_nan=True)
    except (ValueError, TypeError) as error:  # TypeError: it is NULL
        raise SweepStoreError(f"{where}: the payload of part {row.part} of {row.key} is damaged: {error}") from error
    if not isinstance(payload, dict):
        raise SweepStoreError(f"{where}: the payload of part {row.part} of {row.key} is {payload!r:.80}, no object")
    return cast("dict[str, Any]", payload)


def manifest_problems(manifest: Manifest) -> list[str]:
    """What is damaged in a manifest, a sentence each; every row of it is read. Empty if it is whole."""
    if manifest.version == 1:
        return []
    problems = [f"{manifest.path}: {text}" for (text,) in manifest.run("PRAGMA integrity_check(8)") if text != "ok"]
    counts: Counter[tuple[Any, ...]] = Counter()
    for number, maker, group, *values in manifest.run(_ALL):
        row = PartRow(*values)
        counts[number, group, row.key] += 1
        if _digest_of(maker, group, row) != row.digest:
            problems.append(f"{manifest.path}: part {row.part} of {group} {row.key} is damaged: its digest differs")
    tally: dict[tuple[Any, ...], int] = {
        (number, group, key): parts
        for number, group, key, parts in manifest.run('SELECT maker, "group", key, parts FROM tally')
    }
    for _, group, key in [place for place in {**counts, **tally} if counts.get(place) != tally.get(place)]:
        problems.append(f"{manifest.path}: parts of {group} {key} are missing")
    return problems
