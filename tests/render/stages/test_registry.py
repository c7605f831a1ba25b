"""Stages: options, registration, running them in order, and judging what a user's own stage gives."""

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from contour_random import random_batch

from palpate.render import ContourBatch, IntersectionStrategy
from palpate.render.errors import PalpateWarning, StrategyError
from palpate.render.hands.plane_hand import flat_hand
from palpate.render.stages import registry
from palpate.render.stages.point_function import register_point_function
from palpate.render.stages.prune import cut_batch
from palpate.render.stages.registry import (
    Option,
    Stage,
    known_stages,
    register_prune,
    register_transform,
)
from palpate.render.stages.setting import Setting
from palpate.render.strategies.stage_runner import run_stages

POSE = np.tile(np.array([0, 0, 0.2, 0, 0, 0, 1], np.float32), (4, 1))
SETTING = Setting(None, flat_hand(), POSE, 0, "cpu", 0.01, 0.0025)  # random batches have patches 0..2, the hand 15


@pytest.fixture(autouse=True)
def _own_stages_go():
    """Stages that a test registers are forgotten after it."""
    known_stages("prune")
    before = dict(registry._ENTRIES)
    yield
    registry._ENTRIES.clear()
    registry._ENTRIES.update(before)


@pytest.fixture
def batch(rng):
    return random_batch(rng, 4)


def run(batch, *, prune=(), transform=(), device="cpu"):
    setting = replace(SETTING, device=device, warned={})  # a rendering of its own, which has warned of nothing yet
    return run_stages(batch, IntersectionStrategy(prune=prune, transform=transform), setting)


def shifted(batch, setting, *, by):
    """Move everything up."""
    return ContourBatch(**{**batch.by_name(), "points": batch.points + np.float32([0, 0, by])})


def test_a_stage_without_options_is_its_name():
    assert Stage("close") == "close" == Stage("close", {})
    assert "close" in (Stage("outside"), Stage("close"))
    assert Stage("small", {"length": 0.01}) != "small"
    assert hash(Stage("small", {"length": 0.01})) == hash("small")
    assert Stage("small", {"length": 0.01}) == Stage("small", {"length": 0.01}) != Stage("small", {"length": 0.02})
    stage = Stage("small", {"length": 0.01})
    assert pickle.loads(pickle.dumps(stage)) == copy.deepcopy(stage) == stage
    options = {"length": 0.01}
    stage = Stage("small", options)
    options["length"] = 5.0
    assert stage.options["length"] == 0.01


@pytest.mark.parametrize(
    ("option", "good", "bad", "words"),
    [
        (Option(0.1, 0.0, 1.0, "m"), (0.0, 1.0, 0.5, 1), (1.1, -0.1, np.nan, np.inf, "1", True, None), "0..1 m"),
        (Option(8, 1, 64), (1, 64), (0, 65, 8.0, True), "1..64"),
        (Option(True), (True, False), (1, 0, "yes", None), "true or false"),
        (Option("point", choices=("point", "patch")), ("patch",), ("else", 1, None), "point, patch"),
        (Option(None, 0.0, 1.0, "m"), (None, 0.5), (2.0, "x", True), "0..1 m"),
    ],
)
def test_an_option_takes_what_is_like_its_default_and_within_its_bounds(option, good, bad, words):
    for value in good:
        option.check("f.o", value)
    for value in bad:
        with pytest.raises(StrategyError, match=words):
            option.check("f.o", value)


def test_a_transform_of_ones_own_is_a_function_and_a_name(batch):
    register_transform("t", shifted, by=0.01)
    assert known_stages("transform")["t"].line == "Move everything up"
    out, removed = run(batch, transform=("t", Stage("t", {"by": 0.1})))
    np.testing.assert_allclose(out.points, batch.points + np.array([0, 0, 0.11]), atol=1e-6)
    assert removed == {}


def test_a_prune_stage_of_ones_own_may_leave_the_counting_to_the_package(batch):
    def keep_object(batch, setting):
        return cut_batch(batch, batch.kind == 0)

    def keep_object_only(batch, setting):
        return cut_batch(batch, batch.kind == 0)[0]

    register_prune("counted", keep_object)
    register_prune("uncounted", keep_object_only)
    one, removed = run(batch, prune=("counted",))
    other, reckoned = run(batch, prune=("uncounted",))
    np.testing.assert_array_equal(one.points, other.points)
    np.testing.assert_allclose(removed["counted"], reckoned["uncounted"], atol=1e-6)
    np.testing.assert_allclose(removed["counted"], batch.lengths()[:, 1:].sum(axis=1), atol=1e-6)
    assert removed["counted"].dtype == np.float32


def test_prune_stages_run_before_transformations_each_where_it_wants_its_batch(batch, device):
    seen = []

    def host(batch, setting):
        seen.append(("host", batch.on_device))
        return batch

    def on_device(batch, setting, *, again):
        seen.append((str(batch.points.device), batch.on_device))
        return batch, np.zeros(batch.pose_count)

    register_transform("h", host)
    register_prune("d", on_device, on="device", again=0)
    register_prune("p", lambda batch, setting: batch)
    out, removed = run(batch, prune=("p", "d", Stage("d", {"again": 1})), transform=("h",), device=device)
    assert seen == [(device, True), (device, True), ("host", False)]
    assert list(removed) == ["p", "d", "d#2"]
    np.testing.assert_array_equal(out.points, batch.points)


@wp.func
def drawn_up(x: wp.vec3):
    """Everything twice as high."""
    return wp.vec3(x[0], x[1], 2.0 * x[2])


@wp.func
def weaker_outside(x: wp.vec3):
    """Strong in the middle."""
    return wp.exp(-100.0 * (x[0] * x[0] + x[1] * x[1]))


