"""What a page holds of a contour file, read back by an oracle, beside the file."""

import numpy as np
import pytest
import trimesh
from page_oracle import read_page

from palpate.datasets.contour_file.writer import ContourWriter
from palpate.datasets.rigid import rotate
from palpate.render import (
    ContourFile,
    HandMotion,
    MeshHand,
    SamplingStrategy,
    exploration,
    export_page,
    flat_hand,
    render,
    static_pose,
)
from palpate.render.errors import PalpateWarning
from palpate.render.view.file_scene import FileScene
from palpate.render.view.focal_path import focal_path
from palpate.render.view.page.payload import FOCUS_MOST, simplified_for_display

STEP = 0.5e-5 + 1e-9  # [m] half of what positions are rounded to, and float32


def page_of(path, **options):
    out = path.with_suffix(".html")
    export_page(path, out, overwrite=True, **options)
    return read_page(out.read_text())["files"][0]


def rows_of(values, counts):
    ends = np.cumsum(counts).astype(int)
    return np.split(values, ends[:-1])


@pytest.fixture(scope="module")
def depth(tmp_path_factory):
    """Contours with intensities, of every kind but one."""
    batch = render("tube", "palm", exploration("tube", duration=2.5, seed=3)[15:65], "depth-hatch")
    return batch.save(tmp_path_factory.mktemp("page") / "depth.h5")


@pytest.fixture(scope="module")
def page(depth):
    return page_of(depth)


def test_numbers_and_contours_are_those_of_the_file(depth, page):
    with ContourFile(depth) as file:
        motion, length, arrays = file.motion(), file.metrics()["length"], file.contours()
    poses, packed = page["poses"], page["contours"]
    assert poses["index"].tolist() == list(range(len(length)))
    assert poses["time"].tolist() == motion["time"].tolist()
    assert poses["hand_pose"].tolist() == motion["pose"].tolist()
    assert poses["length"].tolist() == length.tolist()
    drawn = length > 0
    assert 0 < drawn.sum() < len(drawn)
    samples = np.ceil(length[drawn].astype(float) / 7.0 * 10_000 - 1e-3)
    np.testing.assert_allclose(poses["draw_frequency"][drawn], 10_000 / samples, rtol=1e-6)
    assert np.isnan(poses["draw_frequency"][~drawn]).all()
    normal = rotate(motion["pose"][:, 3:].astype(float), np.array([0.0, 1.0, 0.0]))
    cosine = normal[:, 2] / np.linalg.norm(normal, axis=1)
    np.testing.assert_allclose(np.cos(np.radians(poses["tilt"])), cosine, atol=1e-6)
    assert packed["polyline_count"].tolist() == np.diff(arrays["pose_start"]).tolist()
    assert packed["point_count"].tolist() == np.diff(arrays["polyline_start"]).tolist()
    assert packed["kind"].tolist() == arrays["kind"].tolist()
    assert np.abs(packed["points"] - arrays["points"]).max() <= STEP
    assert arrays["intensity"].min() < 0.9
    assert np.abs(packed["intensity"] / 255 - arrays["intensity"]).max() <= 0.5 / 255 + 1e-6


def test_focal_points_are_those_of_the_sampler(depth, page):
    packed = page["focus"]
    assert packed["stride"] == 1
    places = rows_of(packed["position"], packed["sample_count"])
    levels, steps = (rows_of(packed[name], packed["sample_count"]) for name in ("intensity", "step"))
    drawn = 0
    with FileScene(depth) as scene:
        for row, (place, level, step) in enumerate(zip(places, levels, steps, strict=True)):
            if not len(place):
                assert scene.moment(row).contours.point_count == 0
                continue
            path = focal_path(scene, row)
            drawn += 1
            assert packed["rate"][row] == 10_000.0
            assert np.abs(place - path.position).max() <= STEP
            assert np.abs(level[:, 0] / 255 - path.intensity).max() <= 0.5 / 255 + 1e-6
            assert (step == 1).tolist() == path.jump.tolist()
            assert (step == 2).tolist() == path.hop.tolist()
    assert drawn > 20
    assert sum((step == 1).sum() for step in steps) > 0


