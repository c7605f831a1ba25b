"""A store takes over what another one holds: every row, column and kept file, once, and nothing that is damaged."""

import itertools
import json
import os
import shutil
import sqlite3
from contextlib import closing, suppress

import numpy as np
import pytest
from contour_cases import make_contours, write_file
from hypothesis import given, settings
from hypothesis import strategies as st
from sweep_store_rows import MAKER, payload, pose_columns, write_rows

from palpate.datasets.errors import SweepStoreError
from palpate.datasets.sweeps.check import check_store
from palpate.datasets.sweeps.merge import merge_store
from palpate.datasets.sweeps.shard import ShardRow, write_shard
from palpate.datasets.sweeps.status import store_status
from palpate.datasets.sweeps.store import SweepStore

pytestmark = pytest.mark.exhaustive

KEYS = [("contours", "a"), ("contours", "b"), ("poses", "a")]
ALL = [(*key, part) for key in KEYS for part in range(3)]


def made(folder, places, maker=MAKER, name="s"):
    with SweepStore(folder, maker=maker) as store:
        if places:
            write_rows(store.folder / "shards" / f"{name}.h5", places, maker=maker)
            store.record(f"shards/{name}.h5")
    return folder


def keep(store, key, seed=0):
    """A kept contour file and its row."""
    path = store.folder / "contours" / f"{key}.h5"
    path.parent.mkdir(exist_ok=True)
    path.unlink(missing_ok=True)
    write_file(path, make_contours(5, seed=seed))
    path.with_suffix(".json").write_text(json.dumps({"maker": store.maker}))
    row = ShardRow("keep-contours", key, 0, {"path": f"contours/{key}.h5", "bytes": path.stat().st_size})
    write_shard(store.folder / f"shards/keep{seed}.h5", [row], maker=store.maker)
    store.record(f"shards/keep{seed}.h5")
    return path


def content(folder):
    """Rows, columns and failures of a store."""
    with SweepStore(folder, maker=MAKER, mode="read") as store:
        rows = {(group, key, part): own for group, key, part, own in store.results(KEYS)}
        columns = {key: store.columns(key) for group, key in KEYS if group == "poses" and store.done([(group, key)])}
        return rows, columns, store.failed()


@settings(max_examples=4, deadline=None)
@given(st.lists(st.lists(st.sampled_from(ALL), unique=True, min_size=1), min_size=1, max_size=4), st.randoms())
def test_the_union_is_the_same_in_every_order(tmp_path_factory, shares, random):
    top = tmp_path_factory.mktemp("merge")
    sources = [made(top / str(number), share) for number, share in enumerate(shares)]
    random.shuffle(sources)
    with SweepStore(top / "all", maker=MAKER) as store:
        counts = [merge_store(store, source).parts for source in sources]
        assert [merge_store(store, source).parts for source in sources] == [0] * len(sources)
    union = set(itertools.chain(*shares))
    assert sum(counts) == len(union)
    with SweepStore(top / "all", maker=MAKER, mode="read") as store:
        rows = {(group, key, part): own for group, key, part, own in store.results(KEYS)}
        assert rows == {place: payload(*place) for place in union}
        for part, columns in store.column_parts("a"):
            np.testing.assert_equal(columns, pose_columns("a", part))
    assert not check_store(top / "all").problems


def test_kept_files_and_failures_come_along(tmp_path):
    with SweepStore(made(tmp_path / "one", ALL), maker=MAKER) as store:
        kept = keep(store, "k")
        store.record_failure("00ff", "cube: it is open")
        store.record_failure("01ff", "an older sentence")
    with SweepStore(tmp_path / "all", maker=MAKER) as store:
        store.record_failure("01ff", "the own sentence")
        merged = merge_store(store, tmp_path / "one")
        assert (merged.parts, merged.failures, merged.problems) == (len(ALL) + 1, 1, [])
        assert store.failed() == {"00ff": "cube: it is open", "01ff": "the own sentence"}
        assert store.done([("keep-contours", "k")]) == {("keep-contours", "k"): {0}}
    copied = tmp_path / "all/contours/k.h5"
    assert copied.read_bytes() == kept.read_bytes()
    assert copied.with_suffix(".json").read_text() == kept.with_suffix(".json").read_text()
    assert not list((tmp_path / "all/shards").iterdir())


def damage_row(folder):
    with closing(sqlite3.connect(folder / "store.sqlite")) as connection, connection:
        connection.execute("UPDATE part SET payload = '{}' WHERE \"group\" = 'contours' AND key = 'b' AND part = 1")


