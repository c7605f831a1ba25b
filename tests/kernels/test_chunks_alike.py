"""Every strategy gives the same bits whether poses are rendered all at once, in chunks, or one by one."""

from functools import cache

import numpy as np
import pytest

from palpate.datasets.hand_model.shape import hand_shape
from palpate.render import IntersectionStrategy, MeshHand, MeshObject, Palm, Stage, render
from palpate.render.contour_batch import join_batches
from palpate.render.hands.plane_hand import flat_hand
from palpate.render.stages.registry import known_stages
from palpate.render.strategies.intersection_strategy import PRESETS

COUNT = 22
MANY = IntersectionStrategy(
    prune=("outside", "close-together", "small"),
    transform=("close", "smooth", "simplify", "resample", "corners", "edges", Stage("depth", {"at": "point"})),
)
PRUNED = {name: IntersectionStrategy(prune=("outside", name)) for name in known_stages("prune") if name != "outside"}
STRATEGIES = {**{name: make() for name, make in PRESETS.items()}, "many": MANY, **PRUNED}
FILLED = {"whole", "inset", "hatch", "inset-hatch", "depth-hatch"}  # which a hand mesh cannot have


@cache
def hand_of(kind):
    if kind == "palm":
        return Palm()
    if kind == "planes":
        return flat_hand()
    shape = hand_shape(detail=1)
    return MeshHand(shape.vertices, shape.faces, glabrous=shape.glabrous)


@cache
def scene():
    """The dog, and palms about its middle; one of them touches nothing."""
    thing, rng = MeshObject.load("dog"), np.random.default_rng(3)
    turn = rng.normal(0, 0.25, (COUNT, 4)) + np.array([np.sqrt(0.5), 0, 0, np.sqrt(0.5)])
    place = thing.bounds.mean(axis=0) + rng.normal(0, 0.02, (COUNT, 3))
    pose = np.concatenate([place, turn / np.linalg.norm(turn, axis=1, keepdims=True)], axis=1).astype(np.float32)
    pose[5, 0] = 3.0
    return thing, pose


@pytest.mark.exhaustive(after=1)
@pytest.mark.filterwarnings("ignore::palpate.render.errors.PalpateWarning")
@pytest.mark.parametrize("kind", ["palm", "planes", "skin"])
@pytest.mark.parametrize("name", sorted(STRATEGIES))
def test_what_a_pose_becomes_does_not_depend_on_the_poses_beside_it(name, kind):
    if kind == "skin" and name in FILLED:
        pytest.skip("for planes")
    (thing, pose), hand = scene(), hand_of(kind)
    whole = render(thing, hand, pose, STRATEGIES[name]).arrays()
    assert len(whole["points"]) > 20 or name == "small"
    for size in (7, 1):
        parts = [render(thing, hand, pose[k : k + size], STRATEGIES[name]) for k in range(0, COUNT, size)]
        joined = join_batches(parts).arrays()
        assert joined.keys() == whole.keys()
        for field, values in whole.items():
            np.testing.assert_array_equal(joined[field], values, err_msg=f"{field}, {size} at once")
