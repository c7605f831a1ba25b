"""kill -9 of a process that saves answers, and power cuts: what was reported as saved is there, once; the rest goes on.

`disk_faults.Disk` says what a file system may keep of what was not synced. `PALPATE_FAULTS=N` lays out N more remains.
How the file itself is made is shown once for all files (tests/datasets/storage/test_durable.py).
"""

import os
import random
import re
import shutil
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest
import study_answers
from disk_faults import Disk
from study_answers import PLAN, answer, interval, take_part

from palpate.render.study.run.answer_store import AnswerStore
from palpate.render.study.run.study_file import NAME, columns_of

SCRIPT = Path(study_answers.__file__)
MORE = int(os.environ.get("PALPATE_FAULTS", "0"))


def rows_of(folder):
    """Rows of the data by kind, trial, attempt and what, with the session; the file is judged whole as it is opened."""
    with AnswerStore(folder, PLAN) as store, closing(sqlite3.connect(store.path)) as connection:
        connection.row_factory = sqlite3.Row
        assert connection.execute("PRAGMA integrity_check").fetchone()[0] == "ok"
        found = {}
        for table, what in (("intervals", "interval"), ("answers", "name")):
            for row in connection.execute(f"SELECT * FROM {table}"):
                own = dict(row)
                place = (table.removesuffix("s"), own["trial"], own["attempt"], own[what])
                assert place not in found
                expected = columns_of(
                    (interval if table == "intervals" else answer)(own["trial"], own[what], own["attempt"])
                )
                assert {name: own[name] for name in expected} == expected
                found[place] = own["session"]
        return found


def places(lines):
    """Rows that were reported as saved, from lines that are whole."""
    fields = [line.split() for line in lines if line.startswith(("interval ", "answer ")) and line.endswith("\n")]
    return [
        (kind, int(trial), int(attempt), what if kind == "answer" else int(what))
        for kind, trial, attempt, what in fields
    ]


def assert_saved(folder, reported, before=frozenset()):
    """All that was reported is there, and at most one row more than before and that."""
    found = rows_of(folder)
    assert set(reported) <= found.keys()
    assert len(found.keys() - set(reported) - before) <= 1
    return found


def is_finished(folder):
    """Whether the participant has answered everything."""
    if not (folder / NAME).exists():
        return False
    with closing(sqlite3.connect(folder / NAME)) as connection:
        return connection.execute("SELECT count(*) FROM participants WHERE finished IS NOT NULL").fetchone() == (1,)


def answers_of(folder):
    """The final content, whichever attempts and processes it came from."""
    assert is_finished(folder)
    with closing(sqlite3.connect(folder / NAME)) as connection:
        return connection.execute("SELECT block, trial, name, value FROM answers ORDER BY trial, name").fetchall()


def test_a_process_killed_at_any_statement_leaves_what_was_reported(tmp_path):
    """What a kill leaves of files is what they hold at that moment: copies, made between statements, stand for kills.

    With a cache of one page SQLite writes pages before the transaction ends, so that a copy's journal must undo them.
    """
    images, reported = [], []

    def copy(statement):
        folder = tmp_path / str(len(images))
        shutil.copytree(tmp_path / "data", folder)
        images.append((folder, list(reported), statement))

    with AnswerStore(tmp_path / "data", PLAN) as store:
        store.begin("P01")
        connection = store._file._connection
        connection.execute("PRAGMA cache_size = 1")
        connection.set_trace_callback(copy)
        for place, save in ((("interval", 0, 0, 0), interval(0)), (("answer", 0, 0, "why"), answer(0, "why"))):
            (store.add_interval if place[0] == "interval" else store.add_answer)(save)
            reported.append(place)
    assert sum((folder / f"{NAME}-journal").stat().st_size > 512 for folder, *_ in images) > 1
    for folder, own, _ in images:
        assert_saved(folder, own)
    last = images[-2][0]
    take_part(last, lambda *_: None, 2)
    assert [row[1:3] for row in answers_of(last)] == [(0, "answer"), (0, "why"), (1, "answer"), (1, "why")]


# System calls, by strace.

TRACED = re.compile(r"^(?:\d+ +)?(\w+)\((.*)\) += (-?\d+)")


