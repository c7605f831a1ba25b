"""What a process that draws is started with: user-defined stages and functions, if another process can import them."""

import importlib
import subprocess
import sys

import numpy as np
import pytest

from palpate.render import IntersectionStrategy, register_transform
from palpate.render.errors import StrategyError
from palpate.render.live.shipped_settings import ship, unship
from palpate.render.objects.functions.implicit_object import ImplicitObject
from palpate.render.stages import registry

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
from palpate.render.live.shipped_settings import unship
from palpate.render.stages.registry import find_stage
strategy, solid = unship(sys.stdin.buffer.read())
print(strategy.transform, find_stage("transform", "live-raised").function.__module__, solid)
"""


@pytest.fixture
def module(tmp_path, monkeypatch):
    """A module of a user's, beside the program that is running."""
    (tmp_path / "live_user_stages.py").write_text(MODULE)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(registry, "_ENTRIES", dict(registry._ENTRIES))
    yield importlib.import_module("live_user_stages")
    sys.modules.pop("live_user_stages")


@pytest.fixture
def strategy(module):
    register_transform("live-raised", module.raised, by=0.05)
    return IntersectionStrategy(prune=("outside",), transform=("close", "live-raised"))


def test_stages_of_an_importable_module_are_registered_again(strategy, monkeypatch):
    content = ship({"rate": 10e3}, [strategy])
    monkeypatch.setattr(registry, "_ENTRIES", {k: v for k, v in registry._ENTRIES.items() if k != "live-raised"})
    assert unship(content) == {"rate": 10e3}
    assert registry.find_stage("transform", "live-raised").defaults() == {"by": 0.05}


@pytest.mark.exhaustive
def test_another_process_imports_them_from_their_folder(strategy, module, tmp_path):
    solid = ImplicitObject(module.ball, bounds=np.array([[-0.05, -0.05, 0.15], [0.05, 0.05, 0.25]]))
    content = ship((strategy, solid), [strategy])
    done = subprocess.run([sys.executable, "-P", "-c", READING], input=content, capture_output=True, cwd="/")
    assert done.returncode == 0, done.stderr.decode()
    assert "live-raised" in done.stdout.decode()
    assert "live_user_stages" in done.stdout.decode()


def test_code_of_the_program_that_was_started_is_refused_by_name(module, monkeypatch):
    monkeypatch.setattr(module.raised, "__module__", "__main__")
    register_transform("live-here", module.raised, by=0.05)
    with pytest.raises(StrategyError, match=r"raised is in the program that was started.*module of its own"):
        ship(None, [IntersectionStrategy(prune=("outside",), transform=("close", "live-here"))])


def test_what_cannot_be_pickled_is_refused_with_the_reason():
    with pytest.raises(StrategyError, match=r"cannot be given to the process that draws: .*lambda.*of their own"):
        ship(lambda: 0, [])


def test_a_module_that_is_gone_is_named(strategy, module):
    content = ship(None, [strategy])
    registry._ENTRIES.pop("live-raised")
    sys.modules["live_user_stages"] = None  # as Python marks what cannot be imported
    with pytest.raises(StrategyError, match=r"cannot import what it needs: .*live_user_stages"):
        unship(content)
    sys.modules["live_user_stages"] = module
