"""One clock for files of other rates; playing at any speed, over the end and on."""

import numpy as np
import pytest

from palpate.render import exploration, render, static_pose
from palpate.render.view.file_scene import FileScene
from palpate.render.view.live.timeline import SPEEDS, Timeline


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("timeline")
    opened = []
    for rate in (90.0, 60.0):
        motion = exploration("tube", duration=1.0, rate=rate, seed=1)
        opened.append(FileScene(render("tube", "palm", motion, "oc").save(folder / f"{rate}.h5")))
    opened.append(FileScene(render("tube", "palm", static_pose([0, 0, 0.2]), "oc").save(folder / "still.h5")))
    yield opened
    for scene in opened:
        scene.close()


def test_both_files_show_the_same_time(scenes):
    timeline = Timeline(scenes[:2])
    for pose in (0, 45, 89):
        timeline.seek(pose)
        first, second = timeline.poses()
        assert first == pose
        assert second == int(pose / 90 * 60 + 1e-9)


def test_numbers_beyond_the_file_are_its_ends(scenes):
    timeline = Timeline(scenes[:1])
    timeline.seek(-5)
    assert timeline.poses() == [0]
    timeline.seek(10**9)
    assert timeline.poses() == [89]


def test_time_passes_as_fast_as_it_is_asked_and_begins_again_at_the_end(scenes):
    timeline = Timeline(scenes[:1])
    timeline.advance(0.5)
    assert timeline.now == 0.0  # it does not play
    timeline.is_playing, timeline.speed = True, SPEEDS["1/10"]
    timeline.advance(2.0)
    assert timeline.now == pytest.approx(0.2)
    assert timeline.poses() == [18]
    timeline.speed = 1.0
    timeline.advance(0.9)
    assert timeline.now == pytest.approx(0.1, abs=1e-6)  # the whole motion lasts 1 s


def test_the_share_of_a_pose_that_has_gone(scenes):
    timeline = Timeline(scenes[:2])
    timeline.is_playing = True
    timeline.advance(10.25 / 90)
    assert timeline.poses() == [10, 6]
    assert timeline.share_of(0) == pytest.approx(0.25, abs=1e-6)
    assert timeline.share_of(1) == pytest.approx(10.25 / 90 * 60 - 6, abs=1e-6)


def test_a_static_pose_is_shown_for_a_twentieth_of_a_second_again_and_again(scenes):
    timeline = Timeline(scenes[2:])
    timeline.is_playing = True
    shares = []
    for _ in range(10):
        timeline.advance(0.01)
        assert timeline.poses() == [0]
        shares.append(timeline.share_of(0))
    np.testing.assert_allclose(shares, [0.2, 0.4, 0.6, 0.8, 0.0] * 2, atol=1e-6)
