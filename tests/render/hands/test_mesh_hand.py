"""Hand meshes: two triangles are a palm, faults are named, files are placed, what is stored is read back."""

import warnings

import numpy as np
import pytest
import trimesh
import warp as wp
from mesh_cases import CLOSED, generic_poses
from section_oracle import rotation
from skin_cases import drawn, grid_skin, lines_of

from palpate.kernels.section.draw import draw_contours
from palpate.kernels.section.half_edges import HalfEdges, upload_surface
from palpate.kernels.section.join import join_sections
from palpate.kernels.section.pieces import CutPlanes
from palpate.render.contour_batch import ContourBatch
from palpate.render.errors import MeshError, PalpateWarning, PlacementError, PoseError, StrategyError
from palpate.render.hands.hand import Palm
from palpate.render.hands.mesh_hand import MeshHand, facing_palm
from palpate.render.hands.stored_hand import hand_from
from palpate.render.objects.functions.expression import box
from palpate.render.objects.functions.implicit_object import ImplicitObject

STEP = 0.002


def two_triangles(side=0.085):
    """The palm's rectangle as a mesh, its skin facing -Y."""
    h = side / 2
    return np.array([[-h, 0, h], [h, 0, h], [h, 0, -h], [-h, 0, -h]], np.float32), np.array([[0, 2, 1], [0, 3, 2]])


def palm_contours(name, poses, device, *, closes):
    """What mesh x Palm draws."""
    surface, patch = upload_surface(HalfEdges(*CLOSED[name]()), device), Palm().on(device)
    pose = wp.array(poses[:, None], dtype=wp.transform, device=device)
    drawing = draw_contours(join_sections(CutPlanes(surface, pose, patch, bounded=True, closes=closes)))
    return ContourBatch.of_sections(drawing, 1).numpy()


def area_of(batch, pose, poses):
    """Area that a pose's closed contours go around, counter-clockwise seen from +n [m^2]."""
    normal = rotation(poses[pose][3:])[:, 1]
    loops = [points - points[0] for points, _, closed in lines_of(batch, pose) if closed]
    return sum(0.5 * np.cross(p[:-1], p[1:]).sum(axis=0) @ normal for p in loops)


def far_from(points, lines):
    """Greatest distance of points to polylines [m]."""
    a = np.concatenate([p[:-1] for p, _, _ in lines])
    d = np.concatenate([p[1:] for p, _, _ in lines]) - a
    share = np.einsum("sk,psk->ps", d, points[:, None] - a) / np.maximum((d * d).sum(axis=1), 1e-30)
    near = a + np.clip(share, 0, 1)[..., None] * d
    return float(np.linalg.norm(points[:, None] - near, axis=2).min(axis=1).max())


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("name", ["cube", "tube", "sphere", "dog"])
def test_a_hand_of_two_triangles_is_the_palm(name, device):
    hand, poses = MeshHand(*two_triangles(), step=STEP), generic_poses(60, 11)
    wanted, got = palm_contours(name, poses, device, closes=True), drawn(hand, name, poses, device, closes=True)
    agrees = []
    for k in range(len(poses)):
        want, have = lines_of(wanted, k), lines_of(got, k)
        assert bool(want) == bool(have) or wanted.lengths()[k].sum() < 8 * STEP
        if not want or not have:
            continue
        assert far_from(np.concatenate([p for p, _, _ in have]), want) < STEP
        if len(want) == len(have) and min(np.ptp(p, axis=0).max() for p, _, _ in want) > 8 * STEP:
            missed = far_from(np.concatenate([p for p, _, _ in want]), have)
            area = area_of(wanted, k, poses)
            agrees.append(missed < STEP and abs(area_of(got, k, poses) - area) < 0.01 * area + (2 * STEP) ** 2)
    assert len(agrees) > (8 if name == "dog" else 40)
    assert np.mean(agrees) >= (0.9 if name == "dog" else 1.0)  # a leg may thin out below a step
    whole = [np.diff(batch.pose_start) for batch in (wanted, got)]
    assert (whole[0] == whole[1]).mean() > 0.8


VERTICES, FACES = two_triangles()
FIN = np.array([[0, 2, 1], [0, 3, 2], [2, 0, 4]])
BOX = trimesh.creation.box((0.1, 0.02, 0.1))


