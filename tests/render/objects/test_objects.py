"""Meshes are judged and mended when loaded; placement; bad files get one clear sentence."""

import warnings

import numpy as np
import pytest
import shapely
import trimesh
from box_meshes import box, inverted, joined
from scipy.spatial.transform import Rotation

from palpate.render import MeshObject, Palm, Placement, closed_contour, open_contour, render
from palpate.render.errors import MeshError, PalpateWarning, PlacementError


def volume(thing):
    return trimesh.Trimesh(thing.vertices, thing.faces, process=False).volume


LEVEL = np.array([[0, 0, 0.2, -np.sqrt(0.5), 0, 0, np.sqrt(0.5)]])  # a palm parallel to the array


@pytest.mark.parametrize(
    ("other", "outline", "message"),
    [
        pytest.param((0.1, (0.05, 0.0, 0.2)), 0.5, "2 bodies that cross or touch united", id="overlap"),
        pytest.param((0.06, (0.0, 0.0, 0.2)), 0.4, "1 bodies inside others left out", id="nest"),
        pytest.param((0.1, (0.1, 0.0, 0.2)), 0.6, "4 triangles dropped .*walls with a back", id="share a face"),
    ],
)
def test_bodies_that_overlap_nest_or_share_a_face_are_one_solid(other, outline, message, device):
    with pytest.warns(PalpateWarning, match=message):
        thing = MeshObject(*joined(box(), box(*other)))
    length = render(thing, Palm(0.4, 0.4), LEVEL, closed_contour(), device=device).length()
    assert length == pytest.approx([outline], abs=1e-5)


@pytest.mark.parametrize(
    ("bodies", "turned", "cavities", "small", "large"),
    [  # small and large: length of CC of palms of 30 and 200 mm through the middle
        pytest.param([box(0.1), inverted(box(0.06)), box(0.02)], 0, 1, 0.08, 0.72, id="body in a cavity"),
        pytest.param([box(0.1), inverted(box(0.05)), inverted(box(0.02))], 1, 1, 0.08, 0.68, id="island inwards"),
        pytest.param([inverted(box(0.1)), box(0.06)], 2, 1, 0.0, 0.64, id="hollow cube inside out"),
        pytest.param([inverted(box(0.1)), inverted(box(0.06))], 1, 1, 0.0, 0.64, id="only the outside inside out"),
        pytest.param(
            [box(0.1), inverted(box(0.04, (-0.01, 0, 0.2))), inverted(box(0.04, (0.01, 0, 0.2)))],
            0,
            2,
            0.0,
            0.6,
            id="two cavities that overlap",
        ),
        pytest.param([box(0.1), inverted(box(0.02, (0.07, 0, 0.2)))], 1, 0, 0.12, 0.48, id="inward body outside"),
    ],
)
def test_nests_are_settled_from_the_outside_inwards(bodies, turned, cavities, small, large, device):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PalpateWarning)
        thing = MeshObject(*joined(*bodies))
    assert (thing.report.bodies_turned, thing.report.cavities) == (turned, cavities)
    for palm, length in ((Palm(0.03, 0.03), small), (Palm(0.2, 0.2), large)):
        assert render(thing, palm, LEVEL, closed_contour(), device=device).length() == pytest.approx([length], abs=1e-5)


def test_inward_body_beside_an_l_is_not_taken_for_its_cavity():
    """It lies in the L's bounding box, but not in the L."""
    short = box(0.02, (0.06, 0.06, 0.2))
    outline = np.array([[0, 0], [0.08, 0], [0.08, 0.02], [0.02, 0.02], [0.02, 0.08], [0, 0.08]])
    ell = trimesh.creation.extrude_polygon(shapely.Polygon(outline - 0.01), 0.02, engine="manifold")
    ell.apply_translation([0, 0, 0.19])
    with pytest.warns(PalpateWarning, match="1 of 2 bodies turned"):
        thing = MeshObject(*joined((ell.vertices, ell.faces), inverted(short)))
    assert thing.report.cavities == 0
    assert volume(thing) == pytest.approx(ell.volume + 0.02**3, rel=1e-5)


