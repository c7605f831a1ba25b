"""The benchmark of a study's onsets runs, small, and finds intervals that were played when they should be."""

import json
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import study

pytestmark = pytest.mark.exhaustive


def test_onsets_are_those_of_a_whole_run(capsys):
    assert study.main(["--trials", "4", "--seconds", "0.6"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["intervals"] == found["played"] == 8
    for kind in ("live", "stored"):
        assert 0 < found[kind]["latency"]["p50"] <= found[kind]["late"]["p50"] <= found[kind]["late"]["max"]
    assert found["pose_latency_p50"]["p50"] > 0
