"""Curves on a triangulated skin: against an oracle that looks at every face, and what holds whatever comes."""

import numpy as np
import pytest
import warp as wp
from mesh_cases import CLOSED, MIDDLE, generic_poses
from skin_cases import drawn, grid_skin, lines_of, oracle_lines, placed_by, summary_of
from stage_cases import assert_limited

from palpate.kernels.section.half_edges import OPEN, twins_of
from palpate.kernels.skin.curves import list_curves
from palpate.kernels.skin.edges import SkinEdges, refine_faces, upload_skin
from palpate.render.hands.mesh_hand import MeshHand


def still(x, y, z):
    """A pose without turn, so far from the middle of the objects [m]."""
    return [*np.add(MIDDLE, (x, y, z)), 0, 0, 0, 1]


def arched():
    return MeshHand(*grid_skin(9))


def pierced():
    """A skin with a hole, a bite out of its side, and an island."""
    vertices, faces = grid_skin(13)
    middle = vertices[faces].mean(axis=1)[:, [0, 2]]
    ring = np.hypot(*middle.T)
    region = ((ring > 0.018) | (ring < 0.008)) & ~((middle[:, 0] > 0.02) & (np.abs(middle[:, 1]) < 0.012))
    return MeshHand(vertices, faces, glabrous=region)


def ball():
    """The lower part of a sphere of 30 mm: strongly bent, its rim a ring."""
    vertices, faces = CLOSED["sphere"]()
    vertices = ((vertices - MIDDLE) * 0.5)[:, [1, 2, 0]]
    return MeshHand(vertices, faces, glabrous=(vertices[faces][:, :, 1] < 0.012).all(axis=1))


SKINS = {"arched": arched, "pierced": pierced, "ball": ball}


@pytest.mark.exhaustive
@pytest.mark.parametrize("closes", [False, True], ids=["oc", "cc"])
@pytest.mark.parametrize("solid", ["cube", "tube", "shell"])
@pytest.mark.parametrize("skin", SKINS)
def test_curves_are_those_of_the_oracle(skin, solid, closes, device):
    hand, poses = SKINS[skin](), generic_poses(8, 3)
    batch = drawn(hand, solid, poses, device, closes=closes)
    lines = 0
    for k, pose in enumerate(poses):
        place = placed_by(hand.vertices[0], pose)
        wanted = summary_of(oracle_lines(place, hand.faces[hand.glabrous], CLOSED[solid](), closes=closes))
        got = summary_of(lines_of(batch, k))
        assert got.shape == wanted.shape
        np.testing.assert_allclose(got, wanted, atol=2.1e-4)  # middles are rounded to 1e-4
        np.testing.assert_allclose(got[:, 4:6], wanted[:, 4:6], atol=3e-6)
        lines += len(got)
    assert lines > 3


@pytest.mark.exhaustive
@pytest.mark.parametrize("skin", SKINS)
def test_open_contours_are_the_object_kind_segments_of_closed_ones(skin, device):
    hand, poses = SKINS[skin](), generic_poses(40, 4)
    for solid in ("tube", "bodies"):
        one = drawn(hand, solid, poses, device, closes=False)
        two = drawn(hand, solid, poses, device, closes=True)
        assert two.polyline_closed.all()
        assert (one.kind == 0).all()
        for k in range(len(poses)):
            pieces = [segments(points, kinds) for points, kinds, _ in lines_of(one, k)]
            wanted = [segments(points, kinds) for points, kinds, _ in lines_of(two, k)]
            assert set().union(*pieces) == set().union(*wanted)
            assert sum(map(len, pieces)) == sum(map(len, wanted))


def segments(points, kinds):
    """Object-kind segments, from where to where."""
    return {
        (*map(float, a), *map(float, b)) for a, b, kind in zip(points, points[1:], kinds, strict=False) if kind == 0
    }


def test_skin_within_the_solid_gives_its_rims_and_skin_without_nothing(device):
    hand = pierced()
    rims = SkinEdges(hand.vertices, hand.faces[hand.glabrous]).rims
    assert len(rims) == 3  # outline with its bite, hole, island
    within, beyond = still(0, 0.004, 0), still(0.2, 0, 0)
    batch = drawn(hand, "cube", [within, beyond], device, closes=True)
    assert batch.pose_start.tolist() == [0, 3, 3]
    assert (batch.kind == 1).all()
    assert sorted(np.diff(batch.polyline_start)) == sorted(rims[:, 1] + 1)
    assert drawn(hand, "cube", [within, beyond], device, closes=False).polyline_count == 0


