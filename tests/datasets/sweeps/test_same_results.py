"""Results of other code versions that count: which, in which order, until when, and what a store records of it."""

import json
import sqlite3
from contextlib import closing

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sweep_store_rows import payload, pose_columns, write_rows

from palpate.datasets.errors import SweepStoreError
from palpate.datasets.sweeps import manifest as manifest_module
from palpate.datasets.sweeps.check import check_store
from palpate.datasets.sweeps.counted_versions import FILE, counted_for, read_counted
from palpate.datasets.sweeps.shard import ShardRow, write_shard
from palpate.datasets.sweeps.store import SweepStore

OLD, NEW = "code old", "code new"
PLACES = [("contours", "k", 0), ("contours", "k", 1), ("poses", "p", 0)]
KEYS = [("contours", "k"), ("poses", "p")]


def put(store, places, name="a", **options):
    write_rows(store.folder / "shards" / f"{name}.h5", places, maker=store.maker, **options)
    store.record(f"shards/{name}.h5")


@pytest.fixture
def folder(tmp_path):
    """A store with three parts that old code made, and a recipe that it could not make."""
    with SweepStore(tmp_path / "s", maker=OLD) as store:
        put(store, PLACES)
        store.record_failure("00ff", "cube: it is open")
    return tmp_path / "s"


def stated(folder, own=NEW, other=OLD):
    """A store opened for writing, after a statement."""
    store = SweepStore(folder, maker=own)
    store.count_results_of(other)
    return store


def sql(folder, statement, values=()):
    with closing(sqlite3.connect(folder / "store.sqlite")) as connection, connection:
        return connection.execute(statement, values).fetchall()


def test_results_count_from_the_statement_on_for_every_reader(folder):
    with SweepStore(folder, maker=NEW) as store:
        assert store.done(KEYS) == {key: set() for key in KEYS}
        assert store.latest_other() == OLD
        store.count_results_of(OLD)
        assert store.done(KEYS) == {KEYS[0]: {0, 1}, KEYS[1]: {0}}
    with SweepStore(folder, maker=NEW, mode="read") as store:
        assert list(store.results(KEYS)) == [(*place, payload(*place)) for place in PLACES]
        assert store.columns("p")["length"].tolist() == pose_columns("p", 0)["length"].tolist()
        assert store.failed() == {"00ff": "cube: it is open"}
        assert (store.counted, store.made_by) == ((OLD,), f"{NEW}; also results of {OLD}")
    found = check_store(folder)
    assert (found.problems, found.unproven) == ([], [])


def test_the_old_code_s_own_results_stay_as_they_were(folder):
    stated(folder).close()
    with SweepStore(folder, maker=OLD, mode="read") as store:
        assert store.done(KEYS) == {KEYS[0]: {0, 1}, KEYS[1]: {0}}
        assert (store.counted, store.made_by) == ((), OLD)
    assert [row[0] for row in sql(folder, "SELECT DISTINCT maker FROM parts")] == [OLD]


def test_of_a_part_that_both_have_the_own_one_counts(folder):
    with stated(folder) as store:
        write_shard(store.folder / "shards/b.h5", [ShardRow("contours", "k", 1, {"own": True})], maker=NEW)
        store.record("shards/b.h5")
        payloads = [found for *_, found in store.results(KEYS[:1])]
        assert payloads == [payload("contours", "k", 0), {"own": True}]


def test_a_statement_of_a_reader_is_not_recorded(folder):
    before = (folder / "store.sqlite").read_bytes()
    with SweepStore(folder, maker=NEW, mode="read") as store:
        store.count_results_of(OLD)
        assert store.done(KEYS)[KEYS[0]] == {0, 1}
    assert (folder / "store.sqlite").read_bytes() == before
    assert not (folder / FILE).exists()
    with SweepStore(folder, maker=NEW, mode="read") as store:
        assert store.counted == ()


MAKERS = st.sampled_from("abcd")
STATEMENTS = st.dictionaries(MAKERS, st.lists(MAKERS, max_size=3), max_size=4)


@given(STATEMENTS, MAKERS)
def test_what_counts_is_what_statements_lead_to(statements, maker):
    reached = {maker}
    for _ in range(4):
        reached |= {other for own in reached for other in statements.get(own, ())}
    counted = counted_for(statements, maker)
    assert set(counted) == reached - {maker}
    assert len(counted) == len(set(counted))


