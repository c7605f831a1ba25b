"""Users' code by what it does: a rendering is resumed only by the same stage; what is bound counts by its content."""

import json
import os
import subprocess
import sys
from functools import partial
from importlib.util import module_from_spec, spec_from_file_location

import numpy as np
import pytest
import warp as wp

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


def bound(first, *, second=None):
    """What registers a stage may bind."""
    return first, second


def closure(level):
    """A stage made by a factory elsewhere."""
    return lambda batch, setting: (batch, level)


class Settings:
    """What a stage may be bound to: it does not tell how it is written."""

    def __init__(self, share):
        self.share = share


class Slotted:
    __slots__ = ("share",)

    def __init__(self, share):
        self.share = share

    def __call__(self, batch, setting):
        return batch


def test_what_is_bound_counts_by_what_it_holds():
    pairs = [
        (partial(bound, Settings(0.1)), partial(bound, Settings(0.5))),
        (partial(bound, wp.zeros(3, device="cpu")), partial(bound, wp.ones(3, device="cpu"))),
        (partial(bound, {"a", "b"}), partial(bound, {"a", "c"})),
        (partial(bound, np.array(["a", None], object)), partial(bound, np.array(["b", None], object))),
        (Slotted(1), Slotted(2)),
        (partial(bound, closure, bound, closure), partial(bound, closure, bound, bound)),
        (bound, closure),
        (closure(1), closure(2)),
        (partial(bound, 1, second={"a": 1}), partial(bound, 1, second={"a": 2})),
        (partial(bound, np.zeros(100_000)), partial(bound, np.eye(1, 100_000, 50_000)[0])),
    ]
    for one, other in pairs:
        assert digest_of(one) != digest_of(other), one
        assert digest_of(one) == digest_of(one)
    for make in (lambda: Settings(0.1), object, lambda: np.zeros(100_000)):
        assert digest_of(partial(bound, second=make())) == digest_of(partial(bound, second=make()))


@pytest.mark.exhaustive
def test_sets_are_told_alike_in_every_process(tmp_path):
    code = (
        "from functools import partial; from palpate.render.stages.user_code_digest import digest_of;"
        "import numpy as np;"
        "print(digest_of(partial(print, frozenset({'object', 'hand', 'made', 'other'}), np.array(['a', 'b'], object))))"
    )
    run = partial(subprocess.run, [sys.executable, "-c", code], capture_output=True, text=True, check=True)
    told = {run(env={**os.environ, "PYTHONHASHSEED": seed}).stdout for seed in ("1", "2", "3")}
    assert len(told) == 1
