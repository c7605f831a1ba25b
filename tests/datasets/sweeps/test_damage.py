"""Damage to a sweep's store: what is read is right to the bit, or an error; a sweep makes it again."""

import hashlib
import shutil
import sqlite3
import struct
from contextlib import closing

import h5py
import numpy as np
import pytest
from sweep_damage import RECIPE_SHARDS, Damages, damaged, make_store, read_path
from sweep_store_rows import MAKER, payload, places_of, pose_columns, write_rows

from palpate.datasets.errors import SweepStoreError
from palpate.datasets.sweeps.check import check_store
from palpate.datasets.sweeps.shard import read_shard
from palpate.datasets.sweeps.store import SweepStore

TRAILER_BYTES = 56
PLACES = [place for number in range(RECIPE_SHARDS) for place in places_of(1, number)]
KEYS = sorted({place[:2] for place in PLACES})


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    folder = tmp_path_factory.mktemp("damage") / "store"
    make_store(folder)
    return folder


@pytest.fixture
def folder(original, tmp_path):
    return shutil.copytree(original, tmp_path / "copy")


def in_manifest(folder, *statements):
    """Change a manifest as no palpate does."""
    with closing(sqlite3.connect(folder / "store.sqlite")) as connection, connection:
        for statement in statements:
            connection.execute(statement)


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", range(6))
def test_no_damage_is_read_as_something_else(original, tmp_path, seed):
    damages = Damages(original, tmp_path, seed)
    for number in range(40):
        damages.once(number)
    assert damages.told == []
    assert sum(damages.counts[kind, "error"] for kind in damages.kinds) > 10


def record_missing(folder):
    """What a sweep does: take over what is there, and make again what is not; what it said of damage."""
    with SweepStore(folder, maker=MAKER) as store:
        store.recover()
        done = store.done(KEYS)
        missing = [place for place in PLACES if place[2] not in done[place[:2]]]
        if missing:
            write_rows(store.folder / "shards/again.h5", missing)
            store.record("shards/again.h5")
        found = {
            place: own
            for *place, own in ((*row[:3], row[3]) for row in store.results(KEYS))
            for place in [tuple(place)]
        }
        assert {place: found.get(place) for place in PLACES} == {place: payload(*place) for place in PLACES}
        for group, key in KEYS:
            for part, columns in store.column_parts(key, group=group):
                np.testing.assert_array_equal(columns["length"], pose_columns(key, part)["length"])
        return store.damaged


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", range(25))
def test_a_sweep_makes_again_what_a_damaged_store_lacks_or_tells_the_way_out(original, folder, seed):
    chance = np.random.default_rng(seed)
    victims = [folder / "store.sqlite", *sorted((folder / "columns").iterdir())]
    victim = victims[int(chance.integers(len(victims))) if seed % 2 else 0]
    victim.write_bytes(damaged(victim.read_bytes(), chance)[0])
    told = []
    for _ in range(3):
        try:
            record_missing(folder)
            break
        except SweepStoreError as error:
            told.append(str(error))
            if "move it away and run the sweep again" in told[-1]:
                (folder / "store.sqlite").rename(folder / "moved")
    else:
        pytest.fail("three sweeps did not mend it")
    assert all("run the sweep again" in sentence for sentence in told)
    assert record_missing(folder) == []


def test_a_damaged_row_counts_as_not_done_and_is_made_again(folder):
    in_manifest(folder, "UPDATE part SET payload = replace(payload, '1.5', '1.6') WHERE id = 7")
    with (
        SweepStore(folder, mode="read") as store,
        pytest.raises(SweepStoreError, match=r"1 parts of contours .* run the sweep again: it makes them anew"),
    ):
        list(store.results(KEYS))
    said = record_missing(folder)
    assert len(said) == 1
    assert "1 parts of contours do not have their digests" in said[0]
    assert record_missing(folder) == []


def test_rows_that_changed_places_are_found(folder):
    in_manifest(
        folder,
        "CREATE TEMP TABLE old AS SELECT id, payload, digest FROM part WHERE id IN (7, 8)",
        "UPDATE part SET (payload, digest) = (SELECT payload, digest FROM old WHERE id = 15 - part.id) "
        "WHERE id IN (7, 8)",
    )
    assert len(check_store(folder).problems) == 2
    assert "2 parts of contours" in record_missing(folder)[0]