@wp.func
def too_strong(x: wp.vec3):
    return 2.0


def test_a_warp_function_moves_points_or_sets_intensity(batch, device):
    register_point_function("up", drawn_up, gives="point")
    register_point_function("weak", weaker_outside, gives="intensity")
    assert known_stages("transform")["up"].line == "Everything twice as high"
    with pytest.warns(PalpateWarning, match="weaker_outside: along a segment"):
        out, _ = run(batch, transform=("up", "weak"), device=device)
    out = out.numpy()
    np.testing.assert_allclose(out.points, batch.points * np.float32([1, 1, 2]), rtol=1e-6)
    wanted = np.exp(-100 * (batch.points[:, :2].astype(float) ** 2).sum(axis=1))
    np.testing.assert_allclose(out.intensity, wanted, atol=1e-6)
    np.testing.assert_array_equal(out.polyline_start, batch.polyline_start)
    register_point_function("strong", too_strong, gives="intensity")
    with pytest.raises(StrategyError, match=r"'strong'.*intensity.*0\.\.1"):
        run(batch, transform=("strong",), device=device)
    with pytest.raises(StrategyError, match="gives must be one of point, intensity"):
        register_point_function("no", drawn_up, gives="colour")


def test_names_do_not_clash_but_the_same_function_may_come_again():
    def make():
        def stage(batch, setting):
            """First."""
            return batch

        return stage

    register_transform("mine", make())
    register_transform("mine", make())  # as when a notebook's cell is run again
    with pytest.raises(StrategyError, match="there is a transform stage 'mine' already: First"):
        register_transform("mine", shifted, by=0.0)
    with pytest.raises(StrategyError, match="there is a prune stage 'small' already"):
        register_transform("small", shifted)
    with pytest.raises(StrategyError, match="there is a transform stage 'close' already"):
        register_prune("close", shifted)
    with pytest.raises(StrategyError, match="text of one character at least"):
        register_prune("", shifted)
    with pytest.raises(StrategyError, match="on must be one of host, device, not 'gpu'"):
        register_prune("other", shifted, on="gpu")
    with pytest.raises(StrategyError, match=r"option 'x' cannot default to \[1\]"):
        register_prune("other", shifted, x=[1])


def changed(name, change):
    def stage(batch, setting):
        return ContourBatch(**{**batch.by_name(), name: change(getattr(batch, name))})

    return stage


def at(index, value):
    def change(array):
        out = np.array(array, np.float64 if isinstance(value, float) else None)
        out[index] = value
        return out

    return change


@pytest.mark.parametrize(
    ("stage", "words"),
    [
        (lambda batch, setting: None, "must give a ContourBatch, not NoneType"),
        (lambda batch, setting: 1 / 0, "failed: ZeroDivisionError: division by zero"),
        (changed("kind", lambda x: wp.array(x, device="cpu")), "arrays on the host, as it got them, but kind is"),
        (changed("points", lambda x: [[0.0, 0.0], [0.0]]), "points must be an array of float32"),
        (changed("points", at((slice(None), 0), np.nan)), "point 0 is not finite"),
        (changed("polyline_patch", lambda x: x + 15), r"polyline_patch must lie in 0\.\.14, the hand's patches, not 1"),
        (lambda batch, setting: batch.select(0, 2), "pose_start must stand for 4 poses, not 2"),
        (changed("points", lambda x: x[:, :2]), r"points must have shape \[point, 3\]"),
        (changed("kind", at(0, 3)), r"kind must lie in 0\.\.2, not 3"),
        (changed("kind", lambda x: x.astype(np.int64) + 256), "kind has values beyond uint8"),
        (changed("intensity", at(0, 1.5)), r"intensity must be finite and lie in 0\.\.1"),
        (changed("polyline_start", at(1, 0)), "polyline 0 must have two points at least, not 0"),
        (changed("polyline_closed", lambda x: np.ones_like(x)), "is closed, so it must end with its first point"),
        (
            lambda batch, setting: replace(batch, dwell=np.arange(len(batch.points), dtype=np.float32)),
            "is closed, so dwell at its last point must be that at its first",
        ),
        (changed("pose_start", lambda x: x[::-1]), "pose_start must be offsets"),
    ],
)
def test_what_a_stage_gives_is_judged_and_told_by_its_name(rng, stage, words):
    register_transform("mine", stage)
    with pytest.raises(StrategyError, match=f"transform stage 'mine'.*{words}"):
        run(random_batch(rng, 4, line_most=6), transform=("mine",))


@pytest.mark.parametrize(
    ("removed", "words"),
    [
        (np.zeros(3), r"shape \[4\], not \[3\]"),
        (np.full(4, -1.0), "finite and not negative"),
        ("much", "array of numbers"),
        (np.full(4, 0.01), r"said to have removed 0\.01 m of pose 0 .* 0 m shorter"),
    ],
)
def test_the_removed_length_is_judged_too(batch, removed, words):
    register_prune("mine", lambda batch, setting: (batch, removed))
    with pytest.raises(StrategyError, match=f"prune stage 'mine'.*{words}"):
        run(batch, prune=("mine",))


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("kind", lambda x: x.numpy(), "arrays on the device, as it got them, but kind is elsewhere"),
        ("points", lambda x: wp.array(x.numpy().ravel(), dtype=wp.float32), r"must have shape \[point, 3\]"),
        ("polyline_patch", lambda x: wp.array(x.numpy() + 99, dtype=wp.int32), r"polyline_patch must lie in 0\.\.14"),
    ],
)
def test_warp_arrays_are_judged_too(batch, device, name, change, words):
    register_transform("mine", changed(name, change), on="device")
    with pytest.raises(StrategyError, match=f"transform stage 'mine'.*{words}"):
        run(batch, transform=("mine",), device=device)
