"""Wire bytes of pulses made by kernels, against exact arithmetic in float64."""

import numpy as np
import pytest
import warp as wp

from palpate.kernels.driving.pulse_frames import board_on, pack_delays, pack_pulses
from palpate.kernels.driving.weigh import FocalBox

PER_METRE, TURN, HALF, MARK = 40_000.0 / 343.0, 128, 64, 0x80
LEAST = np.sin((np.arange(1, HALF + 1) - 0.5) * np.pi / 128)  # of the width that is nearest to 128 / pi arcsin


def board_of(rng, device, places=32, calibrated=True):
    values = {
        "position": np.column_stack([rng.uniform(-0.08, 0.08, (places, 2)), np.zeros(places)]),
        "offset": rng.uniform(0, 1, places) * calibrated,
        "gain": rng.uniform(0.5, 1, places) if calibrated else np.ones(places),
        "level_least": LEAST,
    }
    return values, board_on(values, per_metre=PER_METRE, turn=TURN, mark=MARK, device=device)


def box_of(*, force=False):
    box = FocalBox()
    box.turn, box.middle = wp.mat33d(np.eye(3)), wp.vec3d()
    box.lateral, box.low, box.high = 0.1, 0.05, 0.5
    box.intensity_most, box.level_most, box.is_force = 1.0, 0.8, int(force)
    return box


def packed(points, intensity, board, box, device):
    arrays = wp.array(np.float32(points), dtype=wp.vec3, device=device), wp.array(np.float32(intensity), device=device)
    return pack_pulses(*arrays, board, box)


@pytest.mark.parametrize("force", [False, True])
@pytest.mark.parametrize("calibrated", [False, True])
def test_starts_and_widths_are_the_nearest(calibrated, force, device, rng):
    values, board = board_of(rng, device, calibrated=calibrated)
    points = np.column_stack([rng.uniform(-0.1, 0.1, (500, 2)), rng.uniform(0.05, 0.5, 500)]).astype(np.float32)
    intensity = rng.uniform(0.001, 1, 500).astype(np.float32)
    frame, refused = packed(points, intensity, board, box_of(force=force), device)
    bytes_ = frame.numpy().astype(int)
    assert (bytes_[:, 0] & MARK).all()
    bytes_[:, 0] &= 0x7F
    assert bytes_[:, :32].max() == 127  # a start is less than a turn
    level = 0.8 * (np.sqrt(intensity.astype(float)) if force else intensity)[:, None] * values["gain"]
    exact = np.arcsin(level) * 128 / np.pi
    assert np.abs(bytes_[:, 32:] - exact).max() < 0.5 + 1e-4
    distance = np.linalg.norm(points[:, None].astype(float) - values["position"].astype(np.float32), axis=2)
    wanted = 128 * (-distance * PER_METRE - values["offset"]) + (64 - bytes_[:, 32:]) / 2
    off = (bytes_[:, :32] - wanted + 64) % 128 - 64
    assert np.abs(off).max() < 0.5 + 128 * 1e-4
    assert refused == 0


def test_points_out_of_reach_and_odd_intensities_are_silent_and_counted(device, rng):
    _, board = board_of(rng, device)
    good = (0.1, -0.1, 0.5)
    cases = [
        (good, 1.0, True), ((0.1001, 0, 0.2), 1.0, False), ((0, -0.1001, 0.2), 1.0, False),
        ((0, 0, 0.0499), 1.0, False), ((0, 0, 0.5001), 1.0, False),
        ((np.nan, 0, 0.2), 1.0, False), (good, 1.001, False), (good, -0.1, False),
        (good, np.nan, False), (good, np.inf, False), (good, 0.0, None), ((9, 9, 9), 0.0, None),
    ]  # fmt: skip
    points, intensity, drawn = zip(*cases, strict=True)
    frame, refused = packed(points, intensity, board, box_of(), device)
    assert (frame.numpy()[:, 32:] > 0).any(axis=1).tolist() == [one is True for one in drawn]
    assert refused == sum(one is False for one in drawn)


def test_a_frame_does_not_depend_on_others_and_none_are_none(device, rng):
    _, board = board_of(rng, device)
    points, intensity = rng.uniform(0.06, 0.1, (50, 3)), rng.uniform(0, 1, 50)
    whole = packed(points, intensity, board, box_of(), device).frame.numpy()
    parts = [packed(points[a:b], intensity[a:b], board, box_of(), device).frame.numpy() for a, b in ((0, 7), (7, 50))]
    np.testing.assert_array_equal(np.concatenate(parts), whole)
    assert packed(np.zeros((0, 3)), np.zeros(0), board, box_of(), device).frame.shape == (0, 64)


def test_transducers_must_fill_whole_groups(device, rng):
    _, board = board_of(rng, device, places=20)
    with pytest.raises(ValueError, match="a multiple of 16, not 20"):
        packed(np.zeros((1, 3)), np.zeros(1), board, box_of(), device)


@pytest.mark.parametrize("calibrated", [False, True])
def test_starts_of_delays_are_the_nearest_in_the_order_of_the_wire(calibrated, device, rng):
    values, _ = board_of(rng, device, calibrated=calibrated)
    values["order"] = rng.permutation(32)
    board = board_on(values, per_metre=PER_METRE, turn=TURN, mark=MARK, device=device)
    delay, level = rng.uniform(0, 1, (200, 32)).astype(np.float32), rng.uniform(0, 1, 200).astype(np.float32)
    delay[0], level[1] = 1.0, 0.0  # a full turn; silence
    frame = pack_delays(wp.array(delay, device=device), wp.array(level, device=device), board).numpy().astype(int)
    assert (frame[:, 0] & MARK).all()
    frame[:, 0] &= 0x7F
    assert np.abs(frame[:, 32:] - np.arcsin(level[:, None] * values["gain"]) * 128 / np.pi).max() < 0.5 + 1e-4
    wanted = 128 * (delay[:, values["order"]] - values["offset"]) + (64 - frame[:, 32:]) / 2
    off = (frame[:, :32] - wanted + 64) % 128 - 64
    assert np.abs(off).max() < 0.5 + 1e-4
