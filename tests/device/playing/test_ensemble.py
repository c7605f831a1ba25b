"""Several arrays at once: whoever starts late plays all of its own, and whatever happens all are off in the end."""

from __future__ import annotations

import os
import signal
import threading
from array import array
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from injected_faults import Fault, FaultKind, inject

from palpate.device import EmulatorBackend, Link, PlayInterrupted, array_model, open_link
from palpate.device.errors import DeviceTimeoutError, LinkError, UpdateRateError
from palpate.device.playing.ensemble import play_together

RATE = 10e3
WIRE = array("B", np.full((100, 512), 200, np.uint8).tobytes())


class LateLink:
    """A link that starts only once it is let."""

    def __init__(self, link: Link, may_start: threading.Event) -> None:
        self._link, self._may_start = link, may_start

    def __getattr__(self, name: str) -> Any:
        return getattr(self._link, name)

    def start(self, divider: int) -> None:
        assert self._may_start.wait(30)
        self._link.start(divider)


def pair() -> tuple[list[EmulatorBackend], list[Link]]:
    buses = [EmulatorBackend(), EmulatorBackend(("EMU2",))]
    return buses, [open_link(array_model("emulator"), backend=bus) for bus in buses]


def are_off(buses: list[EmulatorBackend]) -> bool:
    return not any(bus.board().playing[1::2].any() for bus in buses)


@pytest.mark.exhaustive
@pytest.mark.parametrize("count", [3, 8])
def test_one_that_starts_when_the_other_has_played_all_plays_all_too(count: int) -> None:
    buses, links = pair()
    may_start = threading.Event()
    threading.Timer(0.5, may_start.set).start()
    late: Any = LateLink(links[1], may_start)
    reports = play_together([links[0], late], [(WIRE, WIRE)] * count, update_rate=RATE)
    assert [report.frames for report in reports] == [100 * count] * 2
    assert [report.stopped_by for report in reports] == ["end", "end"]
    assert are_off(buses)


@pytest.mark.exhaustive
def test_a_signal_tells_of_the_array_that_may_still_be_on() -> None:
    buses, links = pair()

    def blocks() -> Iterator[tuple[array[int], array[int]]]:
        for number in range(10_000):
            if number == 30:
                inject(buses[1], Fault(FaultKind.TIMEOUT, byte=buses[1].board().bytes_received, count=None))
                for request in (2, 3):
                    inject(buses[1], Fault(FaultKind.STALL, request=request, count=None))
                os.kill(os.getpid(), signal.SIGINT)
            yield WIRE, WIRE

    with pytest.raises(PlayInterrupted) as caught:
        play_together(links, blocks(), update_rate=RATE)
    assert caught.value.report.serial == "EMU2"
    assert caught.value.report.may_emit
    assert "may still be emitting" in str(caught.value)
    assert isinstance(caught.value.__cause__, LinkError)
    assert not buses[0].board().playing[1::2].any()


def test_a_signal_that_finds_all_well_switches_all_off() -> None:
    buses, links = pair()

    def blocks() -> Iterator[tuple[array[int], array[int]]]:
        for number in range(10_000):
            if number == 30:
                os.kill(os.getpid(), signal.SIGTERM)
            yield WIRE, WIRE

    with pytest.raises(PlayInterrupted) as caught:
        play_together(links, blocks(), update_rate=RATE)
    assert caught.value.__cause__ is None
    assert caught.value.report.stopped_by == "SIGTERM"
    assert are_off(buses)


def test_what_the_maker_of_blocks_raises_passes_through_once_all_are_off() -> None:
    buses, links = pair()

    def blocks() -> Iterator[tuple[array[int], array[int]]]:
        for _ in range(20):
            yield WIRE, WIRE
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        play_together(links, blocks(), update_rate=RATE)
    assert are_off(buses)


@pytest.mark.exhaustive
def test_an_array_that_fails_stops_the_others() -> None:
    buses, links = pair()
    inject(buses[1], Fault(FaultKind.TIMEOUT, byte=1_000_000, count=None))
    with pytest.raises(DeviceTimeoutError):
        play_together(links, ((WIRE, WIRE) for _ in range(100_000)), update_rate=RATE)
    assert not buses[0].board().playing[1::2].any()


def test_a_rate_that_one_of_them_lacks_is_refused_before_any_is_started() -> None:
    buses, links = pair()
    with pytest.raises(UpdateRateError):
        play_together(links, [(WIRE, WIRE)], update_rate=7000.0)
    assert [bus.board().bytes_received for bus in buses] == [0, 0]
