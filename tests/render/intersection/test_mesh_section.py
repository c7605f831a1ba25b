"""Patches of hands as scenes take them: palms are resolved once, other hands whenever they are asked for."""

from dataclasses import dataclass

import numpy as np
import warp as wp

from palpate.kernels.patch import Patch
from palpate.render import MeshObject, Palm
from palpate.render.intersection.mesh_section import patches_for
from palpate.render.strategies.intersection_strategy import strategy_of

STRATEGY = strategy_of("oc")


SHIFT = {"x": 0.0}  # along x, of the patches of every ShiftedPalm [m]


@dataclass(frozen=True)
class ShiftedPalm(Palm):
    """A palm whose patch is not where its width and length alone would put it."""

    def on(self, device):
        patch = Palm.on(self, device).numpy()
        patch["origin"][:, 0] = SHIFT["x"]
        return wp.array(patch, dtype=Patch, device=device)


def test_equal_palms_share_their_patches(device):
    cube = MeshObject.load("cube")
    first = patches_for(Palm(0.08, 0.1), cube, STRATEGY, device)
    assert patches_for(Palm(0.08, 0.1), cube, STRATEGY, device) is first
    others = {
        "size": patches_for(Palm(0.08, 0.11), cube, STRATEGY, device),
        "relative": patches_for(Palm(0.08, 0.1), cube, STRATEGY, device, relative=True),
        "farthest": patches_for(Palm(0.08, 0.1), cube, STRATEGY, device, farthest=2.0),
    }
    for field, column in (("size", "half"), ("relative", "relative"), ("farthest", "flush")):
        assert not np.array_equal(others[field].numpy()[column], first.numpy()[column])


def test_a_palm_of_another_class_is_asked_each_time(monkeypatch, device):
    cube = MeshObject.load("cube")
    for shift in (0.0, 0.05):
        monkeypatch.setitem(SHIFT, "x", shift)
        patch = patches_for(ShiftedPalm(0.08, 0.1), cube, STRATEGY, device)
        assert patch.numpy()["origin"][0, 0] == shift
