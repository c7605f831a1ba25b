"""A database beside which lies what SQLite would follow: journals of others, links, pipes; reading changes nothing."""

import os
import shutil
import sqlite3
import struct
from contextlib import closing

import pytest

from palpate.datasets.errors import SweepStoreError
from palpate.datasets.storage.durable import FolderLock
from palpate.datasets.sweeps.merging import check_store
from palpate.datasets.sweeps.result_row import ResultRow
from palpate.datasets.sweeps.store import Failure, SweepStore

CODE = "code 1"
MAGIC = bytes.fromhex("d9d505f920a163d7")
MODES = pytest.mark.parametrize("mode", ["read", "write"])


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    folder = tmp_path_factory.mktemp("opening") / "store"
    with SweepStore(folder, CODE, mode="write") as store:
        store.add([ResultRow.of(CODE, "contours", f"{k:064x}", 0, {"length": 0.5}) for k in range(200)])
        store.replace_failures([Failure("h", "one", "no")])
    return folder


@pytest.fixture
def folder(original, tmp_path):
    return shutil.copytree(original, tmp_path / "copy")


def contents(folder):
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def name_super_journal(folder, victim):
    """Put a journal beside the database that ends with the name of a super-journal, as SQLite's document has it."""
    page = struct.unpack(">H", (folder / "store.sqlite").read_bytes()[16:18])[0]
    pages = (folder / "store.sqlite").stat().st_size // page
    header = (MAGIC + struct.pack(">5I", 0, 0, pages, 512, page)).ljust(512, b"\0")
    name = bytes(victim)
    end = struct.pack(">I", 0x40000000 // page + 1) + name + struct.pack(">II", len(name), sum(name)) + MAGIC
    (folder / "store.sqlite-journal").write_bytes(header + end)


def interrupt(folder):
    """Leave the database as kill -9 does in the middle of a transaction whose pages are partly written."""
    running = folder.with_name("running")
    shutil.copytree(folder, running)
    with closing(sqlite3.connect(running / "store.sqlite", isolation_level=None)) as connection:
        connection.execute("PRAGMA cache_size = 1")
        connection.execute("BEGIN")
        connection.execute("UPDATE result SET payload = payload || printf('%.*c', 5000, ' ')")
        for name in ("store.sqlite", "store.sqlite-journal"):
            shutil.copyfile(running / name, folder / name)


@pytest.mark.exhaustive(but="write")
@MODES
def test_a_journal_that_names_another_file_is_refused_and_that_file_stays(folder, tmp_path, mode):
    victim = tmp_path / "thesis.tex"
    victim.write_text("x")
    name_super_journal(folder, victim)
    before = contents(folder)
    with pytest.raises(SweepStoreError, match="names another file, which SQLite would remove"):
        SweepStore(folder, CODE, mode=mode)
    assert [("names another file" in text) for text in check_store(folder)] == [True]
    assert contents(folder) == before
    assert victim.exists()
    with closing(sqlite3.connect(folder / "store.sqlite")) as connection:
        connection.execute("PRAGMA user_version")
    assert not victim.exists()  # so that journal is one that SQLite follows


def test_what_a_killed_sweep_left_half_done_is_read_as_before_it_and_undone_by_the_next_sweep_only(original, folder):
    interrupt(folder)
    left = contents(folder)
    assert left != contents(original)
    assert check_store(folder) == []
    with SweepStore(original) as before, SweepStore(folder) as store:
        assert list(store.rows()) == list(before.rows())
    assert contents(folder) == left
    SweepStore(folder, CODE, mode="write").close()
    assert check_store(folder) == []
    with closing(sqlite3.connect(f"file:{folder}/store.sqlite?immutable=1", uri=True)) as connection:
        assert connection.execute("SELECT max(length(payload)) FROM result").fetchone()[0] < 5000


def test_a_transaction_that_is_under_way_is_not_taken_for_one_left_half_done(folder):
    with closing(sqlite3.connect(folder / "store.sqlite", isolation_level=None)) as connection:
        connection.execute("BEGIN IMMEDIATE")
        connection.execute("DELETE FROM failure")
        with SweepStore(folder) as store:
            assert len(store.failures()) == 1
        connection.execute("COMMIT")
    with SweepStore(folder) as store:
        assert store.failures() == []


@MODES
@pytest.mark.parametrize("suffix", ["", "-journal", "-wal", "-shm"])
@pytest.mark.parametrize("plant", [os.mkfifo, lambda path: path.symlink_to(path.with_name("thesis.tex"))])
def test_what_is_no_regular_file_is_refused_at_once(folder, mode, suffix, plant):
    path = folder / f"store.sqlite{suffix}"
    path.unlink(missing_ok=True)
    (folder / "thesis.tex").touch()
    plant(path)
    text = rf"store.sqlite{suffix} (is no regular file|cannot be written: .*symbolic links)"
    with pytest.raises(SweepStoreError, match=text):
        SweepStore(folder, CODE, mode=mode)


@pytest.mark.parametrize("plant", [os.mkfifo, lambda path: path.symlink_to(path.with_name("thesis.tex"))])
def test_a_lock_is_a_regular_file_of_the_store(folder, plant):
    (folder / FolderLock.NAME).unlink()
    plant(folder / FolderLock.NAME)
    with pytest.raises(SweepStoreError, match=r"regular file|symbolic link"):
        SweepStore(folder, CODE, mode="write")
    assert not (folder / "thesis.tex").exists()
