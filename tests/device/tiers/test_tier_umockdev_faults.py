"""umockdev: what goes wrong on a bus, on both transports; the array ends off or is lost, and the counts are true."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from umockdev_checks import FRAME, TRANSPORTS, assert_beginning_then_off, emitting, play, sent
from umockdev_session import Plug, missing

pytestmark = pytest.mark.skipif(missing() is not None, reason=str(missing()))

AFTER = 700 * FRAME
TORN = AFTER + 100


def faulty(**fault: object) -> Plug:
    return Plug(faults=(fault,))


@pytest.mark.exhaustive(but=f"{TORN}-")
@pytest.mark.parametrize("transport", TRANSPORTS)
@pytest.mark.parametrize("byte", [0, AFTER, TORN])
def test_a_stall_ends_with_the_array_off_and_it_plays_again(tmp_path: Path, transport: str, byte: int) -> None:
    outcome = play(tmp_path, faulty(kind="stall", byte=byte), transport=transport, frames=1500, plays=2)
    first, second = outcome.told["plays"]
    board, played, wire = outcome.devices[0], outcome.played(), sent(frames=1500)
    assert first["error"] == "DeviceStallError"
    assert "stall" in first["message"]
    assert (second["error"], second["frames"], second["off_confirmed"]) == (None, 1500, True)
    assert board["halts_cleared"] >= 1
    assert board["emitting"] is False
    assert np.array_equal(played[emitting(played)][-1500:], wire)
    before = len(played) - 1500 - int(np.argmax(emitting(played)[::-1]))
    assert_beginning_then_off(np.vstack([played[:before], np.zeros((1, FRAME), np.uint8)]), wire)


@pytest.mark.exhaustive(but=f"{TORN}-")
@pytest.mark.parametrize("transport", TRANSPORTS)
@pytest.mark.parametrize("byte", [0, AFTER, TORN])
def test_a_device_that_takes_nothing_for_a_while(tmp_path: Path, transport: str, byte: int) -> None:
    """Blocking writes go on after their time limit; queued ones give up after a second without progress."""
    outcome = play(tmp_path, faulty(kind="nak", byte=byte), transport=transport, frames=1500, plays=2)
    first, second = outcome.told["plays"]
    played, wire = outcome.played(), sent(frames=1500)
    if transport == "sync":
        assert (first["error"], first["frames"], first["off_confirmed"]) == (None, 1500, True)
        assert first["short_writes"] >= 1
        assert np.array_equal(played[emitting(played)], np.vstack([wire, wire]))
    else:
        assert first["error"] == "DeviceTimeoutError"
        assert second["error"] is None
        assert np.array_equal(played[emitting(played)][-1500:], wire)
        assert outcome.devices[0]["discarded_partly"] <= 1
    assert (second["frames"], second["off_confirmed"]) == (1500, True)
    assert outcome.devices[0]["emitting"] is False


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("transport", TRANSPORTS)
def test_a_device_that_takes_nothing_any_more_is_told_and_holds_its_frame(tmp_path: Path, transport: str) -> None:
    outcome = play(tmp_path, faulty(kind="nak", byte=TORN, count=None), transport=transport, frames=1500)
    (report,) = outcome.told["plays"]
    assert report["error"] == "DeviceTimeoutError"
    assert report["off_confirmed"] is False
    wire, played = sent(frames=1500), outcome.played()
    assert np.array_equal(played, wire[: len(played)])
    assert report["frames"] * FRAME <= TORN
    assert outcome.devices[0]["bytes_out"] == TORN


@pytest.mark.exhaustive(but=f"{TORN}-")
@pytest.mark.parametrize("transport", TRANSPORTS)
@pytest.mark.parametrize("byte", [AFTER, TORN])
def test_a_short_transfer_loses_nothing_or_is_told(tmp_path: Path, transport: str, byte: int) -> None:
    outcome = play(tmp_path, faulty(kind="short", byte=byte), transport=transport, frames=1500, plays=2)
    first, second = outcome.told["plays"]
    wire, played = sent(frames=1500), outcome.played()
    if transport == "sync":
        assert (first["error"], first["short_writes"], first["frames"]) == (None, 1, 1500)
        assert np.array_equal(played[emitting(played)][:1500], wire)
    else:  # the kernel had the next transfers already, so what followed was not what should have
        assert first["error"] in (None, "LinkError")
        assert "torn" in first["message"] or first["short_writes"] == 1
    assert (second["error"], second["frames"], second["off_confirmed"]) == (None, 1500, True)
    assert np.array_equal(played[emitting(played)][-1500:], wire)


@pytest.mark.exhaustive(but=f"{TORN}-")
@pytest.mark.parametrize("transport", TRANSPORTS)
@pytest.mark.parametrize("byte", [0, TORN])
def test_unplugged_while_playing_it_is_lost_and_nothing_hangs(tmp_path: Path, transport: str, byte: int) -> None:
    outcome = play(tmp_path, faulty(kind="unplug", byte=byte), transport=transport, frames=3000)
    (report,) = outcome.told["plays"]
    assert report["error"] == "DeviceLostError"
    assert report["off_confirmed"] is False
    assert report["bytes"] <= byte
    assert outcome.returncode == 0, outcome.err
    assert outcome.told["threads"] == 1
    played = outcome.played()
    assert np.array_equal(played, sent(frames=3000)[: len(played)])


@pytest.mark.exhaustive(but="1-")
@pytest.mark.parametrize(("kind", "error"), [("stall", "DeviceStallError"), ("nak", "DeviceTimeoutError")])
@pytest.mark.parametrize("request_number", [1, 2])
def test_a_request_that_fails_before_playing_is_told_and_nothing_was_sent(
    tmp_path: Path, kind: str, error: str, request_number: int
) -> None:
    outcome = play(tmp_path, faulty(kind=kind, request=request_number), frames=300, plays=2)
    first, second = outcome.told["plays"]
    assert first["error"] == error
    assert (second["error"], second["frames"]) == (None, 300)
    played = outcome.played()
    assert np.array_equal(played[emitting(played)], sent(frames=300))


def test_an_array_that_another_program_has_claimed_is_busy(tmp_path: Path) -> None:
    outcome = play(tmp_path, Plug(busy=True), frames=10)
    assert outcome.returncode == 1
    assert "DeviceBusyError" in outcome.err
    assert outcome.devices[0]["bytes_out"] == 0
