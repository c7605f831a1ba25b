"""Points on the surface of what a hand and an object share."""

import numpy as np
import pytest
from expression_oracle import value
from scipy.spatial.transform import Rotation

from palpate.render.contour_batch import ContourBatch
from palpate.render.errors import MeshError, StrategyError
from palpate.render.hands.hand import Palm
from palpate.render.hands.mesh_hand import MeshHand
from palpate.render.intersection.overlap_tour import overlap_contours, overlap_points
from palpate.render.objects.functions.expression import box, capsule, sphere
from palpate.render.objects.functions.implicit_object import ImplicitObject

OBJECT = sphere(0.05).moved(0, 0, 0.2) - sphere(0.02).moved(0, 0, 0.2)
UP = np.array([0.0, 0.0, 0.2])
HAND = box(0.06, 0.02, 0.08) | capsule((0, 0, -0.04), (0, 0, -0.09), 0.008)


@pytest.fixture(scope="module")
def solids():
    return ImplicitObject(OBJECT), ImplicitObject(HAND, hand=True)


def poses(rng, count, spread=0.03):
    turn = rng.normal(size=(count, 4))
    at = rng.normal(0, spread, (count, 3)) + UP
    return np.concatenate([at, turn / np.linalg.norm(turn, axis=1, keepdims=True)], axis=1).astype(np.float32)


def shared_value(x, pose):
    """Below 0 in both, in float64."""
    wide = pose.astype(np.float64)
    own = Rotation.from_quat(wide[3:]).inv().apply(x - wide[:3])
    return np.maximum(value(OBJECT, x), value(HAND, own))


def cut_cells(pose, step):
    """Lowest nodes of the cells whose corners are not all on one side, found on a grid over everything, in steps."""
    low, high = np.floor(np.array([-0.06, -0.06, 0.13]) / step), np.ceil(np.array([0.06, 0.06, 0.27]) / step)
    axes = [np.arange(a, b + 1) for a, b in zip(low, high, strict=True)]
    node = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    inside = (shared_value(step * node.reshape(-1, 3), pose) < 0).reshape(node.shape[:3]).astype(int)
    total = sum(
        inside[i : inside.shape[0] - 1 + i, j : inside.shape[1] - 1 + j, k : inside.shape[2] - 1 + k]
        for i in (0, 1)
        for j in (0, 1)
        for k in (0, 1)
    )
    return node[:-1, :-1, :-1][(total > 0) & (total < 8)]


@pytest.mark.exhaustive
def test_every_cut_cell_gives_one_point_on_the_surface(solids, device, rng):
    pose, step = poses(rng, 6), 0.004
    points, start = overlap_points(*solids, pose, step=step, device=device)
    assert (points.dtype, start.dtype, len(start)) == (np.float32, np.int64, 7)
    assert start[0] == 0
    assert start[-1] == len(points) > 500
    for k, own in enumerate(pose):
        found = points[start[k] : start[k + 1]].astype(np.float64)
        cells = cut_cells(own, step)
        assert len(found) == len(cells)
        assert np.abs(shared_value(found, own)).max() < 1e-7
        assert ((found >= step * cells - 1e-7) & (found <= step * (cells + 1) + 1e-7)).all()  # also in order


@pytest.mark.exhaustive
def test_cpu_and_every_device_agree(solids, device, rng):
    pose = poses(rng, 20)
    one, other = (overlap_points(*solids, pose, step=0.005, device=d) for d in (device, "cpu"))
    assert (one[1] == other[1]).all()
    assert np.abs(one[0] - other[0]).max() < 1e-7


@pytest.mark.exhaustive
def test_few_or_many_at_a_time_is_the_same(solids, rng):
    pose = poses(rng, 30)
    pose[[0, 7, 8, 29], :3] = 1.0  # where nothing is shared
    whole = overlap_points(*solids, pose, step=0.005)
    for limit in (20_000, 60_000):
        some = overlap_points(*solids, pose, step=0.005, limit=limit)
        assert (some[0] == whole[0]).all()
        assert (some[1] == whole[1]).all()
    assert (np.diff(whole[1])[[0, 7, 8, 29]] == 0).all()


def test_no_poses_give_no_points(solids):
    points, start = overlap_points(*solids, np.zeros((0, 7)), step=0.005)
    assert points.shape == (0, 3)
    assert start.tolist() == [0]


