"""Wire bytes made by kernels, against exact arithmetic in float64 and fractions."""

import re
from fractions import Fraction
from math import isqrt

import numpy as np
import pytest
import warp as wp

from palpate.kernels.driving import pack
from palpate.kernels.driving.pack import board_on, focus_delays, pack_delays, pack_points, unpack_frames

PER_METRE, MARK = 40_000.0 / 343.0, 0x80
PULSES = np.sin((np.arange(1, 65) - 0.5) * np.pi / 128), np.sin(np.arange(65) * np.pi / 128)
LINEAR = (np.arange(1, 101) - 0.5) / 100, np.arange(101) / 100
SWITCH = np.array([0.5]), np.array([0.0, 1.0])


def board_of(rng, device, *, places=32, calibrated=True, column=None, **changes):
    """A board of pulses: starts, then widths; and its numbers."""
    values = {
        "position": np.column_stack([rng.uniform(-0.08, 0.08, (places, 2)), np.zeros(places)]).astype(np.float32),
        "offset": (rng.uniform(0, 1, places) * calibrated).astype(np.float32),
        "gain": (rng.uniform(0.5, 1, places) if calibrated else np.ones(places)).astype(np.float32),
        "column": np.arange(places) if column is None else column,
    }
    fixed = np.zeros(2 * places, np.uint8)
    fixed[0] = MARK
    grid = {"delay_at": range(places), "level_at": range(places, 2 * places), "fixed": fixed}
    options = {**values, **grid, "levels": PULSES, "turn": 128, "later": 0.5, "per_metre": PER_METRE, **changes}
    return values, board_on(options.pop("position"), options.pop("column"), **options, device=device)


def packed(points, amplitude, board, device):
    out = wp.zeros((len(points), board.frame_bytes), dtype=wp.uint8, device=device)
    place = wp.array(np.float32(points), dtype=wp.vec3, device=device)
    pack_points(place, wp.array(np.float32(amplitude), dtype=wp.float32, device=device), board, out=out)
    return out.numpy().astype(int)


def random_points(rng, count):
    return np.column_stack([rng.uniform(-0.1, 0.1, (count, 2)), rng.uniform(0.05, 0.5, count)]).astype(np.float32)


@pytest.mark.parametrize("places", [32, 20, 249])
@pytest.mark.parametrize("calibrated", [False, True])
def test_starts_and_widths_are_the_nearest(calibrated, places, device, rng):
    values, board = board_of(rng, device, places=places, calibrated=calibrated)
    points, amplitude = random_points(rng, 300), rng.uniform(0.001, 1, 300).astype(np.float32)
    frames = packed(points, amplitude, board, device)
    assert (frames[:, 0] & MARK).all()
    frames[:, 0] &= 0x7F
    assert frames[:, :places].max() == 127  # a start is less than a turn
    exact = np.arcsin(amplitude[:, None].astype(float) * values["gain"]) * 128 / np.pi
    assert np.abs(frames[:, places:] - exact).max() < 0.5 + 1e-4
    distance = np.linalg.norm(points[:, None].astype(float) - values["position"], axis=2)
    wanted = 128 * (-distance * PER_METRE - values["offset"]) + (64 - frames[:, places:]) / 2
    off = (frames[:, :places] - wanted + 64) % 128 - 64
    assert np.abs(off).max() < 0.5 + 128 * 1e-4


