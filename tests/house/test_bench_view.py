"""The benchmark of the viewer runs, small, and sees the page's answers."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import view

from palpate.render import exploration, render

pytestmark = pytest.mark.exhaustive


def test_answers_are_seen_and_frames_drawn(tmp_path):
    path = render("tube", "palm", exploration("tube", duration=1.0), "cc").save(tmp_path / "a.h5")
    figures = view.measure([path], steps=10, pause=0.0)
    assert figures["answers"] == 10
    assert 0 < figures["answer_p50_ms"] <= figures["answer_p95_ms"] <= figures["drawn_p95_ms"]
    assert figures["drawn_hz"] > 0
    assert figures["sent_hz"] > 0
