"""Options of `palpate sweep` that mean nothing are misuse, and refused before anything is made."""

import sqlite3
from contextlib import closing

import pytest
from command_line import FAILED, MISUSED, refused, run

ADDRESS = "tcp://127.0.0.1:1"  # where nothing listens


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "a.toml"
    path.write_text('[object]\nsource = "cube"\n[motion]\nduration = 0.2\n')
    return path


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--shard 5/4", "--shard must be I/N with I in 1..N, such as 2/4, not '5/4'"),
        ("--shard 0/3", "not '0/3'"),
        ("--shard a/b", "not 'a/b'"),
        ("--shard 2", "not '2'"),
        ("--unit-timeout -1", "--unit-timeout must be at least 0 s (0 is no limit), not -1"),
        ("--unit-timeout nan", "not nan"),
        ("--worker-memory -5", "--worker-memory must be at least 0 MB (0 is no limit), not -5"),
        ("--workers many", "--workers must be a number or auto, not 'many'"),
        ("--workers 0", "--workers must be at least 1, not 0"),
        ("--workers 257", "--workers must be at most 256 on each device, not 257"),
        ("--device gpu", "no device 'gpu' on this machine"),
        ("--scheduler gone.json", "gone.json: there is no such file"),
        (f"--scheduler {ADDRESS} --workers 2", "--workers does not go with --scheduler"),
        (f"--scheduler {ADDRESS} --worker-memory 2", "--worker-memory does not go with --scheduler"),
        (f"--scheduler {ADDRESS} --device cuda:0,cuda:1", "not 'cuda:0,cuda:1'"),
        ("--dry-run --scheduler x", "--scheduler does not go with --dry-run"),
        ("--dry-run --table n.parquet", "--table does not go with --dry-run"),
        ("--dry-run --summary a.md", "--summary does not go with --dry-run"),
        ("--dry-run --baseline a.csv", "--baseline does not go with --dry-run"),
        ("--dry-run --update-baseline", "--update-baseline does not go with --dry-run"),
        ("--table t.xlsx", "--table t.xlsx: a table must end in"),
        ("--table folder.parquet", "is a folder"),
        ("--table old.parquet", "old.parquet: exists; --overwrite replaces it"),
        ("--summary .", "must be a file in a folder"),
        ("--summary missing/page.md", "must be a file in a folder"),
        ("--update-baseline", "--update-baseline needs --baseline FILE"),
        ("--tolerance 1", "--tolerance needs --baseline"),
        ("--baseline a.csv --shard 1/2", "--baseline does not go with --shard"),
        ("--same-results", "there is no store a.sweep"),
        ("--set nonsense", "--set nonsense: must be key=value"),
    ],
)
def test_an_option_that_means_nothing_is_refused(path, monkeypatch, words, message):
    monkeypatch.chdir(path.parent)
    (path.parent / "folder.parquet").mkdir()
    (path.parent / "old.parquet").touch()
    result = run("sweep", "a.toml", *words.split())
    assert (result.exit_code, "Traceback" in result.output) == (MISUSED, False)
    assert message in " ".join(result.stderr.split())
    assert not (path.parent / "a.sweep").exists()


@pytest.mark.parametrize("version", [1, 2, 3, 5])
def test_a_store_of_another_format_is_refused_with_the_way_out(path, tmp_path, version):
    store = tmp_path / "a.sweep"
    store.mkdir()
    with closing(sqlite3.connect(store / "store.sqlite")) as connection:
        connection.execute(f"PRAGMA application_id={0x70616C70}")  # "palp", see docs/formats/sweep-store.md
        connection.execute(f"PRAGMA user_version={version}")
        connection.execute("CREATE TABLE maker (id INTEGER PRIMARY KEY)")
        connection.commit()
    before = (store / "store.sqlite").read_bytes()
    way_out = "delete its folder or name another store, and run the sweep again" if version < 4 else "update palpate"
    for words in ([path], [path, "--dry-run"], [path, "--same-results"], ["status", store], ["merge", store, store]):
        result = run("sweep", *words)
        assert result.exit_code
        text = " ".join(result.stderr.split())
        assert f"has format version {version}, and this palpate reads version 4" in text or "into itself" in text
    refused(FAILED, way_out, "sweep", path, "--device", "cpu")
    assert (store / "store.sqlite").read_bytes() == before
