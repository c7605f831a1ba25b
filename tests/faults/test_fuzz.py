"""Damaged inputs of every loader and command: read, or refused in a sentence, within bounds of time and memory.

By hand, with new seeds, for as long as one likes: `python tests/faults/fuzz.py --seconds 600`.
"""

import json
import random
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from bounded import ACCEPTED, CLEAR, HANG, MEMORY, RAW, SIGNAL, WRONG, Refused, Wrong, outcome_of
from fuzz_damage import damage

from palpate.datasets.errors import MotionError

FUZZ = Path(__file__).parent / "fuzz.py"
SEED = 20261122
LOADERS = 27


def raising(error):
    def call():
        raise error

    return call


@pytest.mark.exhaustive
@pytest.mark.parametrize(("loaders", "cases"), [([], 8), (["contours", "partial"], 100)], ids=["all", "contours"])
def test_damaged_inputs_are_read_or_refused_in_a_sentence(tmp_path, loaders, cases):
    report = tmp_path / "report.json"
    options = ["--cases", str(cases), "--seed", str(SEED), "--out", tmp_path / "failures", "--json", report]
    options += [word for name in loaders for word in ("--loader", name)]
    done = subprocess.run([sys.executable, FUZZ, *options], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert report.exists(), done.stderr
    counts, faults = (json.loads(report.read_text())[name] for name in ("counts", "faults"))
    assert faults == [], done.stdout
    assert done.returncode == 0
    assert [sum(own.values()) for own in counts.values()] == [cases] * (len(loaders) or LOADERS)
    refused = sum(own.get(CLEAR, 0) for own in counts.values())
    assert cases * len(counts) // 3 < refused < cases * len(counts)


def test_outcomes_of_a_call_are_told_apart():
    for call, kind in (
        (lambda: 1, ACCEPTED),
        (raising(MotionError("no")), CLEAR),
        (raising(Refused("no")), CLEAR),
        (raising(Wrong("1e30 m")), WRONG),
        (raising(ValueError("no")), RAW),
        (raising(RecursionError()), RAW),
        (raising(SystemExit(1)), RAW),
        (raising(MemoryError()), MEMORY),
    ):
        assert outcome_of(call).kind == kind


CHILDREN = """
import os, signal, time, bounded
takes, dies = (lambda: bytearray(300 << 20), lambda: bytearray(8 << 30)), lambda: os.kill(os.getpid(), signal.SIGSEGV)
for call in (*takes, lambda: time.sleep(60), dies, lambda: 1):
    print(bounded.outcome_in_child(call, seconds=3.0, resident=200 << 20).kind)
"""


@pytest.mark.exhaustive
def test_a_child_that_takes_memory_or_time_or_dies_is_told_apart():
    done = subprocess.run([sys.executable, "-c", CHILDREN], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == [MEMORY, MEMORY, HANG, SIGNAL, ACCEPTED]


def test_a_seed_damages_a_file_in_the_same_way_again(tmp_path):
    np.savez(tmp_path / "a.npz", t=np.arange(3))
    (tmp_path / "a.json").write_text('{"a": [1, {"b": 2}]}')
    for name in ("a.npz", "a.json"):
        whole, damaged = (tmp_path / name).read_bytes(), set()
        for seed in range(6):
            made = []
            for _ in range(2):
                (tmp_path / name).write_bytes(whole)
                damage(tmp_path / name, random.Random(seed))
                made.append((tmp_path / name).read_bytes())
            assert made[0] == made[1]
            damaged.add(made[0])
        assert len(damaged - {whole}) > 3


SPOILED = """
import fuzz
reader = fuzz.Reader("a", None, lambda path: path)
checked = fuzz.Reader("a", None, lambda path: path, True)
def kind(*case): return fuzz.outcome_in_child(lambda: fuzz.compare(*case)).kind
cases = [(checked, 1, "bytes", 1), (checked, 2, "bytes", 1), (checked, 2, "structure: x", 1)]
for case in [*cases, (reader, 2, "bytes", 1)]:
    print(kind(*case))
"""


@pytest.mark.exhaustive
def test_other_values_are_wrong():
    command = [sys.executable, "-c", SPOILED]
    done = subprocess.run(command, cwd=FUZZ.parent, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == [ACCEPTED, WRONG, ACCEPTED, ACCEPTED]
