"""Functions of position: stripes with "resample", a ramp and a warning without."""

import json
import re
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import warp as wp
from transform_cases import a_setting, batch_of_loops, random_poses, run_stage

from palpate.kernels.stages.point_function import PLACES, map_intensity, map_points
from palpate.render import IntersectionStrategy, Stage, load_strategy, register_point_function, render, static_pose
from palpate.render.errors import PalpateWarning
from palpate.render.stages import registry
from palpate.render.stages.point_function import length_least, segment_lengths, set_intensity
from palpate.render.stages.registry import known_stages

GUIDE = Path(__file__).parents[3] / "docs/guide/strategies.md"
CUBE = 0.085  # [m], its edges
SQUARE = 0.0425 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


@pytest.fixture(autouse=True)
def _own_stages_go():
    """Stages that a test registers are forgotten after it."""
    known_stages("prune")
    before = dict(registry._ENTRIES)
    yield
    registry._ENTRIES.clear()
    registry._ENTRIES.update(before)


@wp.func
def striped(x: wp.vec3):
    return 0.5 + 0.5 * wp.sin(x[0] * 200.0)


@wp.func
def stepped(x: wp.vec3):
    return wp.where(x[0] > 0.0113, 1.0, 0.0)


@wp.func
def waving(x: wp.vec3):
    return wp.vec3(x[0], x[1] + 0.01 * wp.sin(x[0] * 200.0), x[2])


def drawn(*stages, poses=1, **options):
    """The cube cut by a palm that rests, with these stages: the batch, and the warnings."""
    strategy = IntersectionStrategy(prune=("outside",), transform=("close", *stages))
    motion = np.repeat(static_pose([0, 0, 0.2]).pose, poses, axis=0)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        batch = render("cube", "palm", motion, strategy, **options)
    return batch, [str(w.message) for w in caught if issubclass(w.category, PalpateWarning)]


def crossings(batch):
    """How often the intensity of each polyline crosses one half."""
    above = batch.intensity > 0.5
    return [
        int(np.count_nonzero(np.diff(above[a:b].astype(int))))
        for a, b in zip(batch.polyline_start[:-1], batch.polyline_start[1:], strict=True)
    ]


def test_the_guides_stripes_are_stripes(tmp_path):
    text = GUIDE.read_text()
    (code,) = [block for block in re.findall(r"```python\n(.*?)```", text, re.DOTALL) if "def pulse" in block]
    (strategy,) = [block for block in re.findall(r"```json\n(.*?)```", text, re.DOTALL) if "my_stages" in block]
    (tmp_path / "my_stages.py").write_text(code)
    (tmp_path / "mine.json").write_text(strategy)
    read = load_strategy(str(tmp_path / "mine.json"), allow_code=True)
    one = static_pose([0, 0, 0.2])
    batch = render("cube", "palm", one, read)
    edges = np.abs(batch.points[:, 1]) > CUBE / 2 - 1e-6  # along x, on which sin(200 x) has 5 zeros
    assert batch.length() == pytest.approx(4 * CUBE, rel=1e-6)
    assert crossings(batch) == [2 * 5]
    np.testing.assert_allclose(batch.intensity, 0.5 + 0.5 * np.sin(200 * batch.points[:, 0]), atol=1e-5)
    assert np.ptp(batch.intensity[edges]) > 0.98
    coarse = replace(read, transform=tuple(s for s in read.transform if Stage.read(s, "").name != "resample"))
    with pytest.warns(PalpateWarning, match='pulse: along a segment of 0.085 m .* put the stage "resample" before it'):
        assert crossings(render("cube", "palm", one, coarse)) == [2]  # a ramp up and a ramp down
    assert "resample" in json.dumps(json.loads(strategy)["transform"])


