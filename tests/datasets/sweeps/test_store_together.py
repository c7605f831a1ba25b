"""Shards of a sweep recorded in one transaction: all of them or none, once, and on the disk before they are named."""

import pytest
from sweep_store_rows import MAKER, file_size_limit, write_rows

from palpate.datasets.errors import SweepStoreError
from palpate.datasets.sweeps import record as record_module
from palpate.datasets.sweeps.store import SweepStore


@pytest.fixture
def store(tmp_path):
    with SweepStore(tmp_path / "s.sweep", maker=MAKER) as opened:
        yield opened


def put(store, name, places):
    path = store.folder / "shards" / f"{name}.h5"
    write_rows(path, places)
    return path


def names_in(store, folder):
    return sorted(path.name for path in (store.folder / folder).iterdir())


def test_shards_are_recorded_together_or_not_at_all(store):
    paths = [put(store, name, [("contours", name, 0), ("poses", name, 0)]) for name in "abc"]
    checked = [store.check(path) for path in paths]
    assert store.done([("contours", "a")]) == {("contours", "a"): set()}
    with file_size_limit(4096), pytest.raises(SweepStoreError, match="what was recorded before is safe"):
        store.record_all(checked)
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
