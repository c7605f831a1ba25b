"""umockdev: what goes wrong on a bus, on both transports; the array ends off or is lost, and the counts are true."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from umockdev_checks import FRAME, PLAYER, TRANSPORTS, assert_beginning_then_off, emitting, play, sent
from umockdev_session import Outcome, Plug, run

pytestmark = [pytest.mark.exhaustive, pytest.mark.usefixtures("umockdev")]
EACH_TRANSPORT = pytest.mark.parametrize("transport", TRANSPORTS)
TORN = 700 * FRAME + 100


def twice(folder: Path, kind: str, byte: int, transport: str) -> tuple[dict, dict, Outcome]:
    """Play 1500 frames twice, the first time with a fault; the reports, and all else."""
    outcome = play(folder, faults=({"kind": kind, "byte": byte},), transport=transport, frames=1500, plays=2)
    first, second = outcome.told["plays"]
    played = outcome.played()
    assert (second["error"], second["frames"], second["off_confirmed"]) == (None, 1500, True)
    assert np.array_equal(played[emitting(played)][-1500:], sent(1500))
    assert outcome.devices[0]["emitting"] is False
    return first, second, outcome


@EACH_TRANSPORT
@pytest.mark.parametrize("byte", [0, TORN])
def test_a_stall_ends_with_the_array_off_and_it_plays_again(tmp_path: Path, transport: str, byte: int) -> None:
    first, _, outcome = twice(tmp_path, "stall", byte, transport)
    assert first["error"] == "DeviceStallError"
    assert "stall" in first["message"]
    assert outcome.devices[0]["halts_cleared"] >= 1
    played = outcome.played()
    before = len(played) - 1500 - int(np.argmax(emitting(played)[::-1]))
    assert_beginning_then_off(np.vstack([played[:before], np.zeros((1, FRAME), np.uint8)]), sent(1500))


@EACH_TRANSPORT
@pytest.mark.parametrize("byte", [0, TORN])
def test_a_device_that_takes_nothing_for_a_while(tmp_path: Path, transport: str, byte: int) -> None:
    """Blocking writes go on after their time limit; queued ones give up after a second without progress."""
    first, _, outcome = twice(tmp_path, "nak", byte, transport)
    played = outcome.played()
    if transport == "sync":
        assert (first["error"], first["frames"], first["off_confirmed"]) == (None, 1500, True)
        assert first["short_writes"] >= 1
        assert np.array_equal(played[emitting(played)], np.tile(sent(1500), (2, 1)))
    else:
        assert first["error"] == "DeviceTimeoutError"
        assert outcome.devices[0]["discarded_partly"] <= 1


@EACH_TRANSPORT
@pytest.mark.parametrize("byte", [700 * FRAME, TORN])
def test_a_short_transfer_loses_nothing_or_is_told(tmp_path: Path, transport: str, byte: int) -> None:
    first, _, outcome = twice(tmp_path, "short", byte, transport)
    played = outcome.played()
    if transport == "sync":
        assert (first["error"], first["short_writes"], first["frames"]) == (None, 1, 1500)
        assert np.array_equal(played[emitting(played)][:1500], sent(1500))
    else:  # the kernel had the next transfers already, so what followed was not what should have
        assert first["error"] in (None, "LinkError")
        assert "torn" in first["message"] or first["short_writes"] == 1


@EACH_TRANSPORT
def test_a_device_that_takes_nothing_any_more_is_told_and_holds_its_frame(tmp_path: Path, transport: str) -> None:
    faults = ({"kind": "nak", "byte": TORN, "count": None},)
    outcome = play(tmp_path, faults=faults, transport=transport, frames=1500)
    (report,) = outcome.told["plays"]
    assert (report["error"], report["off_confirmed"]) == ("DeviceTimeoutError", False)
    played = outcome.played()
    assert np.array_equal(played, sent(1500)[: len(played)])
    assert report["frames"] * FRAME <= TORN
    assert outcome.devices[0]["bytes_out"] == TORN


@EACH_TRANSPORT
@pytest.mark.parametrize("byte", [0, TORN])
def test_unplugged_while_playing_it_is_lost_and_nothing_hangs(tmp_path: Path, transport: str, byte: int) -> None:
    outcome = play(tmp_path, faults=({"kind": "unplug", "byte": byte},), transport=transport, frames=3000)
    (report,) = outcome.told["plays"]
    assert (report["error"], report["off_confirmed"]) == ("DeviceLostError", False)
    assert report["bytes"] <= byte
    assert outcome.returncode == 0, outcome.err
    assert outcome.told["threads"] == 1
    played = outcome.played()
    assert np.array_equal(played, sent(3000)[: len(played)])


@pytest.mark.parametrize(("kind", "error"), [("stall", "DeviceStallError"), ("nak", "DeviceTimeoutError")])
@pytest.mark.parametrize("request_number", [1, 2])
def test_a_request_that_fails_before_playing_is_told_and_nothing_was_sent(
    tmp_path: Path, kind: str, error: str, request_number: int
) -> None:
    outcome = play(tmp_path, faults=({"kind": kind, "request": request_number},), frames=300, plays=2)
    first, second = outcome.told["plays"]
    assert (first["error"], second["error"], second["frames"]) == (error, None, 300)
    played = outcome.played()
    assert np.array_equal(played[emitting(played)], sent(300))


def test_an_array_that_another_program_has_claimed_is_busy(tmp_path: Path) -> None:
    outcome = run([sys.executable, PLAYER, '{"frames": 10}'], tmp_path, plugs=(Plug(busy=True),))
    assert outcome.returncode == 1
    assert "DeviceBusyError" in outcome.err
    assert outcome.devices[0]["bytes_out"] == 0
