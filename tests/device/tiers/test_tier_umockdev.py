"""umockdev: pyusb and the real libusb against emulated devices: enumeration, content, stops, signals and deaths."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from umockdev_checks import FRAME, PALPATE, TRANSPORTS, assert_beginning_then_off, emitting, play, sent
from umockdev_session import Plug, run, run_code

pytestmark = [pytest.mark.exhaustive, pytest.mark.usefixtures("umockdev")]
EACH_TRANSPORT = pytest.mark.parametrize("transport", TRANSPORTS)


def test_arrays_are_listed_by_the_command_line_with_their_serial_numbers(tmp_path: Path) -> None:
    plugs = (Plug("pat16", "FT4TKZL8"), Plug("pat16", "FT41TEIY", driver="ftdi_sio"))
    outcome = run([PALPATE, "devices", "--json"], tmp_path, plugs=plugs)
    assert outcome.returncode == 0, outcome.err
    assert "FT4TKZL8" in outcome.out
    assert "FT41TEIY" in outcome.out


@EACH_TRANSPORT
@pytest.mark.parametrize("rate", [40e3, 10e3])
def test_content_played_is_content_sent_then_off_and_the_array_is_let_go(
    tmp_path: Path, transport: str, rate: float
) -> None:
    outcome = play(tmp_path, transport=transport, rate=rate, frames=4000, plays=2)
    board, played = outcome.devices[0], outcome.played()
    assert np.array_equal(played[emitting(played)], np.tile(sent(4000), (2, 1)))
    assert not emitting(played[-1:])
    for report in outcome.told["plays"]:
        assert (report["error"], report["stopped_by"], report["transport"]) == (None, "end", transport)
        assert (report["frames"], report["bytes"], report["off_confirmed"]) == (4000, 4000 * FRAME, True)
    assert (board["faults_struck"], board["claimed"], outcome.told["threads"]) == (0, False, 1)
    assert board["pending_max"] == 1 or transport == "queued"


@EACH_TRANSPORT
def test_a_stop_plays_a_beginning_and_then_off(tmp_path: Path, transport: str) -> None:
    outcome = play(tmp_path, transport=transport, rate=4e3, frames=5000, forever=True, stop_after=4000)
    (report,) = outcome.told["plays"]
    count = assert_beginning_then_off(outcome.played(), np.tile(sent(5000), (3, 1)))
    board = outcome.devices[0]
    assert (report["error"], report["stopped_by"], report["off_confirmed"]) == (None, "stop", True)
    assert report["frames"] - report["frames_cleared"] == pytest.approx(count, abs=1)
    assert board["discarded_partly"] <= 1  # only one write can be torn
    assert board["discarded_out_of_order"] == 0  # as the last is ended first
    assert board["discarded"] > 1 or transport == "sync"


@EACH_TRANSPORT
@pytest.mark.parametrize("name", ["SIGTERM", "SIGINT"])
def test_a_signal_switches_the_array_off(tmp_path: Path, transport: str, name: str) -> None:
    session = {"signal": name, "signal_byte": 2500 * FRAME}
    outcome = play(tmp_path, transport=transport, rate=10e3, frames=3000, forever=True, session=session)
    (report,) = outcome.told["plays"]
    assert (report["error"], report["stopped_by"], report["off_confirmed"]) == ("PlayInterrupted", name, True)
    assert_beginning_then_off(outcome.played(), np.tile(sent(3000), (3, 1)))
    assert outcome.devices[0]["emitting"] is False


@pytest.mark.parametrize("watchdog", [False, True])
@pytest.mark.parametrize(("array", "transport"), [("emulator", "sync"), ("emulator", "queued"), ("pat16", "queued")])
def test_killed_the_array_stays_on_without_a_watchdog_and_goes_off_with_one(
    tmp_path: Path, array: str, transport: str, watchdog: bool
) -> None:
    byte = 1000 * FRAME + 77 if array == "pat16" else 2500 * FRAME
    session = {"signal": "SIGKILL", "signal_byte": byte, "linger": 20.0 if watchdog else 0.5}
    options = {"rate": 10e3, "frames": 3000, "forever": True, "watchdog": watchdog}
    outcome = play(tmp_path, array=array, transport=transport, session=session, **options)
    assert outcome.returncode == -9
    assert outcome.devices[0]["emitting"] is not watchdog  # without one nobody is left to switch it off
    if array == "emulator":
        played, wire = outcome.played(), np.tile(sent(3000), (3, 1))
        if watchdog:
            assert_beginning_then_off(played, wire)
        else:
            assert np.array_equal(played, wire[: len(played)])  # the frames that it had, and the last of them held


@EACH_TRANSPORT
def test_a_slow_source_is_counted_and_loses_nothing(tmp_path: Path, transport: str) -> None:
    outcome = play(tmp_path, transport=transport, frames=3000, pause_at=20, pause=0.3)
    (report,) = outcome.told["plays"]
    played = outcome.played()
    assert np.array_equal(played[emitting(played)], sent(3000))
    assert report["underruns"] >= 1
    assert outcome.devices[0]["underruns"] >= 1


IS_SUSPENDED = """
import os, signal, subprocess, sys
from pathlib import Path
from palpate.device import Player, array_model, open_link
from palpate.device.transports.pyusb import libusb_backend
from palpate.device.playing.watchdog import Watchdog

log = Path(sys.argv[1])
waker = "import os, signal, sys, time; time.sleep(1.0); os.kill(int(sys.argv[1]), signal.SIGCONT); time.sleep(0.2)"

def blocks():
    yield bytes(512)
    subprocess.Popen([sys.executable, "-c", waker, str(os.getpid())])
    os.kill(os.getpid(), signal.SIGSTOP)
    yield bytes(512)

with open_link(array_model("emulator"), serial="U1", backend=libusb_backend()) as link:
    with Watchdog(link, silence_max=0.3, log=log) as watchdog:
        assert watchdog.process_id
        print(Player(link).play(blocks(), update_rate=10e3).frames)
"""


def test_a_player_that_is_suspended_keeps_the_array_and_the_watchdog_says_so(tmp_path: Path) -> None:
    outcome = run_code(IS_SUSPENDED, tmp_path, str(tmp_path / "log"))
    assert outcome.returncode == 0, outcome.err
    assert outcome.out.strip() == "2"
    (silent,) = (tmp_path / "log").read_text().splitlines()
    assert "palpate watchdog of array emulator U1: the player has given no sign of life for 0.3 s" in silent
    assert "the array may be emitting: array emulator U1 is in use" in silent
