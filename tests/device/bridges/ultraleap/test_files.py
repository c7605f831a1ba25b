"""Files of focal points that palpate-ultraleap refuses: docs/formats/focal-points.md."""

import os
import re
import subprocess

import numpy as np
import pytest
from ultraleap_bridge import focus_file, shared_program, unlike_samples


@pytest.fixture(scope="session")
def program(tmp_path_factory):
    return shared_program(tmp_path_factory)


def play(program, path, *options, **stub):
    environment = os.environ | {f"STUB_{name.upper()}": str(value) for name, value in stub.items()}
    words = [program, "play", path, *options]
    done = subprocess.run(words, env=environment, capture_output=True, text=True, check=False)
    return done.returncode, done.stderr


SAMPLES = unlike_samples(5, 2)
WHOLE = focus_file(SAMPLES, 1000.0)
WRONG_FILES = {
    "none": (None, "cannot be opened"),
    "empty": (b"", "is no file of focal points: it does not begin with PALPATEF"),
    "another program's": (b"\x89HDF\r\n\x1a\n" + bytes(100), "is no file of focal points"),
    "short header": (WHOLE[:30], "ends within its header: it has 30 bytes"),
    "version": (focus_file(SAMPLES, 1000.0, version=2), "is of version 2: version 1 can be played"),
    "no points": (focus_file(SAMPLES[:, :0], 1000.0), "has 0 focal points a sample: 1 to 8 can be played"),
    "points": (focus_file(unlike_samples(2, 9), 1000.0), "has 9 focal points a sample: 1 to 8 can be played"),
    "rate": (focus_file(SAMPLES, -1.0), "has a rate of -1 Hz, which must be 1 Hz or more"),
    "rate not finite": (focus_file(SAMPLES, np.inf), "has a rate of inf Hz"),
    "no samples": (focus_file(SAMPLES[:0], 1000.0), "has no samples"),
    "within a sample": (
        WHOLE[:-20],
        "header says 5 samples of 32 bytes, and it holds 4 samples and 12 bytes, so it ends within a sample",
    ),
    "a sample short": (WHOLE[:-32], "says 5 samples of 32 bytes, and it holds 4 samples$"),
    "too long": (WHOLE + b"x", "says 5 samples of 32 bytes, and it holds 5 samples and 1 bytes$"),
    "huge": (focus_file(SAMPLES, 1000.0, count=2**63), "says 9223372036854775808 samples of 32 bytes, and it holds 5"),
    "not finite": (
        focus_file(np.where(SAMPLES[3, 1, 2] == SAMPLES, np.nan, SAMPLES), 1000.0),
        "sample 3, point 1: z nan is not finite",
    ),
    "intensity": (
        focus_file(SAMPLES * [1, 1, 1, 3], 1000.0),
        r"sample \d, point \d: intensity [12]\.\d+ is outside 0..1",
    ),
}


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("case", WRONG_FILES)
def test_a_file_is_judged_before_the_array_is_reached(program, tmp_path, case):
    content, sentence = WRONG_FILES[case]
    path = tmp_path / "points.bin"
    if content is not None:
        path.write_bytes(content)
    code, errors = play(program, path, fault="unconnected", record=tmp_path / "record")
    assert code == 1
    assert errors.startswith(f"palpate-ultraleap: {path}")
    assert re.search(sentence, errors.rstrip())
    assert not (tmp_path / "record.1").exists()


def test_a_file_that_the_array_cannot_play_is_refused(program, tmp_path):
    path = tmp_path / "points.bin"
    path.write_bytes(focus_file(SAMPLES, 30_000.0))
    code, errors = play(program, path, rates="40000,16000")
    assert code == 1
    assert "a rate of 30000 Hz is above 16000 Hz" in errors
    assert "update rate 13333.3333 Hz (40000 / 3) fits" in errors
    code, errors = play(program, path, rates="40000")
    assert code == 1
    assert "2 focal points a sample: this array takes 1 to 1" in errors
