"""Drives of an array that takes focal points: its frames against a loop in float64, and what it cannot be asked for."""

from itertools import pairwise

import numpy as np
import pytest
from foci_oracle import focus_frames, unpacked
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.device import array_model
from palpate.device.errors import FrameError
from palpate.render import Driver, DriveStrategy, FocalPoints
from palpate.render.errors import StrategyError

TILTED = np.array([0.02, -0.01, 0.05, 0.0, 0.6, 0.0, 0.8])


def wandering(rng, foci, count=120):
    """Focal points of which some are out of reach, no numbers, too strong, or silent."""
    position = rng.uniform([-0.1, -0.1, 0.15], [0.1, 0.1, 0.4], (count, foci, 3))
    intensity = rng.random((count, foci))
    position[rng.random((count, foci)) < 0.1] = [0.0, 0.0, 3.0]
    position[rng.random((count, foci)) < 0.1, 1] = np.nan
    for level in (0.0, np.nan, -0.5, 1.5, 1.0):
        intensity[rng.random((count, foci)) < 0.08] = level
    return FocalPoints(position.astype(np.float32), intensity.astype(np.float32))


def values_of(model, packed):
    """What a program reads from the frames, shape [frame, point, 4]."""
    (frames,) = packed.frames
    return np.array([unpacked(frame.tobytes(), model.point_count) for frame in frames.numpy()])


@pytest.mark.parametrize("foci", [1, 3])
@pytest.mark.parametrize("amplitude", ["pressure", "force"])
def test_frames_are_those_of_a_loop_in_float64(amplitude, foci, rng, device):
    model = array_model("stratos").with_points(4 if foci == 3 else 1).placed(TILTED)
    focus = wandering(rng, foci)
    driver = Driver(model, DriveStrategy(amplitude=amplitude, level_max=0.75), device=device)
    packed = driver.pack(focus)
    wanted, refused = focus_frames(
        focus.position,
        focus.intensity,
        pose=model.pose,
        zone=model.focal_zone,
        count=model.point_count,
        is_force=amplitude == "force",
        level_max=float(np.float32(0.75)),
    )
    found = values_of(model, packed)
    np.testing.assert_array_equal(found[..., :3], wanted[..., :3].astype(np.float32))
    # ratios of several points are rounded to 2^-16 of the greatest
    np.testing.assert_allclose(found[..., 3], wanted[..., 3], rtol=0, atol=1e-7 if foci == 1 else 2**-17)
    np.testing.assert_array_equal(found[..., 3] == 0, wanted[..., 3] == 0)
    assert packed.refused == refused > 10


def test_values_of_one_point_at_rest_are_those_that_were_asked_for():
    """No arithmetic stands between: float32 in, the same float32 out."""
    rng = np.random.default_rng(5)
    place = rng.uniform([-0.1, -0.1, 0.1], [0.1, 0.1, 0.4], (50, 3)).astype(np.float32)
    level = rng.random(50, np.float32)
    (found,) = Driver("stratos").pack(FocalPoints(place, level)).frames
    assert found.numpy().tobytes() == np.concatenate([place, level[:, None]], axis=1).astype("<f4").tobytes()


@settings(max_examples=15)
@given(seed=st.integers(0, 2**32 - 1), cuts=st.sets(st.integers(1, 59), max_size=6), foci=st.sampled_from([1, 4]))
def test_bytes_do_not_depend_on_how_frames_are_cut(seed, cuts, foci):
    focus = wandering(np.random.default_rng(seed), foci, 60)
    model = array_model("stratos").with_points(foci)
    whole, driver = Driver(model).pack(focus).frames[0].numpy(), Driver(model)
    places = [0, *sorted(cuts), 60]
    parts = [
        driver.pack(FocalPoints(focus.position[a:b], focus.intensity[a:b])).frames[0].numpy()
        for a, b in pairwise(places)
    ]
    np.testing.assert_array_equal(np.concatenate(parts), whole)


def test_what_cannot_be_asked_of_an_array_that_finds_its_phases_by_itself_is_refused():
    for changes, field in (
        ({"sound_speed": 340.0}, "sound_speed is 340.0"),
        ({"solver": "wgs"}, "solver is wgs"),
        ({"gs_pat_iterations": 3}, "gs_pat_iterations is 3"),
        ({"wgs_iterations": 3}, "wgs_iterations is 3"),
        ({"piston_radius": 0.001}, "piston_radius is 0.001"),
    ):
        with pytest.raises(StrategyError, match=f"{field}, but array stratos takes focal points"):
            Driver("stratos", DriveStrategy(**changes)).require_played()
    with pytest.raises(StrategyError, match=r"slew is 0\.01, but array stratos takes focal points"):
        Driver("stratos", DriveStrategy(slew=0.01), update_rate=10e3)
    Driver("stratos", DriveStrategy(amplitude="force", level_max=0.5)).require_played()
    Driver("emulator", DriveStrategy(solver="wgs")).require_played()


@pytest.mark.parametrize("arrays", [["stratos", "stratos"], ["emulator", "stratos"], ["stratos", "pat16"]])
def test_an_array_of_focal_points_plays_alone(arrays):
    with pytest.raises(StrategyError, match=r"array stratos plays alone: .* no other array could be in phase"):
        Driver(arrays)


def test_more_points_than_a_frame_holds_are_refused():
    focus = FocalPoints(np.full((1, 3, 3), 0.2, np.float32), np.ones((1, 3), np.float32))
    with pytest.raises(StrategyError, match="opened for 2 focal points a frame, not 3"):
        Driver(array_model("stratos").with_points(2)).pack(focus)
    for count in (0, 9, -1):
        with pytest.raises(FrameError, match=rf"holds 1\.\.8 focal points, not {count}"):
            array_model("stratos").with_points(count)


def test_predictions_of_it_are_those_of_an_array_with_fine_steps(rng):
    """Drives for predictions are palpate's own, rounded to 256 delays and 255 levels: those of an `emulator` there."""
    own = array_model("stratos")
    focus = FocalPoints(rng.uniform([-0.05, -0.05, 0.1], [0.05, 0.05, 0.3], (20, 3)).astype(np.float32), np.ones(20))
    found = Driver(own).rounded(focus)
    distance = np.linalg.norm(own.position - focus.position[:, None].astype(np.float64), axis=2)
    steps = np.mod(-distance * 40e3 / 343.0, 1) * 256
    apart = np.abs((found.delay.numpy() - steps + 128) % 256 - 128)
    assert apart.max() < 0.51  # half a step, and what float32 rounds
    assert found.amplitude.numpy().tolist() == [1] * 20
