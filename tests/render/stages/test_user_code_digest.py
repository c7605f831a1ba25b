"""A rendering with a user's own stage is resumed only by the same code."""

import json
import sys
from importlib.util import module_from_spec, spec_from_file_location

import numpy as np
import pytest

from palpate.datasets import ContourFile, HandMotion, static_pose
from palpate.datasets.errors import ContourFileError
from palpate.render import MeshObject, Palm, closed_contour, load_strategy, record
from palpate.render.stages.user_code_digest import digest_of
from palpate.render.strategies.user_stage_sources import stage_sources

STAGE = """
from palpate.render import ContourBatch, register_transform


def weaken(batch, setting, *, level):
    '''Contours at another intensity.'''
    return ContourBatch(**{**batch.by_name(), "intensity": 0 * batch.points[:, 0] + %s})


register_transform("weaken-%s", weaken, level=0.5)
"""


def own_function(source, folder):
    """The stage's function of a module of another text."""
    spec = spec_from_file_location("edited_stage", folder / "edited_stage.py")
    module = module_from_spec(spec)
    (folder / "edited_stage.py").write_text(source.rpartition("register_transform(")[0])
    spec.loader.exec_module(module)
    return module.weaken


def test_an_edited_stage_is_another_recipe(tmp_path):
    module = f"stage_of_{tmp_path.name}"
    (tmp_path / f"{module}.py").write_text(STAGE % ("level", module))
    strategy = {"modules": [module], "prune": ["outside"], "transform": ["close", f"weaken-{module}"]}
    (tmp_path / "own.json").write_text(json.dumps(strategy))
    own, motion = (
        load_strategy(str(tmp_path / "own.json"), allow_code=True),
        HandMotion(None, static_pose([0, 0, 0.2]).pose),
    )
    path = tmp_path / "a.h5"
    record(path, MeshObject.load("cube"), Palm(), motion, own)
    with ContourFile(path) as file:
        assert file.strategy["sources"] == stage_sources(own)
        assert (file.contours()["intensity"] == np.float32(0.5)).all()
    assert record(path, MeshObject.load("cube"), Palm(), motion, own, mode="resume").rendered == 0
    other = STAGE % ("2 * level", module)
    assert digest_of(own_function(other, tmp_path)) != stage_sources(own)[f"weaken-{module}"]
    assert stage_sources(closed_contour()) == {}


def test_another_source_is_refused_when_resuming(tmp_path, monkeypatch):
    motion, path = HandMotion(None, static_pose([0, 0, 0.2]).pose), tmp_path / "a.h5"
    record(path, MeshObject.load("cube"), Palm(), motion, closed_contour())
    module = sys.modules[record.__module__]  # the package's attribute of that name is the function
    monkeypatch.setattr(module, "stage_sources", lambda strategy: {"x": "0"})
    with pytest.raises(ContourFileError, match="strategy was"):
        record(path, MeshObject.load("cube"), Palm(), motion, closed_contour(), mode="resume")
