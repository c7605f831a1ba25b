"""umockdev: pyusb and the real libusb against emulated devices: enumeration, content, stops and signals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from umockdev_checks import FRAME, PALPATE, TRANSPORTS, assert_beginning_then_off, emitting, play, sent
from umockdev_session import Plug, missing, run

pytestmark = pytest.mark.skipif(missing() is not None, reason=str(missing()))


def test_arrays_are_listed_by_the_command_line_with_their_serial_numbers(tmp_path: Path) -> None:
    plugs = (Plug("pat16", "FT4TKZL8"), Plug("pat16", "FT41TEIY", driver="ftdi_sio"))
    outcome = run([PALPATE, "devices", "--json"], tmp_path, plugs=plugs)
    assert outcome.returncode == 0, outcome.err
    assert "FT4TKZL8" in outcome.out
    assert "FT41TEIY" in outcome.out


@pytest.mark.exhaustive(but="40000.0-")
@pytest.mark.parametrize("transport", TRANSPORTS)
@pytest.mark.parametrize("rate", [40e3, 10e3])
def test_content_played_is_content_sent_then_off(tmp_path: Path, transport: str, rate: float) -> None:
    outcome = play(tmp_path, transport=transport, rate=rate, frames=4000)
    (report,) = outcome.told["plays"]
    board = outcome.devices[0]
    played = outcome.played()
    assert np.array_equal(played[emitting(played)], sent(frames=4000))
    assert not emitting(played[-1:])
    assert (report["error"], report["stopped_by"], report["transport"]) == (None, "end", transport)
    assert (report["frames"], report["bytes"], report["off_confirmed"]) == (4000, 4000 * FRAME, True)
    assert board["faults_struck"] == 0
    assert board["pending_max"] == 1 or transport == "queued"


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("transport", TRANSPORTS)
def test_the_array_is_let_go_for_the_next_player(tmp_path: Path, transport: str) -> None:
    outcome = play(tmp_path, transport=transport, frames=200, plays=3)
    played = outcome.played()
    assert np.array_equal(played[emitting(played)], np.tile(sent(frames=200), (3, 1)))
    assert outcome.devices[0]["claimed"] is False
    assert outcome.told["threads"] == 1


@pytest.mark.parametrize("transport", TRANSPORTS)
def test_a_stop_plays_a_beginning_and_then_off(tmp_path: Path, transport: str) -> None:
    outcome = play(tmp_path, transport=transport, rate=4e3, frames=5000, forever=True, stop_after=4000)
    (report,) = outcome.told["plays"]
    count = assert_beginning_then_off(outcome.played(), np.tile(sent(frames=5000), (3, 1)))
    board = outcome.devices[0]
    assert (report["error"], report["stopped_by"], report["off_confirmed"]) == (None, "stop", True)
    assert report["frames"] - report["frames_cleared"] == pytest.approx(count, abs=1)
    assert board["discarded_partly"] <= 1  # only one write can be torn
    assert board["discarded_out_of_order"] == 0  # as the last is ended first
    assert board["discarded"] > 1 or transport == "sync"


@pytest.mark.exhaustive(but="SIGTERM-")
@pytest.mark.parametrize("transport", TRANSPORTS)
@pytest.mark.parametrize("name", ["SIGTERM", "SIGINT"])
def test_a_signal_switches_the_array_off(tmp_path: Path, transport: str, name: str) -> None:
    outcome = play(
        tmp_path,
        transport=transport,
        rate=10e3,
        frames=3000,
        forever=True,
        session={"signal": name, "signal_byte": 2500 * FRAME},
    )
    (report,) = outcome.told["plays"]
    assert (report["error"], report["stopped_by"], report["off_confirmed"]) == ("PlayInterrupted", name, True)
    assert_beginning_then_off(outcome.played(), np.tile(sent(frames=3000), (3, 1)))
    assert outcome.devices[0]["emitting"] is False


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("transport", TRANSPORTS)
def test_killed_without_a_watchdog_the_array_stays_on(tmp_path: Path, transport: str) -> None:
    """The documented truth: nobody is left to switch it off."""
    outcome = play(
        tmp_path,
        transport=transport,
        rate=10e3,
        frames=3000,
        forever=True,
        session={"signal": "SIGKILL", "signal_byte": 2500 * FRAME, "linger": 0.5},
    )
    assert outcome.returncode == -9
    assert outcome.devices[0]["emitting"] is True
    wire = np.tile(sent(frames=3000), (3, 1))
    played = outcome.played()
    assert np.array_equal(played, wire[: len(played)])  # the frames that it had, and the last of them held


@pytest.mark.parametrize("transport", TRANSPORTS)
def test_killed_with_a_watchdog_the_array_goes_off(tmp_path: Path, transport: str) -> None:
    outcome = play(
        tmp_path,
        transport=transport,
        rate=10e3,
        frames=3000,
        forever=True,
        watchdog=True,
        session={"signal": "SIGKILL", "signal_byte": 2500 * FRAME, "linger": 20.0},
    )
    assert outcome.returncode == -9
    assert outcome.devices[0]["emitting"] is False
    assert_beginning_then_off(outcome.played(), np.tile(sent(frames=3000), (3, 1)))


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("transport", TRANSPORTS)
def test_a_slow_source_is_counted_and_loses_nothing(tmp_path: Path, transport: str) -> None:
    outcome = play(tmp_path, transport=transport, frames=3000, pause_at=20, pause=0.3)
    (report,) = outcome.told["plays"]
    played = outcome.played()
    assert np.array_equal(played[emitting(played)], sent(frames=3000))
    assert report["underruns"] >= 1
    assert outcome.devices[0]["underruns"] >= 1
