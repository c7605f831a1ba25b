"""Waiting for an array to be silent: not before all that is queued has played; and three attempts to switch it off."""

from __future__ import annotations

from array import array

import pytest
from injected_faults import Fault, FaultKind, inject

from palpate.device import EmulatorBackend, VirtualClock, array_model, open_link
from palpate.device.silence import is_switched_off, wait_silent

FRAME = 512


@pytest.mark.parametrize("stalls", [0, 2, 3])
def test_an_array_is_silent_once_what_it_holds_has_played(stalls: int) -> None:
    bus = EmulatorBackend(clock=VirtualClock(), record=10)
    with open_link(array_model("emulator"), backend=bus) as link:
        link.start(4)
        link.write(array("B", bytes([200] * FRAME) * 5))  # none of them plays yet
        inject(bus, Fault(FaultKind.STALL, byte=5 * FRAME, count=stalls)) if stalls else None
        assert is_switched_off(link) == (stalls < 3)
        if stalls < 3:
            assert wait_silent(link, 4) is True
            assert bus.board().frames_played == 6
        else:  # the last frame plays on
            assert wait_silent(link, 4) is False
        assert bus.board().emitting == (stalls == 3)