def test_gap_of_rounding_is_named_with_what_would_close_it():
    angle = np.linspace(0, 2 * np.pi, 33)  # the last is not quite the first
    ring = 0.05 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    below, above = (np.column_stack([ring, np.full(33, z)]) for z in (0.15, 0.25))
    i = np.arange(32)
    side = np.vstack([np.stack([i, i + 1, i + 33], 1), np.stack([i + 1, i + 34, i + 33], 1)])
    caps = np.vstack([np.stack([i + 1, i, 0 * i + 66], 1), np.stack([i + 33, i + 34, 0 * i + 67], 1)])
    vertices = np.vstack([below, above, [[0, 0, 0.15], [0, 0, 0.25]]])
    assert MeshObject(vertices, np.vstack([side, caps])).report.closed  # float32 cannot tell the two ends apart
    vertices[[32, 65], 1] += 5e-6
    with pytest.warns(PalpateWarning, match=r"6 open edges around 1 holes.*weld=1e-05 would close them all"):
        thing = MeshObject(vertices, np.vstack([side, caps]))
    with pytest.raises(MeshError, match=r"open edges \(1 bodies\)"):
        thing.require_closed()
    assert MeshObject(vertices, np.vstack([side, caps]), weld=1e-5).report.closed


def test_open_mesh_gives_open_contours_and_no_closed_ones(device):
    vertices, faces = box()
    with pytest.warns(PalpateWarning, match="4 open edges around 1 holes, the longest 0.483 m long"):
        thing = MeshObject(vertices, faces[2:])
    assert thing.report.open_edges == 4
    assert render(thing, Palm(), LEVEL, open_contour(), device=device).pose_count == 1
    with pytest.raises(MeshError, match=r"4 open edges.*strategy=.oc"):
        render(thing, Palm(), LEVEL, closed_contour(), device=device)


def test_open_surface_is_drawn_where_it_is_and_nowhere_else(device):
    sheet = np.array([[-0.05, 0.0, 0.1], [0.05, 0.0, 0.1], [0.05, 0.0, 0.3], [-0.05, 0.0, 0.3]])
    with pytest.warns(PalpateWarning, match="4 open edges"):
        thing = MeshObject(sheet, [[0, 1, 2], [0, 2, 3]])
    whole = render(thing, Palm(0.2, 0.2), LEVEL, open_contour(), device=device)
    part = render(thing, Palm(0.06, 0.06), LEVEL, open_contour(), device=device)
    for batch, length in ((whole, 0.1), (part, 0.06)):
        assert batch.length() == pytest.approx([length], abs=1e-6)
        assert batch.polyline_count == 1
        assert batch.polyline_closed.tolist() == [0]


def test_one_sided_surface_is_refused_for_closed_contours():
    angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    across = np.stack([np.cos(angle) * np.cos(angle / 2), np.sin(angle) * np.cos(angle / 2), np.sin(angle / 2)], axis=1)
    vertices = np.vstack([0.1 * ring - 0.03 * across, 0.1 * ring + 0.03 * across]) + np.array([0, 0, 0.2])
    faces = []
    for i in range(24):
        a, b, c, d = i, (i + 1) % 24, i + 24, (i + 1) % 24 + 24
        if i == 23:
            b, d = 24, 0
        faces += [[a, b, c], [b, d, c]]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PalpateWarning)
        band = MeshObject(vertices, faces)
    with pytest.raises(MeshError, match="one side only"):
        band.require_closed()


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        (np.zeros((0, 3)), np.zeros((0, 3), int), "no triangles"),
        ([[0, 0, 0], [1, 0, 0], [0, np.nan, 0]], [[0, 1, 2]], r"1 vertices are not finite, the first is vertex 2"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 3]], r"face 0 names vertex \[0, 1, 3\], but there are 3"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 1]], "all 1 triangles have a corner twice"),
        (
            [[0, 0, 0], [1, 0, 0], [0.5, 0, 0], [0.5, 0, 0]],
            [[0, 1, 2], [1, 0, 3]],
            "all 2 triangles are flat .*float32 cannot tell",
        ),
        ([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]], r"\[vertex, 3\]"),
    ],
)
def test_what_is_no_mesh_is_refused(vertices, faces, message):
    with pytest.raises(MeshError, match=message):
        MeshObject(vertices, faces)


