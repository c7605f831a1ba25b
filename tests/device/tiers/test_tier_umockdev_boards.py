"""umockdev: the models of real boards behind FTDI chips, played to through the real libusb, on both transports."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from umockdev_checks import TRANSPORTS, play
from umockdev_player import content
from umockdev_session import Plug, missing, write_pat_file

from palpate.device import array_model

pytestmark = pytest.mark.skipif(missing() is not None, reason=str(missing()))

SERIAL = "FT4TKZL8"
FRAME = 512
DUTY = slice(256, 512)


@pytest.fixture
def board_file(tmp_path: Path) -> Path:
    write_pat_file(tmp_path / "board.pat", serial=SERIAL)
    return tmp_path / "board.pat"


def pat16(**options: object) -> Plug:
    return Plug("pat16", SERIAL, driver="ftdi_sio", **options)


def emitting(frames: np.ndarray) -> np.ndarray:
    return frames[:, DUTY].any(axis=1)


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("transport", TRANSPORTS)
def test_pat16_plays_what_was_sent_then_off_and_its_driver_is_bound_again(
    tmp_path: Path, board_file: Path, transport: str
) -> None:
    outcome = play(
        tmp_path, pat16(), array="pat16", pat=str(board_file), transport=transport, rate=10e3, frames=2000, plays=2
    )
    first, second = outcome.told["plays"]
    played, board = outcome.played(), outcome.devices[0]
    wire = content(2000, 0, array_model("pat16", calibration=board_file))
    assert np.array_equal(played[emitting(played)], np.vstack([wire, wire]))
    assert not emitting(played[-1:])
    for report in (first, second):
        assert (report["error"], report["frames"], report["off_sent"]) == (None, 2000, True)
        assert (report["off_confirmed"], report["board_underruns"]) == (None, None)  # the board never answers
    assert (board["divider"], board["bindings"]) == (4, ["-ftdi_sio", "+ftdi_sio"])


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("transport", TRANSPORTS)
def test_a_stopped_pat16_is_off_after_a_beginning(tmp_path: Path, board_file: Path, transport: str) -> None:
    outcome = play(
        tmp_path,
        pat16(),
        array="pat16",
        pat=str(board_file),
        transport=transport,
        rate=10e3,
        frames=3000,
        forever=True,
        stop_after=1000,
    )
    (report,) = outcome.told["plays"]
    played, board = outcome.played(), outcome.devices[0]
    wire = content(3000, 0, array_model("pat16", calibration=board_file))
    on = played[emitting(played)]
    assert (report["error"], report["stopped_by"], report["off_sent"]) == (None, "stop", True)
    assert board["emitting"] is False
    assert np.array_equal(on[:-1], wire[: len(on) - 1])
    assert len(on) == pytest.approx(report["frames"], abs=1)
    torn = on[-1] != wire[len(on) - 1]
    assert not (on[-1][torn]).any()  # its part that did not come is silent
    assert board["discarded_partly"] <= 1


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("transport", TRANSPORTS)
@pytest.mark.parametrize("byte", [40 * FRAME + 511, 600 * FRAME + 100])
def test_a_pat16_whose_chip_stalls_goes_off_and_plays_again(
    tmp_path: Path, board_file: Path, transport: str, byte: int
) -> None:
    plug = pat16(faults=({"kind": "stall", "byte": byte},))
    outcome = play(
        tmp_path, plug, array="pat16", pat=str(board_file), transport=transport, rate=10e3, frames=1000, plays=2
    )
    first, second = outcome.told["plays"]
    played = outcome.played()
    wire = content(1000, 0, array_model("pat16", calibration=board_file))
    assert (first["error"], first["off_sent"]) == ("DeviceStallError", True)
    assert (second["error"], second["frames"]) == (None, 1000)
    on = emitting(played)
    assert np.array_equal(played[on][-1000:], wire)
    assert (~on[: int(np.flatnonzero(on)[-1000])][-1:]).all()  # silent in between
    assert outcome.devices[0]["emitting"] is False


@pytest.mark.exhaustive
def test_a_pat16_unplugged_while_playing_is_lost(tmp_path: Path, board_file: Path) -> None:
    plug = pat16(faults=({"kind": "unplug", "byte": 600 * FRAME},))
    outcome = play(tmp_path, plug, array="pat16", pat=str(board_file), rate=10e3, frames=1000)
    (report,) = outcome.told["plays"]
    assert (report["error"], report["off_sent"]) == ("DeviceLostError", False)
    assert outcome.returncode == 0, outcome.err


@pytest.mark.exhaustive
def test_a_killed_pat16_player_leaves_it_on_and_the_watchdog_does_not(tmp_path: Path, board_file: Path) -> None:
    ends = {}
    for watchdog in (False, True):
        outcome = play(
            tmp_path,
            pat16(),
            array="pat16",
            pat=str(board_file),
            rate=10e3,
            frames=3000,
            forever=True,
            watchdog=watchdog,
            session={"signal": "SIGKILL", "signal_byte": 1000 * FRAME + 77, "linger": 20.0 if watchdog else 0.5},
        )
        assert outcome.returncode == -9
        ends[watchdog] = outcome.devices[0]["emitting"]
    assert ends == {False: True, True: False}


def test_a_pat16_refuses_a_rate_that_its_chip_cannot_keep_up(tmp_path: Path, board_file: Path) -> None:
    outcome = play(tmp_path, pat16(), array="pat16", pat=str(board_file), rate=20e3, frames=100)
    (report,) = outcome.told["plays"]
    assert report["error"] == "UpdateRateError"
    assert not emitting(outcome.played()).any()


@pytest.mark.exhaustive
def test_a_pat16_plays_as_few_frames_as_its_chip_holds_at_any_rate(tmp_path: Path, board_file: Path) -> None:
    burst = play(tmp_path, pat16(), array="pat16", pat=str(board_file), rate=20e3, frames=28)
    (report,) = burst.told["plays"]
    assert (report["error"], report["frames"]) == (None, 28)
    assert np.count_nonzero(emitting(burst.played())) == 28