def test_of_many_samples_every_nth_is_kept_with_its_rate_and_no_jump_is_lost(tmp_path):
    motion = exploration("tube", duration=2.0, seed=3, rate=10.0)[3:8]  # a pose has 4,000 samples
    path = render("tube", "palm", motion, "depth-hatch").save(tmp_path / "slow.h5")
    sampling = SamplingStrategy(update_rate=40_000.0)
    packed = page_of(path, sampling=sampling)["focus"]
    assert packed["stride"] == 8
    assert packed["sample_count"].max() == 500 < FOCUS_MOST
    places, steps = (rows_of(packed[name], packed["sample_count"]) for name in ("position", "step"))
    jumps = 0
    with FileScene(path) as scene:
        for row, (place, step) in enumerate(zip(places, steps, strict=True)):
            if len(place):
                found = focal_path(scene, row, sampling)
                assert packed["rate"][row] == 5000.0
                assert np.abs(place - found.position[::8]).max() <= STEP
                ends = np.flatnonzero(found.jump[: 8 * (len(step) - 1) + 1])
                assert np.flatnonzero(step == 1).tolist() == sorted({-(-int(end) // 8) for end in ends})
                jumps += len(ends)
    assert jumps > 0


def test_planes_and_the_hand_around_them_stand_where_the_hand_is(tmp_path):
    hand, motion = flat_hand(), exploration("tube", duration=0.1, seed=3)
    path = render("tube", hand, motion, "cc").save(tmp_path / "planes.h5")
    skin = page_of(path)["skin"]
    corners = hand.corners(motion.pose)
    assert skin["patch_count"].tolist() == [corners.shape[1]] * len(motion.pose)
    assert np.abs(skin["corners"].reshape(corners.shape) - corners).max() <= STEP
    with FileScene(path) as scene:
        look = scene.moment(7).hand
    pose = motion.pose[7].astype(float)
    placed = pose[:3] + rotate(pose[3:] / np.linalg.norm(pose[3:]), skin["vertices"])
    assert np.abs(placed - look.vertices).max() <= 2 * STEP
    assert skin["is_rigid"]
    assert not skin["is_rendered"]


def test_a_moving_object_has_its_poses_and_one_at_rest_its_place(tmp_path):
    time = np.arange(8) / 60
    turned = np.zeros((8, 7))
    turned[:, 0], turned[:, 2], turned[:, 5], turned[:, 6] = 0.05 * time, 0.2, np.sin(time), np.cos(time)
    motion = HandMotion(time, np.repeat(static_pose([0, 0, 0.2]).pose, 8, axis=0))
    path = render("cube", "palm", motion, "cc", object_pose=HandMotion(time, turned)).save(tmp_path / "moving.h5")
    solid = page_of(path)["solid"]
    np.testing.assert_allclose(solid["pose"], turned, atol=1e-6)
    rest = page_of(render("cube", "palm", motion, "cc").save(tmp_path / "rest.h5"))["solid"]
    assert rest["pose"] is None
    with ContourFile(tmp_path / "rest.h5") as file:
        vertices = file.object()["vertices"]
    assert np.abs(rest["vertices"] + rest["middle"] - vertices).max() <= STEP


def test_a_pose_that_is_not_rendered_yet_has_no_length_and_no_contours(depth, tmp_path):
    begun = tmp_path / "begun.h5"
    with ContourFile(depth) as file, ContourWriter(begun, file.header()) as writer:
        length = file.metrics()["length"]
        writer.write(0, 20, file.contours(0, 20), file.metrics(0, 20))
    with pytest.warns(PalpateWarning, match="contours of 20 of"):
        packed = page_of(begun)
    assert packed["poses"]["length"][:20].tolist() == length[:20].tolist()
    assert np.isnan(packed["poses"]["length"][20:]).all()
    assert np.isnan(packed["poses"]["draw_frequency"][20:]).all()
    assert packed["contours"]["polyline_count"][20:].sum() == 0
    assert len(packed["poses"]["hand_pose"]) == len(length)


def test_a_hand_mesh_that_deforms_has_its_vertices_at_each_pose(tmp_path):
    box = trimesh.creation.box((0.08, 0.03, 0.1)).subdivide()
    motion = exploration("tube", duration=0.3, rate=50.0, seed=3)
    grown = 1.0 + 0.01 * np.arange(len(motion.pose))
    feels = box.face_normals[:, 1] < -0.9
    hand = MeshHand(box.vertices[None] * grown[:, None, None], box.faces, glabrous=feels, name="box")
    path = render("tube", hand, motion, "cc").save(tmp_path / "deforming.h5")
    skin = page_of(path)["skin"]
    assert not skin["is_rigid"]
    assert skin["is_rendered"]
    assert skin["patch_count"].tolist() == [0] * len(motion.pose)
    vertices = skin["vertices"].reshape(len(motion.pose), skin["vertex_count"], 3)
    for row, pose in enumerate(motion.pose.astype(float)):
        turn = pose[3:] / np.linalg.norm(pose[3:])
        placed = (pose[:3] + rotate(turn, vertices[row]))[skin["faces"][feels].astype(int)]
        np.testing.assert_allclose(placed, hand.triangles(motion.pose[row : row + 1], row)[0], atol=3e-5)


def test_a_large_mesh_becomes_a_small_one_of_the_same_volume():
    ball = trimesh.creation.icosphere(5, 0.05)  # 20,480 triangles
    ball.apply_translation([0.1, -0.2, 0.3])
    vertices, faces, tolerance = simplified_for_display(ball.vertices.astype(np.float32), ball.faces)
    assert 100 < len(faces) <= 20_000
    small = trimesh.Trimesh(vertices, faces, process=False)
    assert small.is_watertight
    assert abs(small.volume / ball.volume - 1) < 0.01
    same = simplified_for_display(vertices, faces)  # small already
    assert (same[0] is vertices, same[2]) == (True, 0.0)
    kept = simplified_for_display(ball.vertices.astype(np.float32), ball.faces[5:])  # an open surface
    assert (len(kept[1]), kept[2]) == (len(ball.faces) - 5, 0.0)
    off = np.abs(np.linalg.norm(vertices - [0.1, -0.2, 0.3], axis=1) - 0.05)
    assert off.max() <= tolerance < 0.001
