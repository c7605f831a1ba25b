"""How regularised sections are used: order, blocks, limits, sizes, live poses, measuring; and what Clipper2 needs."""

import numpy as np
import pytest
import warp as wp
from crossing_cases import PRISMS, block, crossing, overlapping_blocks, section_region
from drawing import SEARCHES, patch_array, searching_by, surface_on
from manifold3d import CrossSection, FillRule
from mesh_cases import CLOSED, MIDDLE, bowl, generic_poses, merged, moved
from section_oracle import section_links, walk

from palpate.kernels.offsets import PointLimitError
from palpate.kernels.section.loops import plane_loops
from palpate.render import IntersectionStrategy, Palm, closed_contour, open_contour, render
from palpate.render.errors import MeshError
from palpate.render.hands.hand import rigid_poses
from palpate.render.intersection import section_regularisation as regularisation
from palpate.render.intersection.mesh_section import intersect
from palpate.render.intersection.prepared_contours import PreparedContours
from palpate.render.intersection.section_regularisation import FILL_RULES, STEP, UNIT, Loops, Planes

OC, CC, WHOLE = open_contour(), closed_contour(), IntersectionStrategy()
LEVEL = np.array([[*MIDDLE, np.sqrt(0.5), 0, 0, np.sqrt(0.5)]], np.float32)


def sections(poses, device="cpu"):
    return wp.array(rigid_poses(poses), dtype=wp.transform, ndim=2, device=device)


def assert_same_bits(one, two):
    for name, array in one.arrays().items():
        assert array.tobytes() == two.arrays()[name].tobytes(), name


@pytest.mark.parametrize("method", SEARCHES)
@pytest.mark.parametrize("name", ["tube", "egg box", "shell"])
def test_loops_are_those_of_a_walk_over_mesh_edges(name, method, device):
    mesh, poses = CLOSED[name](), generic_poses(15, 2)
    patch, surface = patch_array([[0.0425, 0.0425]], device), surface_on(mesh, device)
    with searching_by(method):
        loops = plane_loops(surface, sections(poses, device), patch)
    points, start, of_section = (array.numpy() for array in loops[:3])
    for row, pose in enumerate(poses):
        crossing_of, after = section_links(*mesh, pose)
        expected = sorted(len(chain) for chain, _ in walk(after))
        own = range(of_section[row], of_section[row + 1])
        assert sorted(start[k + 1] - start[k] for k in own) == expected
        mine = points[start[own.start] : start[own.stop]]
        theirs = np.array(list(crossing_of.values())).reshape(-1, 2)
        apart = np.linalg.norm(mine[:, None] - theirs[None], axis=2)
        if len(theirs):
            assert max(apart.min(axis=0).max(), apart.min(axis=1).max()) < 1e-12
    with pytest.raises(PointLimitError):
        plane_loops(surface, sections(poses, device), patch, limit=len(points) - 1)


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("solid", ["winding", "even-odd"])
def test_the_order_of_triangles_bodies_and_corners_changes_no_contour(solid, rng):
    parts, poses = overlapping_blocks()[1], generic_poses(60, 4, spread=0.03)
    mesh = merged(*parts, moved(CLOSED["tube"](), (0.01, 0.005, 0), 0.4))
    expected = render(crossing(mesh, solid), Palm(), poses, CC)
    assert expected.polyline_count > 60
    for _ in range(5):
        vertex = rng.permutation(len(mesh[0]))
        faces = np.argsort(vertex)[mesh[1]][rng.permutation(len(mesh[1]))]
        faces = np.stack([np.roll(face, k) for face, k in zip(faces, rng.integers(0, 3, len(faces)), strict=True)])
        other = render(crossing((mesh[0][vertex], faces), solid), Palm(), poses, CC)
        np.testing.assert_array_equal(other.polyline_start, expected.polyline_start)
        np.testing.assert_allclose(other.points, expected.points, atol=3e-8)  # float32 at 0.3 m


