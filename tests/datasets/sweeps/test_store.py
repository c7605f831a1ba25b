"""A sweep's store: results recorded once, proven by digests, found again by what they depend on."""

import os
import signal
import sqlite3
import subprocess
import sys
import time

import numpy as np
import pytest
import xxhash

from palpate.datasets import ResultRow, SweepStore
from palpate.datasets.errors import SweepStoreError
from palpate.datasets.sweeps.merging import check_store, merge_store
from palpate.datasets.sweeps.result_row import columns_of
from palpate.datasets.sweeps.store import Failure
from palpate.datasets.sweeps.store_database import network_file_system

CODE, OTHER = "code 1", "code 2"
KEEP = "keep-focal-points"


def row(key="a1", chunk=0, group="contours", code=CODE, columns=None, **payload):
    return ResultRow.of(code, group, key, chunk, payload or {"length": 0.25}, columns)


def kept(key="k1", content=b"frames", code=CODE):
    """A row with a kept file, and the file."""
    name = f"focal-points/{key}.h5"
    return [row(key, group=KEEP, code=code, path=name, bytes=len(content))], {name: content}


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "s.sweep"


def written(folder, *rows, code=CODE):
    with SweepStore(folder, code, mode="write") as store:
        store.add(rows)
    return folder


def changed(folder, statement, *values):
    with sqlite3.connect(folder / "store.sqlite") as database:
        database.execute(statement, values)
    database.close()


def test_results_are_recorded_once_and_given_in_the_order_asked_for(folder):
    with SweepStore(folder, CODE, mode="write") as store:
        assert store.add([row("b", 1), row("b", 0), row("a")]) == 3
        assert store.add([row("b", 1), row("c")]) == 1
        assert store.done([("contours", "b"), ("contours", "x")]) == {
            ("contours", "b"): {0, 1},
            ("contours", "x"): set(),
        }
        found = list(store.results([("contours", key) for key in ("b", "a", "b")]))
    assert [(key, chunk) for _, key, chunk, _ in found] == [("b", 0), ("b", 1), ("a", 0)]
    assert found[0][3] == {"length": 0.25}


def test_digests_are_xxh3_of_identity_and_content(folder):
    """As docs/formats/sweep-store.md has it, by xxhash alone."""
    own = row(length=0.5)
    number = xxhash.xxh3_64_intdigest(b'code 1\ncontours\na1\n0\n{"length":0.5}')
    assert own.digest % (1 << 64) == number
    written(folder, own)
    with sqlite3.connect(folder / "store.sqlite") as database:
        assert database.execute("SELECT digest FROM result").fetchone() == (own.digest,)
        assert database.execute("SELECT code_version, payload FROM results").fetchone() == (CODE, '{"length":0.5}')
    database.close()


def test_columns_come_back_bit_identical_chunk_by_chunk(folder):
    values = [np.array([0.1, np.nan, -0.0]), np.array([7.0, 8.0])]
    with SweepStore(folder, CODE, mode="write") as store:
        store.add([row(chunk=k, group="poses", columns={"length": own}) for k, own in enumerate(values)])
        found = dict(store.column_chunks("a1"))
    assert all(found[k]["length"].tobytes() == own.tobytes() for k, own in enumerate(values))


def test_columns_that_grow_when_unpacked_are_refused(tmp_path):
    np.savez_compressed(tmp_path / "a.npz", length=np.zeros(10**6))
    with pytest.raises(ValueError, match="never compressed"):
        columns_of((tmp_path / "a.npz").read_bytes())


