"""Tips that marching squares cut off or never see, against Shapely's polygons and circles in closed form."""

import numpy as np
import pytest
import shapely
import warp as wp
from march_cases import (
    CENTER,
    FLAT,
    area_of,
    assert_sound,
    ball_value,
    lines_of,
    marched,
    random_poses,
    ring_value,
    shape_field,
)

from palpate.kernels.fields.bricked_grid import bricked_field, pad_outside
from palpate.kernels.fields.field import Field
from palpate.kernels.patch import EXACT
from palpate.render.contour_batch import object_part

wp.set_module_options(EXACT)

STEP = 0.0025
DEPTH = 0.03
"""From a wedge's tip to its back [m]."""
PALM = shapely.box(-0.0425, -0.0425, 0.0425, 0.0425)
WITHIN = shapely.box(-0.0425 + 1e-9, -0.0425 + 1e-9, 0.0425 - 1e-9, 0.0425 - 1e-9)


@wp.struct
class Wedge:
    """Three half-spaces."""

    tip: wp.vec3d
    one: wp.vec3d  # outward normals
    other: wp.vec3d
    back: wp.vec3d
    depth: wp.float64


@wp.func
def wedge_value(d: Wedge, x: wp.vec3d):
    p = x - d.tip
    return wp.max(wp.max(wp.dot(p, d.one), wp.dot(p, d.other)), wp.dot(p, d.back) - d.depth)


@wp.func
def notch_value(d: Wedge, x: wp.vec3d):
    """All in front of the wedge's back that is not the wedge."""
    p = x - d.tip
    return wp.max(-wp.max(wp.dot(p, d.one), wp.dot(p, d.other)), wp.dot(p, d.back) - d.depth)


def ray(turn):
    """Unit vector of the palm's plane, in its u and v."""
    return np.array([np.cos(turn), np.sin(turn)])


def in_array(p):
    """A point of the plane of the pose FLAT in the array's frame: u is x, v is -z."""
    return np.array([p[0], 0.0, -p[1]])


def in_plane(points):
    return np.stack([points[:, 0], -points[:, 2]], axis=1).astype(np.float64)


def wedge_of(value, angle, turn, tip):
    """A wedge that points along `turn`, and its section as a polygon (of a notch: what is there near the palm)."""
    half = np.radians(angle) / 2
    d = Wedge()
    d.tip, d.back, d.depth = wp.vec3d(*in_array(tip)), wp.vec3d(*-in_array(ray(turn))), wp.float64(DEPTH)
    d.one, d.other = (wp.vec3d(*in_array(ray(turn + side * (np.pi / 2 - half)))) for side in (1, -1))
    length = DEPTH if value is wedge_value else 0.3
    legs = [tip - ray(turn + side * half) * length / np.cos(half) for side in (1, -1)]
    region = shapely.Polygon([tip, *legs])
    if value is notch_value:
        back, across = tip - DEPTH * ray(turn), ray(turn + np.pi / 2)
        front = shapely.Polygon([back - across, back + across, back + across + ray(turn), back - across + ray(turn)])
        region = front.difference(region)
    return Field(value, Wedge, d), region


def random_wedges(count, seed, spread):
    rng = np.random.default_rng(seed)
    return [(rng.uniform(0, 2 * np.pi), rng.uniform(-spread, spread, 2)) for _ in range(count)]


def rings_of(batch):
    return [in_plane(line[0]) for line in lines_of(batch)[0]]


def loops_in(region):
    return sum(1 + len(part.interiors) for part in getattr(region, "geoms", [region]) if not part.is_empty)


def missing(region, batch, step=STEP):
    """How far the farthest point of the exact boundary on the palm is from the contour [step]."""
    exact = shapely.get_coordinates(shapely.segmentize(region.intersection(PALM).boundary, step / 10))
    found = shapely.MultiLineString([shapely.LineString(ring) for ring in rings_of(batch)])
    return shapely.distance(shapely.points(exact), found).max() / step


