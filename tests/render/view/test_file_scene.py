"""What a viewer reads of a pose is what the file has of it, sealed or still being written."""

import numpy as np
import pytest

from palpate.datasets import HandMotion
from palpate.datasets.errors import ContourFileError
from palpate.render import ContourFile, MeshObject, PalpateWarning, exploration, record, render, static_pose
from palpate.render.view.file_scene import FileScene, tilts_of
from palpate.render.view.page.payload import notes_of


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return render("tube", "palm", exploration("tube", duration=1.0, seed=1), "cc").save(
        tmp_path_factory.mktemp("view") / "tube.h5"
    )


def test_moments_are_rows_of_the_file(path):
    with FileScene(path) as scene, ContourFile(path) as file:
        motion, length = file.motion(), file.metrics()["length"]
        assert (scene.pose_count, scene.object_name) == (90, "tube")
        for index in (0, 40, 54, 89):
            moment = scene.moment(index)
            np.testing.assert_array_equal(moment.hand_pose, motion["pose"][index])
            assert moment.time == motion["time"][index]
            assert moment.length == pytest.approx(length[index], abs=1e-6)
            np.testing.assert_array_equal(moment.contours.points, file.contours(index, index + 1)["points"])


def test_every_time_has_the_pose_that_began_last(path):
    with FileScene(path) as scene:
        time = scene.times(0, scene.pose_count)
        for at in [-1.0, *time, *(time + 1e-4), 99.0]:
            expected = max(int((time <= at).sum()) - 1, 0)
            assert scene.pose_at(at) == expected


def test_a_palm_that_faces_the_array_has_no_tilt():
    half = np.sqrt(0.5)
    down = [0, 0, 0.2, half, 0, 0, half]
    assert tilts_of(np.array(down)) == pytest.approx(0.0, abs=1e-7)
    assert tilts_of(np.array([0, 0, 0.2, 0, 0, 0, 1.0])) == pytest.approx(np.pi / 2)  # y is the back of the hand
    assert tilts_of(np.array([0, 0, 0.2, -half, 0, 0, half])) == pytest.approx(np.pi)


class StopError(Exception):
    """Ends a rendering half way."""


def stop(done, total):
    if done:
        raise StopError


def test_an_unfinished_file_shows_what_is_done_and_goes_on(tmp_path):
    motion = exploration("tube", duration=3.0, seed=1)
    path = tmp_path / "a.h5"

    with pytest.raises(StopError):
        record(path, "tube", "palm", motion, "cc", memory=5_000_000, progress=stop)
    with FileScene(path) as scene:
        assert not scene.is_sealed
        assert 0 <= scene.done_count <= scene.pose_count
        last = scene.moment(scene.pose_count - 1)
        assert last.is_done == scene.is_done(scene.pose_count - 1)
        record(path, "tube", "palm", motion, "cc", mode="resume")
        scene.refresh()
        assert scene.is_sealed
        assert scene.done_count == scene.pose_count == 270
        assert scene.moment(269).is_done


def test_files_that_cannot_be_read_are_refused_by_name(tmp_path, path):
    with pytest.raises(ContourFileError, match=r"nothing\.h5"):
        FileScene(tmp_path / "nothing.h5")
    broken = tmp_path / "broken.h5"
    broken.write_bytes(path.read_bytes()[:20_000])
    with pytest.raises(ContourFileError, match=r"broken\.h5"):
        FileScene(broken)


def test_a_moving_object_is_where_the_file_says_and_the_box_holds_all_its_places(tmp_path):
    motion = exploration("cube", duration=0.1, seed=1)
    far = motion.pose[::-1].copy()
    far[:, 0] += 2.0
    moved = HandMotion(motion.time, far)
    record(tmp_path / "a.h5", "cube", "palm", motion, "oc", object_pose=moved)
    with FileScene(tmp_path / "a.h5") as scene:
        np.testing.assert_array_equal(scene.moment(2).object_pose, moved.pose[2])
        low, high = scene.bounds()
        assert (low <= motion.pose[:, :3].min(axis=0) + 1e-6).all()
        assert (high >= motion.pose[:, :3].max(axis=0) - 1e-6).all()
        assert high[0] >= far[:, 0].max() + 0.05  # half a cube beyond the farthest middle


def test_another_rendering_at_the_same_place_is_told(tmp_path):
    """Its object and hand would be shown with the other's contours."""
    path = tmp_path / "a.h5"
    motions = [exploration("tube", duration=3.0, seed=seed) for seed in (1, 2)]
    with pytest.raises(StopError):
        record(path, "tube", "palm", motions[0], "cc", memory=5_000_000, progress=stop)
    with FileScene(path) as scene:
        record(path, "tube", "palm", motions[1], "cc", mode="overwrite")
        with pytest.raises(ContourFileError, match="is another rendering now"):
            scene.refresh()


def test_a_file_that_another_one_replaces_is_noted(tmp_path):
    batch = render("cube", "palm", static_pose([0, 0, 0.2]), "cc")
    path, other = batch.save(tmp_path / "a.h5"), batch.save(tmp_path / "b.h5")
    with FileScene(path) as scene:
        assert not scene.is_replaced
        assert not notes_of(scene)
        other.replace(path)
        assert scene.is_replaced
        assert "a.h5 was replaced or removed" in notes_of(scene)[0]
        assert scene.moment(0).length > 0  # the old one is still there to be shown
        path.unlink()
        assert scene.is_replaced


def test_what_hides_contours_is_noted(tmp_path):
    """A mesh in millimetres, and a hand 0.3 m above the cube's upper side at 0.265 m."""
    far = render("cube", "palm", static_pose([0, 0, 0.265 + 0.3]), "cc").save(tmp_path / "far.h5")
    with FileScene(far) as scene:
        assert "0.3 m from it at the nearest" in notes_of(scene)[0]
    with pytest.warns(PalpateWarning, match="like a file in millimetres"):
        huge = MeshObject.load("cube", scale=1000.0, at=(0.0, 0.0, 0.2))
    with FileScene(render(huge, "palm", static_pose([0, 0, 0.2]), "cc").save(tmp_path / "huge.h5")) as scene:
        assert "The object is 130 m wide: a mesh in millimetres needs --scale 0.001" in notes_of(scene)[0]