@pytest.mark.parametrize("other", [False, True], ids=["one inside", "one outside"])
def test_the_loop_around_any_one_vertex_is_found(other, device):
    """The smallest loops there are: one for each vertex of the region, whatever edges searches begin at."""
    hand = pierced()
    edges = SkinEdges(hand.vertices, hand.faces[hand.glabrous], step=0.006)
    count, on_rim = edges.vertex_count, edges.faces.ravel()[edges.before != OPEN]
    fans = np.bincount(on_rim, minlength=count)  # of faces around a vertex on the rim: 2 where rims touch
    single = (np.arange(count) == np.arange(count)[:, None]) != other
    words = np.pad(single, ((0, 0), (0, -count % 32))).reshape(count, -1, 32)
    bits = (words.astype(np.uint64) << np.arange(32, dtype=np.uint64)).sum(axis=2).astype(np.uint32)
    inside = wp.array(bits, dtype=wp.uint32, device=device)
    drafts = list_curves(upload_skin(edges, device), inside, closes=False)
    lines = np.diff(drafts.c.pose_start.numpy())
    np.testing.assert_array_equal(lines, np.maximum(fans, 1))
    closed = drafts.c.polyline_closed.numpy()
    assert closed.sum() == (fans == 0).sum() > 100


def test_the_inside_lies_to_the_left_seen_from_inside_the_hand(device):
    """The hand's inside is +Y of a skin that faces -Y; a sphere's section is a loop around +Y, a whole rim as well."""
    hand = MeshHand(*grid_skin(21, bump=0.0))
    batch = drawn(hand, "sphere", [still(0, 0.06, 0)], device, closes=False)
    ((points, _, closed),) = lines_of(batch, 0)
    assert closed
    assert turn_around(points) > 0
    batch = drawn(hand, "cube", [still(0, 0, 0)], device, closes=True)
    ((points, kinds, _),) = lines_of(batch, 0)
    assert (kinds == 1).all()
    assert turn_around(points) == pytest.approx(0.085**2, rel=1e-4)


def turn_around(points):
    """Area that a loop goes around, counter-clockwise seen from +Y [m^2]."""
    return 0.5 * np.cross(points[:-1] - points[0], points[1:] - points[0]).sum(axis=0)[1]


def test_articulated_vertices_are_those_of_their_own_pose(device):
    rigid, poses = arched(), generic_poses(5, 8)
    scale = np.linspace(0.8, 1.2, 5)[:, None, None].astype(np.float32)
    rows = MeshHand(rigid.vertices * scale, rigid.faces)
    batch = drawn(rows, "tube", poses, device, closes=True)
    for k in range(5):
        alone = drawn(MeshHand(rows.vertices[k], rigid.faces), "tube", poses[k : k + 1], device, closes=True)
        np.testing.assert_allclose(alone.lengths()[0], batch.lengths()[k], atol=1e-6)


def test_limit_is_raised_with_the_count_and_only_beyond_it(device):
    hand, poses = arched(), generic_poses(20, 7)
    assert_limited(lambda limit: drawn(hand, "tube", poses, device, closes=True, limit=limit).point_count)


def test_vertices_on_the_surface_make_no_spikes(device):
    """A skin whose vertices lie in a cube's face, edges and corners: they count as outside, and loops stay whole."""
    size = float(np.ptp(CLOSED["cube"]()[0][:, 0]))
    hand = MeshHand(*grid_skin(9, size=2 * size, bump=0.0))
    batch = drawn(hand, "cube", [still(0, 0, 0)], device, closes=True)
    assert batch.polyline_count == 1
    ((points, kinds, closed),) = lines_of(batch, 0)
    assert closed
    assert (kinds == 0).all()
    assert turn_around(points) == pytest.approx(size**2, rel=0.1)  # the corners are cut off by a triangle
    assert (np.abs(points[:, [0, 2]] - MIDDLE[[0, 2]]).max(axis=1) > size / 2 - 1e-6).all()
    assert (np.linalg.norm(np.diff(points, axis=0), axis=1) > 0).all()


@pytest.mark.parametrize("step", [0.02, 0.0071, 0.003])
def test_refined_triangles_are_short_close_up_and_cover_the_same_skin(step):
    hand = pierced()
    faces = hand.faces[hand.glabrous].astype(np.int64)
    rows = np.concatenate([hand.vertices, hand.vertices * [1.5, 1.0, 0.7]])
    fine = refine_faces(rows, faces, step)
    assert (fine.weight.sum(axis=1) == 1).all()
    for row in rows:
        place = (row[np.maximum(fine.source, 0)] * fine.weight[..., None]).sum(axis=1)
        corner = place[fine.faces]
        assert np.linalg.norm(np.roll(corner, -1, axis=1) - corner, axis=2).max() <= step * (1 + 1e-6)
        areas = [np.linalg.norm(np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]), axis=1) for c in (corner, row[faces])]
        assert areas[0].sum() == pytest.approx(areas[1].sum(), rel=1e-6)
        assert len(np.unique(place, axis=0)) == len(place)
        assert rim_length(corner, fine.faces) == pytest.approx(rim_length(row[faces], faces), rel=1e-6)  # nothing gapes
    with pytest.raises(ValueError, match="more than"):
        refine_faces(rows, faces, 1e-6)


def rim_length(corner, faces):
    """Length of all edges with one triangle [m]."""
    sides = np.linalg.norm(np.roll(corner, -1, axis=1) - corner, axis=2)
    return sides.ravel()[twins_of(faces) == OPEN].sum()