@pytest.mark.exhaustive
@pytest.mark.parametrize("value", [wedge_value, notch_value], ids=["wedge", "notch"])
@pytest.mark.parametrize("angle", [120, 90, 40, 20, 10])
def test_tips_of_wedges_are_met_wherever_they_lie(angle, value, device):
    """Marching squares alone lose 0.7, 1.5, 2.9, 5.6 steps at 90, 40, 20, 10 degrees."""
    for turn, tip in random_wedges(40, angle, 0.01):
        field, region = wedge_of(value, angle, turn, tip)
        opened, closed = (marched(field, [FLAT], device, step=STEP, closes=closes) for closes in (False, True))
        assert_sound(closed)
        assert missing(region, closed) < 0.25
        points = shapely.points(in_plane(opened.points))
        assert shapely.distance(points, region.boundary).max() < 1e-7  # no point that is not on the surface
        exact = region.boundary.intersection(WITHIN).length
        assert opened.length()[0] == pytest.approx(exact, abs=0.4 * STEP)
        assert closed.length("object")[0] == pytest.approx(opened.length()[0], rel=1e-6)
        assert closed.polyline_count == loops_in(region.intersection(PALM))
        assert all(shapely.LinearRing(ring).is_simple for ring in rings_of(closed))
        area = sum(area_of(line[0], np.float32(FLAT)) for line in lines_of(closed)[0])
        assert area == pytest.approx(region.intersection(PALM).area, abs=0.2 * STEP**2)


@pytest.mark.exhaustive
@pytest.mark.parametrize("angle", [90, 40, 20, 10])
def test_a_wedge_that_leaves_the_palm_is_cut_at_its_side(angle, device):
    """Tips near the sides and beyond them, of wedges whose thick part is on the palm."""
    left = 0
    for turn, tip in random_wedges(200, angle + 1, 0.055):
        field, region = wedge_of(wedge_value, angle, turn, tip)
        thick = shapely.Point(tip - 0.9 * DEPTH * ray(turn))
        if not PALM.buffer(-2 * STEP).contains(thick) or PALM.buffer(-2 * STEP).contains(shapely.Point(tip)):
            continue
        left += 1
        opened, closed = (marched(field, [FLAT], device, step=STEP, closes=closes) for closes in (False, True))
        assert missing(region, closed) < 1.0
        assert all(shapely.LinearRing(ring).is_simple for ring in rings_of(closed))
        assert np.abs(in_plane(closed.points)).max() <= 0.0425 + 1e-7
        exact = region.boundary.intersection(WITHIN).length
        assert opened.length()[0] == pytest.approx(exact, abs=2.0 * STEP)
        one, two = (
            sorted(map(repr, (line[0].tolist() for line in lines_of(b)[0]))) for b in (opened, object_part(closed))
        )
        assert one == two
    assert left > 15


@pytest.mark.exhaustive
def test_smooth_contours_are_the_same_to_the_bit_whether_tips_are_looked_for_or_not(device):
    for value, size in ((ball_value, (0.03, 0, 0)), (ring_value, (0.03, 0.012, 0))):
        field, poses = shape_field(value, CENTER, size), random_poses(60, 5)
        with_tips, without = (marched(field._replace(grain=g), poses, device, step=0.001) for g in (0.0, 1.0))
        near = np.abs(np.diff(with_tips.pose_start) - np.diff(without.pose_start))
        assert near.max() == 0
        for one, other in zip(lines_of(with_tips), lines_of(without), strict=True):
            for a, b in zip(one, other, strict=True):
                turning = (
                    np.linalg.norm(a[0].max(axis=0) - a[0].min(axis=0)) < 0.008
                )  # smaller than 8 steps: round tips
                assert turning or np.array_equal(a[0], b[0])


@pytest.mark.exhaustive
@pytest.mark.parametrize("grain", [0.0005, 0.002])
def test_voxels_have_tips_where_they_are_finer_than_a_quarter_step(grain, device):
    """A wedge of 40 degrees in voxels: its tip in them is where the trilinear surface ends, less than 3 voxels off."""
    lost = []
    for turn, tip in random_wedges(10, 6, 0.004):
        normal = [ray(turn + side * (np.pi / 2 - np.radians(20))) for side in (1, -1)]
        axis = np.arange(-0.045, 0.045, grain)
        flat = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1) - tip  # u and v
        value = np.maximum.reduce([*(flat @ n for n in normal), flat @ -ray(turn) - DEPTH])
        volume = np.repeat(value[:, None, ::-1], 5, axis=1).astype(np.float32)  # x = u, z = -v
        affine = np.diag([grain, grain, grain, 1.0])
        affine[:3, 3] = axis[0], -2 * grain, -axis[-1]
        field = bricked_field(pad_outside(volume), affine, device)
        with_tips, without = (marched(f, [FLAT], device, step=STEP) for f in (field, field._replace(grain=1.0)))
        if grain > STEP / 4:
            np.testing.assert_array_equal(with_tips.points, without.points)
        lost.append([np.linalg.norm(in_plane(b.points) - tip, axis=1).min() / STEP for b in (with_tips, without)])
    if grain < STEP / 4:
        assert np.array(lost)[:, 0].max() < 3 * grain / STEP
        assert np.array(lost)[:, 1].max() > 1.0