def test_polylines_start_and_stand_in_the_order_that_is_promised():
    thing = crossing(merged(moved(CLOSED["bodies"](), scale=1.3), moved(CLOSED["tube"](), scale=0.5)))
    for strategy in (OC, CC):
        batch = render(thing, Palm(0.06, 0.06), generic_poses(80, 4, spread=0.03), strategy)
        for row in range(batch.pose_count):
            lines = range(batch.pose_start[row], batch.pose_start[row + 1])
            spans = [slice(batch.polyline_start[k], batch.polyline_start[k + 1]) for k in lines]
            meets = [
                not batch.polyline_closed[k] or (batch.kind[s] == 1).any() for k, s in zip(lines, spans, strict=True)
            ]
            assert meets == sorted(meets, reverse=True)
            for k, span, met in zip(lines, spans, meets, strict=True):
                points, kind = batch.points[span], batch.kind[span]
                assert (points[1:] != points[:-1]).any(axis=1).all()
                if batch.polyline_closed[k]:
                    assert (points[0] == points[-1]).all()
                if met and (kind == 0).any() and batch.polyline_closed[k]:
                    assert kind[0] == 0
                    assert kind[-2] == 1


@pytest.mark.exhaustive
def test_blocks_chunks_and_memory_change_no_bit(monkeypatch):
    thing, poses = crossing(PRISMS["zigzag"]()), generic_poses(50, 3)
    expected = {strategy: render(thing, Palm(), poses, strategy) for strategy in (OC, CC, WHOLE)}
    monkeypatch.setattr(regularisation, "BLOCK_POINTS", 64)
    for strategy, batch in expected.items():
        assert batch.point_count > 500
        assert_same_bits(render(thing, Palm(), poses, strategy), batch)
        assert_same_bits(render(thing, Palm(), poses, strategy, memory=2**21), batch)
    count = expected[CC].point_count
    with pytest.raises(PointLimitError):
        intersect(thing, Palm(), sections(poses), CC, point_limit=count // 4)


def test_live_poses_have_the_contours_of_render_bit_for_bit():
    thing, poses = crossing(PRISMS["pentagram"]()), generic_poses(30, 3)
    for strategy in (OC, CC):
        live, expected = PreparedContours(thing, Palm(), strategy), render(thing, Palm(), poses, strategy)
        for row, pose in enumerate(poses):
            assert_same_bits(live.at_checked(pose), expected.select(row, row + 1))


def test_a_surface_with_a_rim_is_drawn_as_cut_and_refused_where_it_must_be_closed():
    poses = generic_poses(20, 3)
    thing, plain = (crossing(bowl(), crossings=n) for n in (1, 0))
    for open_one in (thing, plain):
        open_one.report = type(open_one.report)(crossings=open_one.report.crossings, open_edges=30)
    assert_same_bits(render(thing, Palm(), poses, OC), render(plain, Palm(), poses, OC))
    with pytest.raises(MeshError, match="30 open edges"):
        render(thing, Palm(), poses, CC)


@pytest.mark.parametrize("size", [0.01, 0.1, 1.0])
def test_patches_of_any_size_see_scaled_objects_alike(size):
    """From 10 mm to 1 m, which is the largest patch there is."""
    mesh, pose = PRISMS["pentagram"](), generic_poses(40, 6, spread=0.01)
    expected = render(crossing(mesh), Palm(0.1, 0.08), pose, CC).lengths()
    scale = size / 0.1
    pose[:, :3] *= scale
    scaled = np.asarray(mesh[0], np.float64) * scale, mesh[1]
    lengths = render(crossing(scaled), Palm(size, 0.8 * size), pose, CC).lengths()
    np.testing.assert_allclose(lengths / scale, expected, atol=2e-6)


FAR = pytest.mark.filterwarnings("ignore:.*float32 steps by")


@FAR
@pytest.mark.parametrize("reach", [10.0, 1e3, 1e5, 1e6])
def test_what_reaches_far_beyond_the_patch_is_cut_where_it_should_be(reach):
    """Two blocks that overlap far away; their common side passes through the palm, which is dyadic as it is."""
    corners = [
        np.array([[0.0, -reach, -1.0], [reach, 0.5 * reach, 1.0]]),
        np.array([[0.0, -0.5 * reach, -2.0], [reach, reach, 2.0]]),
    ]
    mesh = merged(*(block(*pair) for pair in corners))
    pose = LEVEL.copy()
    pose[0, 0] += 0.0078125
    expected = 0.0625 / 2 + 0.0078125
    batch = render(crossing(mesh), Palm(0.0625, 0.0625), pose, CC)
    assert batch.polyline_count == 1
    assert batch.lengths()[0] == pytest.approx([0.0625, 2 * expected + 0.0625, 0], abs=1e-6)
    assert batch.points[:, 0].min() > -1e-6
    whole = render(crossing(mesh), Palm(), pose, WHOLE)
    assert whole.length()[0] == pytest.approx(2 * reach + 4 * reach, rel=1e-6)


@FAR
def test_what_reaches_too_far_is_refused():
    huge = block([0.0, -1e9, -1.0], [1e9, 1e9, 1.0])
    with pytest.raises(MeshError, match=r"may reach 1\.05e\+06 m from a patch at most, not 1e\+09 m"):
        render(crossing(huge), Palm(), LEVEL, CC)


def test_what_the_library_rounds_to_is_a_power_of_2_whatever_the_place():
    """The lattice stands on this: `CrossSection` takes 8 decimal places as 2^-27 of its unit."""
    for place in (0.0, 1000.0, 2.0**22):
        corners = np.array([[0.0, 0.0], [1 / 3, 0.0], [1 / 3, 1 / 7], [0.0, 1 / 7]]) + place
        points = CrossSection([corners], FillRule.Positive).to_polygons()[0]
        assert (points / UNIT == np.rint(points / UNIT)).all()
        assert np.abs(points[:, None] - corners[None]).max(axis=2).min(axis=1).max() <= UNIT / 2 + 1e-9 * place
        exact = np.rint(corners / UNIT) * UNIT
        assert {tuple(p) for p in CrossSection([exact]).to_polygons()[0]} == {tuple(p) for p in exact}


def lines_on_a_grid(rng):
    """Closed polygons whose corners lie on a turned grid: many lines meet in one point, or lie on each other."""
    turn = np.array([[np.cos(1), np.sin(1)], [-np.sin(1), np.cos(1)]])
    return [np.round(rng.uniform(-5, 5, (rng.integers(3, 40), 2))) @ turn * 0.01 for _ in range(rng.integers(1, 4))]


def windings(loops, points):
    """Winding numbers of polygons around points, by crossings of the ray along u."""
    total = np.zeros(len(points), int)
    for loop in loops:
        a, b = loop[:, None] - points[None], np.roll(loop, -1, axis=0)[:, None] - points[None]
        left = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
        total += ((a[..., 1] <= 0) & (b[..., 1] > 0) & (left > 0)).sum(axis=0)
        total -= ((a[..., 1] > 0) & (b[..., 1] <= 0) & (left < 0)).sum(axis=0)
    return total


@pytest.mark.exhaustive
@pytest.mark.parametrize("gap", [0.0, 2.4e-7])
def test_where_many_lines_meet_in_a_point_no_hole_is_filled(gap, rng):
    """Clipper2 fills one now and then if corners are not moved into general position: 5 or so of 250 such sections."""
    half = np.array([[0.03, 0.03]])
    filled = dict.fromkeys(("moved", "as they are"), 0)
    for _ in range(250):
        loops = lines_on_a_grid(rng)
        points = rng.uniform(-0.03, 0.03, (2000, 2))
        start = np.concatenate([[0], np.cumsum([len(loop) for loop in loops])])
        many = Loops(np.concatenate(loops), start, np.zeros(len(loops), np.int64))
        expected = windings(loops, points) > 0
        planes = Planes(np.zeros((1, 3, 3)), np.rint(half / STEP))
        own = regularisation._on_lattice(many, planes.sides)
        still = Loops(np.rint(many.points / STEP), many.start, many.section)
        for way, given in (("moved", own), ("as they are", still)):
            found = regularisation._regularised(given, planes, FILL_RULES["winding"], gap)
            polygons = [found.points[a:b] * STEP for a, b in zip(found.start, found.start[1:], strict=False)]
            filled[way] += (windings(polygons, points) != expected).sum() > 0
    assert filled["moved"] == 0
    assert gap or filled["as they are"] > 0


def test_a_sliver_below_all_others_turns_nothing_inside_out(monkeypatch):
    """Clipper2 offsets all polygons inwards for outwards if the lowest one goes around clockwise, as slivers may."""
    monkeypatch.setattr(regularisation, "_jitter", np.zeros_like)
    box = block([-0.02, -0.02, -0.02], [0.02, 0.02, 0.02])
    within = block([-0.02, -0.02, -0.02], [0.01, 0.02, 0.01])  # shares three planes with it
    thing = crossing(merged(box, within), "even-odd")
    poses = generic_poses(200, 6, spread=0.01)
    assert min(section_region(box, pose).area - section_region(within, pose).area for pose in poses) > 1e-5
    assert render(thing, Palm(0.2, 0.2), poses, CC).length().min() > 0.01