def test_bad_steps_are_named(solids):
    pose = np.array([[1, 1, 1, 0, 0, 0, 1], [0, 0, 0.2, 0, 0, 0, 1]])
    for step in (0, -1, float("nan"), 1e-6, "fine", None):
        with pytest.raises(StrategyError, match="overlap: step must be at least 1e-05 m"):
            overlap_points(*solids, pose, step=step)
    with pytest.raises(StrategyError, match=r"takes \d+ nodes at pose 1, of which 10000 are allowed; 0.0\d+ m fits"):
        overlap_points(*solids, pose, step=0.001, limit=10_000)


def closed_hand():
    return MeshHand.from_solid(ImplicitObject(HAND, hand=True), 0.003)


def batch_of(contours):
    return ContourBatch.of_sections(contours, 1).numpy()


@pytest.mark.exhaustive
def test_a_path_goes_over_what_is_shared(device, rng):
    thing, hand, pose = ImplicitObject(OBJECT), closed_hand(), poses(rng, 8)
    pose[3, :3] = 1.0
    batch = batch_of(overlap_contours(thing, hand, pose, device=device, step=0.004, separation=0.008))
    lines = np.diff(batch.pose_start)
    assert set(lines) <= {0, 1}
    assert lines[3] == 0
    assert lines.sum() >= 5
    assert (batch.kind == 2).all()
    for k in np.flatnonzero(lines):
        line = batch.pose_start[k]
        x = batch.points[batch.polyline_start[line] : batch.polyline_start[line + 1]].astype(np.float64)
        assert np.abs(shared_value(x, pose[k])).max() < 2e-3  # edges of the hand's mesh are cut off
        assert (x[0] == x[-1]).all()
        apart = np.linalg.norm(x[:-1, None] - x[None, :-1], axis=2)
        assert apart[~np.eye(len(apart), dtype=bool)].min(initial=1) >= 0.008 - 1e-7 or len(apart) == 2


@pytest.mark.exhaustive
def test_rows_of_an_articulated_hand_are_its_own_shapes(rng):
    rigid, pose = closed_hand(), poses(rng, 4, spread=0.01)
    sizes = np.array([0.5, 0.8, 1.0, 1.2])
    rows = (sizes[:, None, None] * rigid.vertices).astype(np.float32)
    moving = MeshHand(rows, rigid.faces, glabrous=rigid.glabrous)
    thing = ImplicitObject(OBJECT)
    whole = batch_of(overlap_contours(thing, moving, pose, step=0.004))
    for k in range(4):
        one = MeshHand(rows[k], rigid.faces, glabrous=rigid.glabrous)
        alone = batch_of(overlap_contours(thing, one, pose[k : k + 1], step=0.004))
        later = batch_of(overlap_contours(thing, moving, pose[k : k + 1], k, step=0.004))
        line = slice(whole.polyline_start[whole.pose_start[k]], whole.polyline_start[whole.pose_start[k + 1]])
        assert len(alone.points) > 3
        assert (alone.points == whole.points[line]).all()
        assert (alone.points == later.points).all()


@pytest.mark.exhaustive
def test_hands_without_an_inside_are_refused():
    thing, pose = ImplicitObject(OBJECT), np.array([[0, 0, 0.2, 0, 0, 0, 1]], np.float32)
    with pytest.raises(StrategyError, match='raw "overlap" needs a hand with an inside, a MeshHand'):
        overlap_contours(thing, Palm(), pose, step=0.004)
    corner = np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]]) * 0.05
    sheet = MeshHand(corner, np.array([[0, 1, 2], [0, 2, 3]]))
    with pytest.raises(MeshError, match="needs a closed hand mesh, but it has 4 open edges"):
        overlap_contours(thing, sheet, pose, step=0.004)
    for separation in (0, float("nan")):
        with pytest.raises(StrategyError, match="overlap: separation must be a positive length"):
            overlap_contours(thing, closed_hand(), pose, step=0.004, separation=separation)
    with pytest.raises(
        StrategyError, match=r"^overlap: pose 3 keeps more than 2000 of its \d+ points .*; 0.\d+ m fits"
    ):
        overlap_contours(thing, closed_hand(), pose, 3, step=0.0005, separation=0.0001)
