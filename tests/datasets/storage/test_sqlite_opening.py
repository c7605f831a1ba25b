"""A manifest beside which lies what SQLite would follow: journals of others, links, pipes; reading changes nothing."""

import os
import shutil
import sqlite3
import struct
from contextlib import closing

import pytest
from sweep_damage import make_store
from sweep_store_rows import MAKER

from palpate.datasets.errors import SweepStoreError
from palpate.datasets.storage.durable import FolderLock, is_locked
from palpate.datasets.sweeps.check import check_store, is_sweep_data
from palpate.datasets.sweeps.shard import read_shard
from palpate.datasets.sweeps.store import SweepStore
from palpate.render.errors import SweepError
from palpate.render.sweeps.report.results import STAMP, _stamped, locked
from palpate.render.sweeps.run.log import LOG, SweepLog

MAGIC = bytes.fromhex("d9d505f920a163d7")
MODES = pytest.mark.parametrize("mode", ["read", "create"])


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    folder = tmp_path_factory.mktemp("opening") / "store"
    make_store(folder)
    return folder


@pytest.fixture
def folder(original, tmp_path):
    return shutil.copytree(original, tmp_path / "copy")


def contents(folder):
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def name_super_journal(folder, victim):
    """Put a journal beside the manifest that ends with the name of a super-journal, as SQLite's document has it."""
    page = struct.unpack(">H", (folder / "store.sqlite").read_bytes()[16:18])[0]
    pages = (folder / "store.sqlite").stat().st_size // page
    header = (MAGIC + struct.pack(">5I", 0, 0, pages, 512, page)).ljust(512, b"\0")
    name = bytes(victim)
    end = struct.pack(">I", 0x40000000 // page + 1) + name + struct.pack(">II", len(name), sum(name)) + MAGIC
    (folder / "store.sqlite-journal").write_bytes(header + end)


def interrupt(folder):
    """Leave the manifest as kill -9 does in the middle of a transaction whose pages are partly written."""
    running = folder.with_name("running")
    shutil.copytree(folder, running)
    with closing(sqlite3.connect(running / "store.sqlite", isolation_level=None)) as connection:
        connection.execute("PRAGMA cache_size = 1")
        connection.execute("BEGIN")
        connection.execute("UPDATE part SET payload = payload || printf('%.*c', 5000, ' ')")
        for name in ("store.sqlite", "store.sqlite-journal"):
            shutil.copyfile(running / name, folder / name)


@pytest.mark.exhaustive(but="create")
@MODES
def test_a_journal_that_names_another_file_is_refused_and_that_file_stays(folder, tmp_path, mode):
    victim = tmp_path / "thesis.tex"
    victim.write_text("x")
    name_super_journal(folder, victim)
    before = contents(folder)
    with pytest.raises(SweepStoreError, match="names another file, which SQLite would remove"):
        SweepStore(folder, maker=MAKER, mode=mode)
    assert [("names another file" in text) for text in check_store(folder).problems] == [True]
    assert contents(folder) == before
    assert victim.exists()
    with closing(sqlite3.connect(folder / "store.sqlite")) as connection:
        connection.execute("PRAGMA user_version")
    assert not victim.exists()  # so that journal is one that SQLite follows


def test_what_a_killed_sweep_left_half_done_is_read_as_before_it_and_undone_by_the_next_sweep_only(original, folder):
    interrupt(folder)
    left = contents(folder)
    assert left != contents(original)
    assert check_store(folder).problems == []
    with SweepStore(original, mode="read") as before, SweepStore(folder, mode="read") as store:
        assert store.makers() == before.makers()
    assert contents(folder) == left
    SweepStore(folder, maker=MAKER).close()
    assert check_store(folder).problems == []
    with closing(sqlite3.connect(f"file:{folder}/store.sqlite?immutable=1", uri=True)) as connection:
        assert connection.execute("SELECT max(length(payload)) FROM part").fetchone()[0] < 5000


def test_a_transaction_that_is_under_way_is_not_taken_for_one_left_half_done(folder):
    with closing(sqlite3.connect(folder / "store.sqlite", isolation_level=None)) as connection:
        connection.execute("BEGIN IMMEDIATE")
        connection.execute("DELETE FROM failure")
        with SweepStore(folder, mode="read") as store:
            assert len(store.failed()) == 1
        connection.execute("COMMIT")
    with SweepStore(folder, mode="read") as store:
        assert len(store.failed()) == 0


@MODES
@pytest.mark.parametrize("suffix", ["", "-journal", "-wal", "-shm"])
@pytest.mark.parametrize("plant", [os.mkfifo, lambda path: path.symlink_to(path.with_name("table.h5"))])
def test_what_is_no_regular_file_is_refused_at_once(folder, mode, suffix, plant):
    path = folder / f"store.sqlite{suffix}"
    path.unlink(missing_ok=True)
    plant(path)
    with pytest.raises(SweepStoreError, match=rf"store.sqlite{suffix} is no regular file"):
        SweepStore(folder, maker=MAKER, mode=mode)


@pytest.mark.parametrize("name", ["shards/x.h5", "columns/x.h5", "contours/x.h5", "x.h5", "table.h5", "lock"])
def test_a_pipe_in_a_store_keeps_check_waiting_for_nobody(folder, name):
    (folder / name).parent.mkdir(exist_ok=True)
    (folder / name).unlink(missing_ok=True)
    os.mkfifo(folder / name)
    if name.startswith("columns"):  # which the manifest names
        own = next(path for path in (folder / "columns").iterdir() if path.name != "x.h5")
        os.replace(folder / name, own)
        name = f"columns/{own.name}"
    problems = check_store(folder).problems
    assert [f"{folder / name}" in text and "regular file" in text for text in problems] == [True] * (name != "lock")
    assert not is_sweep_data(folder / name)
    assert not is_locked(folder / name)
    with pytest.raises(SweepStoreError, match="is no regular file"):
        read_shard(folder / name)


@pytest.mark.parametrize("plant", [os.mkfifo, lambda path: path.symlink_to(path.with_name("thesis.tex"))])
def test_log_lock_and_stamp_are_regular_files_of_the_store(tmp_path, plant):
    (tmp_path / "thesis.tex").write_text("{}")
    for name in (LOG, STAMP, FolderLock.NAME):
        plant(tmp_path / name)
    reader = os.open(tmp_path / LOG, os.O_RDONLY | os.O_NONBLOCK)
    try:
        with SweepLog(tmp_path / LOG) as log:
            log.write("start")
        assert os.read(reader, 100) in (b"", b"{}")
    finally:
        os.close(reader)
    with pytest.raises(OSError, match=r"regular file|symbolic link"):
        FolderLock(tmp_path)
    with pytest.raises(SweepError, match="its table cannot be written"), locked(tmp_path):
        pass
    assert _stamped(tmp_path) in (None, {})
    assert (tmp_path / "thesis.tex").read_text() == "{}"