def damage_columns(folder):
    (path,) = (folder / "columns").iterdir()
    image = bytearray(path.read_bytes())
    image[len(image) // 2] ^= 1
    path.write_bytes(image)


def lose_columns(folder):
    shutil.rmtree(folder / "columns")


def cut_kept(folder):
    os.truncate(folder / "contours/k.h5", 500)


def flip_kept(folder):
    image = bytearray((folder / "contours/k.h5").read_bytes())
    for place in range(len(image) // 3, len(image), 97):
        image[place] ^= 1
    (folder / "contours/k.h5").write_bytes(image)


def pipe_beside_kept(folder):
    (folder / "contours/k.json").unlink()
    os.mkfifo(folder / "contours/k.json")


def link_kept(folder):
    (folder / "contours/k.h5").unlink()
    (folder / "contours/k.h5").symlink_to("/etc/hostname")


@pytest.mark.parametrize(
    ("damage", "lost", "sentence"),
    [
        (damage_row, 1, "1 parts of contours do not have their digests"),
        (damage_columns, 3, "is damaged"),
        (lose_columns, 3, "does not exist|cannot be"),
        (cut_kept, 1, "does not have"),
        (flip_kept, 1, "k.h5"),
        (link_kept, 1, "cannot be read"),
        (pipe_beside_kept, 1, "cannot be read"),
    ],
    ids=lambda own: getattr(own, "__name__", ""),
)
def test_what_is_damaged_is_left_out_and_named(tmp_path, damage, lost, sentence):
    with SweepStore(made(made(tmp_path / "one", ALL[:6]), ALL[6:], name="t"), maker=MAKER) as store:
        keep(store, "k")
    damage(tmp_path / "one")
    with SweepStore(tmp_path / "all", maker=MAKER) as store:
        merged = merge_store(store, tmp_path / "one")
        assert merged.parts == len(ALL) + 1 - lost
        (problem,) = merged.problems
        assert any(own in problem for own in sentence.split("|")), problem
    assert check_store(tmp_path / "all").problems == []
    is_of_kept = damage.__name__.endswith("kept")
    assert (tmp_path / "all/contours/k.h5").exists() is not is_of_kept


@pytest.mark.parametrize(
    "path",
    ["../../outside", "/etc/hostname", "columns/x", "contours/..", "contours/a/b", "contours/k.hdf5", "contours/\0.h5"],
)
def test_a_row_cannot_name_a_file_outside_the_store(tmp_path, path):
    with SweepStore(made(tmp_path / "one", []), maker=MAKER) as store:
        row = ShardRow("keep-contours", "k", 0, {"path": path, "bytes": 3})
        write_shard(store.folder / "shards/keep.h5", [row], maker=MAKER)
        store.record("shards/keep.h5")
    with SweepStore(tmp_path / "all", maker=MAKER) as store:
        merged = merge_store(store, tmp_path / "one")
    assert merged.parts == 0
    assert "none of a kept file" in merged.problems[0]


def test_other_code_versions_stay_behind(tmp_path):
    made(made(tmp_path / "one", ALL[:3]), ALL[3:], maker="other code", name="t")
    with SweepStore(tmp_path / "all", maker=MAKER) as store:
        assert merge_store(store, tmp_path / "one").parts == 3
        assert merge_store(store, made(tmp_path / "two", ALL, maker="a third")).parts == 0


@pytest.mark.parametrize("fail_at", range(8))
def test_after_a_full_disk_merging_again_completes(tmp_path, monkeypatch, fail_at):
    with SweepStore(made(tmp_path / "one", ALL), maker=MAKER) as store:
        keep(store, "k")
    real, calls = os.fsync, itertools.count()

    def fsync(handle):
        if next(calls) == fail_at:
            raise OSError(28, "No space left on device")
        real(handle)

    with SweepStore(tmp_path / "all", maker=MAKER) as store:
        monkeypatch.setattr(os, "fsync", fsync)
        with suppress(SweepStoreError):
            merge_store(store, tmp_path / "one")
        assert next(calls) > fail_at
        monkeypatch.setattr(os, "fsync", real)
        merge_store(store, tmp_path / "one")
        assert store.done([("keep-contours", "k")]) == {("keep-contours", "k"): {0}}
    assert content(tmp_path / "all")[0] == {place: payload(*place) for place in ALL}


def test_status_counts_what_there_is(tmp_path):
    made(made(tmp_path / "s", ALL), ALL[:1], maker="newer", name="t")
    with SweepStore(tmp_path / "s", maker=MAKER) as store:
        kept = keep(store, "k")
        store.record_failure("00ff", "cube: it is open")
    write_rows(tmp_path / "s/shards/waiting.h5", ALL[:1])
    (tmp_path / "s/parents").mkdir()
    (tmp_path / f"s/parents/{os.uname().nodename}-{os.getpid()}-00").write_text("1")
    (tmp_path / f"s/parents/{os.uname().nodename}-999999999-00").write_text("1")
    status = store_status(tmp_path / "s")
    groups = {maker: {own.group: (own.results, own.parts) for own in counts} for maker, counts in status.groups.items()}
    assert list(groups.items()) == [
        ("newer", {"contours": (1, 1)}),
        (MAKER, {"contours": (2, 6), "keep-contours": (1, 1), "poses": (1, 3)}),
    ]
    assert status.failures == {MAKER: 1}
    assert status.bytes["contours"] == kept.stat().st_size + kept.with_suffix(".json").stat().st_size
    assert status.bytes["store.sqlite"] == (tmp_path / "s/store.sqlite").stat().st_size
    assert status.shards_waiting == 1
    assert status.parents == (f"{os.uname().nodename}-{os.getpid()}-00",)


def test_pruning_removes_kept_files_that_nothing_else_names(tmp_path):
    with SweepStore(made(tmp_path / "s", ALL, maker="old"), maker="old") as store:
        gone, shared = keep(store, "gone"), keep(store, "shared")
    with SweepStore(made(tmp_path / "s", ALL), maker=MAKER) as store:
        keep(store, "shared")
        unused = store.unused()
        assert unused == store.prune()
    assert unused.part_count == len(ALL) + 2
    assert not gone.exists()
    assert not gone.with_suffix(".json").exists()
    assert shared.exists()
    assert shared.with_suffix(".json").exists()
    assert content(tmp_path / "s")[0] == {place: payload(*place) for place in ALL}
    assert json.dumps(check_store(tmp_path / "s").unproven) == "[]"


def test_pruning_stops_where_it_cannot_tell_what_is_used(tmp_path):
    with SweepStore(made(tmp_path / "s", ALL, maker="old"), maker="old") as store:
        kept = keep(store, "shared")
    with SweepStore(made(tmp_path / "s", ALL), maker=MAKER) as store:
        keep(store, "shared")
    with closing(sqlite3.connect(tmp_path / "s" / "store.sqlite")) as file, file:
        file.execute("UPDATE part SET payload = '[' WHERE \"group\" LIKE 'keep-%' AND maker = 2")
    refusal = pytest.raises(SweepStoreError, match="a payload of the store cannot be read, so nothing is removed")
    with SweepStore(tmp_path / "s", maker=MAKER) as store, refusal:
        store.prune()
    assert kept.exists()


def test_a_kept_file_of_another_code_version_stays(tmp_path):
    with SweepStore(made(tmp_path / "all", ALL), maker=MAKER) as store:
        kept = keep(store, "k", seed=1)
    with SweepStore(made(tmp_path / "one", ALL[:1], maker="old"), maker="old") as store:
        keep(store, "k", seed=2)
        keep(store, "other", seed=3)
    before = kept.read_bytes(), kept.with_suffix(".json").read_text()
    with SweepStore(tmp_path / "all", maker="old") as store:
        merged = merge_store(store, tmp_path / "one")
        assert (merged.parts, len(merged.problems)) == (2, 1)
        assert "which stays" in merged.problems[0]
        assert store.done([("keep-contours", "k"), ("keep-contours", "other")]) == {
            ("keep-contours", "k"): set(),
            ("keep-contours", "other"): {0},
        }
    assert (kept.read_bytes(), kept.with_suffix(".json").read_text()) == before


def test_pruning_leaves_linked_folders_alone(tmp_path):
    with SweepStore(made(tmp_path / "s", ALL, maker="old"), maker="old") as store:
        keep(store, "thesis")
    shutil.move(tmp_path / "s/contours", tmp_path / "elsewhere")
    (tmp_path / "s/contours").symlink_to(tmp_path / "elsewhere")
    with SweepStore(made(tmp_path / "s", ALL), maker=MAKER) as store:
        assert store.prune().part_count == len(ALL) + 1
    assert sorted(path.name for path in (tmp_path / "elsewhere").iterdir()) == ["thesis.h5", "thesis.json"]


def test_pruning_removes_no_file_outside_the_store(tmp_path):
    victim = tmp_path / "victim.h5"
    victim.write_bytes(b"abc")
    with SweepStore(made(tmp_path / "s", ALL, maker="old"), maker="old") as store:
        rows = [
            ShardRow("keep-contours", str(k), 0, {"path": path, "bytes": 3})
            for k, path in enumerate([str(victim), "../victim.h5", "contours/../../victim.h5", "a\0b"])
        ]
        write_shard(store.folder / "shards/keep.h5", rows, maker="old")
        store.record("shards/keep.h5")
    with closing(sqlite3.connect(tmp_path / "s/store.sqlite")) as connection, connection:
        connection.execute("INSERT INTO column_file (name) VALUES ('../../victim.h5')")
    with SweepStore(made(tmp_path / "s", ALL), maker=MAKER) as store:
        assert store.prune().part_count == len(ALL) + 4
    assert victim.exists()


def test_many_failures_merge_at_once(tmp_path):
    with SweepStore(made(tmp_path / "one", []), maker=MAKER) as store:
        store.record_failures({f"{number:032x}": f"reason {number}" for number in range(3000)})
    with SweepStore(tmp_path / "all", maker=MAKER) as store:
        assert merge_store(store, tmp_path / "one").failures == 3000
        assert len(store.failed()) == 3000
