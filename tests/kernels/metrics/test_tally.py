"""Numbers of a pose and their sums against slow oracles: lengths, area, statistics, histograms, facing palms."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from mesh_cases import bodies, generic_poses, shell

from palpate.datasets.motions.facing import facing_angles
from palpate.kernels.contours import measure_contours
from palpate.kernels.metrics.random_pose import random_poses
from palpate.kernels.metrics.tally import METRICS, count_bins, count_facing, measure_gaps, sum_parts, tally_contours
from palpate.render import MeshObject, Palm, closed_contour, load_strategy, open_contour
from palpate.render.hands.plane_hand import HandPatch, PlaneHand
from palpate.render.intersection.scene import PoseBlock, Scene
from palpate.render.objects.functions.expression import box, sphere
from palpate.render.objects.functions.implicit_object import ImplicitObject

HALF = 0.0425
TWO = PlaneHand(
    (
        HandPatch("one", 0.06, 0.05),
        HandPatch("two", 0.05, 0.08, (0.02, 0.01, -0.04, 0.48, 0.0, 0.36, 0.8)),
    )
)
"""Two patches that overlap."""


def thing_of(name):
    if name == "shell":
        return MeshObject(*shell())
    if name == "bodies":
        return MeshObject(*bodies())
    if name == "function":
        hollow = sphere(0.06) - sphere(0.03) - box(0.02, 0.2, 0.02)
        return ImplicitObject(hollow.moved(0, 0, 0.2))
    return MeshObject.load(name)


def tallied(batch, device, *, encloses=True):
    value = wp.full((len(METRICS), batch.pose_count), np.nan, dtype=wp.float32, device=device)
    length = wp.empty(batch.pose_count, dtype=wp.float64, device=device)
    tally_contours(batch.struct, value, length, measures=True, encloses=encloses)
    return dict(zip(METRICS, value.numpy(), strict=True)), length.numpy()


def signed_area(points, frames, pose, patch):
    """Shoelace about the patch's normal: what lies to the left seen from +n counts as positive."""
    off = points.astype(np.float64) - frames.origin[pose, patch]
    u, v = off @ frames.u[pose, patch], off @ frames.v[pose, patch]
    return 0.5 * float(np.sum(u[:-1] * v[1:] - u[1:] * v[:-1]))


@pytest.mark.exhaustive(but="dog")
@pytest.mark.parametrize("hand", [Palm(), TWO], ids=["palm", "two patches"])
@pytest.mark.parametrize("name", ["tube", "dog", "shell", "bodies", "function"])
def test_lengths_polylines_and_area_are_those_of_the_oracle(name, hand, device):
    scene = Scene.of(thing_of(name), hand, closed_contour())
    poses = generic_poses(60, 4)
    batch = scene.raw_contours(PoseBlock(poses, 0, device))
    got, length = tallied(batch, device)
    host, frames = batch.numpy(), hand.frames(poses)
    area = np.zeros(len(poses))
    for pose in range(len(poses)):
        lines = range(host.pose_start[pose], host.pose_start[pose + 1])
        for line, points in zip(lines, host.polylines_of(pose), strict=True):
            area[pose] += signed_area(points, frames, pose, host.polyline_patch[line])
    np.testing.assert_allclose(got["area"], area, atol=2e-9)
    assert got["area"].max() > 1e-3
    by_kind = measure_contours(batch.struct).numpy()
    for k, kind in enumerate(("object", "hand", "made")):
        np.testing.assert_array_equal(got[f"length_{kind}"], by_kind[:, k])  # to the bit
    np.testing.assert_array_equal(got["length"], by_kind.sum(axis=1, dtype=np.float64).astype(np.float32))
    np.testing.assert_allclose(length, by_kind.sum(axis=1), atol=1e-7)
    np.testing.assert_array_equal(got["polylines"], np.diff(host.pose_start))


