"""Levels of noise around a moment: they need times, and the closed contours are quieter than lines with jumps."""

import numpy as np
import pytest

from palpate.render import HandMotion, PalpateWarning, exploration, load_rig, render, static_pose
from palpate.render.errors import StrategyError
from palpate.render.view.served.noise_levels import predict_levels, predict_levels_apart


def test_poses_without_times_have_no_noise(tmp_path):
    path = render("cube", "palm", static_pose([0, 0, 0.2]), "cc").save(tmp_path / "still.h5")
    with pytest.raises(StrategyError, match="noise needs poses with times"):
        predict_levels([path], [0], ["cc"], load_rig("emulator"))


@pytest.mark.exhaustive
def test_open_lines_are_louder_than_closed_ones_and_each_has_levels_over_time(tmp_path):
    motion = exploration("tube", duration=2.0, seed=1)
    paths = [render("tube", "palm", motion, name).save(tmp_path / f"{name}.h5") for name in ("cc", "oc")]
    levels = predict_levels_apart(paths, [90, 90], ["cc", "oc"], load_rig("emulator"))
    assert levels["text"].startswith("cc: +0.0 dB(A), oc: +")  # jumps of open lines are louder
    assert [len(file["clock"]) > 10 for file in levels["files"]] == [True, True]
    assert levels == predict_levels(paths, [90, 90], ["cc", "oc"], load_rig("emulator"))


@pytest.mark.exhaustive
def test_an_error_of_the_process_is_a_sentence(tmp_path, monkeypatch):
    with pytest.raises(StrategyError, match="no-such"):
        predict_levels_apart([tmp_path / "no-such.h5"], [0], ["cc"], load_rig("emulator"))
    monkeypatch.setattr("sys.executable", "/bin/false")
    with pytest.raises(StrategyError, match="noise could not be predicted"):
        predict_levels_apart([tmp_path / "no-such.h5"], [0], ["cc"], load_rig("emulator"))


@pytest.mark.exhaustive
def test_a_hand_that_touches_nothing_is_silent_not_infinitely_quiet(tmp_path):
    still = HandMotion(np.arange(90) / 30.0, np.tile([0, 0, 0.5, 0, 0, 0, 1.0], (90, 1)))
    with pytest.warns(PalpateWarning, match="no pose has a contour"):
        silent = render("tube", "palm", still, "cc").save(tmp_path / "silent.h5")
    loud = render("tube", "palm", exploration("tube", duration=3.0, rate=30.0, seed=1), "cc").save(tmp_path / "cc.h5")
    arrays = load_rig("emulator")
    assert predict_levels([silent], [45], ["cc"], arrays)["text"].startswith("silent; ")
    first = predict_levels([silent, loud], [45, 45], ["a", "b"], arrays)
    assert first["text"].startswith("a: silent, b: ")
    assert "in units of their own, as the first file is silent" in first["text"]
    assert set(first["files"][0]["level"]) == {None}
    assert "b: silent" in predict_levels([loud, silent], [45, 45], ["a", "b"], arrays)["text"]