def test_a_warning_says_how_long_the_segment_is_and_how_far_off_the_ramp(device):
    register_point_function("mine", striped, gives="intensity")
    _, told = drawn("mine", device=device)
    ends = 0.5 + 0.5 * np.sin(200 * np.array([-1, 1]) * CUBE / 2)
    share = np.array([0.27, 0.49, 0.69])
    off = 0.5 + 0.5 * np.sin(200 * CUBE * (share - 0.5)) - (ends[0] + share * (ends[1] - ends[0]))
    assert told == [
        f"striped: along a segment of 0.085 m this function of position is up to {np.abs(off).max():.2g} off the "
        "straight line between the segment's ends, and contours follow it at vertices only: put the stage "
        '"resample" before it'
    ]


@pytest.mark.parametrize("workers", [1, 3])
def test_one_rendering_warns_once_whoever_renders_and_the_next_one_again(workers):
    register_point_function("mine", striped, gives="intensity")
    options = {"poses": 3000, "devices": ["cpu"] * workers, "memory": 2**22 * workers}
    assert len(drawn("mine", **options)[1]) == 1
    assert len(drawn("mine", **options)[1]) == 1


@pytest.mark.parametrize(("func", "gives"), [(stepped, "intensity"), (waving, "point")], ids=["step", "bend"])
def test_resampled_by_default_no_function_is_warned_of(func, gives):
    register_point_function("mine", func, gives=gives)
    assert len(drawn("mine")[1]) == 1
    assert drawn("resample", "mine")[1] == []
    far = {"poses": 1, "device": "cpu"}
    assert drawn(Stage("resample", {"spacing": 0.02}), "mine", **far)[1] != []


def test_no_part_that_resampling_leaves_is_taken_for_longer_however_float32_rounds_it(rng):
    """The square's sides are 34 of the spacings long, so that every part is as long as a part can be."""
    setting = a_setting(random_poses(rng, 5))
    batch = run_stage("resample", batch_of_loops([[SQUARE]] * 5, setting.frames), setting)
    longest = segment_lengths(batch)[1].max()
    assert 0.0025 < longest < length_least(striped, setting) < 0.00251


def test_between_polylines_there_is_no_segment(rng):
    setting = a_setting(np.float32([[0, 0, 0.2, 0, 0, 0, 1]]))
    dots = [0.001 * SQUARE + [x, 0.0] for x in (-0.04, 0.0, 0.033)]
    batch = batch_of_loops([dots], setting.frames).to("cpu")
    assert map_intensity(striped, batch.points, length_least=0.002)[1].numpy().max() > 0.3  # from dot to dot
    set_intensity(striped, batch, setting)  # a warning would be an error


def test_the_kernels_measure_what_the_oracle_measures(device, rng):
    setting = a_setting(random_poses(rng, 5))
    batch = batch_of_loops([[SQUARE]] * 5, setting.frames)
    points = batch.to(device).points
    a, b = batch.points[:-1].astype(float), batch.points[1:].astype(float)

    def wave(x):
        return np.stack([x[..., 0], x[..., 1] + 0.01 * np.sin(x[..., 0] * 200), x[..., 2]], axis=-1)

    def stripe(x):
        return 0.5 + 0.5 * np.sin(x[..., :1] * 200)

    for found, func in ((map_points(waving, points, length_least=0.01), wave),
                        (map_intensity(striped, points, length_least=0.01), stripe)):  # fmt: skip
        off = [np.linalg.norm(func(a + t * (b - a)) - (1 - t) * func(a) - t * func(b), axis=1) for t in PLACES]
        want = np.where(np.linalg.norm(b - a, axis=1) > 0.01, np.max(off, axis=0), 0.0)
        value, deviation = (part.numpy().reshape(batch.point_count, -1) for part in found)
        np.testing.assert_allclose(value, func(batch.points.astype(float)), atol=1e-5)
        np.testing.assert_allclose(deviation[:, 0], np.append(want, 0.0), atol=1e-4)
    unasked, none = map_points(waving, points)
    assert none.shape == (0,)
    np.testing.assert_array_equal(unasked.numpy(), map_points(waving, points, length_least=0.01)[0].numpy())
