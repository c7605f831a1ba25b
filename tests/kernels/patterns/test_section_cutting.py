"""Cutting where nothing is doubtful, without long branches: the same words and counts as cutting exactly."""

import numpy as np
import pytest
from degenerate_cases import degenerate_poses
from drawing import STRATEGIES, exact_poses, patch_array, pose_array
from small_solids import SOLIDS, table_on

from palpate.kernels.patterns.cut_loops import EXACT_SHIFT
from palpate.kernels.patterns.section_cutting import cut_sections

SEVERAL = [[0.04, 0.03], [0.3, 0.3], [0.004, 0.003], [0.05, 0.01]]


@pytest.mark.exhaustive(but="few")
@pytest.mark.parametrize("count", [40, 400], ids=["few", "many"])
@pytest.mark.parametrize("strategy", STRATEGIES)
def test_clear_sections_are_cut_as_exactly(strategy, count, device):
    patch, (bounded, closes) = patch_array(SEVERAL, device), STRATEGIES[strategy]
    bits = np.uint64(2 ** int(EXACT_SHIFT) - 1)
    for name, make in SOLIDS.items():
        mesh = make()
        table, degenerate = (
            table_on(name, device),
            degenerate_poses(mesh, 1 + count // 100, seed=5),
        )
        pose = pose_array(np.concatenate([exact_poses(count, 3), list(degenerate.values())]), device)
        one, two = (
            cut_sections(table, pose, patch, bounded=bounded, closes=closes, split=split) for split in (False, True)
        )
        exactly = two.word.numpy()[3] >> np.uint64(int(EXACT_SHIFT)) != 0
        assert sorted(two.rest.numpy()[: two.rest_count.numpy()[0]]) == np.flatnonzero(exactly).tolist()
        np.testing.assert_array_equal(two.polylines.numpy(), one.polylines.numpy(), err_msg=name)
        np.testing.assert_array_equal(two.points.numpy(), one.points.numpy(), err_msg=name)
        np.testing.assert_array_equal(two.word.numpy() & bits, one.word.numpy() & bits, err_msg=name)
        assert exactly[: count * len(SEVERAL)].mean() < (0.1 if closes else 0.01)


def test_nothing_is_cut_exactly_of_a_cube_at_random_poses(device):
    """Nearly nothing: so a GPU's threads have no long branches."""
    table, patch = table_on("cube", device), patch_array([0.0425, 0.0425], device)
    cut = cut_sections(table, pose_array(exact_poses(4000, 1), device), patch, bounded=True, closes=True, split=True)
    assert cut.rest_count.numpy()[0] < 20
