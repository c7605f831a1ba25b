"""Metrics from the table of loops without a point written: the bits of drawing and tallying."""

import numpy as np
import pytest
from degenerate_cases import degenerate_poses
from drawing import STRATEGIES, exact_poses, patch_array, pose_array
from small_solids import SOLIDS
from tally_outputs import empty

from palpate.kernels.metrics.tally import METRICS, tally_contours
from palpate.kernels.patterns.loop_table import upload_loop_table
from palpate.kernels.patterns.section_cutting import cut_sections
from palpate.kernels.patterns.section_drawing import draw_sections
from palpate.kernels.patterns.section_sums import sum_sections
from palpate.kernels.section.half_edges import HalfEdges
from palpate.render.contour_batch import ContourBatch

SEVERAL = [[0.04, 0.03], [0.3, 0.3], [0.004, 0.003], [0.05, 0.01]]


@pytest.mark.parametrize("strategy", STRATEGIES)
@pytest.mark.parametrize("name", SOLIDS)
def test_bits_are_those_of_drawing(name, strategy, device):
    mesh, patch = SOLIDS[name](), patch_array(SEVERAL, device)
    table, (bounded, closes) = upload_loop_table(HalfEdges(*mesh), device), STRATEGIES[strategy]
    degenerate = list(degenerate_poses(mesh, 4, seed=5).values())
    pose = pose_array(np.concatenate([exact_poses(200, 3), degenerate]), device)
    cut = cut_sections(table, pose, patch, bounded=bounded, closes=closes)
    contours = draw_sections(table, pose, patch, cut, bounded=bounded, closes=closes)
    drawn, summed = empty(pose.shape[0], device), empty(pose.shape[0], device)
    tally_contours(ContourBatch.from_device(contours, len(SEVERAL)), *drawn, measures=True, encloses=closes)
    sum_sections(table, pose, patch, cut, *summed, bounded=bounded, closes=closes)
    if not closes:
        drawn[0][METRICS.index("area")].fill_(np.nan)
    for want, got in zip((a.numpy() for a in drawn), (a.numpy() for a in summed), strict=True):
        np.testing.assert_array_equal(np.isnan(got), np.isnan(want))
        assert got[~np.isnan(got)].tobytes() == want[~np.isnan(want)].tobytes()
    assert drawn[1].numpy().max() > 0


def test_values_of_another_shape_are_refused(device):
    mesh, patch, pose = SOLIDS["cube"](), patch_array(SEVERAL, device), pose_array(exact_poses(5, 3), device)
    table = upload_loop_table(HalfEdges(*mesh), device)
    cut = cut_sections(table, pose, patch, bounded=True, closes=True)
    with pytest.raises(ValueError, match=rf"values must have shape \[{len(METRICS)}.., 5\]"):
        sum_sections(table, pose, patch, cut, *empty(4, device), bounded=True, closes=True)
