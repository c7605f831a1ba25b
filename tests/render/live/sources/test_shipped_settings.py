"""What another process is started with: user-defined code, if that process can import it."""

import importlib
import subprocess
import sys

import numpy as np
import pytest

from palpate.render.errors import StrategyError
from palpate.render.live.sources.shipped_settings import ship, unship
from palpate.render.objects.functions.implicit_object import ImplicitObject

MODULE = """
from dataclasses import replace

import warp as wp


def raised(batch, setting, by):
    "Every contour higher."
    return replace(batch, points=batch.points + [0, 0, by])


@wp.func
def ball(x: wp.vec3):
    return wp.length(x - wp.vec3(0.0, 0.0, 0.2)) - 0.04
"""
READING = """
import sys
from palpate.render.live.sources.shipped_settings import unship
print(*unship(sys.stdin.buffer.read()))
"""


@pytest.fixture
def module(tmp_path, monkeypatch):
    """A module of a user's, beside the program that is running."""
    (tmp_path / "live_user_stages.py").write_text(MODULE)
    monkeypatch.syspath_prepend(tmp_path)
    yield importlib.import_module("live_user_stages")
    sys.modules.pop("live_user_stages")


@pytest.mark.exhaustive
def test_another_process_imports_code_from_its_folder(module, tmp_path):
    solid = ImplicitObject(module.ball, bounds=np.array([[-0.05, -0.05, 0.15], [0.05, 0.05, 0.25]]))
    content = ship((module.raised, solid))
    done = subprocess.run([sys.executable, "-P", "-c", READING], input=content, capture_output=True, cwd="/")
    assert done.returncode == 0, done.stderr.decode()
    assert "<function raised at" in done.stdout.decode()


def test_code_of_the_program_that_was_started_is_refused_by_name(module, monkeypatch):
    monkeypatch.setattr(module.raised, "__module__", "__main__")
    with pytest.raises(StrategyError, match=r"raised is in the program that was started.*module of its own"):
        ship(module.raised)


def test_what_cannot_be_pickled_is_refused_with_the_reason():
    with pytest.raises(StrategyError, match=r"cannot be given to another process: .*lambda.*of their own"):
        ship(lambda: 0)


def test_a_module_that_is_gone_is_named(module):
    content = ship(module.raised)
    sys.modules["live_user_stages"] = None  # as Python marks what cannot be imported
    with pytest.raises(StrategyError, match=r"cannot import what it needs: .*live_user_stages"):
        unship(content)
    sys.modules["live_user_stages"] = module
