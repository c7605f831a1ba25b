"""Contours of meshes that cross or touch themselves: against GEOS, plane geometry and the kernels for simple meshes."""

from copy import copy
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
import shapely
from crossing_cases import (
    PRISMS,
    block,
    crossing,
    lengths_in,
    overlapping_blocks,
    pentagram,
    prism,
    region_of,
    region_within,
    section_region,
    segments_of,
)
from mesh_cases import CLOSED, MIDDLE, flipped, generic_poses, merged
from scipy.spatial.transform import Rotation
from section_oracle import in_palm

from palpate.render import IntersectionStrategy, MeshObject, Palm, closed_contour, open_contour, render
from palpate.render.contour_batch import HAND, OBJECT
from palpate.render.hands.plane_hand import HandPatch, PatchJoint, PlaneHand
from palpate.render.intersection import section_regularisation as regularisation
from palpate.render.objects.mesh.placement import Placement

OC, CC, WHOLE = open_contour(), closed_contour(), IntersectionStrategy()
STRATEGIES = {"whole plane": WHOLE, "oc": OC, "cc": CC}
LEVEL = np.array([[*MIDDLE, np.sqrt(0.5), 0, 0, np.sqrt(0.5)]], np.float32)
"""A palm at MIDDLE, its u and v along the array's x and y, but for their signs."""
HALF = np.array([0.0425, 0.0425])
ROUNDING = 2e-7  # [m]; of a length: some 10 points, each rounded to float32 (1.5e-8 m at 0.2 m)


def level_lengths(mesh, palm, solid="winding", *, at=(0.0, 0.0, 0.0)):
    """OC and CC of a mesh that crosses itself on a level palm, beside MIDDLE [m]."""
    pose = LEVEL + np.array([*at, 0, 0, 0, 0], np.float32)
    return [float(render(crossing(mesh, solid), palm, pose, strategy).length()[0]) for strategy in (OC, CC)]


def assert_same_contours(batch, expected, near=1e-7):
    """Polylines at each pose: as many, as long, closed and on patches alike, and points near those of the other."""
    np.testing.assert_array_equal(batch.pose_start, expected.pose_start)
    np.testing.assert_allclose(batch.lengths(), expected.lengths(), atol=ROUNDING)
    for row in range(batch.pose_count):
        lines = slice(expected.pose_start[row], expected.pose_start[row + 1])
        for name in ("polyline_closed", "polyline_patch"):
            assert sorted(getattr(batch, name)[lines]) == sorted(getattr(expected, name)[lines])
        one, two = (np.concatenate([np.zeros((0, 3)), *b.polylines_of(row)]) for b in (batch, expected))
        if len(one):
            apart = np.linalg.norm(one[:, None] - two[None], axis=2)
            assert max(apart.min(axis=0).max(), apart.min(axis=1).max()) < near


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("strategy", STRATEGIES)
@pytest.mark.parametrize("name", CLOSED)
def test_contours_of_simple_meshes_are_those_of_the_kernels(name, strategy, device):
    """The kernels share no code with this but the walk: they clip and close by rank, here manifold3d does."""
    mesh, poses = CLOSED[name](), generic_poses(120, 3)
    for palm in (Palm(), Palm(0.02, 0.04)):
        own, expected = (
            render(crossing(mesh, crossings=n), palm, poses, STRATEGIES[strategy], device=device) for n in (1, 0)
        )
        assert expected.length().max() > 0.02
        assert_same_contours(own, expected)


@pytest.mark.exhaustive
def test_hands_of_several_patches_joints_and_objects_that_move_give_what_the_kernels_give(device):
    patches = (HandPatch("a", 0.05, 0.06), HandPatch("b", 0.03, 0.02, (0.0, 0.0, -0.04, 0, 0, 0, 1)))
    poses, places = generic_poses(60, 4), generic_poses(60, 9)
    own = np.tile(np.array([[0, 0, 0, 0, 0, 0, 1.0], [0.01, 0, -0.04, 0.28, 0, 0, 0.96]]), (60, 1, 1))
    own[::3, 1] = np.nan  # a patch that is not there
    hands = (PlaneHand(patches, (PatchJoint("a", 2, "b", 0),)), PlaneHand(patches, (), own))
    for hand, name, strategy, moves in product(hands, ("tube", "bodies"), (OC, CC), (False, True)):
        things = [crossing(CLOSED[name](), crossings=n) for n in (1, 0)]
        where = {"object_pose": places if moves else None, "device": device}
        batch, expected = (render(thing, hand, poses, strategy, **where) for thing in things)
        assert set(expected.polyline_patch) == {0, 1}
        assert_same_contours(batch, expected, near=3e-7)