@pytest.mark.parametrize(
    ("vertices", "faces", "options", "says"),
    [
        (VERTICES + np.float32([0, np.nan, 0]), FACES, {}, "vertex 0 is not finite"),
        (np.stack([VERTICES, np.full_like(VERTICES, np.inf)]), FACES, {}, "vertex 0 at pose 1 is not finite"),
        (VERTICES[:, :2], FACES, {}, r"not \[4, 2\]"),
        (VERTICES, [[0, 1, 4]], {}, r"face 0 names vertices \[0, 1, 4\], but there are 4"),
        (VERTICES, np.zeros((0, 3), int), {}, "integers of shape"),
        (VERTICES, FACES.astype(float), {}, "integers of shape"),
        (VERTICES, FACES, {"glabrous": np.ones(3, bool)}, "mask of the 2 faces"),
        (VERTICES, FACES, {"glabrous": np.zeros(2, bool)}, "no triangle"),
        (np.vstack([VERTICES, [[0, 0.1, 0]]]), FIN, {}, "between vertices 0 and 2 is shared by 3 triangles"),
        (VERTICES, [[0, 2, 1], [0, 2, 3]], {}, "between vertices 0 and 2 are wound against each other"),
        (BOX.vertices, BOX.faces, {}, "no boundary to close contours along"),
    ],
    ids=lambda x: None if not isinstance(x, str) else x[:30],
)
def test_bad_hands_are_named(vertices, faces, options, says):
    with pytest.raises(MeshError, match=says):
        MeshHand(vertices, np.asarray(faces), **options)


def test_a_strip_without_area_at_the_rim_falls_whole_so_that_the_stored_hand_reads_back():
    strip = [VERTICES[1] + share * (VERTICES[2] - VERTICES[1]) for share in (0.25, 0.5, 0.75)]
    faces = np.concatenate([FACES, [[2, 1, 4], [2, 4, 5], [2, 5, 6]]])
    with pytest.warns(PalpateWarning, match="3 of 5 triangles were dropped"):
        hand = MeshHand(np.vstack([VERTICES, strip]), faces)
    back = hand_from(hand.described(), hand.arrays())
    np.testing.assert_array_equal(back.faces, hand.faces)
    assert back.identity == hand.identity


def test_steps_and_rows_that_are_none_are_named():
    with pytest.raises(StrategyError, match=r"at least 0\.0001 m, not 0"):
        MeshHand(VERTICES, FACES, step=0)
    with pytest.raises(StrategyError, match=r"a step of 0\.0001 m asks for more than"):
        MeshHand(VERTICES * 11, FACES, step=1e-4).edges_of()
    rows = MeshHand(VERTICES * np.float32([1.0, 1.1, 1.2])[:, None, None], FACES)
    assert rows.pose_count == 3
    on_device = rows.vertices_on("cpu", 1, 3).numpy()  # in an order of the kernels' own
    np.testing.assert_array_equal(np.sort(on_device, axis=1), np.sort(rows.vertices[1:3], axis=1))
    for ask in (lambda: rows.vertices_on("cpu", 2, 4), lambda: rows.frames(np.zeros((2, 7)), 2)):
        with pytest.raises(PoseError, match=r"3 poses, not for 2\.\.4"):
            ask()


@pytest.mark.filterwarnings("ignore::palpate.render.errors.PalpateWarning")
def test_triangles_that_are_none_are_dropped_and_counted():
    faces = np.concatenate([FACES, [[0, 0, 1], [1, 2, 2], FACES[0], [0, 1, 4]]])
    vertices = np.vstack([VERTICES, [(VERTICES[0] + VERTICES[1]) / 2]])
    with pytest.warns(PalpateWarning, match="4 of 6 triangles were dropped"):
        hand = MeshHand(vertices, faces, glabrous=np.array([1, 1, 0, 1, 0, 1], bool))
    assert len(hand.faces) == hand.glabrous.sum() == 2
    assert hand.identity == MeshHand(VERTICES, FACES).identity
    with pytest.warns(PalpateWarning, match="suggests millimetres"):
        MeshHand(VERTICES * 1000, FACES)


def test_seams_are_welded_where_all_poses_agree():
    apart = VERTICES[FACES].reshape(-1, 3)
    hand = MeshHand(apart, np.arange(6).reshape(2, 3))
    assert hand.vertices.shape == (1, 4, 3)
    moving = np.stack([apart, apart])
    moving[1, 3:] += np.float32(0.01)  # the two part
    assert MeshHand(moving, np.arange(6).reshape(2, 3)).vertices.shape == (2, 6, 3)


def test_a_closed_hand_that_faces_inwards_is_turned_over():
    mask = facing_palm(BOX.vertices, BOX.faces)
    right = MeshHand(BOX.vertices, BOX.faces, glabrous=mask)
    with pytest.warns(PalpateWarning, match="faces inwards"):
        turned = MeshHand(BOX.vertices, BOX.faces[:, ::-1], glabrous=mask)
    np.testing.assert_array_equal(np.sort(turned.faces, axis=1), np.sort(right.faces, axis=1))
    for hand in (right, turned):
        assert hand.palm_frames.n[0, 0] == pytest.approx([0, 1, 0])
        assert hand.palm_frames.half[0] == pytest.approx([0.05, 0.05])
        assert hand.palm_frames.origin[0, 0] == pytest.approx([0, -0.01, 0])