@pytest.mark.parametrize(
    "loss",
    [
        (
            "DELETE FROM part WHERE id = 7",  # its trigger counts that, as no damage does
            "UPDATE tally SET parts = parts + 1 WHERE key = 'key1-0' AND \"group\" = 'contours'",
        ),
        ("UPDATE tally SET parts = parts - 1 WHERE key = 'key1-0'",),
        ("DELETE FROM tally WHERE key = 'key1-1'",),
        ("UPDATE part SET key = 'other' WHERE id = 7",),
    ],
)
def test_a_manifest_that_lost_rows_is_refused_with_the_way_out(folder, loss):
    in_manifest(folder, *loss)
    for mode in ("read", "create"):
        with (
            SweepStore(folder, maker=MAKER, mode=mode) as store,
            pytest.raises(
                SweepStoreError, match=r"store.sqlite is damaged .*recorded.*: move it away and run the sweep"
            ),
        ):
            store.done(KEYS)
    assert check_store(folder).problems


def read_all_columns(store):
    for group, key in KEYS:
        if store.done([(group, key)])[group, key] and group == "poses":
            store.columns(key, group=group)


def test_a_chunk_of_zeros_in_columns_is_found_though_its_checksum_is_right(folder):
    """Fletcher-32 of zeros is 0, so HDF5 alone reads them as they are."""
    path = next((folder / "columns").iterdir())
    with h5py.File(path) as file:
        info = file["columns/0/length"].id.get_chunk_info(0)
    content = bytearray(path.read_bytes())
    content[info.byte_offset : info.byte_offset + info.size] = bytes(info.size)
    path.write_bytes(content)
    with h5py.File(path) as file:
        assert not file["columns/0/length"][...].any()
    with SweepStore(folder, mode="read") as store, pytest.raises(SweepStoreError, match="its checksum does not match"):
        read_all_columns(store)


def test_a_manifest_that_is_gone_is_noticed(folder):
    (folder / "store.sqlite").unlink()
    assert "store.sqlite is missing, so a new one is made" in record_missing(folder)[0]
    assert record_missing(folder) == []


def version_one(folder):
    """Take from a manifest what version 2 added, as an earlier palpate wrote it."""
    drops = [f"ALTER TABLE {name} DROP COLUMN digest" for name in ("part", "maker", "failure")]
    in_manifest(
        folder,
        "DROP TRIGGER part_comes",
        "DROP TRIGGER part_goes",
        "DROP TABLE tally",
        *drops,
        "PRAGMA user_version = 1",
    )


@pytest.mark.exhaustive
def test_a_store_of_version_1_is_read_as_it_is_and_proven_from_the_next_sweep_on(original, folder):
    version_one(folder)
    with SweepStore(folder, mode="read") as store:
        assert not store.is_proven
        assert list(store.done(KEYS)) == KEYS
    found, expected = (read_path(where / "store.sqlite", KEYS) for where in (folder, original))
    assert [found[name] for name in ("makers", "done", "results", "failed")] == [
        expected[name] for name in ("makers", "done", "results", "failed")
    ]
    assert (check_store(folder).problems, len(check_store(folder).unproven)) == ([], 1)
    assert f"carried no digests: its {len(PLACES)} parts are believed as they are" in record_missing(folder)[0]
    assert check_store(folder).unproven == []
    in_manifest(folder, "UPDATE part SET payload = replace(payload, '1.5', '1.6') WHERE id = 7")
    assert "1 parts of contours do not have their digests" in record_missing(folder)[0]


ENDLESS = "WITH RECURSIVE n(x) AS (VALUES (1) UNION ALL SELECT x + 1 FROM n) SELECT x AS id, x AS name FROM n"


@pytest.mark.parametrize(
    ("name", "statements"),
    [
        ("shard", ["DROP TABLE shard", f"CREATE VIEW shard AS {ENDLESS}"]),
        (
            "column_file",
            ["ALTER TABLE column_file RENAME TO x", f"CREATE VIEW column_file AS {ENDLESS}"],
        ),
        ("more", ["CREATE TRIGGER more AFTER INSERT ON part BEGIN DELETE FROM part; END"]),
        ("part_goes", ["DROP TRIGGER part_goes"]),
        ("failure", ["ALTER TABLE failure ADD COLUMN cost AS (length(sentence))"]),
    ],
)
def test_a_manifest_with_other_tables_views_or_triggers_is_refused_by_their_name(folder, name, statements):
    in_manifest(folder, "PRAGMA legacy_alter_table = ON", *statements)
    for mode in ("read", "create"):
        with pytest.raises(SweepStoreError, match=f"its tables are not those of version 2: '{name}' differs"):
            SweepStore(folder, maker=MAKER, mode=mode)
    assert any(f"'{name}' differs" in text for text in check_store(folder).problems)