DAMAGE = {
    "payload": 'UPDATE result SET payload = replace(payload, "0.25", "0.26") WHERE key = "a"',
    "key": 'UPDATE result SET key = "z" WHERE key = "a"',
    "chunk": 'UPDATE result SET chunk = 3 WHERE key = "a"',
    "digest": 'UPDATE result SET digest = digest + 1 WHERE key = "a"',
    "no JSON": 'UPDATE result SET payload = "[" WHERE key = "a"',
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_a_row_that_was_changed_is_found_and_made_again(folder, damage):
    changed(written(folder, row("a"), row("b")), DAMAGE[damage])
    assert len(check_store(folder)) == 1
    with SweepStore(folder, CODE) as store:
        assert store.done([("contours", "a")]) == {("contours", "a"): set()}
        if damage != "key" and damage != "chunk":
            with pytest.raises(SweepStoreError, match="damaged: chunk 0 of contours a does not have its digest"):
                list(store.results([("contours", "a")]))
    with SweepStore(folder, CODE, mode="write") as store:
        store.done([("contours", key) for key in ("a", "b", "z")])
        assert "lack their digests" in store.damaged[0]
        store.add([row("a")])
        assert [own[3] for own in store.results([("contours", "a")])] == [{"length": 0.25}]
    assert check_store(folder) == []


def test_columns_that_were_changed_are_made_again(folder):
    written(folder, row(group="poses", columns={"length": np.zeros(3)}))
    changed(folder, "UPDATE result SET columns = zeroblob(length(columns))")
    assert len(check_store(folder)) == 1
    with SweepStore(folder, CODE, mode="write") as store:
        with pytest.raises(SweepStoreError, match="damaged: chunk 0 of poses a1"):
            list(store.column_chunks("a1"))
        assert store.done([("poses", "a1")]) == {("poses", "a1"): set()}


def test_a_kept_file_that_is_gone_or_has_another_size_is_not_done(folder):
    rows, files = kept()
    with SweepStore(folder, CODE, mode="write") as store:
        store.add(rows, files)
        assert store.done([(KEEP, "k1")]) == {(KEEP, "k1"): {0}}
        (folder / "focal-points/k1.h5").write_bytes(b"longer frames")
        assert store.done([(KEEP, "k1")]) == {(KEEP, "k1"): set()}
        (folder / "focal-points/k1.h5").unlink()
        assert store.done([(KEEP, "k1")]) == {(KEEP, "k1"): set()}


def test_a_kept_file_that_was_made_again_is_named_by_its_new_row(folder):
    """Its size differs when a recipe that keeps it is made by code that writes more."""
    with SweepStore(folder, CODE, mode="write") as store:
        for content in (b"frames", b"more frames"):
            store.add(*kept(content=content))
            assert store.done([(KEEP, "k1")]) == {(KEEP, "k1"): {0}}


@pytest.mark.parametrize("name", ["../a.h5", "contours/../../a.h5", "/etc/a.h5", "contours/a.txt", "x/a.h5", "a.h5"])
def test_kept_files_stay_in_their_folders(folder, name):
    with SweepStore(folder, CODE, mode="write") as store, pytest.raises(SweepStoreError, match="none of a kept file"):
        store.add([row(group=KEEP, path=name, bytes=1)], {name: b"x"})


def test_a_file_of_other_code_is_replaced_and_its_result_forgotten(folder):
    for code in (CODE, OTHER):
        with SweepStore(folder, code, mode="write") as store:
            store.add(*kept(code=code))
    with SweepStore(folder, CODE) as store:
        assert store.done([(KEEP, "k1")]) == {(KEEP, "k1"): set()}


def test_results_of_other_code_are_taken_over_when_a_person_says_that_they_are_the_same(folder):
    written(folder, row("a"), row("b", length=1.0), row(group="poses", columns={"length": np.ones(2)}))
    with SweepStore(folder, OTHER, mode="write") as store:
        store.add([row("b", code=OTHER, length=2.0)])
        assert store.take_results_of(CODE) == 2
        found = list(store.results([("contours", key) for key in ("a", "b")]))
        assert [own[3]["length"] for own in found] == [0.25, 2.0]
        assert len(list(store.column_chunks("a1"))) == 1
    assert check_store(folder) == []


def test_damage_stays_damage_when_results_are_taken_over(folder):
    changed(written(folder, row("a")), 'UPDATE result SET payload = "{}"')
    with SweepStore(folder, OTHER, mode="write") as store:
        store.take_results_of(CODE)
        assert store.done([("contours", "a")]) == {("contours", "a"): set()}


def test_pruning_removes_other_code_and_files_that_nothing_names(folder):
    written(folder, row("a"), row("b", code=CODE))
    with SweepStore(folder, OTHER, mode="write") as store:
        store.add(*kept("mine", code=OTHER))
        (folder / "focal-points/left.h5").write_bytes(b"x")
        assert store.unused() == store.prune()
        assert list(store.code_versions()) == [OTHER]
        assert [path.name for path in (folder / "focal-points").iterdir()] == ["mine.h5"]
        found = store.unused()
        assert (found.rows, found.rows_kept, found.files) == (0, 1, ())


@pytest.mark.parametrize("name", ["contours", "focal-points", "drives", "making"])
def test_links_in_the_place_of_folders_are_refused(folder, tmp_path, name):
    """Files behind them are not the store's to replace or to prune."""
    written(folder, row("a"))
    (folder / name).symlink_to(tmp_path)
    with pytest.raises(SweepStoreError, match=f"{name} is a link"):
        SweepStore(folder, OTHER, mode="write")


@pytest.mark.parametrize(
    "change", ["payload = x'7b7d'", "chunk = -1", "chunk = 'abc'", "payload = CAST(x'ff' AS TEXT)"]
)
def test_rows_of_other_types_are_damage(folder, change):
    """As only a hostile store, or a flipped bit, has them."""
    changed(written(folder, row("a"), row("b")), f"UPDATE result SET {change} WHERE key = 'a'")
    assert len(check_store(folder)) == 1
    with SweepStore(folder, CODE) as store:
        assert store.done([("contours", "a"), ("contours", "b")]) == {("contours", "a"): set(), ("contours", "b"): {0}}


# Opening


def test_one_process_writes_at_a_time_and_others_read(folder):
    with SweepStore(folder, CODE, mode="write"):
        with pytest.raises(SweepStoreError, match=r"in use by another process.*--shard"):
            SweepStore(folder, CODE, mode="write")
        SweepStore(folder, CODE).close()
    SweepStore(folder, CODE, mode="write").close()


@pytest.mark.parametrize("version", [1, 3, 5])
def test_stores_of_other_format_versions_are_refused_with_the_way_out(folder, version):
    changed(written(folder), f"PRAGMA user_version={version}")
    way = "update palpate" if version == 5 else "delete its folder or name another store"
    text = rf"format version {version}, and this palpate reads version 4.*{way}"
    for mode in ("read", "write"):
        with pytest.raises(SweepStoreError, match=text):
            SweepStore(folder, CODE, mode=mode)


@pytest.mark.parametrize(
    "statement",
    [
        "CREATE TRIGGER t AFTER INSERT ON result BEGIN DELETE FROM result; END",
        "DROP VIEW results",
        "ALTER TABLE result ADD COLUMN more",
        "CREATE TABLE other (a)",
    ],
)
def test_a_strangers_tables_are_refused(folder, statement):
    changed(written(folder), statement)
    with pytest.raises(SweepStoreError, match="its tables are not a store's"):
        SweepStore(folder, CODE)


KILLED = """
import sys
from palpate.datasets import ResultRow, SweepStore
with SweepStore(sys.argv[1], "code 1", mode="write") as store:
    for k in range(100_000):
        store.add([ResultRow.of("code 1", "contours", str(k), 0, {"k": k})])
        print(k, flush=True)
"""


@pytest.mark.exhaustive
def test_what_was_reported_as_recorded_survives_a_kill(folder):
    process = subprocess.Popen([sys.executable, "-c", KILLED, str(folder)], stdout=subprocess.PIPE, text=True)
    time.sleep(2.0)
    os.kill(process.pid, signal.SIGKILL)
    last = int(process.communicate()[0].splitlines()[-1])
    with SweepStore(folder, CODE, mode="write") as store:
        found = store.done([("contours", str(k)) for k in range(last + 1)])
    assert all(found.values())
    assert check_store(folder) == []


# Merging


def merged(target, source):
    with SweepStore(target, CODE, mode="write") as store, SweepStore(source, CODE) as other:
        return merge_store(store, other)


def test_merging_adds_what_is_missing_once(folder, tmp_path):
    written(folder, row("a"))
    written(tmp_path / "b", row("a"), row("b"), row(group="poses", columns={"length": np.ones(2)}))
    with SweepStore(tmp_path / "b", CODE, mode="write") as store:
        store.replace_failures([Failure("h", "one", "no")])
    first, again = merged(folder, tmp_path / "b"), merged(folder, tmp_path / "b")
    assert (first.results, first.failures, first.problems) == (2, 1, [])
    assert (again.results, again.failures) == (0, 0)
    with SweepStore(folder, CODE) as store:
        assert len(list(store.rows())) == 3
        assert len(list(store.column_chunks("a1"))) == 1


def test_merging_leaves_damage_out_and_names_it(folder, tmp_path):
    changed(written(tmp_path / "b", row("a"), row("b")), 'UPDATE result SET payload = "{}" WHERE key = "a"')
    found = merged(folder, tmp_path / "b")
    assert found.results == 1
    assert len(found.problems) == 1
    assert "chunk 0 of contours a does not have its digest" in found.problems[0]


@pytest.mark.parametrize("content", [None, b"xxxxxx", b"longer than it was"])
def test_merging_leaves_damaged_kept_files_out(folder, tmp_path, content):
    with SweepStore(tmp_path / "b", CODE, mode="write") as store:
        store.add(*kept())
    path = tmp_path / "b/focal-points/k1.h5"
    path.unlink() if content is None else path.write_bytes(content)
    found = merged(folder, tmp_path / "b")
    assert (found.results, len(found.problems)) == (0, 1)
    assert "k1.h5" in found.problems[0]


# Network disks


@pytest.mark.parametrize(
    ("mounts", "kind"),
    [
        ("/dev/sda1 / ext4 rw 0 0\nserver:/x /home nfs4 rw 0 0\n", "nfs4"),
        ("/dev/sda1 / ext4 rw 0 0\nx /home/a fuse.sshfs rw 0 0\n", "fuse.sshfs"),
        ("x / nfs rw 0 0\n/dev/sdb /home/a ext4 rw 0 0\n", None),
        ("x /home/b nfs rw 0 0\n/dev/sdb / ext4 rw 0 0\n", None),
        ("x /home/a\\040b nfs rw 0 0\n", None),
        ("x\n", None),
    ],
)
def test_the_nearest_mount_tells_whether_a_disk_is_of_a_network(tmp_path, mounts, kind):
    (tmp_path / "mounts").write_text(mounts)
    assert network_file_system(tmp_path.__class__("/home/a/store"), tmp_path / "mounts") == kind