def test_a_palm_wholly_inside_has_its_own_area(device):
    pose = np.array([[0, 0, 0.2, 0.1, 0.2, 0.3, 0.9]], np.float32)
    for hand, area in ((Palm(0.05, 0.03), 0.0015), (Palm(0.001, 0.02), 2e-5)):
        got, _ = tallied(
            Scene.of(thing_of("cube"), hand, closed_contour()).raw_contours(PoseBlock(pose, 0, device)), device
        )
        np.testing.assert_allclose(got["area"], area, rtol=2e-5)
        assert got["length_object"] == 0


def test_flags_leave_the_other_rows_as_they_are(device):
    batch = Scene.of(thing_of("tube"), Palm(), open_contour()).raw_contours(PoseBlock(generic_poses(20, 1), 0, device))
    got, _ = tallied(batch, device, encloses=False)
    assert np.isnan(got["area"]).all()
    value = wp.full((len(METRICS), 20), 7.0, dtype=wp.float32, device=device)
    tally_contours(batch.struct, value, wp.empty(20, dtype=wp.float64, device=device), measures=False, encloses=True)
    assert (value.numpy()[:5] == 7).all()
    assert (value.numpy()[5] == 0).all()  # nothing is closed
    assert not batch.polyline_closed.numpy().any()
    with pytest.raises(ValueError, match="shape"):
        tally_contours(batch.struct, value, wp.empty(3, dtype=wp.float64, device=device), measures=True, encloses=True)


@pytest.mark.parametrize("strategy", ["edges", "corners", "cc"])
def test_intensity_is_integrated_along_contours(strategy, device):
    scene = Scene.of(thing_of("shell"), Palm(), load_strategy(strategy))
    host = scene.contours(generic_poses(40, 5), 0, device)[0].numpy()
    got, _ = tallied(host.to(device), device, encloses=False)
    level = np.ones(host.point_count) if host.intensity is None else host.intensity.astype(np.float64)
    for pose in range(40):
        want = 0.0
        for line in range(host.pose_start[pose], host.pose_start[pose + 1]):
            own = slice(host.polyline_start[line], host.polyline_start[line + 1])
            along = np.cumsum([0, *np.linalg.norm(np.diff(host.points[own].astype(np.float64), axis=0), axis=1)])
            want += np.trapezoid(level[own], along)
        assert got["length_intensity"][pose] == pytest.approx(want, rel=3e-7)
    assert (strategy == "cc") == np.array_equal(got["length_intensity"], got["length"])


def test_an_intensity_of_1_gives_the_bits_of_none(device):
    batch = Scene.of(thing_of("bodies"), Palm(), closed_contour()).raw_contours(
        PoseBlock(generic_poses(60, 2), 0, device)
    )
    ones = replace(batch, intensity=wp.full(batch.point_count, 1.0, dtype=wp.float32, device=device))
    half = replace(batch, intensity=wp.full(batch.point_count, 0.5, dtype=wp.float32, device=device))
    got, halved = tallied(ones, device)[0], tallied(half, device)[0]
    assert got["length"].max() > 0.1
    np.testing.assert_array_equal(got["length_intensity"], got["length"])
    np.testing.assert_array_equal(halved["length_intensity"], got["length"] / 2)
    np.testing.assert_array_equal(halved["length"], got["length"])


def test_gaps_are_those_of_open_polylines_only(device):
    batch = Scene.of(thing_of("shell"), Palm(), open_contour()).raw_contours(PoseBlock(generic_poses(50, 3), 0, device))
    open_length, chord, count = (array.numpy() for array in measure_gaps(batch.struct))
    host = batch.numpy()
    for pose in range(50):
        lines = host.polylines_of(pose)
        first = host.pose_start[pose]
        opened = [x.astype(np.float64) for k, x in enumerate(lines) if not host.polyline_closed[first + k]]
        want = sum(np.linalg.norm(np.diff(x, axis=0), axis=1).sum() for x in opened)
        assert open_length[pose] == pytest.approx(want, abs=1e-12)
        assert chord[pose] == pytest.approx(sum(np.linalg.norm(x[-1] - x[0]) for x in opened), abs=1e-12)
        assert count[pose] == len(lines)
    assert set(host.polyline_closed) == {0, 1}