@pytest.mark.exhaustive
@settings(max_examples=40)
@given(
    made=st.lists(st.tuples(st.sampled_from("abc"), st.integers(0, 4)), min_size=1, max_size=12, unique=True),
    statements=st.lists(st.tuples(st.sampled_from("abc"), st.sampled_from("abc")).filter(lambda s: s[0] != s[1])),
)
def test_done_is_the_union_of_what_counted_versions_made(tmp_path_factory, made, statements):
    folder = tmp_path_factory.mktemp("union") / "s"
    for number, (maker, part) in enumerate(made):
        with SweepStore(folder, maker=maker) as store:
            put(store, [("contours", "k", part)], name=str(number))
    for own, other in statements:
        stated(folder, own, other).close()
    for maker in {maker for maker, _ in made}:
        with SweepStore(folder, maker=maker, mode="read") as store:
            counted = {maker, *store.counted}
            assert store.done(KEYS[:1])[KEYS[0]] == {part for own, part in made if own in counted}
            assert len(list(store.results(KEYS[:1]))) == len({part for own, part in made if own in counted})
    assert check_store(folder).problems == []


def test_a_store_without_a_statement_stays_readable_for_an_earlier_palpate(folder, monkeypatch):
    assert sql(folder, "PRAGMA user_version") == [(2,)]
    stated(folder).close()
    assert sql(folder, "PRAGMA user_version") == [(3,)]
    monkeypatch.setattr(manifest_module, "FORMAT_VERSION", 2)
    for mode in ("create", "read"):
        with pytest.raises(SweepStoreError, match="has format version 3, this palpate reads up to 2: a newer one"):
            SweepStore(folder, maker=OLD, mode=mode)


def test_the_manifest_says_what_counts_for_what_since_when(folder):
    for _ in range(2):
        stated(folder).close()
    query = (
        "SELECT own.maker, other.maker, time FROM same_results JOIN maker own ON own.id = same_results.maker "
        "JOIN maker other ON other.id = counted"
    )
    ((own, other, time),) = sql(folder, query)
    assert (own, other) == (NEW, OLD)
    assert time[:2] == "20"
    assert time.endswith("+00:00")


@pytest.mark.parametrize("change", ["time = '1999-01-01'", "counted = maker", "digest = x'00'", "counted = 77"])
def test_a_damaged_statement_is_refused(folder, change):
    stated(folder).close()
    sql(folder, f"UPDATE same_results SET {change}")
    with pytest.raises(SweepStoreError, match=r"is damaged \(that results of .* count for"):
        SweepStore(folder, maker=NEW)


def test_a_damaged_part_of_the_other_version_is_made_again(folder):
    stated(folder).close()
    sql(folder, "UPDATE part SET payload = '{}' WHERE part = 1")
    with SweepStore(folder, maker=NEW) as store:
        assert store.done(KEYS)[KEYS[0]] == {0}
        assert "they count as not done" in store.damaged[-1]
        put(store, [("contours", "k", 1)], name="b")
        assert store.done(KEYS)[KEYS[0]] == {0, 1}


def test_a_failure_is_forgotten_once_the_recipe_is_made(folder):
    with stated(folder) as store:
        store.record_failure("00ff", "cube: another reason")
        assert store.failed() == {"00ff": "cube: another reason"}
        store.forget_failures(["00ff"])
        assert store.failed() == {}


def test_pruning_keeps_what_counts_and_its_statements(folder):
    with SweepStore(folder, maker="other") as store:
        put(store, [("contours", "k", 5)], name="b")
    stated(folder, "other", OLD).close()
    with stated(folder) as store:
        assert store.prune().part_count == 1
        assert store.makers() == {OLD: 3, NEW: 0}
        assert store.done(KEYS)[KEYS[0]] == {0, 1}
    assert json.loads((folder / FILE).read_text()) == {NEW: [OLD]}
    with SweepStore(folder, maker="third") as store:
        assert store.prune().part_count == 3
    assert read_counted(folder, NEW) == ()
    assert check_store(folder).problems == []


def test_workers_find_what_counts_in_a_file_that_parents_renew(folder):
    stated(folder).close()
    stated(folder, "newest", NEW).close()
    assert read_counted(folder, "newest") == (NEW, OLD)
    assert read_counted(folder, OLD) == ()
    for content in ("", "[1]", '{"newest": 3}', '{"newest": [["code old"]]}'):
        (folder / FILE).write_text(content)
        assert OLD not in read_counted(folder, "newest")
    SweepStore(folder, maker=NEW).close()
    assert read_counted(folder, "newest") == (NEW, OLD)
