"""umockdev: the model of a pat16 behind its FTDI chip, played to through the real libusb, on both transports."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from umockdev_checks import FRAME, TRANSPORTS, emitting, play, sent

pytestmark = [pytest.mark.exhaustive, pytest.mark.usefixtures("umockdev")]
EACH_TRANSPORT = pytest.mark.parametrize("transport", TRANSPORTS)


@EACH_TRANSPORT
def test_pat16_plays_what_was_sent_then_off_and_its_driver_is_bound_again(tmp_path: Path, transport: str) -> None:
    outcome = play(tmp_path, array="pat16", transport=transport, rate=10e3, frames=2000, plays=2)
    played, board = outcome.played(), outcome.devices[0]
    assert np.array_equal(played[emitting(played, "pat16")], np.tile(sent(2000, tmp_path), (2, 1)))
    assert not emitting(played[-1:], "pat16")
    for report in outcome.told["plays"]:
        assert (report["error"], report["frames"], report["off_sent"]) == (None, 2000, True)
        assert (report["off_confirmed"], report["board_underruns"]) == (None, None)  # the board never answers
    assert (board["divider"], board["bindings"]) == (4, ["-ftdi_sio", "+ftdi_sio"])


@EACH_TRANSPORT
def test_a_stopped_pat16_is_off_after_a_beginning(tmp_path: Path, transport: str) -> None:
    options = {"rate": 10e3, "frames": 3000, "forever": True, "stop_after": 1000}
    outcome = play(tmp_path, array="pat16", transport=transport, **options)
    (report,) = outcome.told["plays"]
    played, board, wire = outcome.played(), outcome.devices[0], sent(3000, tmp_path)
    on = played[emitting(played, "pat16")]
    assert (report["error"], report["stopped_by"], report["off_sent"]) == (None, "stop", True)
    assert board["emitting"] is False
    assert np.array_equal(on[:-1], wire[: len(on) - 1])
    assert len(on) == pytest.approx(report["frames"], abs=1)
    torn = on[-1] != wire[len(on) - 1]
    assert not (on[-1][torn]).any()  # its part that did not come is silent
    assert board["discarded_partly"] <= 1


@EACH_TRANSPORT
@pytest.mark.parametrize("byte", [40 * FRAME + 511, 600 * FRAME + 100])
def test_a_pat16_whose_chip_stalls_goes_off_and_plays_again(tmp_path: Path, transport: str, byte: int) -> None:
    faults = ({"kind": "stall", "byte": byte},)
    outcome = play(tmp_path, array="pat16", faults=faults, transport=transport, rate=10e3, frames=1000, plays=2)
    first, second = outcome.told["plays"]
    played = outcome.played()
    assert (first["error"], first["off_sent"]) == ("DeviceStallError", True)
    assert (second["error"], second["frames"]) == (None, 1000)
    on = emitting(played, "pat16")
    assert np.array_equal(played[on][-1000:], sent(1000, tmp_path))
    assert (~on[: int(np.flatnonzero(on)[-1000])][-1:]).all()  # silent in between
    assert outcome.devices[0]["emitting"] is False
