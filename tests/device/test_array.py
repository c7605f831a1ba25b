"""Array models: geometry, poses, reach, update rates, and board files."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

import numpy as np
import pytest
from board_file_cases import GRID, board_lines, write
from drive_cases import ARRAYS_OF_PHASES
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from palpate.device.errors import UnknownArrayError, UpdateRateError
from palpate.device.registry import array_kinds, array_model, array_names, canonical_name

# published lists of wiring, as comma-separated text: OpenMPD's board files, SonicSurface.py
PAT_PINS_SHA256 = "01f0ad1d1a1bb16fb6857e8386922bc5b80663cc7de0ee6d75236d9afb49c2d8"
SONIC_SLOTS_SHA256 = "49cd8f6c4e98a6e2e91ce88d2bc65ae02b0d156c5737489e388e22213d7e35ee"


def text_sha256(numbers: np.ndarray) -> str:
    return hashlib.sha256(",".join(map(str, numbers.tolist())).encode()).hexdigest()


def at(name: str, x: float, y: float) -> int:
    """Transducer at x, y [mm]."""
    return int(np.argmin(np.linalg.norm(array_model(name).position[:, :2] * 1e3 - [x, y], axis=1)))


@pytest.mark.parametrize("name", ["emulator", "pat16", "sonicsurface"])
def test_square_arrays_are_centred_flat_and_face_up(name: str) -> None:
    model = array_model(name)
    x, y, z = (np.round(model.position * 1e3, 2).T).tolist()
    assert (x[:16], y[::16], set(z)) == (GRID, GRID, {0.0})
    assert np.array_equal(model.normal, np.tile([0, 0, 1], (256, 1)))
    # stored in files, so it must stay; the three have the same geometry, so drives of one fit the others
    assert model.identity() == "52f183542e18dc0645909b6d232f22dc4495970dfd39f7fd4e6929e9716b3aa4"


def test_an_autd3_lacks_the_three_places_of_its_screws_and_is_centred() -> None:
    position = array_model("autd3").position * 1e3
    assert len(position) == 249
    assert np.allclose(position.min(axis=0), [-86.36, -66.04, 0], atol=1e-4)
    assert np.allclose(position.max(axis=0), [86.36, 66.04, 0], atol=1e-4)
    place = np.round((position[:, :2] + [86.36, 66.04]) / 10.16).astype(int)
    assert {(i, j) for i in range(18) for j in range(14)} - set(map(tuple, place)) == {(1, 1), (2, 1), (16, 1)}
    assert place[:2].tolist() == [[0, 0], [1, 0]]  # the vendor's own order: x fastest


def test_wiring_is_that_of_the_published_lists() -> None:
    pin = np.argsort(array_model("pat16").wire_order)
    in_file_order = pin.reshape(16, 16)[::-1].T.ravel()  # x ascending outside, y descending inside
    assert in_file_order[:8].tolist() == [249, 253, 241, 245, 233, 237, 225, 229]
    assert text_sha256(in_file_order) == PAT_PINS_SHA256
    slot = np.argsort(array_model("sonicsurface").wire_order)
    assert slot[:20].tolist() == [0, 7, 1, 2, 64, 71, 65, 66, 128, 135, 129, 130, 192, 199, 193, 194, 4, 3, 6, 5]
    assert text_sha256(slot) == SONIC_SLOTS_SHA256


@pytest.mark.parametrize("name", array_names())
def test_each_place_of_the_wire_has_its_own_transducer(name: str) -> None:
    model = array_model(name)
    assert sorted(model.wire_order.tolist()) == list(range(model.transducer_count))
    for field in (model.position, model.normal, model.wire_order, model.gain, model.delay_offset, model.pose):
        assert not field.flags.writeable  # models are shared


def test_a_placed_array_stands_there_and_reaches_what_it_reached() -> None:
    model = array_model("pat16")
    facing_down = model.placed([0, 0, 0.2388, 0, 1, 0, 0])  # half a turn about y, as a second board is mounted
    corner = model.position[0]
    assert np.allclose(facing_down.position[0], [-corner[0], corner[1], 0.2388], atol=1e-7)
    assert np.allclose(facing_down.normal, [0, 0, -1], atol=1e-7)
    assert facing_down.identity() != model.identity()
    points = np.array([[0.0, 0, 0.1], [0, 0, 0.2], [0, 0, 0.3], [0, 0, -0.3], [np.nan, 0, 0.1]])
    assert model.in_reach(points).tolist() == [True, True, True, False, False]
    assert facing_down.in_reach(points).tolist() == [True, False, False, False, False]
    assert facing_down.placed(model.pose).identity() == model.identity()


def test_placing_turns_as_scipy_does() -> None:
    model, rotation = array_model("autd3"), Rotation.from_rotvec([0.7, -1.1, 0.4])
    middle = np.array([0.1, 0.2, 0.3])
    placed = model.placed([*middle, *rotation.as_quat()])
    assert np.allclose(placed.position, rotation.apply(model.position) + middle, atol=1e-7)
    assert np.allclose(placed.normal, rotation.apply([0, 0, 1]), atol=1e-7)
    points = np.array([[0.14, -0.14, 0.06], [0.14, 0.16, 0.06], [0.0, 0.0, 0.51]])
    assert placed.in_reach(rotation.apply(points) + middle).tolist() == [True, False, False]


def test_whether_a_point_is_in_reach_depends_on_no_other_point() -> None:
    model = array_model("pat16")
    turn = np.array([1.0, 2, 3, 4]) / np.sqrt(30)
    placed = model.placed([0.01, 0.02, 0.1, *turn])
    bound = np.float32(model.focal_zone.lateral)
    rng = np.random.default_rng(4)
    own = np.column_stack([np.zeros(1000), rng.uniform(-0.1, 0.1, 1000), rng.uniform(0.15, 0.25, 1000)])
    own[:, 0] = (float(bound) + float(np.nextafter(bound, np.float32(1)))) / 2  # float32 rounds the last bits in or out
    points = Rotation.from_quat(turn).apply(own) + placed.pose[:3]
    reached = placed.in_reach(points)
    assert 100 < np.count_nonzero(reached) < 900
    assert [bool(placed.in_reach(point[None])[0]) for point in points] == reached.tolist()
    assert placed.in_reach(points[::-1].reshape(10, 100, 3)).ravel().tolist() == reached[::-1].tolist()
    assert not placed.in_reach(np.array([[np.inf, 0, 0.2], [0, -np.inf, 0.2]])).any()


def test_a_pose_that_is_none_is_refused() -> None:
    for pose in ([0] * 7, [0, 0, 0, 0, 0, 0, 1.1], [np.nan, 0, 0, 0, 0, 0, 1], [0] * 6):
        with pytest.raises(ValueError, match="pose"):
            array_model("pat16").placed(pose)


def test_what_people_call_an_array_gives_the_one_of_its_own_name() -> None:
    called = {"pat16": ["openmpd", "OpenMPD", "PAT", "pat-16", "AsierInho"], "emulator": [" Emulator "]}
    called |= {"sonicsurface": ["sonic-surface", "Sonic Surface", "SonicSurface"], "autd3": ["AUTD", "AUTD3"]}
    called["stratos"] = ["ultraleap", "Ultraleap", "USX", "usx", "STRATOS Explore", "ultrahaptics"]
    for own, others in called.items():
        assert {array_model(other).name for other in others} == {own}


def test_no_two_arrays_have_a_name_in_common() -> None:
    for kind in array_kinds():
        assert {canonical_name(name) for name in (kind.name, *kind.aliases)} == {kind.name}
    assert array_names() == (*ARRAYS_OF_PHASES, "stratos")


def test_an_unknown_array_is_refused_with_names_and_aliases() -> None:
    known = re.escape("; known: emulator, pat16 (openmpd, asierinho, pat), sonicsurface (sonic-surface), autd3 (autd)")
    for name in ("pat17", "", "sonic", "openmpd.json", "pat16,autd3"):
        with pytest.raises(UnknownArrayError, match=f"unknown array {name!r}.*{known}"):
            array_model(name)


@given(st.integers(1, 255))
def test_each_divider_comes_back_from_its_update_rate(divider: int) -> None:
    model = array_model("emulator")
    assert model.divider(model.update_rate(divider)) == divider
    assert model.divider(float(f"{model.update_rate(divider):.8g}")) == divider


def test_an_update_rate_that_the_board_does_not_have_is_refused_with_its_neighbours() -> None:
    for rate in (7e3, 39e3, 41e3, 100.0, 0.0, -1e4, float("nan"), float("inf")):
        with pytest.raises(UpdateRateError, match="update rate"):
            array_model("emulator").divider(rate)
    with pytest.raises(UpdateRateError, match=r"nearest are 6666\.66667 and 8000 Hz"):
        array_model("emulator").divider(7e3)


def test_a_sonicsurface_refuses_rates_above_its_link_with_the_figure() -> None:
    reason = "its UART carries 89.3 frames a second at 230400 Bd, or one pattern switched on and off at up to 23040 Hz"
    message = f"10000 Hz is not 23040 Hz / n, as array sonicsurface needs; nearest are 7680 and 11520 Hz; {reason}"
    with pytest.raises(UpdateRateError, match=re.escape(message)):
        array_model("sonicsurface").divider(10e3)
    message = f"50 Hz is outside 89.3023..23040 Hz of array sonicsurface: {reason}"
    with pytest.raises(UpdateRateError, match=re.escape(message)):
        array_model("sonicsurface").divider(50.0)
    model = array_model("sonicsurface")
    assert model.divider(model.update_rate(model.divider_default)) == model.divider_sustained == 258
    assert model.update_rate(258) == pytest.approx(230400 / 10 / 258)
    recompiled = array_model("sonicsurface", baud=1462857)
    assert recompiled.update_rate(258) == pytest.approx(1462857 / 2580)
    for baud in (0, -5, 1199, 12_000_001):
        with pytest.raises(UpdateRateError, match=rf"{baud} Bd is outside 1200\.\.12000000 Bd"):
            array_model("sonicsurface", baud=baud)
    with pytest.raises(UpdateRateError, match="emulator has no UART"):
        array_model("emulator", baud=9600)


@pytest.mark.parametrize("ending", ["\n", "\r\n"])
def test_a_board_file_gives_each_transducer_its_own_pin_offset_and_factor(tmp_path: Path, ending: str) -> None:
    lines, pin, offset, factor = board_lines(np.random.default_rng(3))
    model = array_model("pat16", calibration=write(tmp_path / "board.pat", lines, ending))
    assert (model.serial, model.calibrated, model.name) == ("FT4TKZL8", True, "pat16")
    assert model.identity() == array_model("pat16").identity()  # drives that are stored fit it
    pin_of = np.argsort(model.wire_order)
    for t in (0, 1, 16, 100, 255):
        ours = at("pat16", GRID[t // 16], GRID[15 - t % 16])
        assert pin_of[ours] == pin[t]
        assert model.delay_offset[ours] == pytest.approx(offset[t] / 360)
        assert model.gain[ours] == pytest.approx(factor[t])
    assert (array_model("pat16", calibration=write(tmp_path / "b.pat", lines[:6])).gain == 1).all()