@pytest.mark.parametrize("rows", [None, 3])
def test_what_is_stored_is_read_back(rows):
    vertices, faces = grid_skin(5)
    mask = np.arange(len(faces)) % 5 > 0
    given = vertices if rows is None else np.stack([vertices * k for k in (1.0, 1.1, 1.2)])
    hand = MeshHand(given, faces, glabrous=mask, step=0.004, name="grid")
    again = MeshHand.from_file(hand.described(), hand.arrays())
    assert again.described() == hand.described()
    assert again.pose_count == rows
    np.testing.assert_array_equal(again.vertices, hand.vertices)
    other = {**hand.arrays(), "skin_glabrous": 1 - hand.arrays()["skin_glabrous"]}
    with pytest.raises(StrategyError, match="SHA-256 differs"):
        MeshHand.from_file(hand.described(), other)


def test_a_file_is_scaled_turned_and_moved(tmp_path):
    """A box in millimetres whose back is +z and whose fingers point along +x."""
    block = trimesh.creation.box((180, 80, 20))
    block.apply_translation([10, 0, 5])
    block.export(tmp_path / "hand.stl")
    options = {"scale": 1e-3, "back": "z", "fingers": "x", "origin": (0.01, 0.0, -0.005)}
    hand = MeshHand.load(tmp_path / "hand.stl", **options)
    low, high = hand.vertices[0].min(axis=0), hand.vertices[0].max(axis=0)
    np.testing.assert_allclose([low, high], [[-0.04, 0, -0.09], [0.04, 0.02, 0.09]], atol=1e-6)
    assert hand.glabrous.sum() == 2
    assert hand.palm_frames.n[0, 0] == pytest.approx([0, 1, 0])
    assert np.linalg.det(np.stack([hand.palm_frames[k][0, 0] for k in (1, 2, 3)])) == pytest.approx(1)  # not mirrored
    np.savetxt(tmp_path / "mask.txt", hand.glabrous.astype(int), fmt="%d")
    np.save(tmp_path / "mask.npy", hand.glabrous)
    for mask in (
        tmp_path / "mask.txt",
        str(tmp_path / "mask.npy"),
        hand.glabrous,
        lambda middle, normal: middle[:, 1] < 1e-6,
    ):
        assert MeshHand.load(tmp_path / "hand.stl", glabrous=mask, **options).identity == hand.identity
    np.savetxt(tmp_path / "mask.txt", np.arange(12))
    for fault, says in (
        ({"glabrous": tmp_path / "mask.txt"}, "mask of the 12 faces"),
        ({"glabrous": tmp_path / "none.txt"}, "no such file"),
        ({"back": "up"}, "back must be one of"),
        ({"fingers": "-z"}, "across each other"),
        ({"origin": "palm"}, "give origin"),
        ({"origin": (0, 1)}, "three finite numbers"),
        ({"scale": -1}, "scale must be positive"),
    ):
        with pytest.raises((MeshError, PlacementError), match=says):
            MeshHand.load(tmp_path / "hand.stl", **{**options, **fault})
    with pytest.raises(MeshError, match="no such file"):
        MeshHand.load(tmp_path / "nothing.glb")


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_webxr_hand_lies_in_the_hand_frame(outside_data, side, device):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        hand = MeshHand.load(outside_data / "hands" / f"{side}.glb")
    low, high = hand.vertices[0].min(axis=0), hand.vertices[0].max(axis=0)
    assert -0.14 < low[2] < -0.12  # finger tips ahead
    assert 0.07 < high[2] < 0.09  # wrist behind
    thumb = hand.vertices[0][np.abs(hand.vertices[0][:, 0]).argmax()]
    assert (thumb[0] > 0.07) == (side == "left")
    assert (thumb[0] < -0.07) == (side == "right")
    assert hand.palm_frames.n[0, 0, 1] > 0.98
    assert 1000 < hand.glabrous.sum() < 1500
    poses = generic_poses(8, 14)
    batch = drawn(hand, "tube", poses, device, closes=True, step=0.004)
    assert batch.polyline_closed.all()
    assert (batch.lengths()[:, 0] > 0).sum() > 4


def test_a_hand_given_as_a_function_is_meshed_once(device):
    block = ImplicitObject(box(0.08, 0.02, 0.1), hand=True)
    hand = MeshHand.from_solid(block, 0.005, device=device)
    assert hand.palm_frames.half[0] == pytest.approx([0.04, 0.05], abs=0.006)
    assert hand.palm_frames.origin[0, 0] == pytest.approx([0, -0.01, 0], abs=1e-3)
    sole = MeshHand.from_solid(block, 0.005, glabrous=lambda middle, normal: normal[:, 1] < -0.99, device=device)
    assert sole.glabrous.sum() < hand.glabrous.sum()
    with pytest.raises(MeshError, match="no boundary"):
        MeshHand.from_solid(block, 0.005, glabrous="all", device=device)
