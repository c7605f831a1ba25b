"""Focal points of one pose lie on its contours, as many as the update rate asks for; jumps are where they are far."""

import numpy as np
import pytest

from palpate.render import exploration, render, static_pose
from palpate.render.acoustics.skin_print import distance_to
from palpate.render.sampling.strategy import SamplingStrategy
from palpate.render.view.file_scene import FileScene
from palpate.render.view.focal_path import focal_path, steps_of


def scene_of(tmp_path, strategy, motion):
    return FileScene(render("tube", "palm", motion, strategy).save(tmp_path / f"{strategy}.h5"))


def test_points_lie_on_the_contours_of_their_pose(tmp_path):
    with scene_of(tmp_path, "cc", exploration("tube", duration=1.0, seed=1)) as scene:
        for index in (54, 70):
            path = focal_path(scene, index)
            lines = [line.astype(float) for line in scene.moment(index).contours[0]]
            assert len(path.position) in (111, 112)  # 10 kHz, 90 poses a second
            sounding = path.position[path.intensity > 0]
            assert len(sounding)
            on = np.median(distance_to(lines, sounding.astype(float), 1e-4))  # the first ones leave the pose before
            assert on < 1e-4


def test_an_open_line_jumps_from_its_end_and_a_closed_one_never(tmp_path):
    pose = static_pose([0, 0.045, 0.2])
    with scene_of(tmp_path, "oc", pose) as scene:
        path, length = focal_path(scene, 0), scene.moment(0).length
        assert path.jump.sum() == pytest.approx(0.05 * 7.0 / length, abs=1.01 * len(scene.moment(0).contours[0]))
        assert path.jump.any()
    with scene_of(tmp_path, "cc", static_pose([0, 0.06, 0.2])) as scene:
        assert len(scene.moment(0).contours[0]) == 1
        assert not focal_path(scene, 0).jump.any()


def test_steps_by_length_and_silence():
    strategy = SamplingStrategy(speed=7.0, update_rate=10_000.0)  # 0.7 mm a sample
    place = np.zeros((5, 3), np.float32)
    place[:, 0] = np.cumsum([0, 7e-4, 2e-3, 5e-2, 5e-2])
    sounds = np.ones(5, np.float32)
    jump, hop = steps_of(place, sounds, strategy)
    assert strategy.jump_threshold > 2e-3
    assert jump.tolist() == [False, False, False, True, True]
    assert hop.tolist() == [False, False, True, False, False]
    sounds[3] = 0.0
    assert not steps_of(place, sounds, strategy)[0].any()
