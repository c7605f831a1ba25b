"""Lines of plots are those of the file; jumps are counted as the sampler of the same poses counts them."""

import numpy as np
import pytest

from palpate.render import ContourFile, exploration, render, static_pose
from palpate.render.playback.focal_points import ContourSource
from palpate.render.sampling.sampler import Sampler
from palpate.render.view.file_scene import FileScene
from palpate.render.view.series import longest_pose, overview_of, steps_in, window_around


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    path = tmp_path_factory.mktemp("series") / "tube.h5"
    render("tube", "palm", exploration("tube", duration=4.0, seed=1), "oc").save(path)
    with FileScene(path) as opened:
        yield opened


def test_bins_hold_every_pose_once(scene):
    with ContourFile(scene.path) as file:
        length = file.metrics()["length"].astype(float)
    overview = overview_of(scene, bins=50)
    parts = np.split(length, np.linspace(0, 360, 51).astype(int)[1:-1])
    np.testing.assert_allclose(overview.longest, [part.max() for part in parts])
    assert overview.time[0] == 0.0
    assert overview_of(scene, bins=1000).longest.tolist() == length.tolist()


def test_a_window_is_a_range_of_poses_around_the_moment(scene):
    window = window_around(scene, 200, poses_most=100)
    assert (window.first, len(window.time)) == (150, 101)
    np.testing.assert_array_equal(window.time, scene.times(150, 251))
    with ContourFile(scene.path) as file:
        np.testing.assert_array_equal(window.length, file.metrics(150, 251)["length"])
    drawn = window.length > 0
    samples = np.ceil(window.length[drawn] / 7.0 * 10_000 - 1e-3)
    np.testing.assert_allclose(window.draw_frequency[drawn], 10_000 / samples, rtol=1e-6)
    assert np.isnan(window.draw_frequency[~drawn]).all()
    assert window_around(scene, 0, poses_most=100).first == 0


def test_jumps_and_hops_are_those_that_a_sampler_counts(scene):
    window = window_around(scene, 100)  # the whole file
    jump, _ = steps_in(scene, window)
    sampler = Sampler(scene.sampling)
    with ContourFile(scene.path) as file:
        for _ in ContourSource(file, sampler):
            pass
    counted = sum(sampler.count.jumps.values())
    assert counted > 50
    assert len(jump) == pytest.approx(counted, rel=0.02)  # the sampler knows each contour's own ordinary step
    assert ((jump >= 0.0) & (jump <= 4.1)).all()


def test_windows_of_poses_without_times_have_no_steps(tmp_path):
    path = render("tube", "palm", static_pose([0, 0, 0.2]), "oc").save(tmp_path / "a.h5")
    with FileScene(path) as one:
        window = window_around(one, 0)
        assert window.time.tolist() == [0.0]
        assert steps_in(one, window)[0].size == 0


@pytest.mark.parametrize("bins", [1, 50])
def test_the_longest_pose_is_that_of_the_whole_file(scene, bins):
    with ContourFile(scene.path) as file:
        assert longest_pose(scene, overview_of(scene, bins)) == file.metrics()["length"].argmax()


def test_a_file_without_contours_begins_at_its_first_pose(tmp_path):
    path = render("tube", "palm", static_pose([0, 0.4, 0.2]), "oc").save(tmp_path / "a.h5")
    with FileScene(path) as none:
        assert longest_pose(none, overview_of(none)) == 0
