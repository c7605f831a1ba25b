"""Ovals on a device against those that NumPy, LAPACK and least squares make, region by region."""

import math

import numpy as np
import pytest
import shapely
from ovals_oracle import oval_batch
from stage_cases import assert_limited
from transform_cases import (
    a_setting,
    assert_valid,
    batch_of_loops,
    near_poses,
    random_poses,
    region_batches,
    run_stage,
)

from palpate.kernels.stages.ovals import draw_ovals, find_centroids
from palpate.kernels.stages.regions import find_regions
from palpate.render import MeshObject, Palm, Scene

TOLERANCE = 1e-6  # [m]
LENGTHS = {"scale": 1.2, "smallest": 0.0025}
CASES = [
    *(("ellipse", {"of": of, "points": 24, **LENGTHS}) for of in ("area", "moments", "line")),
    *(("circle", {"of": of, "points": 17, **LENGTHS}) for of in ("area", "line")),
    ("centroid", {"radius": 0.003}),
]


def assert_near(got, want):
    """The same polylines, each point within the tolerance."""
    for name, values in want.by_name().items():
        if name != "points":
            np.testing.assert_array_equal(getattr(got, name), values, err_msg=name)
    np.testing.assert_allclose(got.points, want.points, atol=TOLERANCE, rtol=0)


@pytest.mark.parametrize(("name", "options"), CASES)
def test_ovals_are_those_of_the_oracle(name, options, device, rng):
    for per in ("region", "patch"):
        for batch, setting in region_batches(rng, device):
            got = run_stage(name, batch, setting, per=per, **options)
            assert_valid(got, batch.pose_count)
            assert_near(got, oval_batch(name, batch, setting, per=per, **options))
    pose = near_poses(rng, 30)
    raw, _ = Scene.of(MeshObject.load("tube"), Palm(), "cc").contours(pose, 0, device)
    setting, raw = a_setting(pose, device=device), raw.numpy()
    got = run_stage(name, raw, setting, per="region", **options)
    assert got.polyline_count > 15
    assert_near(got, oval_batch(name, raw, setting, per="region", **options))


def ovals_of_loops(name, loops, setting, *, closed=True, **options):
    """The ovals of loops of one pose, each flat in the palm's plane."""
    out = run_stage(name, batch_of_loops([loops], setting.frames, closed=closed), setting, **options)
    off = out.points.astype(np.float64) - setting.frames.origin[0, 0]
    flat = off @ np.stack([setting.frames.u[0, 0], setting.frames.v[0, 0]], axis=1)
    return np.split(flat, out.polyline_start[1:-1])


def test_an_oblong_begins_at_the_end_of_its_longer_axis_with_u_above_0(device, rng):
    setting = a_setting(random_poses(rng, 1), device=device)
    for turn in (0.0, 0.5 * math.pi, math.pi, 2.5):
        c, s = math.cos(turn), math.sin(turn)
        box = np.array([[-0.03, -0.01], [0.03, -0.01], [0.03, 0.01], [-0.03, 0.01]]) @ np.array([[c, s], [-s, c]])
        (oval,) = ovals_of_loops("ellipse", [box], setting)
        end = math.sqrt(0.06 * 0.02 / math.pi * 3) * np.array([c, s])
        end = -end if end[0] < -1e-9 else end
        assert min(np.linalg.norm(oval[0] - way * end) for way in ((1,) if abs(end[0]) > 1e-9 else (1, -1))) < 1e-4
        assert shapely.Polygon(oval).exterior.is_ccw


def test_lines_of_no_length_have_no_oval(device, rng):
    setting = a_setting(random_poses(rng, 1), device=device)
    dot = np.full((3, 2), 0.01)
    arc = 0.01 * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    for name in ("ellipse", "circle", "centroid"):
        out = run_stage(name, batch_of_loops([[dot, arc]], setting.frames, closed=False), setting, per="region")
        assert out.polyline_count == 1
        assert run_stage(name, batch_of_loops([[dot]], setting.frames), setting).polyline_count == 0


def test_more_points_than_the_limit_are_refused(device, rng):
    batch, setting = next(iter(region_batches(rng, device)))
    ovals = find_centroids(find_regions(batch.to(device).struct, setting.patches), 0.003)
    assert_limited(lambda limit: draw_ovals(ovals, 16, setting.patches, 9, point_limit=limit).points.shape[0])
