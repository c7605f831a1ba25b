"""Noise and pressure as metrics of sweeps: the numbers that files of the same recipes give."""

import numpy as np
import pytest
from skin_cases import grid_skin
from sweep_recipes import explored, made, random_motion, recipe_of, recorded

from palpate.datasets import HandMotion
from palpate.render import Palm, exploration, predict_noise, pressure_metrics, render
from palpate.render.hands.mesh_hand import MeshHand
from palpate.render.sampling.metrics import FocalPoints
from palpate.render.sweeps.make.acoustic_metrics import NoiseMeter, measure_pressure
from palpate.render.sweeps.make.rendering import sampling_of as sampling_strategy
from palpate.render.sweeps.report.table import METRICS


def payloads(recipe):
    """Of noise and pressure, by group."""
    return {group: payload for (group, _, _), (payload, _) in made([recipe], ("noise", "pressure")).items()}


@pytest.mark.exhaustive
def test_columns_are_what_files_give(tmp_path):
    motion, levels = exploration("cube", duration=1.5, seed=3), {}
    for strategy in ("oc", "cc"):
        explored_over_array = explored(1.5, seed=3) | {"model": "over-array"}
        got = payloads(recipe_of("cube", motion=explored_over_array, strategy=strategy))
        path = render("cube", Palm(), motion, strategy).save(tmp_path / f"{strategy}.h5")
        for name, level in predict_noise(path).spectrum().levels().items():
            assert got["noise"][f"noise_{name}"] == pytest.approx(level, abs=1e-3)
        found = pressure_metrics(path).as_dict()
        for column in METRICS["pressure"]:
            assert got["pressure"][column] == pytest.approx(found[column.removeprefix("pressure_")], rel=1e-5)
        levels[strategy] = got["noise"]["noise_db_300_10k"]
    assert levels["oc"] > levels["cc"]  # open contours click


def test_a_recipe_has_no_values_for_the_reason_that_its_payload_names(tmp_path):
    pose = np.array([[0, 0, 0.2, 2**-0.5, 0, 0, 2**-0.5]])
    HandMotion(np.zeros(1), pose).save(tmp_path / "one.csv")
    for motion, reason in (
        (random_motion(9), "the poses have no times"),
        (recorded(tmp_path / "one.csv"), "there is one pose only"),
    ):
        got = payloads(recipe_of("cube", motion=motion))
        assert {group: payload["reason"] for group, payload in got.items()} == {"noise": reason, "pressure": reason}
        assert not [name for payload in got.values() for name in payload if name.startswith(("noise_", "pressure_"))]
    short = payloads(recipe_of("cube", motion=explored(0.05)))
    assert "too short for a spectrum" in short["noise"]["reason"]
    assert "not on meshes" in measure_pressure(None, MeshHand(*grid_skin()), None, None)["reason"]


def test_silence_has_no_level():
    recipe = recipe_of("cube")
    meter = NoiseMeter(recipe, sampling_strategy(recipe.sampling), 1100)
    meter.take(FocalPoints(np.full((1100, 3), 0.2, np.float32), np.zeros(1100, np.float32)))
    got = meter.publish()
    assert got.pop("seconds").keys() == {"noise"}
    assert got == dict.fromkeys(METRICS["noise"])