def test_digests_are_what_the_document_says(folder):
    """Computed here from the document, not by palpate."""
    for path in (folder / "columns").iterdir():
        content = path.read_bytes()
        mark, size, digest = struct.unpack("<16sQ32s", content[-TRAILER_BYTES:])
        assert mark.rstrip(b"\0") == b"palpate shard 1\n"
        assert size == len(content) - TRAILER_BYTES
        assert digest == hashlib.blake2b(content[:-TRAILER_BYTES], digest_size=32).digest()
        assert path.stem == digest.hex()
    with closing(sqlite3.connect(folder / "store.sqlite")) as connection:
        query = (
            "SELECT maker, \"group\", key, part, coalesce(substr(file, 9), ''), coalesce(\"row\", ''), payload "
            "FROM parts ORDER BY 2, 3, 4"
        )
        rows = connection.execute(query).fetchall()
        digests = connection.execute('SELECT digest FROM part ORDER BY "group", key, part').fetchall()
    assert len(rows) == len(PLACES)
    texts = ["\n".join(map(str, row)).encode() for row in rows]
    assert [(hashlib.blake2b(text, digest_size=16).digest(),) for text in texts] == digests


def sealed(path):
    """Put a right trailer behind a shard, as somebody does who makes one by hand."""
    content = path.read_bytes()
    digest = hashlib.blake2b(content, digest_size=32).digest()
    path.write_bytes(content + struct.pack("<16sQ32s", b"palpate shard 1\n", len(content), digest))


def as_bytes(text):
    return np.frombuffer(text.encode(), np.uint8)


ROWS = as_bytes('[["poses","k",0]]')


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ({"rows": ROWS.astype(np.float64)}, r"/rows is float64 \[17\], expected bytes"),
        ({"rows": ROWS.reshape(1, -1)}, r"/rows is uint8 \[1, 17\], expected bytes in one dimension"),
        ({"rows": as_bytes("{}")}, "/rows is dict, expected a list"),
        ({"rows": as_bytes("[1")}, "/rows is not JSON"),
        ({"rows": as_bytes("[" * 100_000)}, "/rows is not JSON: .* deep"),
        ({"rows": as_bytes('[["poses","k"]]')}, r"/rows has \['poses', 'k'\] at place 0, expected group, key"),
        (
            {"rows": as_bytes('[["poses","k",-1]]')},
            r"/rows has .*-1\] at place 0, expected group, key, and part below 9223372036854775808",
        ),
        ({"rows": as_bytes('[["poses","k",true]]')}, "/rows has .* at place 0"),
        ({"rows": as_bytes(f'[["poses","k",{1 << 63}]]')}, "/rows has .* at place 0"),
        ({"payloads": None}, "/payloads is missing"),
        ({"payloads": as_bytes("{}\n{}")}, "1 rows have 2 payloads"),
        ({"columns/0/a": np.zeros((2, 2))}, r"/columns/0/a has shape \[2, 2\], expected one dimension"),
        ({"columns/0/a": np.zeros(2, np.complex64)}, "/columns/0/a is of an HDF5 c"),
        ({"columns/0/a/b": np.zeros(2)}, "/columns/0/a is missing or not a dataset"),
        ({"columns/7/a": np.zeros(2)}, "/columns/7 is nothing that a shard of 1 rows has"),
        ({"columns/0/a": np.zeros(2), "columns/0/b": np.zeros(3)}, "/columns/0/b has 3 rows, expected 2"),
    ],
)
def test_a_shard_of_other_ranks_and_types_is_refused_by_path(tmp_path, content, reason):
    path = tmp_path / "a.h5"
    with h5py.File(path, "w", libver=("v108", "v108")) as file:
        for name, values in ({"rows": ROWS, "payloads": as_bytes("{}")} | content).items():
            if values is not None:
                file[name] = values
    sealed(path)
    with pytest.raises(SweepStoreError, match=rf"a\.h5.*{reason}"):
        read_shard(path)


def test_check_names_every_damaged_file_of_a_store(folder):
    assert check_store(folder).problems == check_store(folder).unproven == []
    victims = [next((folder / "columns").iterdir()), next((folder / "shards").iterdir())]
    for path in victims:
        content = bytearray(path.read_bytes())
        content[len(content) // 2] ^= 1
        path.write_bytes(content)
    in_manifest(folder, "UPDATE part SET part = 99 WHERE id = 7")
    problems = check_store(folder).problems
    for path in victims:
        assert sum(str(path) in text for text in problems) == 1
    assert any("part 99 of contours key1-0 is damaged" in text for text in problems)
    assert len(problems) == len(victims) + 1
