"""A sweep's store: what is recorded is found, once, by its maker; what is no store, newer or damaged is refused."""

import errno
import os
import sqlite3
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sweep_store_rows import MAKER, file_size_limit, payload, pose_columns, write_rows

from palpate.datasets.errors import SweepStoreError
from palpate.datasets.focus_files.frame_file import FrameField, FrameFile
from palpate.datasets.sweeps import record as record_module
from palpate.datasets.sweeps.shard import ShardRow, write_shard
from palpate.datasets.sweeps.store import SweepStore


@pytest.fixture
def store(tmp_path):
    with SweepStore(tmp_path / "s.sweep", maker=MAKER) as opened:
        yield opened


def put(store, name, places, **options):
    path = store.folder / "shards" / f"{name}.h5"
    write_rows(path, places, **options)
    return path


def names_in(store, folder):
    return sorted(path.name for path in (store.folder / folder).iterdir())


def test_a_recorded_shard_is_done_and_its_results_come_back(store):
    path = put(store, "a", [("contours", "k", 0), ("contours", "k", 2), ("frequency", "f", 1)])
    assert store.record("shards/a.h5") == 3
    assert not path.exists()
    keys = [("frequency", "f"), ("contours", "absent"), ("contours", "k")]
    assert store.done(keys) == {("frequency", "f"): {1}, ("contours", "absent"): set(), ("contours", "k"): {0, 2}}
    expected = [("frequency", "f", 1), ("contours", "k", 0), ("contours", "k", 2)]
    assert list(store.results(keys)) == [(*place, payload(*place)) for place in expected]


def test_results_come_in_the_order_asked_for_across_many_statements(store):
    places = [("contours", f"{(k * 7919) % 2500:04}", part) for k in range(2500) for part in (1, 0)]
    put(store, "a", places)
    assert store.record("shards/a.h5") == 5000
    keys = [("contours", f"{k:04}") for k in reversed(range(2500))]
    found = list(store.results(keys + keys[:3]))
    assert [(key, part) for _, key, part, _ in found] == [(key, part) for _, key in keys for part in (0, 1)]
    assert store.done(keys) == {key: {0, 1} for key in keys}


def test_columns_of_parts_come_in_order_whatever_shard_they_are_in(store):
    for name, parts in (("a", [3, 0]), ("b", [2]), ("c", [1])):
        put(store, name, [("poses", "k", part) for part in parts] + [("contours", "k", part) for part in parts])
        store.record(f"shards/{name}.h5")
    assert names_in(store, "shards") == []
    assert len(names_in(store, "columns")) == 3
    columns = store.columns("k")
    assert [part for part, _ in store.column_parts("k")] == [0, 1, 2, 3]
    for name in ("pose", "length", "drawn"):
        expected = np.concatenate([pose_columns("k", part)[name] for part in range(4)])
        np.testing.assert_array_equal(columns[name], expected)
        assert columns[name].dtype == expected.dtype
    with pytest.raises(SweepStoreError, match="no columns of poses other"):
        store.columns("other")


@pytest.mark.parametrize("group", ["contours", "poses"])
def test_recording_twice_or_a_second_shard_of_the_same_parts_changes_nothing(store, group):
    put(store, "a", [(group, "k", 0)])
    assert store.record("shards/a.h5") == 1
    assert store.record("shards/a.h5") == 0
    before = list(store.results([(group, "k")])), names_in(store, "columns")
    write_shard(store.folder / "shards/b.h5", [ShardRow(group, "k", 0, {"seconds": 9})], [{"x": [1]}], maker=MAKER)
    assert store.record("shards/b.h5") == 0
    put(store, "a", [(group, "k", 0)])  # the same worker again, late
    assert store.record("shards/a.h5") == 0
    assert (list(store.results([(group, "k")])), names_in(store, "columns")) == before
    assert names_in(store, "shards") == []


PLACES = st.tuples(st.sampled_from(["contours", "poses"]), st.sampled_from("abc"), st.integers(0, 5))


@pytest.mark.exhaustive
@settings(max_examples=20)
@given(shards=st.lists(st.lists(PLACES, unique=True, max_size=6), max_size=6))
def test_the_store_of_any_shards_is_their_union(tmp_path_factory, shards):
    with SweepStore(tmp_path_factory.mktemp("union") / "s", maker=MAKER) as store:
        added = []
        for number, places in enumerate(shards):
            put(store, str(number), places)
            added.append(store.record(f"shards/{number}.h5"))
        union = {place for places in shards for place in places}
        keys = [(group, key) for group in ("contours", "poses") for key in "abc"]
        assert sum(added) == len(union)
        assert list(store.results(keys)) == [(*place, payload(*place)) for place in sorted(union)]
        for key in "abc":
            parts = {part: columns["pose"].tolist() for part, columns in store.column_parts(key)}
            assert parts == {p: pose_columns(k, p)["pose"].tolist() for g, k, p in union if (g, k) == ("poses", key)}
        assert store.recover() == 0
        assert store.damaged == []