def strace(folder, trials, *options, output):
    """A participant whose data file is made and whose system calls strace sees; skips where it cannot."""
    if (
        shutil.which("strace") is None
        or subprocess.run(["strace", "-qq", "-o", "/dev/null", "true"], check=False).returncode
    ):
        pytest.skip("strace is not there, or may not trace: it shows and changes what SQLite asks the system for")
    AnswerStore(folder, PLAN).close()
    command = [
        "strace",
        "-f",
        "--seccomp-bpf",
        "-o",
        str(output),
        *options,
        sys.executable,
        str(SCRIPT),
        str(folder),
        str(trials),
    ]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)


STEPS = {"pwrite64": 41, "fdatasync": 7, "ftruncate": 5}
"""One of so many calls fails; no row takes as many, so that it is saved when it is tried again."""


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("name", "error"),
    [("pwrite64", "ENOSPC"), ("pwrite64", "EIO"), ("fdatasync", "EIO"), ("ftruncate", "EIO")],
)
def test_system_calls_that_fail_are_reported_and_the_next_try_saves_the_row_once(tmp_path, name, error):
    failures = 0
    for first in range(1, STEPS[name] + 1, 3 if name == "pwrite64" else 1):
        folder = tmp_path / f"{name}-{first}"
        when = f"{first}+{STEPS[name]}"
        done = strace(folder, 1, "-e", f"inject={name}:error={error}:when={when}", output=tmp_path / "trace")
        assert done.returncode == 0, (name, first, done.stdout, done.stderr)
        failures += done.stdout.count("failed")
        assert_saved(folder, places(done.stdout.splitlines(keepends=True)))
        assert len(answers_of(folder)) == 2
    print(f"{failures} calls failed")  # noqa: T201
    assert failures >= 3


def replay(trace, root, disk, reported):
    """Make the traced calls below a folder again, so that a `Disk` sees them; other calls only as what they report."""
    handles = {}

    def own(text):
        path = bytes.fromhex(re.findall(r'"((?:\\x[0-9a-f]{2})*)"', text)[-1].replace("\\x", "")).decode()
        return (
            root / Path(path).relative_to(root.parent / "data") if path.startswith(str(root.parent / "data")) else None
        )

    def content(text):
        return bytes.fromhex(re.search(r'"((?:\\x[0-9a-f]{2})*)"', text)[1].replace("\\x", ""))

    for line in trace.read_text().splitlines():
        match = TRACED.match(line)
        if match is None or int(match[3]) < 0:
            continue
        name, words, result = match[1], match[2], int(match[3])
        number = re.match(r"\d+", words)
        handle = handles.get(int(number[0])) if number else None
        if name == "openat" and (path := own(words)):
            flags = (os.O_RDWR if "O_RDWR" in words or "O_WRONLY" in words else os.O_RDONLY) | (
                os.O_CREAT if "O_CREAT" in words else 0
            )
            handles[result] = os.open(path, flags, 0o644)
        elif name == "openat":
            handles.pop(result, None)
        elif name == "write" and words.startswith("1,"):
            reported += places([content(words).decode()])
        elif handle is None:
            continue
        elif name == "close":
            os.close(handles.pop(int(number[0])))
        elif name == "pwrite64":
            os.pwrite(handle, content(words), int(words.rsplit(",", 1)[1]))
        elif name == "ftruncate":
            os.ftruncate(handle, int(words.rsplit(",", 1)[1]))
        elif name == "fdatasync":
            os.fdatasync(handle)


@pytest.mark.exhaustive
def test_a_power_cut_at_any_system_call_leaves_what_was_reported(tmp_path):
    calls = "openat,close,write,pwrite64,fdatasync,ftruncate"
    AnswerStore(tmp_path / "data", PLAN).close()
    root, reported, cuts = tmp_path / "disk", [], 0
    shutil.copytree(tmp_path / "data", root)
    done = strace(tmp_path / "data", 2, "-xx", "-s", "100000", "-e", f"trace={calls}", output=tmp_path / "trace")
    assert done.returncode == 0, done.stderr

    def cut():
        nonlocal cuts
        for number, share in enumerate((0.0, 1.0, 0.5, 0.5, *[0.5] * MORE)):
            folder = tmp_path / f"{cuts}-{number}"
            folder.mkdir()
            disk.lay_out(folder, random.Random(f"{cuts} {number}"), share)
            assert_saved(folder, reported)
            shutil.rmtree(folder)
        cuts += 1

    disk = Disk(root, cut)
    with disk.recording():
        replay(tmp_path / "trace", root, disk, reported)
    cut()
    assert len(reported) == 8
    print(f"power cuts at {cuts} moments")  # noqa: T201
    assert cuts > 80
