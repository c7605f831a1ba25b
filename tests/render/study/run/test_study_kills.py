"""A study that is killed at random moments loses no answer, and plays at most the trial under way again."""

import os
import random
import signal
import sqlite3
import subprocess
import sys
import threading
import time
from collections import Counter
from pathlib import Path

import pytest

import palpate.render.study.run.study_run  # what is killed

SCRIPT = Path(__file__).parents[3] / "cases" / "study" / "killed_study.py"
assert palpate.render.study.run.study_run


class KilledStudy:
    """A process whose children run the study, one after the other."""

    def __init__(self, folder):
        path = os.pathsep.join(sys.path)
        self._process = subprocess.Popen(
            [sys.executable, SCRIPT, folder], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            env=os.environ | {"PYTHONPATH": path},
        )  # fmt: skip

    def run(self, seconds=None):
        """What a child told until it ended, or was killed after so many seconds."""
        self._process.stdin.write("\n")
        self._process.stdin.flush()
        lines = []
        for line in self._process.stdout:
            name, *rest = line.split()
            if name == "child" and seconds is not None:
                threading.Timer(seconds, _kill, (int(rest[0]),)).start()
            if name == "over":
                return lines
            if name != "child":
                lines.append(line.strip())
        raise AssertionError("the process that begins children has ended")

    def close(self):
        self._process.stdin.close()
        self._process.wait(10)
        self._process.stdout.close()


def _kill(process_number):
    try:
        os.kill(process_number, signal.SIGKILL)
    except ProcessLookupError:
        return


def stored(folder):
    """Answers on disk: as the child tells them, and in full."""
    connection = sqlite3.connect(folder / "answers.sqlite")
    try:
        assert connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        told = connection.execute(
            "SELECT 'answer', block, trial, name, value FROM answers ORDER BY sequence"
        ).fetchall()
        full = connection.execute(
            "SELECT block, trial, name, value, key, key_order, stimuli, is_practice FROM answers ORDER BY sequence"
        ).fetchall()
        attempts = connection.execute("SELECT DISTINCT block, trial, attempt FROM intervals").fetchall()
        return [" ".join(map(str, row)) for row in told], full, attempts
    finally:
        connection.close()


@pytest.mark.exhaustive  # test_study_run.py ends runs without a process
@pytest.mark.parametrize("kill_count", [2, 200])
def test_killed_at_random_moments_it_loses_no_answer_and_goes_on(tmp_path, kill_count):
    draw = random.Random(kill_count)
    uninterrupted = KilledStudy(tmp_path / "whole")
    began = time.monotonic()
    assert uninterrupted.run()[-1] == "finished"
    whole_seconds = time.monotonic() - began
    uninterrupted.close()
    _, whole, _ = stored(tmp_path / "whole")
    kills, reached = 0, Counter()
    for folder in (tmp_path / f"killed-{number}" for number in range(1000)):
        study, told = KilledStudy(folder), []
        for _ in range(1000):
            lines = study.run(draw.uniform(0.0, whole_seconds / 15))
            if lines[-1:] == ["finished"]:
                break
            kills += 1
            told += [line for line in lines if line.startswith("answer")]
            if not (folder / "answers.sqlite").exists():
                assert told == []
                continue
            on_disk, full, attempts = stored(folder)
            assert [line for line in told if line not in on_disk] == []
            assert len(on_disk) - len(told) <= 1 + reached[folder]  # killed between the disk and the word about it
            reached[folder] = len(on_disk) - len(told)
            assert full == whole[: len(full)]
            answered = {(block, trial) for block, trial, *_ in full}
            ahead = {(block, trial) for block, trial, _ in attempts} - answered
            assert len(ahead) <= 1  # the trial under way
            if kills >= kill_count:
                assert study.run()[-1] == "finished"
                break
        study.close()
        _, full, attempts = stored(folder)
        assert full == whole
        if kills >= kill_count:
            break
    assert kills >= kill_count
