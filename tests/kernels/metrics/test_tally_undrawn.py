"""What ordered pieces come to without a point written: the bits of drawing and tallying, on every mesh and hand."""

import numpy as np
import pytest
import warp as wp
from degenerate_cases import degenerate_poses
from drawing import METHODS, STRATEGIES, exact_poses, patch_array, surface_on
from mesh_cases import CLOSED, MESHES, generic_poses
from tally_outputs import assert_same_numbers, empty

from palpate.kernels.metrics.tally import METRICS, tally_contours
from palpate.kernels.pieces.finding import find_pieces
from palpate.kernels.section.contour_writing import draw_contours
from palpate.kernels.section.joining import join_pieces, order_pieces
from palpate.kernels.section.tally_undrawn import tally_pieces
from palpate.render import MeshObject, Palm, closed_contour, open_contour
from palpate.render.contour_batch import ContourBatch
from palpate.render.hands.plane_hand import HandPatch, PlaneHand
from palpate.render.intersection.scene import PoseBlock, Scene

PALM = [[0.0425, 0.0425]]
SEVERAL = [[0.04, 0.03], [0.3, 0.3], [0.004, 0.003], [0.05, 0.01]]
"""The second goes around all objects, the third is inside most of them at some poses."""


def both_ways(mesh, poses, halves, strategy, method, device):
    """Values and lengths by drawing, and by walking alone."""
    surface, patch = surface_on(mesh, device), patch_array(halves, device)
    bounded, closes = STRATEGIES[strategy]
    poses = np.asarray(poses, np.float32)
    poses = poses if poses.ndim == 3 else poses[:, None]
    pose = wp.array(poses, dtype=wp.transform, ndim=2, device=device)
    found = list(find_pieces(surface, pose, patch, bounded=bounded, closes=closes, method=method))
    joined = join_pieces(surface, found, pose, patch, closes=closes)
    contours = draw_contours(surface, pose, patch, joined, bounded=bounded, closes=closes)
    drawn, walked = empty(len(poses), device), empty(len(poses), device)
    tally_contours(ContourBatch.of_sections(contours, len(halves)).struct, *drawn, measures=True, encloses=closes)
    if not closes:
        drawn[0][METRICS.index("area")].fill_(np.nan)
    ordered = order_pieces(surface, found, pose, patch, closes=closes)
    tally_pieces(surface, pose, patch, ordered, *walked, bounded=bounded, closes=closes)
    return drawn, walked, len(found)


@pytest.mark.exhaustive
@pytest.mark.parametrize("halves", [PALM, SEVERAL], ids=["palm", "several"])
@pytest.mark.parametrize("name", sorted(MESHES))
def test_bits_are_those_of_drawing(name, halves, device):
    mesh = MESHES[name]()
    for method in METHODS:
        for strategy in STRATEGIES if name in CLOSED else ("raw", "oc"):
            rows = exact_poses(300, 3)
            if halves is SEVERAL:  # each patch has poses of its own
                rows = np.stack([exact_poses(150, 3 + k) for k in range(len(halves))], axis=1)
            drawn, walked, _ = both_ways(mesh, rows, halves, strategy, method, device)
            assert_same_numbers(drawn, walked)
            assert drawn[1].numpy().max() > 0


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("name", sorted(CLOSED))
def test_bits_are_those_of_drawing_at_degenerate_poses(name, device):
    mesh = CLOSED[name]()
    poses = list(degenerate_poses(mesh, 8, seed=5).values())
    for strategy in STRATEGIES:
        for halves in (PALM, SEVERAL):
            assert_same_numbers(*both_ways(mesh, poses, halves, strategy, None, device)[:2])


def test_patches_that_have_no_room_at_first_keep_their_place(device):
    drawn, walked, row_sets = both_ways(CLOSED["comb"](), exact_poses(300, 8), SEVERAL, "cc", None, device)
    assert row_sets == 2
    assert_same_numbers(drawn, walked)


def test_a_patch_wholly_inside_is_gone_around(device):
    drawn, walked, _ = both_ways(CLOSED["cube"](), [[0, 0, 0.2, 0, 0, 0, 1]], [[0.004, 0.003]], "cc", None, device)
    assert_same_numbers(drawn, walked)
    np.testing.assert_allclose(walked[0].numpy()[:6, 0], [0.028, 0, 0.028, 0, 1, 4.8e-5], rtol=1e-4)


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("strategy", [open_contour(), closed_contour()], ids=["oc", "cc"])
@pytest.mark.parametrize("name", ["cube", "tube", "dog"])
def test_a_scene_tells_the_same_with_and_without_points(name, strategy, device):
    poses = generic_poses(60, 4)
    own = generic_poses(60, 5, spread=0.01)[:, None] - np.array([0, 0, 0.2, 0, 0, 0, 0], np.float32)
    hands = [
        Palm(),
        PlaneHand((HandPatch("a", 0.05, 0.05), HandPatch("b", 0.07, 0.02, (0.02, 0.01, -0.04, 0.48, 0.0, 0.36, 0.8)))),
        PlaneHand((HandPatch("articulated", 0.08, 0.08),), (), own),
    ]
    for hand in hands:
        scene = Scene.of(MeshObject.load(name), hand, strategy)
        drawn, walked = empty(60, device), empty(60, device)
        tally_contours(
            scene.raw_contours(PoseBlock(poses, 0, device)).struct, *drawn, measures=True, encloses=strategy.closes
        )
        if not strategy.closes:
            drawn[0][METRICS.index("area")].fill_(np.nan)
        scene.tally(PoseBlock(poses, 0, device), *walked)
        assert_same_numbers(drawn, walked)


def test_no_poses_and_values_of_another_shape(device):
    drawn, walked, _ = both_ways(CLOSED["cube"](), np.zeros((0, 7)), PALM, "cc", None, device)
    assert_same_numbers(drawn, walked)
    surface, patch = surface_on(CLOSED["cube"](), device), patch_array(PALM, device)
    pose = wp.array(exact_poses(3, 1)[:, None], dtype=wp.transform, ndim=2, device=device)
    found = find_pieces(surface, pose, patch, bounded=True, closes=True)
    ordered = order_pieces(surface, found, pose, patch, closes=True)
    with pytest.raises(ValueError, match="shape"):
        tally_pieces(surface, pose, patch, ordered, *empty(4, device), bounded=True, closes=True)