def test_the_middle_of_a_pentagram_is_inside_and_by_even_and_odd_a_hole():
    """A pentagram's sides cut each other in the golden section: an arm's edge is a side over phi^2."""
    phi, corner = (1 + np.sqrt(5)) / 2, 0.04
    edge = corner * 2 * np.sin(2 * np.pi / 5) / phi**2  # of ten that bound the star
    core = edge / phi  # of five that bound the pentagon in the middle
    mesh = prism(pentagram())
    assert level_lengths(mesh, Palm(0.2, 0.2)) == pytest.approx([10 * edge] * 2, abs=ROUNDING)
    assert level_lengths(mesh, Palm(0.2, 0.2), "even-odd") == pytest.approx([10 * edge + 5 * core] * 2, abs=ROUNDING)
    assert level_lengths(mesh, Palm(0.01, 0.01)) == pytest.approx([0, 0.04], abs=ROUNDING)
    assert level_lengths(mesh, Palm(0.01, 0.01), "even-odd") == [0, 0]


@pytest.mark.exhaustive(but="pentagram-winding")
@pytest.mark.parametrize("solid", ["winding", "even-odd"])
@pytest.mark.parametrize("name", PRISMS)
def test_lengths_and_areas_are_those_of_the_faces_that_geos_makes_of_the_lines(name, solid):
    mesh, poses = PRISMS[name](), generic_poses(60, 8, spread=0.02)
    batches = [render(crossing(mesh, solid), Palm(), poses, strategy) for strategy in (OC, CC)]
    near = 10 * crossing(mesh, solid).gap  # lids cover themselves: notches narrower than that are filled
    wrong_as_cut = 0
    as_cut = render(crossing(mesh, crossings=0), Palm(), poses, CC).length()
    for row, pose in enumerate(poses):
        *lengths, area = lengths_in(section_region(mesh, pose, solid), HALF)
        assert [b.length()[row] for b in batches] == pytest.approx(lengths, abs=2 * ROUNDING + near)
        rings = [in_palm(line, pose)[:-1, :2] for line in batches[1].polylines_of(row)]
        assert sum(signed_area(ring) for ring in rings) == pytest.approx(area, abs=1e-8)
        wrong_as_cut += abs(as_cut[row] - lengths[1]) > 1e-4
    assert wrong_as_cut > 5  # without all this


def signed_area(ring):
    """Of a polygon, above 0 if it goes counter-clockwise: its inside is on its left [m2]."""
    after = np.roll(ring, -1, axis=0)
    return 0.5 * float((ring[:, 0] * after[:, 1] - ring[:, 1] * after[:, 0]).sum())


def test_kinds_lie_on_the_union_of_two_boxes_and_on_the_palms_sides():
    mesh, parts = overlapping_blocks()
    poses, palm = generic_poses(150, 5, spread=0.03), Palm(0.04, 0.05)
    half, counts = np.array([0.02, 0.025]), np.zeros(2, int)
    batch = render(crossing(mesh), palm, poses, CC)
    for row, pose in enumerate(poses):
        union = shapely.union_all([section_region(part, pose) for part in parts])  # each is convex
        *lengths, _ = lengths_in(union, half)
        assert batch.lengths()[row, [OBJECT, HAND]] == pytest.approx(
            [lengths[0], lengths[1] - lengths[0]], abs=ROUNDING
        )
        sides = shapely.box(*-half, *half).exterior
        for line in range(batch.pose_start[row], batch.pose_start[row + 1]):
            span = slice(batch.polyline_start[line], batch.polyline_start[line + 1])
            flat, kind = in_palm(batch.points[span], pose)[:, :2], batch.kind[span]
            middles = shapely.points(0.5 * (flat[1:] + flat[:-1]))
            assert shapely.distance(middles[kind[:-1] == OBJECT], union.boundary).max(initial=0) < 1e-7
            assert shapely.distance(middles[kind[:-1] == HAND], sides).max(initial=0) < 1e-7
            assert kind[-1] == kind[-2]
            counts += [(kind == OBJECT).sum(), (kind == HAND).sum()]
    assert (counts > 300).all()


