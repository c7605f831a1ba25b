"""A scene of a picture: its view, the hand's outline, the contours' lines."""

import numpy as np
import pytest
import shapely
import trimesh
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure

from palpate.datasets import hand_shape
from palpate.datasets.storage.schema import KIND_NAMES
from palpate.render import MeshHand, Palm, flat_hand, load_strategy, render, static_pose
from palpate.render.errors import StrategyError
from palpate.render.reports.picture_style import COLOURS, HAND_DASHES, paler
from palpate.render.reports.scene_drawing import (
    NAMED,
    WIDTH,
    SceneView,
    draw_contours,
    flat,
    hand_surface,
    intensity_runs,
    silhouette,
)

AXES = np.eye(3)


@pytest.mark.parametrize(
    ("view", "right", "up"),
    [("top", AXES[0], AXES[1]), ("front", AXES[0], AXES[2]), ("side", AXES[1], AXES[2]), ("back", -AXES[0], AXES[2])],
)
def test_named_views_show_the_axes_where_engineers_expect_them(view, right, up):
    np.testing.assert_allclose(SceneView.of(view).basis()[:2], [right, up], atol=1e-12)


@pytest.mark.parametrize("view", [*NAMED, "12.5,200", (-90, 0), [5, 5]])
def test_every_view_is_a_rotation_so_lengths_in_its_plane_are_true(view):
    basis = SceneView.of(view).basis()
    np.testing.assert_allclose(basis @ basis.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(basis) == pytest.approx(1.0)
    assert flat(0.05 * basis[0], basis) == pytest.approx([50.0, 0.0])


def test_the_palms_own_view_shows_its_rectangle_upright_and_in_true_size():
    rng = np.random.default_rng(3)
    for q in rng.normal(size=(5, 4)):
        pose = np.array([*rng.normal(size=3), *(q / np.linalg.norm(q))], np.float32)
        corners = flat(Palm(0.08, 0.1).corners(pose[None])[0, 0], SceneView.of("palm").basis(pose))
        np.testing.assert_allclose(np.ptp(corners, axis=0), [80.0, 100.0], rtol=1e-5)
        fingers = static_pose([0, 0, 0]).pose[0]
        assert fingers.shape == (7,)


@pytest.mark.parametrize(
    ("view", "message"),
    [
        ("isoo", "did you mean 'iso'"),
        ("91,0", "between -90 and 90 degrees, not 91"),
        ("nan,0", "between -90 and 90"),
        ("1,2,3", "ELEVATION,AZIMUTH"),
        ((1,), "unknown view"),
        (7, "unknown view 7"),
        ("", "unknown view ''"),
    ],
)
def test_unknown_views_are_refused_with_those_that_there_are(view, message):
    with pytest.raises(StrategyError, match=message):
        SceneView.of(view)


BASIS = SceneView.of("iso").basis()


def area(outline):
    """Signed area of closed outlines."""
    return sum(0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) for x, y in (ring.T for ring in outline))


def test_a_ball_is_seen_as_a_disc_and_a_box_as_its_shadow():
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.03)
    seen = silhouette(ball.vertices, ball.faces, BASIS)
    assert len(seen.outline) == 1
    assert area(seen.outline) == pytest.approx(np.pi * 30.0**2, rel=5e-3)
    sides = np.array([0.02, 0.03, 0.05])
    box = trimesh.creation.box(sides)
    shadow = 1e6 * np.abs(BASIS[2]) @ (np.prod(sides) / sides)  # each pair of faces as far as it faces the eye
    assert area(silhouette(box.vertices, box.faces, BASIS).outline) == pytest.approx(shadow, rel=1e-6)


def test_folds_are_the_edges_between_seen_and_unseen_triangles():
    box = trimesh.creation.box([0.02, 0.03, 0.05])
    folds = silhouette(box.vertices, box.faces, BASIS).folds
    assert len(folds) == 6  # of a box's twelve edges: its outline, a hexagon
    sides = np.linalg.norm(1e3 * np.diag([0.02, 0.03, 0.05]) @ BASIS[:2].T, axis=1)
    assert np.linalg.norm(folds[:, 1] - folds[:, 0], axis=1).sum() == pytest.approx(2 * sides.sum())


def test_a_ring_has_a_hole():
    ring = trimesh.creation.torus(0.04, 0.01)
    seen = silhouette(ring.vertices, ring.faces, SceneView.of("top").basis())
    assert len(seen.outline) == 2
    assert area(seen.outline) == pytest.approx(np.pi * (50.0**2 - 30.0**2), rel=0.02)


def test_the_hands_outline_is_the_union_of_its_triangles_as_shapely_makes_it():
    vertices, faces = hand_surface(Palm(), static_pose([0.01, 0.02, 0.2]).pose[0], 0)
    union = shapely.union_all(shapely.polygons(flat(vertices, BASIS)[faces]))
    assert area(silhouette(vertices, faces, BASIS).outline) == pytest.approx(union.area, rel=2e-3)


def test_a_palms_hand_is_a_right_one_as_broad_as_the_palm():
    pose = static_pose([0, 0, 0.2]).pose[0]
    basis = SceneView.of("palm").basis(pose)
    small, usual = (flat(hand_surface(Palm(width, 0.1), pose, 0)[0], basis) for width in (0.068, 0.085))
    assert (
        usual[:, 0].min() < -60 < 45 < usual[:, 0].max() < 55
    )  # from the back of a right hand, the thumb is at the left
    assert 100 < usual[:, 1].max() < 160
    np.testing.assert_allclose(small, 0.8 * usual, atol=0.05)