def test_placement_scales_turns_up_fits_rotates_and_moves_in_this_order():
    vertices = np.array([[0, 0, 0], [2, 0, 0], [0, 4, 0], [0, 0, 1.0]])
    faces = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]
    thing = MeshObject(vertices, faces, placement=Placement(up="y", fit=0.2, at=(0.01, 0.02, 0.3)))
    assert np.ptp(thing.vertices, axis=0) == pytest.approx([0.1, 0.05, 0.2], rel=1e-5)
    assert thing.bounds.mean(axis=0) == pytest.approx([0.01, 0.02, 0.3])
    turned = MeshObject(vertices, faces, placement=Placement(up="y", fit=0.2, rotate=(0, 0, 90), at=(0, 0, 0.3)))
    assert np.ptp(turned.vertices, axis=0) == pytest.approx([0.05, 0.1, 0.2], rel=1e-5)
    assert volume(turned) == pytest.approx(volume(thing), rel=1e-5)  # no mirror among them
    angles, middle = (10, 20, 30), np.array([1, 2, 0.5])
    expected = Rotation.from_euler("xyz", angles, degrees=True).apply(vertices - middle) + np.array([0, 0, 0.3])
    assert Placement(rotate=angles, at=(0, 0, 0.3)).applied_to(vertices) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("up", ["x", "y", "z", "-x", "-y", "-z"])
def test_every_up_axis_ends_on_top(up):
    axis, sign = "xyz".index(up[-1]), -1.0 if up[0] == "-" else 1.0
    vertices, faces = box(at=(0, 0, 0))
    vertices = vertices * 0.1
    vertices[:, axis] *= 3
    vertices[:, axis] += sign * 0.05
    thing = MeshObject(vertices, faces, placement=Placement(up=up, scale=2.0))
    assert thing.bounds[:, 2].mean() == pytest.approx(0.1, rel=1e-5)
    assert volume(thing) > 0


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("scale", 0.0),
        ("scale", float("nan")),
        ("up", "w"),
        ("fit", -1.0),
        ("rotate", (0, 0)),
        ("at", (0, 0, float("inf"))),
    ],
)
def test_impossible_placement_is_refused_with_its_field(field, value):
    with pytest.raises(PlacementError, match=field):
        Placement(**{field: value})


def test_dirty_real_mesh_serves_closed_contours(device, outside_data):
    with pytest.warns(PalpateWarning, match=r"604 pairs of triangles cross \(a body crosses itself\)"):
        skull = MeshObject.load(
            outside_data / "meshes" / "dog_skull_1200.stl", placement=Placement(fit=0.13, at=(0, 0, 0.2))
        )
    assert skull.report.closed
    oc, cc = (render(skull, Palm(), LEVEL, s, device=device) for s in (open_contour(), closed_contour()))
    assert cc.length("object") == pytest.approx(oc.length(), abs=1e-6)
    assert cc.length()[0] > 0.1
    assert cc.polyline_closed.all()


def test_hand_mesh_of_a_scene_file_closes_once_its_seams_are_welded(device, outside_data):
    hand = MeshObject.load(outside_data / "hands" / "left.glb", placement=Placement(at=(0, 0, 0.2)))
    assert len(hand.faces) == 2314
    assert 0.15 < np.ptp(hand.vertices, axis=0).max() < 0.25
    assert hand.report.vertices_welded == 201
    assert hand.report.closed
    cc = render(hand, Palm(), LEVEL, closed_contour(), device=device)
    assert cc.polyline_closed.all()
    assert cc.length()[0] > 0.05
