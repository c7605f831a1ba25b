"""Levels of noise around a moment: they need times, and the closed contours are quieter than lines with jumps."""

import json

import pytest

from palpate.render import exploration, load_rig, render, static_pose
from palpate.render.errors import StrategyError
from palpate.render.view.file_scene import FileScene
from palpate.render.view.packing import Packer
from palpate.render.view.served.noise_levels import predict_levels


def test_poses_without_times_have_no_noise(tmp_path):
    path = render("cube", "palm", static_pose([0, 0, 0.2]), "cc").save(tmp_path / "still.h5")
    with FileScene(path) as scene, pytest.raises(StrategyError, match="noise needs poses with times"):
        predict_levels([scene], [0], ["cc"], load_rig("emulator"), Packer(exact=True))


@pytest.mark.exhaustive
def test_open_lines_are_louder_than_closed_ones_and_each_has_levels_over_time(tmp_path):
    motion = exploration("tube", duration=2.0, seed=1)
    paths = [render("tube", "palm", motion, name).save(tmp_path / f"{name}.h5") for name in ("cc", "oc")]
    with FileScene(paths[0]) as first, FileScene(paths[1]) as second:
        levels = predict_levels([first, second], [90, 90], ["cc", "oc"], load_rig("emulator"), Packer(exact=True))
    assert levels["text"].startswith("cc: +0.0 dB(A), oc: +")  # jumps of open lines are louder
    assert [file["clock"]["shape"][0] > 10 for file in levels["files"]] == [True, True]
    json.dumps(levels, allow_nan=False)