def test_meshes_are_drawn_as_they_are_and_planes_have_no_hand_around_them():
    shape = hand_shape(detail=1)
    mesh = MeshHand(shape.vertices, shape.faces, glabrous=shape.glabrous)
    pose = static_pose([0, 0, 0.2]).pose[0]
    vertices, faces = hand_surface(mesh, pose, 0)
    assert faces.shape == mesh.faces.shape
    np.testing.assert_allclose(
        np.linalg.norm(vertices - pose[:3], axis=1), np.linalg.norm(mesh.vertices[0], axis=1), atol=1e-6
    )
    assert hand_surface(flat_hand(), pose, 0) is None


POSE = static_pose([0.065, 0.03, 0.2])  # the cube's corner is in the palm


def drawn(strategy):
    batch = render("cube", Palm(), POSE, load_strategy(strategy))
    axes = Figure().add_subplot()
    axes.set(xlim=(0, 100), ylim=(0, 100))
    artists = draw_contours(axes, batch, lambda points: 1e3 * points[:, :2])
    return batch, axes, artists


@pytest.mark.parametrize("strategy", ["oc", "cc", "hatch", "corners", "edges"])
def test_lines_are_as_long_as_the_contours_whatever_the_intensity(strategy):
    batch = render("cube", Palm(), POSE, load_strategy(strategy))
    lines, kind, strength = intensity_runs(batch)
    length = sum(np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in lines)
    assert length == pytest.approx(float(batch.length()[0]), rel=1e-4)
    assert len(lines) == len(kind) == len(strength)
    assert set(kind.tolist()) == {int(k) for k in batch.kind}
    assert 0 <= strength.min() <= strength.max() <= 1


def test_closed_contours_have_a_line_for_each_kind_and_not_for_each_segment():
    _, _, (halo, lines) = drawn("cc")
    assert isinstance(lines, LineCollection)
    colours = {to_hex(colour) for colour in lines.get_colors()}
    assert colours == {COLOURS["object"], COLOURS["hand"]}
    assert len(lines.get_paths()) <= 3
    assert (np.array(halo.get_linewidths()) > np.array(lines.get_linewidths())).all()
    assert max(lines.get_linewidths()) == pytest.approx(min(lines.get_linewidths())) == pytest.approx(WIDTH)


def test_weak_parts_are_paler_and_each_intensity_has_one_colour():
    batch, _, (_, lines) = drawn("edges")  # the hand's edges have 0.4
    colours = {to_hex(colour) for colour in lines.get_colors()}
    _, kind, strength = intensity_runs(batch)
    pairs = {(int(k), round(float(s), 2)) for k, s in zip(kind, strength, strict=True)}
    assert {(0, 1.0), (1, 0.4)} <= pairs
    assert colours == {to_hex(paler(COLOURS[KIND_NAMES[k]], s)) for k, s in pairs}
    assert len(colours) == len(pairs)
    np.testing.assert_allclose(paler("#000000", 0.0), [0.85] * 3)
    assert to_hex(paler(COLOURS["hand"], 1.0)) == COLOURS["hand"]


def luminance(pixels):
    """Relative luminance of colours 0..1, shape [..., 3]; what a greyscale print keeps."""
    linear = np.where(pixels <= 0.04045, pixels / 12.92, ((pixels + 0.055) / 1.055) ** 2.4)
    return linear @ [0.2126, 0.7152, 0.0722]


@pytest.mark.parametrize("strategy", ["cc", "edges"])
def test_in_greyscale_the_hands_contours_differ_from_the_objects_by_lightness_and_by_dashes(strategy):
    batch, _, (_, lines) = drawn(strategy)
    assert 0 in batch.kind
    assert 1 in batch.kind
    _, kind, _ = intensity_runs(batch)
    styles = lines.get_linestyle()
    for k in (0, 1):
        dashed = {own[1] is not None for own, of in zip(styles, kind, strict=True) if of == k}
        assert dashed == {k == 1}
    shade = {k: luminance(np.array(to_rgb(COLOURS[KIND_NAMES[k]]))) for k in (0, 1)}
    contrast = (shade[1] + 0.05) / (shade[0] + 0.05)
    assert contrast > 2.0


def test_dashes_go_on_over_the_pieces_of_a_line_whose_intensity_varies():
    _, _, (_, lines) = drawn("corners")
    whole, place = sum(HAND_DASHES), 0.0
    axes = lines.axes
    unit = axes.get_window_extent().width / axes.figure.dpi * 72 / np.ptp(axes.get_xlim()) / WIDTH
    pieces = 0
    for (offset, dashes), path in zip(lines.get_linestyle(), lines.get_paths(), strict=True):
        if dashes is None:
            continue
        apart = (offset / WIDTH - place) % whole
        assert min(apart, whole - apart) < 1e-3
        place += unit * np.linalg.norm(np.diff(path.vertices, axis=0), axis=1).sum()
        pieces += 1
    assert pieces > 3


def test_pauses_are_dots_where_the_batch_pauses():
    batch, _, artists = drawn("corner-pauses")
    dots = artists[-1].get_xydata()
    np.testing.assert_allclose(dots, 1e3 * batch.points[batch.dwell > 0][:, :2])
