"""Noise and pressure as metrics of sweeps: the numbers that files of the same recipes give."""

import numpy as np
import pytest
from command_line import answer, refused
from skin_cases import grid_skin
from sweep_recipes import explored, random_motion, recipe_of, recorded, sampling_of, task_of

from palpate.datasets import HandMotion
from palpate.datasets.sweeps.shard import read_shard
from palpate.datasets.sweeps.table import load_table
from palpate.render import Palm, exploration, predict_noise, pressure_metrics, render
from palpate.render.hands.mesh_hand import MeshHand
from palpate.render.sampling.metrics import FocalPoints
from palpate.render.sweeps.make.acoustic_metrics import NoiseMeter, measure_pressure
from palpate.render.sweeps.make.rendering import sampling_of as sampling_strategy
from palpate.render.sweeps.make.sampling import RenderedContours
from palpate.render.sweeps.make.unsplit import walks_of
from palpate.render.sweeps.make.work import run_task
from palpate.render.sweeps.plan.loading import load_plans
from palpate.render.sweeps.report.table import METRICS

PLAN = """
metrics = ["contours", "noise", "pressure"]
[object]
source = "cube"
[motion]
duration = 1.5
seed = 3
[strategy]
source = ["oc", "cc"]
"""


@pytest.mark.exhaustive
def test_columns_are_what_files_give(tmp_path):
    (tmp_path / "plan.toml").write_text(PLAN)
    answer("sweep", tmp_path / "plan.toml", "--no-figure", "--device", "cpu")
    table = load_table(tmp_path / "plan.sweep" / "table.csv")
    assert list(table["strategy"]) == ["oc", "cc"]
    motion = exploration("cube", duration=1.5, seed=3)
    for row, strategy in enumerate(table["strategy"]):
        path = render("cube", Palm(), motion, strategy).save(tmp_path / f"{strategy}.h5")
        for name, level in predict_noise(path).spectrum().levels().items():
            assert table[f"noise_{name}"][row] == pytest.approx(level, abs=1e-3)
        found = pressure_metrics(path).as_dict()
        for column in METRICS["pressure"]:
            assert table[column][row] == pytest.approx(found[column.removeprefix("pressure_")], rel=1e-5)
    assert table["noise_db_300_10k"][0] > table["noise_db_300_10k"][1]  # open contours click


def payloads(store, recipe, name="a"):
    """Of noise and pressure, by group."""
    outcome = run_task(task_of(store, [recipe], ("noise", "pressure"), name=name), "cpu", worker="here")
    assert outcome.error is None
    return {row.group: row.payload for row in read_shard(store / outcome.shard).rows}


def test_a_recipe_has_no_values_for_the_reason_that_its_payload_names(tmp_path):
    pose = np.array([[0, 0, 0.2, 2**-0.5, 0, 0, 2**-0.5]])
    HandMotion(np.zeros(1), pose).save(tmp_path / "one.csv")
    for motion, reason in (
        (random_motion(9), "the poses have no times"),
        (recorded(tmp_path / "one.csv"), "there is one pose only"),
    ):
        got = payloads(tmp_path, recipe_of("cube", motion=motion), str(len(reason)))
        assert {group: payload["reason"] for group, payload in got.items()} == {"noise": reason, "pressure": reason}
        assert not [name for payload in got.values() for name in payload if name.startswith(("noise_", "pressure_"))]
    short = payloads(tmp_path, recipe_of("cube", motion=explored(0.05)), "short")
    assert "too short for a spectrum" in short["noise"]["reason"]
    assert "not on meshes" in measure_pressure(None, MeshHand(*grid_skin()), None, None)["reason"]


def test_silence_has_no_level():
    recipe = recipe_of("cube")
    meter = NoiseMeter(recipe, sampling_strategy(recipe.sampling), 1100)
    meter.take(FocalPoints(np.full((1100, 3), 0.2, np.float32), np.zeros(1100, np.float32)))
    got = meter.publish()
    assert got.pop("seconds").keys() == {"noise"}
    assert got == dict.fromkeys(METRICS["noise"])