def exact_byte(point, place, per_metre):
    """The nearest 1/256 turn, half up, by whole numbers of 64 further binary digits."""
    square = sum((Fraction(float(a)) - Fraction(float(b))) ** 2 for a, b in zip(point, place, strict=True))
    turns = Fraction(isqrt(int(square * 4**90)), 2**90) * Fraction(per_metre)
    return int((-turns * 256 + Fraction(1, 2)) // 1) % 256, (turns * 256) % 1


def test_bytes_are_those_of_exact_arithmetic_but_where_a_delay_lies_between_two(device, rng):
    values, board = board_of(
        rng, device, calibrated=False, turn=256, later=0.0, levels=LINEAR,
        delay_at=range(0, 64, 2), level_at=range(1, 64, 2), fixed=np.zeros(64, np.uint8),
    )  # fmt: skip
    points = random_points(rng, 40)
    frames = packed(points, np.ones(40), board, device)
    assert (frames[:, 1::2] == 100).all()
    near = 0
    for frame, point in zip(frames, points, strict=True):
        for byte, place in zip(frame[0::2], values["position"], strict=True):
            exact, part = exact_byte(point, place, PER_METRE)
            is_between = abs(part - Fraction(1, 2)) < Fraction(256 * 2, 10**5)  # float32 rounds 60 turns by 1e-5
            near += is_between
            assert byte == exact or (is_between and (byte - exact) % 256 in (1, 255))
    assert near < 40  # of 1,280


@pytest.mark.exhaustive
def test_the_code_for_a_gpu_rounds_each_operation_as_ieee_754_does(tmp_path):
    """NVRTC's text for an H100: roots are rounded, and nothing is fused, approximated or flushed to zero."""
    if 90 not in wp.get_cuda_supported_archs():
        pytest.skip("this Warp has no compiler for an H100")
    wp.compile_aot_module(pack, device=None, arch=90, module_dir=str(tmp_path), use_ptx=True)
    (text,) = (path.read_text() for path in tmp_path.rglob("*.ptx"))
    assert text.count("sqrt.rn.f32") >= 16  # of a point and 16 transducers
    assert re.findall(r"\bfma\.\S+|\S+\.approx\S*|\S+\.ftz\S*", text) == []


def test_a_switched_board_has_the_delay_or_off_and_its_marks(device, rng):
    fixed = np.zeros(34, np.uint8)
    fixed[[0, 33]] = 0xFE, 0xFD
    options = {"turn": 32, "later": 0.0, "levels": SWITCH, "delay_at": range(1, 33), "level_at": None, "fixed": fixed}
    values, board = board_of(rng, device, **options)
    delay = rng.uniform(0, 1, (100, 32)).astype(np.float32)
    amplitude = rng.uniform(0.4, 1, 100).astype(np.float32)
    out = wp.zeros((100, 34), dtype=wp.uint8, device=device)
    pack_delays(wp.array(delay, device=device), wp.array(amplitude, device=device), board, out=out)
    frames = out.numpy().astype(int)
    assert (frames[:, [0, 33]] == [0xFE, 0xFD]).all()
    is_on = amplitude[:, None] * values["gain"] >= 0.5
    np.testing.assert_array_equal(frames[:, 1:33] < 32, is_on)
    assert (frames[:, 1:33][~is_on] == 32).all()
    off = (frames[:, 1:33] - 32 * (delay - values["offset"]) + 16) % 32 - 16
    assert np.abs(off[is_on]).max() < 0.5 + 1e-4


def test_points_have_the_bytes_of_their_delays_in_the_columns_of_the_board(device, rng):
    _, board = board_of(rng, device, places=20, column=7 + rng.permutation(20))
    points, amplitude = random_points(rng, 60), rng.uniform(0, 1, 60).astype(np.float32)
    delay = wp.full((60, 30), 9.0, dtype=wp.float32, device=device)
    focus_delays(wp.array(points, dtype=wp.vec3, device=device), board, out=delay)
    host = delay.numpy()
    assert (host[:, :7] == 9).all()
    assert (host[:, 27:] == 9).all()
    assert (host[:, 7:27] >= 0).all()
    assert (host[:, 7:27] <= 1).all()
    out = wp.zeros((60, board.frame_bytes), dtype=wp.uint8, device=device)
    pack_delays(delay, wp.array(amplitude, device=device), board, out=out)
    np.testing.assert_array_equal(out.numpy(), packed(points, amplitude, board, device))


@pytest.mark.parametrize("form", ["pulses", "linear", "switch"])
def test_what_frames_play_is_read_back(form, device, rng):
    plain = {"calibrated": False, "fixed": np.zeros(64, np.uint8)}
    ways = {
        "pulses": {},
        "linear": {"turn": 256, "later": 0.0, "levels": LINEAR},
        "switch": {"turn": 32, "later": 0.0, "levels": SWITCH, "level_at": None},
    }
    _, board = board_of(rng, device, column=rng.permutation(32), **plain, **ways[form])
    delay, amplitude = rng.uniform(0, 1, (80, 32)).astype(np.float32), rng.uniform(0, 1, 80).astype(np.float32)
    delay[0], amplitude[1] = 1.0, 0.0
    out = wp.zeros((80, 64), dtype=wp.uint8, device=device)
    pack_delays(wp.array(delay, device=device), wp.array(amplitude, device=device), board, out=out)
    steps, level = wp.empty((80, 32), dtype=wp.uint8, device=device), wp.empty(80, dtype=wp.float32, device=device)
    unpack_frames(out, board, delay=steps, amplitude=level)
    least, wanted = ways[form].get("levels", PULSES)
    np.testing.assert_allclose(level.numpy(), wanted[(amplitude[:, None] >= least).sum(axis=1)], atol=1e-6)
    apart = (steps.numpy() / 256 - delay + 0.5) % 1 - 0.5
    assert np.abs(apart[level.numpy() > 0]).max() <= 0.5 / ways[form].get("turn", 128) + 1e-6


def test_bytes_and_numbers_that_do_not_fit_are_refused(device, rng):
    for changes, message in (
        ({"delay_at": range(31)}, r"delays of 32 transducers must be in a frame of 64 bytes, not at range\(0, 31\)"),
        ({"level_at": range(40, 72)}, r"levels of 32 transducers .*, not at range\(40, 72\)"),
        ({"level_at": range(63, 31, -1)}, r"levels of 32 transducers .*, not at range\(63, 31, -1\)"),
        ({"delay_at": range(-32, 0)}, r"delays of 32 transducers .*, not at range\(-32, 0\)"),
        ({"turn": 257}, "1..256 steps and 1..255 levels, not 257 and 64"),
        ({"levels": (np.ones(256), np.ones(257))}, "not 128 and 256"),
        ({"turn": 32}, "start 0.5 steps later for each of 64 levels leave a turn"),
    ):
        with pytest.raises(ValueError, match=message):
            board_of(rng, device, **changes)
