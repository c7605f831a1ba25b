"""Palms exactly through vertices, along edges, flush with faces, sides and corners on contours, by either method."""

import numpy as np
import pytest
from degenerate_cases import HALF, degenerate_poses, pose_of
from drawing import SEARCHES, STRATEGIES, assert_same_bits, draw, patch_array, surface_on
from mesh_cases import CLOSED, slab
from section_oracle import SHIFT, cut_mesh, is_degenerate

from palpate.kernels.patch import ON

TOLERANCE = 1e-5  # [m]
SHIFTS = [(plane, side) for plane in (0, SHIFT, -SHIFT) for side in (0, -float(ON), SHIFT, -SHIFT)]


def touches(drawn, i):
    """Whether contours meet in a point, as they do where a plane goes through a saddle's vertex."""
    lines = [line[:-1] if (line[0] == line[-1]).all() else line for line in drawn.lines_of(i)]
    points = np.concatenate(lines).round(7)
    return len(np.unique(points, axis=0)) < len(points)


def fits(oc, cc, i, cut):
    """Whether the contours of a pose are those of the oracle, which does not tell lines apart where they touch."""
    closed = oc.closed_of(i)
    return (
        abs(oc.length[i].sum() - cut.oc_length) <= TOLERANCE
        and abs(cc.length[i].sum() - cut.cc_length) <= TOLERANCE
        and ((len(closed), sum(closed)) == (cut.oc_lines, cut.oc_loops) or touches(oc, i))
        and cc.closed_of(i) == [True] * cut.cc_loops
    )


def check(mesh, poses, device):
    """Both methods give the same bits, and these equal the oracle at one of the shifts; returns how many were so."""
    surface, patch, stack = surface_on(mesh, device), patch_array(HALF, device), np.array(list(poses.values()))
    raw, oc, cc = (draw(surface, stack, patch, strategy, "scan") for strategy in STRATEGIES)
    for strategy, traced in zip(STRATEGIES, (raw, oc, cc), strict=True):
        assert_same_bits(traced, draw(surface, stack, patch, strategy, "tree"))
    for i, (label, pose) in enumerate(poses.items()):
        cuts = [cut_mesh(*mesh, pose, HALF, plane_shift=p, side_shift=s) for p, s in SHIFTS]
        agreed = any(fits(oc, cc, i, cut) for cut in cuts)
        assert agreed, (label, oc.length[i], cc.length[i], cuts)
    return sum(is_degenerate(*mesh, pose, HALF) for pose in stack)


def test_palm_along_an_edge_goes_around_a_sliver(device):
    """A plane through an edge cuts off a sliver of 1e-10 m: its contour leaves the palm right where it came in."""
    mesh = CLOSED["cube"]()
    surface, patch = surface_on(mesh, device), patch_array(HALF, device)
    a, b = mesh[0].astype(float)[[0, 1]]
    rng = np.random.default_rng(1)
    poses = np.array(
        [pose_of(0.5 * (a + b), rng.normal(size=3), np.cross(b - a, rng.normal(size=3))) for _ in range(200)]
    )
    for method in SEARCHES:
        oc, cc = (draw(surface, poses, patch, strategy, method) for strategy in ("oc", "cc"))
        np.testing.assert_allclose(cc.length[:, 0], oc.length[:, 0], atol=1e-6)
        assert np.isfinite(cc.points).all()
        assert (cc.length.sum(axis=1) <= 0.37 + TOLERANCE).all()


@pytest.mark.exhaustive(but="few-cube")
@pytest.mark.parametrize("name", [*(name for name in CLOSED if name != "comb"), "block"])
@pytest.mark.parametrize("count", [3, 12], ids=["few", "many"])
def test_degenerate_poses_equal_a_nearby_answer(count, name, device):
    mesh = slab(lambda x, y: 0 * x, 9) if name == "block" else CLOSED[name]()
    poses = degenerate_poses(mesh, count, seed=3)
    assert check(mesh, poses, device) > 0.9 * len(poses)
