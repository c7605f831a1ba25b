"""Damaged inputs of every loader and command: read, or refused in a sentence, within bounds of time and memory.

By hand for as long as one likes: `python tests/faults/fuzz.py --seconds 600`.
"""

import json
import subprocess
import sys
from pathlib import Path

import fuzz_child
import numpy as np
import pytest
from fuzz_child import ACCEPTED, CLEAR, MEMORY, RAW, WRONG, Case, judged
from fuzz_format import Format, Refused, Wrong
from fuzz_formats import FORMATS, make_seeds

from palpate.datasets.errors import MotionError

FUZZ = Path(__file__).parent / "fuzz.py"
CASES = 8
SEED = 20261122


def raising(error):
    def read(path):
        raise error

    return read


@pytest.mark.exhaustive
def test_damaged_inputs_of_every_loader_are_read_or_refused_in_a_sentence(tmp_path):
    told = tmp_path / "told.json"
    out = ["--cases", str(CASES), "--seed", str(SEED), "--out", tmp_path / "failures", "--json", told]
    done = subprocess.run([sys.executable, FUZZ, *out], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert told.exists(), done.stderr
    counts, faults = (json.loads(told.read_text())[name] for name in ("counts", "faults"))
    assert faults == [], done.stdout
    assert done.returncode == 0
    assert {name: sum(own.values()) for name, own in counts.items()} == {form.name: CASES for form in FORMATS}
    refused = sum(own.get(CLEAR, 0) for own in counts.values())
    assert CASES * len(FORMATS) // 3 < refused < CASES * len(FORMATS)


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize(
    ("read", "how", "kind"),
    [
        (lambda path: 1, "a: bytes", ACCEPTED),
        (lambda path: 2, "a: bytes", WRONG),
        (lambda path: 2, "a: structure", ACCEPTED),
        (lambda path: 1, "a: structure:relinked", WRONG),
        (raising(MotionError("no")), "a: bytes", CLEAR),
        (raising(Refused("no")), "a: bytes", CLEAR),
        (raising(Wrong("1e30 m")), "a: bytes", WRONG),
        (raising(ValueError("no")), "a: bytes", RAW),
        (raising(RecursionError()), "a: bytes", RAW),
        (raising(SystemExit(1)), "a: bytes", RAW),
        (raising(MemoryError()), "a: bytes", MEMORY),
        (lambda path: np.ones(fuzz_child.RESIDENT_BYTES // 2, np.float32).sum(), "a: structure", MEMORY),
    ],
)
def test_what_comes_of_a_case_is_told_apart(monkeypatch, read, how, kind):
    monkeypatch.setattr(fuzz_child, "RESIDENT_BYTES", 1 << 26)
    outcome = judged(Format("a", lambda folder: None, read, is_checked=True), Path("a"), how, 1)
    assert (outcome.kind, outcome.how) == (kind, how)


@pytest.mark.exhaustive(but="mesh")
@pytest.mark.parametrize("name", ["contours", "store", "mesh", "recording", "strategy"])
def test_a_seed_makes_the_same_cases_again(tmp_path, name):
    form = next(form for form in FORMATS if form.name == name)
    make_seeds(form, tmp_path / "seeds" / name)
    for number in range(6):
        made = []
        for again in range(2):
            path, how = Case(name, SEED, number).make(tmp_path / "seeds", tmp_path / str(again))
            files = [path] if path.is_file() else [own for own in sorted(path.rglob("*")) if own.is_file()]
            made.append((how, [own.read_bytes() for own in files]))
        assert made[0] == made[1]