def test_what_other_code_made_does_not_count_and_stays_until_pruned(store):
    put(store, "a", [("contours", "k", 0), ("poses", "k", 0)])
    store.record("shards/a.h5")
    store.record_failure("recipe", "old")
    with SweepStore(store.folder, maker="newer") as newer:
        assert newer.done([("contours", "k")]) == {("contours", "k"): set()}
        assert newer.failed() == {}
        put(newer, "b", [("contours", "k", 0)], maker="newer")
        assert newer.record("shards/b.h5") == 1
        assert newer.makers() == {MAKER: 2, "newer": 1}
        with SweepStore(store.folder, mode="read") as last:
            assert last.maker == "newer"
        assert newer.prune().part_count == 2
        assert newer.makers() == {"newer": 1}
    assert names_in(store, "columns") == []


def test_a_shard_of_other_code_is_refused_by_name_and_stays(store):
    path = put(store, "a", [("contours", "k", 0)], maker="other")
    with pytest.raises(SweepStoreError, match=r"a\.h5 was made by other, not by palpate 0.1.0 test: a worker runs"):
        store.record(path)
    assert path.exists()
    assert store.recover() == 1
    assert store.makers() == {MAKER: 0, "other": 1}


def test_failures_are_kept_by_recipe_until_forgotten(store):
    store.record_failure("one", "object: it is open")
    store.record_failure("one", "object: it is still open")
    store.record_failure("two", "motion: missing")
    assert store.failed() == {"one": "object: it is still open", "two": "motion: missing"}
    store.forget_failures(["one", "three"])
    assert store.failed() == {"two": "motion: missing"}


def test_recover_takes_over_whole_shards_and_sets_damaged_ones_aside(store):
    put(store, "whole", [("contours", "k", 0), ("poses", "k", 1)])
    put(store, "unsigned", [("contours", "k", 7)], maker=None)
    torn = put(store, "torn", [("contours", "k", 8)])
    torn.write_bytes(torn.read_bytes()[:-100])
    (store.folder / "shards" / "x.h5.0123.tmp").write_bytes(b"half")
    assert store.recover() == 2
    assert store.done([("contours", "k")]) == {("contours", "k"): {0}}
    assert names_in(store, "shards") == ["torn.h5.damaged", "x.h5.0123.tmp"]
    assert len(store.damaged) == 1
    assert "torn.h5 is damaged" in store.damaged[0]
    assert store.recover(temporary_age=0.0) == 0
    assert names_in(store, "shards") == ["torn.h5.damaged"]


@pytest.mark.parametrize("folder", ["contours", "focal-points", "drives"])
def test_what_killed_workers_left_of_kept_files_is_removed_and_what_is_being_written_stays(store, folder):
    (store.folder / folder).mkdir()
    (store.folder / folder / "a.h5.0123.tmp").write_bytes(b"half")
    fields = [FrameField("/a/level", (), "1")]
    with FrameFile(store.folder / folder / "b.h5", fields, 1, attributes={}) as file:
        store.recover(temporary_age=0.0)
        assert [name[:4] for name in names_in(store, folder)] == ["b.h5"]
        file.append({"/a/level": np.ones(1)})
        file.publish()
    (store.folder / folder / "c.h5.0123.tmp").write_bytes(b"half")
    store.recover()
    assert names_in(store, folder) == ["b.h5", "c.h5.0123.tmp"]


def test_columns_that_are_gone_or_damaged_count_as_not_done(store):
    for name in ("gone", "hurt", "whole"):
        put(store, name, [("poses", name, 0), ("contours", name, 0)])
        store.record(f"shards/{name}.h5")
    files = {name: read_file_of(store, name) for name in ("gone", "hurt", "whole")}
    (store.folder / "columns" / files["gone"]).unlink()
    hurt = store.folder / "columns" / files["hurt"]
    content = bytearray(hurt.read_bytes())
    at = content.index(pose_columns("hurt", 0)["length"].tobytes())
    content[at] ^= 1
    hurt.write_bytes(content)
    assert store.recover() == 0
    assert "is missing" in store.damaged[0]
    with pytest.raises(SweepStoreError, match=r"checksum .* 1 parts count as not done .* run the sweep again"):
        store.columns("hurt")
    keys = [("poses", name) for name in files] + [("contours", name) for name in files]
    counts = [len(parts) for parts in store.done(keys).values()]
    assert counts == [0, 0, 1, 1, 1, 1]