def test_sums_go_pose_by_pose_and_span_by_span(device, rng):
    value = (rng.normal(size=(2, 90)) ** 5).astype(np.float32)
    value[0, ::7] = np.nan
    value[0, 60:] = np.nan
    first, count, start = [0, 20, 40, 60], [20, 20, 13, 30], [0, 3, 4]
    begun = np.zeros((2, 2, 6))
    begun[..., 3:5] = np.inf, -np.inf
    begun[0, 1] = 4, 0.1, 0.7, -9000, 0.3, 2
    want = begun.copy()
    for part in range(2):
        for span in range(start[part], start[part + 1]):
            for metric in range(2):
                own = np.array([0, 0, 0, np.inf, -np.inf, 0])
                for x in value[metric, first[span] : first[span] + count[span]].astype(np.float64):
                    if np.isfinite(x):
                        own += [1, x, x * x, 0, 0, x > 0]
                        own[3:5] = min(own[3], x), max(own[4], x)
                out = want[part, metric]
                low, high = min(out[3], own[3]), max(out[4], own[4])
                out += own
                out[3:5] = low, high
    arrays = (first, np.int64), (count, np.int64), (start, np.int64), (begun, np.float64)
    given = [wp.array(np.array(array, dtype), device=device) for array, dtype in arrays]
    got = sum_parts(wp.array(value, device=device), *given).numpy()
    np.testing.assert_array_equal(got, want)
    assert got[1, 0].tolist() == [0, 0, 0, np.inf, -np.inf, 0]  # nothing finite
    with pytest.raises(ValueError, match=r"shape \[2, 2, 6\]"):
        sum_parts(wp.array(value, device=device), *given[:3], wp.zeros((1, 2, 6), dtype=wp.float64, device=device))


def test_rows_are_those_of_numpys_angles(device):
    pose = random_poses(0, 5000, seed=3, size=0.13, at=(0.0, 0.0, 0.2), device=device)
    length = np.tile(np.float32([0.1, 0.0, 2.0]), 2000)[:5000]
    out = wp.full((2, 5000), 7.0, dtype=wp.float32, device=device)
    count_facing(pose, wp.array(length, device=device), (30, 60), out)
    angle = np.degrees(facing_angles(pose.numpy()))
    assert np.abs(angle[:, None] - [30, 60]).min() > 1e-6  # no pose that rounding decides
    for row, degrees in zip(out.numpy(), (30, 60), strict=True):
        np.testing.assert_array_equal(row, np.where(length > 0, np.float32(angle <= degrees), np.nan))


def test_counts_are_those_of_numpy(device, rng):
    value = np.concatenate([10.0 ** rng.uniform(-5, 3, 5000), np.zeros(40), [np.nan, np.inf, 0.25, 0.5, 1.0, 2.0]])
    value = rng.permutation(value).astype(np.float32)
    spans, start = np.array([[0, 700], [700, 300], [1000, len(value) - 1000]]), np.array([0, 1, 3])
    arrays = [wp.array(own, dtype=wp.int64, device=device) for own in (*spans.T, start)]
    count = count_bins(wp.array(value, device=device), *arrays, lowest=-2, highest=3, bits=3).numpy()
    octaves = [np.arange(8) / 8 * 2.0**power + 2.0**power for power in range(-2, 3)]
    edges = np.concatenate([[-1.0, 1e-30], *octaves, [8.0, 1e30]])
    assert count.shape == (2, 5 * 8 + 3)
    for own, part in zip(count, (value[:700], value[700:]), strict=True):
        np.testing.assert_array_equal(own, np.histogram(part[np.isfinite(part)].astype(np.float64), edges)[0])
