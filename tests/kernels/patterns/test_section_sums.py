"""Metrics from the table of loops without a point written: the bits of drawing and tallying."""

import numpy as np
import pytest
from degenerate_cases import degenerate_poses
from drawing import STRATEGIES, exact_poses, patch_array, pose_array
from small_solids import SOLIDS, table_on
from tally_outputs import assert_same_numbers, empty

from palpate.kernels.metrics.tally import METRICS, tally_contours
from palpate.kernels.patterns.section_cutting import cut_sections
from palpate.kernels.patterns.section_drawing import draw_sections
from palpate.kernels.patterns.section_sums import sum_sections
from palpate.render.contour_batch import ContourBatch

SEVERAL = [[0.04, 0.03], [0.3, 0.3], [0.004, 0.003], [0.05, 0.01]]


@pytest.mark.exhaustive(but="few")
@pytest.mark.parametrize("count", [25, 200], ids=["few", "many"])
@pytest.mark.parametrize("strategy", STRATEGIES)
def test_bits_are_those_of_drawing(strategy, count, device):
    patch, (bounded, closes) = patch_array(SEVERAL, device), STRATEGIES[strategy]
    for name, make in SOLIDS.items():
        mesh = make()
        table, degenerate = table_on(name, device), degenerate_poses(mesh, 1 + count // 50, seed=5)
        pose = pose_array(np.concatenate([exact_poses(count, 3), list(degenerate.values())]), device)
        cut = cut_sections(table, pose, patch, bounded=bounded, closes=closes)
        contours = draw_sections(table, pose, patch, cut, bounded=bounded, closes=closes)
        drawn, summed = empty(pose.shape[0], device), empty(pose.shape[0], device)
        tally_contours(ContourBatch.of_sections(contours, len(SEVERAL)).struct, *drawn, measures=True, encloses=closes)
        sum_sections(table, pose, patch, cut, *summed, bounded=bounded, closes=closes)
        if not closes:
            drawn[0][METRICS.index("area")].fill_(np.nan)
        assert_same_numbers(drawn, summed)
        assert drawn[1].numpy().max() > 0