def test_a_file_of_columns_that_another_took_the_place_of_is_not_taken_for_it(store):
    put(store, "a", [("poses", "k", 0), ("poses", "k", 1)])
    store.record("shards/a.h5")
    write_rows(store.folder / "columns" / read_file_of(store, "k"), [("poses", "k", 1)])
    with pytest.raises(SweepStoreError, match="not the one that names it; its 2 parts count as not done"):
        store.columns("k")
    assert store.done([("poses", "k")]) == {("poses", "k"): set()}


def read_file_of(store, key):
    with sqlite3.connect(store.folder / "store.sqlite") as connection:
        query = "SELECT name FROM column_file JOIN part ON part.column_file = column_file.id WHERE key = ?"
        name = connection.execute(query, (key,)).fetchone()[0]
    connection.close()
    return name


def test_a_store_whose_manifest_is_lost_keeps_its_columns(store):
    put(store, "a", [("poses", "k", 0), ("contours", "k", 0)])
    store.record("shards/a.h5")
    (store.folder / "store.sqlite").unlink()
    with SweepStore(store.folder, maker=MAKER) as again:
        assert again.recover() == 2
        assert len(again.columns("k")["pose"]) == 10


def test_a_folder_of_other_things_is_refused_and_left_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("x")
    for mode, reason in (("create", r"holds other things \(thesis.tex\)"), ("read", "it has no store.sqlite")):
        with pytest.raises(SweepStoreError, match=reason):
            SweepStore(tmp_path, maker=MAKER, mode=mode)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]
    with pytest.raises(SweepStoreError, match="cannot be a sweep's store: Not a directory"):
        SweepStore(tmp_path / "thesis.tex", maker=MAKER)
    with pytest.raises(SweepStoreError, match="no/such is not a sweep's store"):
        SweepStore(tmp_path / "no/such", mode="read")
    with pytest.raises(SweepStoreError, match="recording needs maker="):
        SweepStore(tmp_path / "new")


def test_another_programs_database_is_refused(tmp_path):
    connection = sqlite3.connect(tmp_path / "store.sqlite")
    connection.execute("CREATE TABLE bookmarks (url TEXT)")
    connection.close()
    with pytest.raises(SweepStoreError, match="not a sweep's manifest"):
        SweepStore(tmp_path, maker=MAKER)


@pytest.mark.parametrize("left", [0, 1000, 4096, 12288])
def test_a_truncated_manifest_is_one_sentence_with_the_way_out(store, left):
    put(store, "a", [("contours", f"k{n}", 0) for n in range(100)])
    store.record("shards/a.h5")
    store.close()
    os.truncate(store.folder / "store.sqlite", left)
    for mode in ("create", "read"):
        with pytest.raises(SweepStoreError, match=r"store.sqlite is .*damaged.*: move it away and run the sweep again"):
            SweepStore(store.folder, maker=MAKER, mode=mode)


def test_reading_changes_nothing(store):
    put(store, "a", [("contours", "k", 0)])
    store.record("shards/a.h5")
    put(store, "b", [("contours", "k", 1)])
    before = (store.folder / "store.sqlite").read_bytes()
    with SweepStore(store.folder, mode="read") as reader:
        assert reader.done([("contours", "k")]) == {("contours", "k"): {0}}
        for change in (reader.recover, reader.prune, lambda: reader.record("shards/b.h5")):
            with pytest.raises(SweepStoreError, match="was opened for reading"):
                change()
    assert (store.folder / "store.sqlite").read_bytes() == before
    assert names_in(store, "shards") == ["b.h5"]


AS_NOBODY = """
import os, sys
import urllib.parse  # Python 3.13 imports it when a path becomes a URI, and nobody may not read Python's folder
from palpate.datasets.sweeps.store import SweepStore, SweepStoreError
os.setgid(65534); os.setuid(65534)
with SweepStore(sys.argv[1], mode="read") as store:
    print(store.done([("contours", "k")]))
try:
    SweepStore(sys.argv[1], maker="m")
except SweepStoreError as error:
    print(error)
"""


