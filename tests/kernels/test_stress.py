"""Many poses on an organic mesh, a sample of them against trimesh and shapely; and every size of the shape."""

import numpy as np
import pytest
import trimesh
from drawing import assert_same_bits, draw, exact_poses, patch_array, surface_on
from section_oracle import cut_mesh, cut_mesh_trimesh, is_degenerate

from palpate.kernels.section.half_edges import HalfEdges
from palpate.render.bench.cases import blob

HALF = np.array([0.0425, 0.0425])
TOLERANCE = 1e-5  # [m]
POSES = 100_000
SAMPLE = 40


def blob_of(face_count):
    """The benchmarks' blob with about that many triangles, always the same shape."""
    return blob(round(np.sqrt(face_count / 20)))


@pytest.mark.exhaustive
@pytest.mark.stress
def test_a_hundred_thousand_poses_on_a_hundred_thousand_triangles(device):
    """All are rendered, as OC and as CC; a sample of them equals what trimesh and shapely make of it."""
    mesh = blob_of(100_000)
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


@pytest.mark.exhaustive(after=1)
@pytest.mark.stress
@pytest.mark.parametrize("face_count", [320, 1280, 2000, 5120, 20_480])
def test_every_size_of_a_shape_agrees_with_the_oracle(face_count, device):
    """And is found the same by either method, as far as there is a trail."""
    mesh = blob_of(face_count)
    edges = HalfEdges(*mesh)
    assert len(edges.faces) == face_count
    surface, patch, poses = surface_on(mesh, device), patch_array(HALF, device), exact_poses(2000, 6)
    oc, cc = (draw(surface, poses, patch, strategy, "seek") for strategy in ("oc", "cc"))
    assert edges.has_scan_path == (face_count < 8000)
    if edges.has_scan_path:
        assert_same_bits(oc, draw(surface, poses, patch, "oc", "trace"))
        assert_same_bits(cc, draw(surface, poses, patch, "cc", "trace"))
    generic = [i for i in range(25) if not is_degenerate(*mesh, poses[i], HALF)]
    assert len(generic) > 10
    for i in generic:
        cut = cut_mesh(*mesh, poses[i], HALF)
        assert oc.length[i].sum() == pytest.approx(cut.oc_length, abs=TOLERANCE)
        assert cc.length[i].sum() == pytest.approx(cut.cc_length, abs=TOLERANCE)
        assert (len(oc.closed_of(i)), len(cc.closed_of(i))) == (cut.oc_lines, cut.cc_loops)
