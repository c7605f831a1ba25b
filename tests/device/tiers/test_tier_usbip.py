"""USB/IP over loopback, both ends of the protocol by others: what is played is what was sent, stall, unplug."""

from __future__ import annotations

from array import array

import numpy as np
import pytest
from umockdev_chips import CHIPS, Chip
from usbip_bus import plugged_in

from palpate.device import (
    DeviceLostError,
    DeviceStallError,
    MonotonicClock,
    Player,
    array_model,
)
from palpate.device.boards.discovery import find_arrays, open_link

MODEL = array_model("emulator")
FRAME = 512
RATE = 40e3


def content(count: int) -> np.ndarray:
    return np.random.default_rng(count).integers(1, 256, (count, FRAME), np.uint8)


def blocks(wire: np.ndarray, size: int = 128) -> list[array]:
    return [array("B", wire[first : first + size].tobytes()) for first in range(0, len(wire), size)]


@pytest.fixture
def chip() -> Chip:
    return CHIPS["emulator"]("IP0001", MonotonicClock(), 100_000)


def test_the_array_is_found_by_its_strings_and_content_played_is_content_sent_then_off(chip: Chip) -> None:
    wire = content(3000)  # more than the FIFO holds: the board is the clock
    with plugged_in(chip) as (backend, _):
        assert [(info.array, info.serial) for info in find_arrays(backend=backend)] == [("emulator", "IP0001")]
        with open_link(MODEL, backend=backend) as link:
            report = Player(link).play(blocks(wire), update_rate=RATE)
    played = chip.board.played
    assert np.array_equal(played[: len(wire)], wire)
    assert not played[len(wire) :].any()
    assert not chip.board.emitting
    assert (report.transport, report.frames, report.off_confirmed) == ("sync", len(wire), True)


@pytest.mark.parametrize("byte", [0, 700 * FRAME + 100])
def test_a_stall_ends_the_playback_with_the_array_off_and_it_plays_again(chip: Chip, byte: int) -> None:
    wire = content(3000)
    with plugged_in(chip) as (backend, bus), open_link(MODEL, backend=backend) as link:
        player = Player(link)
        bus.stall_at = byte
        with pytest.raises(DeviceStallError) as caught:
            player.play(blocks(wire), update_rate=RATE)
        assert not chip.board.emitting
        assert caught.value.report is not None
        before = len(chip.board.played)
        assert player.play(blocks(wire[:50]), update_rate=RATE).frames == 50
    again = chip.board.played[before:]
    assert np.array_equal(again[again.any(axis=1)], wire[:50])
    first = chip.board.played[:before]
    on = first[first.any(axis=1)]
    assert np.array_equal(on[:-1], wire[: max(len(on) - 1, 0)])  # the last may be torn


def test_an_unplugged_array_is_lost_and_the_count_is_of_what_it_took(chip: Chip) -> None:
    wire = content(3000)
    with plugged_in(chip) as (backend, bus), open_link(MODEL, backend=backend) as link:
        bus.unplug_at = 1000 * FRAME
        with pytest.raises(DeviceLostError) as caught:
            Player(link).play(blocks(wire), update_rate=RATE)
    assert not chip.board.emitting
    assert caught.value.report is not None
    assert caught.value.report.frames <= 1000
    assert not caught.value.report.off_confirmed