@pytest.mark.exhaustive
@pytest.mark.skipif(os.getuid() != 0, reason="only root can give up its permissions")
def test_a_store_that_may_not_be_written_can_be_read(store):
    put(store, "a", [("contours", "k", 0)])
    store.record("shards/a.h5")
    store.close()
    for parent in store.folder.parents:
        if "pytest-of" in str(parent):
            parent.chmod(0o755)
    done = subprocess.run([sys.executable, "-c", AS_NOBODY, store.folder], capture_output=True, text=True, timeout=60)
    first, second = done.stdout.splitlines() or pytest.fail(done.stderr)
    assert first == "{('contours', 'k'): {0}}"
    assert "cannot be written: no permission" in second


def test_a_full_disk_loses_nothing_that_was_recorded(store):
    put(store, "a", [("contours", f"k{n}", 0) for n in range(50)])
    store.record("shards/a.h5")
    many = [("contours", f"m{n}", 0) for n in range(3000)] + [("poses", "m", 0)]
    path = put(store, "b", many)
    limit = (store.folder / "store.sqlite").stat().st_size + 20_000
    with file_size_limit(limit), pytest.raises(SweepStoreError, match=r"store.sqlite cannot be .*written.* is safe"):
        store.record(path)
    assert path.exists()
    assert names_in(store, "columns") == []
    assert sum(map(len, store.done([("contours", f"k{n}") for n in range(50)]).values())) == 50
    with pytest.raises(OSError, match="File too large"), file_size_limit(10_000):
        put(store, "c", many)
    assert names_in(store, "shards") == ["b.h5"]
    assert store.record(path) == len(many)


def test_the_document_tells_the_tables_that_there_are(store):
    text = (Path(__file__).parents[3] / "docs/formats/sweep-store.md").read_text()
    with sqlite3.connect(store.folder / "store.sqlite") as connection:
        query = "SELECT name, type FROM sqlite_master WHERE type IN ('table', 'view')"
        names = [name for name, _ in connection.execute(query)]
        for name in names:
            assert f"| `{name}`" in text, name
            columns = [row[1] for row in connection.execute(f"PRAGMA table_info({name})")]
            line = next(line for line in text.splitlines() if line.startswith(f"| `{name}`"))
            assert name == "part" or all(f"`{column}`" in line for column in columns), line
    connection.close()
    assert len(names) == 7


def test_threads_may_share_a_manifest(store):
    def work(number):
        put(store, str(number), [("contours", f"k{number}", part) for part in range(5)])
        return store.record(f"shards/{number}.h5")

    with ThreadPoolExecutor(4) as pool:
        assert sum(pool.map(work, range(24))) == 120
    assert sum(map(len, store.done([("contours", f"k{n}") for n in range(24)]).values())) == 120


def no_room(path):
    raise OSError(errno.ENOSPC, "No space left on device")


def test_shards_are_recorded_together_or_not_at_all(store, monkeypatch):
    paths = [put(store, name, [("contours", name, 0), ("poses", name, 0)]) for name in "abc"]
    checked = [store.check(path) for path in paths]
    assert store.done([("contours", "a")]) == {("contours", "a"): set()}
    with file_size_limit(4096), pytest.raises(SweepStoreError, match="what was recorded before is safe"):
        store.record_all(checked)
    monkeypatch.setattr(record_module, "sync", no_room)  # it is called after files of columns were moved
    with pytest.raises(SweepStoreError, match="No space left on device"):
        store.record_all(checked)
    monkeypatch.undo()
    assert all(path.exists() for path in paths)
    assert names_in(store, "columns") == []
    assert store.record_all(checked) == 6
    assert [store.check(path) for path in paths] == [None, None, None]
    assert store.record_all([]) == 0
    assert store.recover() == 0
    assert len(names_in(store, "columns")) == 3


def test_what_another_parent_takes_over_while_it_is_held_counts_once(store):
    checked = [store.check(put(store, name, [("poses", name, 0), ("contours", name, 0)])) for name in "ab"]
    with SweepStore(store.folder, maker=MAKER) as other:
        assert other.record("shards/a.h5") == 2
    assert store.record_all(checked) == 2
    assert [len(parts) for parts in store.done([("poses", "a"), ("poses", "b")]).values()] == [1, 1]
    assert store.recover() == 0
    assert (len(store.columns("a")["pose"]), store.damaged) == (10, [])


def test_columns_are_on_the_disk_before_the_manifest_names_them(store, monkeypatch):
    put(store, "a", [("poses", "k", 0)])
    synced = []
    monkeypatch.setattr(record_module, "sync", synced.append)
    store.record("shards/a.h5")
    folder = store.folder / "columns"
    assert synced == [folder / names_in(store, "columns")[0], folder]
