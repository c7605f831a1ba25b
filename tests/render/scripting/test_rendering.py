"""`render` for scripts: what is imported for it, and what it refuses of keywords that it does not have."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from palpate.render import record, render, static_pose
from palpate.render.scripting import rendered_batch

STILL = static_pose([0, 0, 0.2])
LATER = ("acoustics", "playback", "reports", "sampling", "view")
"""Rooms that only some methods of a batch need."""


def imported_at_once(module):
    """Rooms of render/ that importing a module imports."""
    nodes = ast.parse(Path(module.__file__).read_text()).body
    return {node.module.split(".")[0] for node in nodes if isinstance(node, ast.ImportFrom) and node.level == 2}


def test_a_script_that_renders_does_not_import_what_plays_draws_or_samples():
    assert not imported_at_once(rendered_batch) & set(LATER)
    assert "contour_batch" in imported_at_once(rendered_batch)


@pytest.mark.exhaustive
def test_what_plays_draws_or_samples_is_not_there_after_rendering():
    code = (
        "import sys; from palpate.render import render, static_pose; render('cube', 'palm', static_pose([0, 0, 0.2])); "
        f"print(sorted(room for room in {LATER} if 'palpate.render.' + room in sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


@pytest.mark.parametrize("function", [render, lambda *rest, **more: record("never.h5", *rest, **more)])
@pytest.mark.parametrize("keyword", ["thing", "moved", "duration", "overwrite"])
def test_a_keyword_that_does_not_exist_is_named(function, keyword, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(TypeError, match=f"unexpected keyword argument '{keyword}'"):
        function("cube", "palm", STILL, **{keyword: None})
    assert not list(tmp_path.iterdir())
