"""kill -9 of who writes and records a sweep's shards, and two who do at once: what was recorded is whole, once."""

import random
import signal
import sqlite3
import subprocess
import sys
import time
from pathlib import Path

import pytest
import sweep_store_rows
from sweep_store_rows import MAKER, payload, places_of, pose_columns, write_rows

from palpate.datasets.sweeps.store import SweepStore

SCRIPT = Path(sweep_store_rows.__file__)


def start(folder, *words):
    command = [sys.executable, str(SCRIPT), str(folder), *map(str, words)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def recorded_of(lines):
    """Seed, number and how many parts were new of each shard that was reported as recorded."""
    return [tuple(map(int, line.split()[1:])) for line in lines if line.startswith("recorded") and line.endswith("\n")]


def assert_there(store, shards):
    """All parts of these shards are there, as they were written."""
    places = {place for seed, number, *_ in shards for place in places_of(seed, number)}
    keys = sorted({place[:2] for place in places})
    found = {tuple(place): own for *place, own in store.results(keys)}
    assert {place: found.get(place) for place in places} == {place: payload(*place) for place in places}
    for group, key in keys:
        if group == "poses":
            parts = dict(store.column_parts(key))
            for own_group, own_key, part in places:
                if (own_group, own_key) == (group, key):
                    assert parts[part]["length"].tolist() == pose_columns(key, part)["length"].tolist()


def assert_whole(folder):
    """SQLite finds nothing wrong; every file of columns is named, every named one there."""
    connection = sqlite3.connect(folder / "store.sqlite")
    assert connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)
    named = {name for (name,) in connection.execute("SELECT name FROM column_file")}
    connection.close()
    assert {path.name for path in (folder / "columns").iterdir()} == named
    assert list((folder / "shards").iterdir()) == []
    assert not list(folder.glob("*.tmp"))


@pytest.mark.exhaustive
def test_kill_9_at_any_moment_loses_nothing_that_was_recorded(tmp_path):
    folder, chance = tmp_path / "s", random.Random(5)
    done = []
    for seed in range(6):
        process = start(folder, seed, 10**6)
        lines = [process.stdout.readline()]
        time.sleep(chance.uniform(0.0, 0.4))
        process.send_signal(signal.SIGKILL)
        lines += process.stdout.readlines()
        process.wait()
        process.stdout.close()
        assert lines[0] == "open\n"
        done += recorded_of(lines)
    with SweepStore(folder, maker=MAKER) as store:
        assert_there(store, done)
        assert store.recover(temporary_age=0.0) <= 3 * 6  # of each process, the shard under way
        assert store.damaged == []
        assert_there(store, done)
    assert done
    assert_whole(folder)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("call", "number", "recovered"),
    [("replace", 6, 3), ("sync", 6, 3), ("discard", 5, 0)],
    ids=["after the move", "before the commit", "after the commit"],
)
def test_a_parent_killed_while_it_records_leaves_what_is_taken_over(tmp_path, call, number, recovered):
    folder = tmp_path / "s"
    process = start(folder, 1, 9, call)
    lines = process.communicate(timeout=60)[0].splitlines(keepends=True)
    assert process.returncode == -signal.SIGKILL
    assert [own[1] for own in recorded_of(lines)] == list(range(number))
    with SweepStore(folder, maker=MAKER) as store:
        assert store.recover() == recovered
        assert store.damaged == []
        assert_there(store, [(1, own) for own in range(number + 1)])
        write_rows(folder / "shards/late.h5", places_of(1, number))  # the killed parent's worker ends its task
        assert store.record("shards/late.h5") == 0
    assert_whole(folder)


@pytest.mark.exhaustive
def test_two_processes_that_record_the_same_parts_at_once_record_each_once(tmp_path):
    folder, count = tmp_path / "s", 40
    processes = [start(folder, seed, count) for seed in (1, 1, 2)]
    outputs = [process.communicate(timeout=120)[0].splitlines(keepends=True) for process in processes]
    shards = [own for output in outputs for own in recorded_of(output)]
    assert all(process.returncode == 0 for process in processes)
    with SweepStore(folder, maker=MAKER) as store:
        store.recover(temporary_age=0.0)
        assert store.damaged == []
        assert_there(store, [(seed, number) for seed in (1, 2) for number in range(count)])
        assert store.makers() == {MAKER: 2 * 3 * count}
        assert sum(new for _, _, new in shards) == 2 * 3 * count
    assert_whole(folder)
