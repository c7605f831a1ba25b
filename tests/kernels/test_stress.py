"""Many poses on an organic mesh, a sample of them against trimesh and shapely."""

import numpy as np
import pytest
import trimesh
from drawing import draw, exact_poses, patch_array, surface_on
from section_oracle import cut_mesh_trimesh, is_degenerate

from palpate.render.bench.cases import blob

HALF = np.array([0.0425, 0.0425])
TOLERANCE = 1e-5  # [m]
POSES = 100_000
SAMPLE = 40


@pytest.mark.exhaustive
@pytest.mark.stress
def test_a_hundred_thousand_poses_on_a_hundred_thousand_triangles(device):
    """All are rendered, as OC and as CC; a sample of them equals what trimesh and shapely make of it."""
    mesh = blob(71)  # with 100,820 triangles
    surface, patch = surface_on(mesh, device), patch_array(HALF, device)
    poses = exact_poses(POSES, 5)
    length = {"oc": [], "cc": []}
    lines = {"oc": [], "cc": []}
    for first in range(0, POSES, 20_000):
        for strategy in ("oc", "cc"):
            drawn = draw(surface, poses[first : first + 20_000], patch, strategy, None)
            length[strategy].append(drawn.length)
            lines[strategy].append(np.diff(drawn.section_start))
            assert np.isfinite(drawn.points).all()
            assert strategy == "oc" or drawn.polyline_closed.all()
    oc, cc = np.concatenate(length["oc"]), np.concatenate(length["cc"])
    assert len(oc) == POSES
    np.testing.assert_allclose(cc[:, 0], oc[:, 0], atol=TOLERANCE)
    assert (cc.sum(axis=1, dtype=float) >= oc.sum(axis=1, dtype=float) - TOLERANCE).all()
    solid = trimesh.Trimesh(*mesh, process=False)
    oc_lines, cc_lines = np.concatenate(lines["oc"]), np.concatenate(lines["cc"])
    compared = 0
    for i in np.linspace(0, POSES - 1, SAMPLE).astype(int):
        if is_degenerate(*mesh, poses[i], HALF):
            continue
        cut = cut_mesh_trimesh(solid, poses[i], HALF)
        assert oc[i].sum() == pytest.approx(cut.oc_length, abs=TOLERANCE), i
        assert cc[i].sum() == pytest.approx(cut.cc_length, abs=TOLERANCE), i
        assert (oc_lines[i], cc_lines[i]) == (cut.oc_lines, cut.cc_loops), i
        compared += cut.cc_length > 0
    assert compared > SAMPLE // 3
