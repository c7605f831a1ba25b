"""Cutting where nothing is doubtful, without long branches: the same words and counts as cutting exactly."""

import numpy as np
import pytest
import warp as wp
from degenerate_cases import degenerate_poses
from drawing import STRATEGIES, exact_poses, patch_array, pose_array
from small_solids import SOLIDS

from palpate.kernels.patterns.loop_table import room_to_remember, upload_loop_table
from palpate.kernels.patterns.section_cutting import _cut_clear_sections, cut_sections
from palpate.kernels.section.half_edges import HalfEdges

SEVERAL = [[0.04, 0.03], [0.3, 0.3], [0.004, 0.003], [0.05, 0.01]]
NEVER_CUT = 9


def cut_clear(table, pose, patch, bounded, closes):
    """Words, polylines and points of `_cut_clear_sections`, and which sections it leaves to the exact kernel."""
    device, count = pose.device, pose.shape[0] * patch.shape[0]
    word = wp.full((4, count), NEVER_CUT, dtype=wp.uint64, device=device)
    polylines, points = (wp.full(count, NEVER_CUT, dtype=wp.int64, device=device) for _ in range(2))
    rest, rest_count = wp.empty(count, dtype=wp.int32, device=device), wp.zeros(1, dtype=wp.int32, device=device)
    inputs = [table, pose, patch, int(bounded), int(closes), room_to_remember(device)]
    outputs = [word, polylines, points, rest, rest_count]
    wp.launch(_cut_clear_sections, count, inputs=inputs, outputs=outputs, device=device, block_dim=64)
    left = np.zeros(count, bool)
    left[rest.numpy()[: rest_count.numpy()[0]]] = True
    return [array.numpy() for array in (word, polylines, points)], left


@pytest.mark.parametrize("strategy", STRATEGIES)
@pytest.mark.parametrize("name", SOLIDS)
def test_clear_sections_are_cut_as_exactly(name, strategy, device):
    mesh, patch = SOLIDS[name](), patch_array(SEVERAL, device)
    table, (bounded, closes) = upload_loop_table(HalfEdges(*mesh), device), STRATEGIES[strategy]
    degenerate = list(degenerate_poses(mesh, 4, seed=5).values())
    pose = pose_array(np.concatenate([exact_poses(400, 3), degenerate]), device)
    cut = cut_sections(table, pose, patch, bounded=bounded, closes=closes)
    own, left = cut_clear(table, pose, patch, bounded, closes)
    for want, got in zip((cut.word, cut.polylines, cut.points), own, strict=True):
        np.testing.assert_array_equal(got[..., ~left], want.numpy()[..., : len(left)][..., ~left])
        assert (got[..., left] == NEVER_CUT).all()
    assert left[: 400 * len(SEVERAL)].mean() < (0.1 if closes else 0.01)