def test_a_contour_along_a_side_of_the_palm_is_the_hands():
    """Dyadic coordinates: the box ends exactly where the palm does, so of four sides one is the object's alone."""
    box = block([-0.03125, -0.03125, -0.03125], [0.03125, 0.0, 0.03125])
    palm = Palm(0.0625, 0.0625)
    lengths = render(crossing(box), palm, LEVEL, CC).lengths()[0]
    assert lengths[:2] == pytest.approx([0.0625, 3 * 0.0625 - 0.0625], abs=ROUNDING)
    assert render(crossing(box), palm, LEVEL, OC).lengths()[0] == pytest.approx([0.0625, 0, 0], abs=ROUNDING)
    beside = LEVEL + np.array([0.0625, 0, 0, 0, 0, 0, 0], np.float32)  # the two touch along a side
    assert render(crossing(box), palm, beside, CC).point_count == 0


TOUCHING = {
    "side by side": (
        [block([-0.02, -0.02, -0.02], [0.0, 0.02, 0.02]), block([0.0, -0.03, -0.02], [0.02, 0.03, 0.02])],
        0.2,
    ),
    "a cavity that reaches the outside": (
        [block([-0.02, -0.02, -0.02], [0.02, 0.02, 0.02]), flipped(block([0.0, -0.01, -0.015], [0.02, 0.01, 0.015]))],
        0.2,
    ),
    "a cavity that is filled again": (
        [
            block([-0.02, -0.02, -0.02], [0.02, 0.02, 0.02]),
            flipped(block([-0.01, -0.01, -0.015], [0.01, 0.01, 0.015])),
            block([-0.01, -0.01, -0.015], [0.01, 0.0, 0.015]),
            block([-0.01, 0.0, -0.015], [0.01, 0.01, 0.015]),
        ],
        0.16,
    ),
}


@pytest.mark.exhaustive
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("name", TOUCHING)
def test_where_a_solid_touches_itself_there_is_no_wall_and_no_gap(name, turned):
    """Exact lengths of sections across boxes; turned ones have gaps of float32's rounding where they touch."""
    parts, length = TOUCHING[name]
    mesh = merged(*parts)
    assert crossing(mesh).gap > 0
    for seed in range(60):
        turn = Rotation.random(random_state=seed) if turned else Rotation.identity()
        there = turn.apply(mesh[0] - MIDDLE) + MIDDLE, mesh[1]
        spin = Rotation.from_rotvec([0, 0, 0.1 * seed])
        pose = LEVEL + np.array([*turn.apply([0.0002 * seed, 0, 0.005]), 0, 0, 0, 0])
        pose[0, 3:] = (turn * spin * Rotation.from_quat(LEVEL[0, 3:])).as_quat()
        batch = render(crossing(there), Palm(0.2, 0.2), pose.astype(np.float32), CC)
        assert batch.polyline_count == 1
        assert batch.length()[0] == pytest.approx(length, abs=ROUNDING)


def outline_of(loops, solid="winding"):
    """Length of the boundary [m] and area [m^2] of what is inside of loops in one plane, [point, 2] each."""
    start = np.cumsum([0, *map(len, loops)])
    given = regularisation.Loops(np.concatenate(loops), start, np.zeros(len(loops), np.int64))
    rule, planes = regularisation.FILL_RULES[solid], regularisation.Planes(np.zeros((1, 3, 3)), None)
    out = regularisation._regularised(regularisation._on_lattice(given, None), planes, rule, 0.0)
    rings = [ring * regularisation.STEP for ring in np.split(out.points, out.start[1:-1])]
    length = sum(np.linalg.norm(ring - np.roll(ring, 1, axis=0), axis=1).sum() for ring in rings)
    return length, sum(map(signed_area, rings))


@pytest.mark.parametrize("overlap", [0.0, 0.05e-9, 0.3e-9, 0.45e-9])
def test_an_overlap_that_is_narrower_than_corners_move_is_no_gap(overlap):
    """Rectangles of 30 x 40 and 30 x 30 mm that share a strip of a fraction of 1 nm: an outline of 200 mm."""
    for angle in np.linspace(0.05, 3.0, 25):
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        half = overlap / 2
        one = np.array([[-0.03, -0.02], [half, -0.02], [half, 0.02], [-0.03, 0.02]]) @ turn
        two = np.array([[-half, -0.015], [0.03, -0.015], [0.03, 0.015], [-half, 0.015]]) @ turn
        assert outline_of([one, two]) == pytest.approx((0.2, 0.0021), abs=1e-8)


