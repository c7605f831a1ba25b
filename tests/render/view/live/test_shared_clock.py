"""One clock for files of other rates; playing at any speed, over the end and on."""

import numpy as np
import pytest

from palpate.render import exploration, render, static_pose
from palpate.render.view.file_scene import FileScene
from palpate.render.view.live.shared_clock import SPEEDS, SharedClock


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
    clock = SharedClock(scenes[:2])
    for pose in (0, 45, 89):
        clock.seek(pose)
        first, second = clock.poses()
        assert first == pose
        assert second == int(pose / 90 * 60 + 1e-9)


def test_time_passes_as_fast_as_it_is_asked_and_begins_again_at_the_end(scenes):
    clock = SharedClock(scenes[:1])
    clock.advance(0.5)
    assert clock.now == 0.0  # it does not play
    clock.is_playing, clock.speed = True, SPEEDS["1/10"]
    clock.advance(2.0)
    assert clock.now == pytest.approx(0.2)
    assert clock.poses() == [18]
    clock.speed = 1.0
    clock.advance(0.9)
    assert clock.now == pytest.approx(0.1, abs=1e-6)  # the whole motion lasts 1 s


def test_the_share_of_a_pose_that_has_gone(scenes):
    clock = SharedClock(scenes[:2])
    clock.is_playing = True
    clock.advance(10.25 / 90)
    assert clock.poses() == [10, 6]
    assert clock.share_of(0) == pytest.approx(0.25, abs=1e-6)
    assert clock.share_of(1) == pytest.approx(10.25 / 90 * 60 - 6, abs=1e-6)


def test_a_static_pose_is_shown_for_a_twentieth_of_a_second_again_and_again(scenes):
    clock = SharedClock(scenes[2:])
    clock.is_playing = True
    shares = []
    for _ in range(10):
        clock.advance(0.01)
        assert clock.poses() == [0]
        shares.append(clock.share_of(0))
    np.testing.assert_allclose(shares, [0.2, 0.4, 0.6, 0.8, 0.0] * 2, atol=1e-6)