def circles(count=1050):
    """Focal points that draw a circle and switch off now and then."""
    time = np.arange(count) / count
    position = np.column_stack([0.04 * np.cos(180 * time), 0.04 * np.sin(180 * time), 0.2 + 0.02 * np.sin(9 * time)])
    return FocalPoints(position.astype(np.float32), (np.sin(70 * time) > -0.7).astype(np.float32))


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("array", ["emulator", "pat16"])
def test_noise_on_a_device_and_of_packed_frames_is_that_of_the_cpu(array, device, monkeypatch):
    """Packed: frames made where they are listened to, as on a GPU."""

    def levels(place):
        recipe, focus = recipe_of("cube", array=array), circles()
        meter = NoiseMeter(recipe, sampling_strategy(recipe.sampling), len(focus.intensity), device=place)
        for first in range(0, len(focus.intensity), 1024):
            meter.take(FocalPoints(focus.position[first : first + 1024], focus.intensity[first : first + 1024]))
        return {name: level for name, level in meter.publish().items() if name != "seconds"}

    host = levels("cpu")
    if device != "cpu":
        assert levels(device) == pytest.approx(host, abs=0.02)  # [dB]
    assert host["noise_db_300_10k"] > 0.0


@pytest.mark.exhaustive
def test_pressure_on_a_device_is_that_of_the_cpu(device):
    recipe = recipe_of("cube", motion=explored(0.3, seed=3))
    batch = render("cube", Palm(), exploration("cube", duration=0.3, seed=3), "cc")
    rows = RenderedContours(batch.scene, batch.motion, "cpu", name="cube")
    strategy = sampling_strategy(recipe.sampling)
    found = [measure_pressure(rows, Palm(), strategy, recipe, device=place) for place in ("cpu", device)]
    for name, value in found[0].items():
        if name != "seconds":
            assert found[1][name] == (None if value is None else pytest.approx(value, rel=1e-3))


@pytest.mark.exhaustive
def test_predictions_are_timed_and_show_progress(tmp_path):
    ticks = []
    recipe = recipe_of("cube", motion=explored(0.09, seed=3))
    got = payloads(tmp_path, recipe)
    assert {stage for payload in got.values() for stage in payload["seconds"]} >= {"noise", "pressure", "sampling"}
    strategy = sampling_strategy(recipe.sampling)
    meter = NoiseMeter(recipe, strategy, 1100, tick=lambda: ticks.append(1))
    meter.take(FocalPoints(np.full((1100, 3), 0.2, np.float32), np.ones(1100, np.float32)))
    meter.publish()
    assert ticks


def test_one_noise_at_most_has_its_frames_in_memory():
    recipes = [recipe_of("cube", array=name) for name in ("emulator", "autd3")]
    other = recipe_of("cube", sampling=sampling_of("stm", update_rate=4000.0))
    groups = ("sampling", "noise", "pressure")
    wanted = {(group, recipe.key(group)): recipe for recipe in (*recipes, other) for group in groups}
    walks = walks_of(wanted)
    assert [[group for group, _ in walk].count("noise") for _, walk in walks] == [1, 1, 1]
    assert [[group for group, _ in walk].count("sampling") for _, walk in walks] == [1, 0, 1]
    assert {place: recipe for _, walk in walks for place, recipe in walk.items()} == wanted


def test_metrics_that_a_plan_asks_for_change_no_recipe(tmp_path):
    hashes = []
    for metrics in (["contours"], ["contours", "noise", "pressure"]):
        (tmp_path / "plan.toml").write_text(PLAN.replace('"contours", "noise", "pressure"', str(metrics)[1:-1]))
        hashes.append([(one.hash, one.key("contours")) for one in load_plans([tmp_path / "plan.toml"]).recipes()])
    assert hashes[0] == hashes[1]


def test_metrics_that_are_none_are_refused_with_those_that_are(tmp_path):
    (tmp_path / "plan.toml").write_text('metrics = ["loudness"]\n[object]\nsource = "cube"\n')
    refused(2, "must be one of contours, frequency, sampling, noise, pressure", "sweep", tmp_path / "plan.toml")