@pytest.mark.parametrize("seed", [*range(3), *(pytest.param(k, marks=pytest.mark.exhaustive) for k in range(3, 200))])
def test_lines_on_a_turned_grid_that_meet_and_coincide_leave_no_slit_and_fill_no_hole(seed):
    """Up to 120 lines between corners of a grid of 10 mm, against what GEOS makes of them before they are turned."""
    rng = np.random.default_rng(seed)
    n, angle = int(rng.integers(4, 9)), rng.uniform(0, np.pi)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    loops = [rng.integers(0, n, (int(rng.integers(3, 16)), 2)) * 0.01 for _ in range(int(rng.integers(2, 9)))]
    solid = ("winding", "even-odd")[seed % 2]
    region = region_of(loops, solid)
    length, area = outline_of([loop @ turn for loop in loops], solid)
    assert length == pytest.approx(region.length, abs=1e-6)
    assert area == pytest.approx(region.area, abs=1e-8)


@pytest.mark.exhaustive
@pytest.mark.parametrize(("name", "most"), [("pentagram", 2), ("limacon", 0)])
def test_a_plane_through_an_edge_gives_no_more_than_planes_beside_it(name, most):
    """Poses whose plane holds an edge of the mesh, and those moved along the normal by 0.1 to 1 um either way.

    A contour through an edge is as long as one just beside it, or lies between: no gap without width adds to it. In 2
    of 600 poses `flush` moves vertices onto the plane such that a wedge of some 5 nm remains, which is no such gap.
    """
    mesh, rng = crossing(PRISMS[name]()), np.random.default_rng(5)
    corners = np.asarray(mesh.vertices, float)[np.asarray(mesh.faces)[rng.integers(len(mesh.faces), size=600)]]
    begin, end = corners[:, 0], corners[:, 1]
    along = (end - begin) / np.linalg.norm(end - begin, axis=1)[:, None]
    normal = np.cross(along, rng.normal(size=along.shape))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    turned = Rotation.from_matrix(np.stack([along, normal, np.cross(along, normal)], axis=2)).as_quat()
    place = begin + rng.uniform(size=(600, 1)) * (end - begin)

    def lengths(shift):
        poses = np.concatenate([place + shift * normal, turned], axis=1).astype(np.float32)
        return np.stack([render(mesh, Palm(0.02, 0.04), poses, strategy).length() for strategy in (OC, CC)])

    through = np.stack([lengths(shift) for shift in (-1e-9, 0.0, 1e-9)])
    beside = np.stack([lengths(shift) for shift in (-1e-6, -1e-7, 1e-7, 1e-6)])
    outside = np.maximum(through - beside.max(axis=0), beside.min(axis=0) - through).max(axis=(0, 1)) > 1e-5
    assert np.count_nonzero(outside) <= most


def test_only_faces_that_look_at_each_other_in_one_plane_may_touch():
    apart = [block([-0.02, 0, 0], [-0.01, 0.01, 0.01]), block([0.01, 0.001, 0.002], [0.02, 0.03, 0.03])]
    assert crossing(merged(*apart)).gap == 0
    assert crossing(overlapping_blocks()[0]).gap == 0
    assert 0 < crossing(merged(*TOUCHING["side by side"][0])).gap < 1e-6  # far below the promised 1e-5 m
    assert crossing(block([0, 0, 0], [0.01, 0.01, 0.01]), "even-odd").gap > 0  # faces twice there cancel


def as_if_simple(thing):
    """The same mesh, cut as if nothing crossed."""
    out = copy(thing)
    out.report = replace(thing.report, crossings=0)
    return out


@pytest.mark.exhaustive
def test_a_dog_skull_that_crosses_itself_has_the_contours_that_geos_finds(outside_data):
    """1,500 poses, section by section from triangles that nobody chained; as cut, many poses are wrong."""
    file = outside_data / "meshes" / "dog_skull_1200.stl"
    with pytest.warns(UserWarning, match=r"."):
        skull = MeshObject.load(file, placement=Placement(fit=0.13, at=(0, 0, 0.2)))
    mesh, poses = (skull.vertices, skull.faces), generic_poses(1500, 5)
    assert not skull.is_simple
    own, plain = (
        [render(thing, Palm(), poses, s).length() for s in (OC, CC)] for thing in (skull, as_if_simple(skull))
    )
    expected = np.array([lengths_in(region_within(segments_of(mesh, pose)), HALF)[:2] for pose in poses]).T
    np.testing.assert_allclose(own, expected, atol=5e-6)
    off = np.abs(own - expected) > 3e-7 + 1e-7 * expected
    assert off.any(axis=0).sum() <= 1  # GEOS keeps a gap of 1.1 um by less than 1.9 nm, which is closed here
    assert (np.abs(plain[1] - expected[1]) > 1e-4).sum() > 10
