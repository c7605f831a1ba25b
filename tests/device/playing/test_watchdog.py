"""The watchdog: what it does when the player says goodbye, dies, or falls silent; real deaths: umockdev tier."""

from __future__ import annotations

import json
import math
import os
import threading
import time
from array import array
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from injected_faults import Fault, FaultKind, inject

from palpate.device import (
    DeviceBusyError,
    UnknownArrayError,
    UsbLink,
    VirtualClock,
    WatchdogError,
    array_model,
    encode_frames,
    open_link,
    remove_array,
)
from palpate.device.playing.watchdog import (
    EXIT_FAILED,
    EXIT_GOODBYE,
    EXIT_OFF,
    Watchdog,
    keep_watch,
    read_order,
    switch_off,
)
from palpate.device.registry import emulated_backend


class Watched:
    """A pipe to a watchdog in a thread, and what it did."""

    def __init__(self, *, silence_max: float = 30.0, reason: str | None = None) -> None:
        self.reason = reason
        self.offs: list[float] = []
        self.said: list[str] = []
        self.code: int | None = None
        self._read, self.write = os.pipe()
        self._thread = threading.Thread(target=self._watch, args=(silence_max,))
        self._thread.start()

    def _watch(self, silence_max: float) -> None:
        def off(patience: float) -> str | None:
            self.offs.append(patience)
            return self.reason

        self.code = keep_watch(self._read, silence_max, off, self.said.append)

    def send(self, data: bytes) -> None:
        os.write(self.write, data)

    def wait_until(self, condition) -> None:
        end = time.monotonic() + 20
        while not condition() and time.monotonic() < end:
            time.sleep(0.005)
        assert condition()

    def end(self) -> int | None:
        os.close(self.write)
        self._thread.join(20)
        os.close(self._read)
        return self.code


def test_after_goodbye_it_does_nothing() -> None:
    watched = Watched()
    watched.send(b"..")
    watched.send(b"G")
    assert watched.end() == EXIT_GOODBYE
    assert (watched.offs, watched.said) == ([], [])


def test_a_pipe_that_closes_without_goodbye_switches_off_with_patience_for_the_system() -> None:
    watched = Watched()
    watched.send(b".")
    assert watched.end() == EXIT_OFF
    assert len(watched.offs) == 1
    assert watched.offs[0] > 1
    assert watched.said == ["the player ended without goodbye; the array was switched off"]


def test_if_it_cannot_it_says_why_and_its_exit_code_says_so() -> None:
    watched = Watched(reason="array x is gone")
    assert watched.end() == EXIT_FAILED
    assert watched.said == ["the player ended without goodbye; the array may still be emitting: array x is gone"]


def test_silence_is_met_once_and_heartbeats_make_it_good() -> None:
    watched = Watched(silence_max=0.05, reason="array x is in use")
    watched.wait_until(lambda: watched.said)
    time.sleep(0.15)
    assert watched.offs == [0.0]
    assert watched.said == [
        "the player has given no sign of life for 0.05 s; the array may be emitting: array x is in use"
    ]
    watched.send(b".")
    watched.wait_until(lambda: len(watched.offs) == 2)  # the player came back, and fell silent again
    watched.send(b"G")
    watched.end()
    assert watched.code == EXIT_GOODBYE


@pytest.mark.parametrize(
    ("name", "request_number"), [("emulator", None), ("emulator", 1), ("pat16", 9), ("sonicsurface", None)]
)
def test_it_silences_what_a_dead_player_left_although_a_request_fails(name: str, request_number: int | None) -> None:
    model = array_model(name)
    bus = emulated_backend(name, clock=VirtualClock())
    wire = encode_frames(np.zeros((9, 256)), np.ones(9), array=model)
    with open_link(model, backend=bus) as dead:
        dead.start(model.divider_default)
        dead.write(array("B", wire.tobytes()[: 8 * model.frame_bytes + 200]))
    bus.clock.advance(20 / model.frame_clock * model.divider_default)
    assert bus.board().emitting
    if request_number is not None:
        inject(bus, Fault(FaultKind.STALL, request=request_number))
    switch_off(model, None, backend=bus)
    bus.clock.advance(1)
    assert not bus.board().emitting


def test_it_waits_for_the_system_to_take_the_array_from_the_dead() -> None:
    model = array_model("emulator")
    bus = emulated_backend("emulator")
    holder = open_link(model, backend=bus)
    threading.Timer(0.2, holder.close).start()
    switch_off(model, None, backend=bus, patience=20)
    with open_link(model, backend=bus), pytest.raises(DeviceBusyError):
        switch_off(model, None, backend=bus, patience=0)


@pytest.fixture
def unreachable() -> Iterator[UsbLink]:
    with open_link(array_model("emulator"), backend=emulated_backend("emulator")) as link:
        yield link


@pytest.mark.exhaustive
def test_an_array_that_another_process_cannot_reach_is_refused(unreachable: UsbLink) -> None:
    with (
        pytest.raises(WatchdogError, match="cannot reach array emulator EMU0001 from its own process: "),
        Watchdog(unreachable),
    ):
        pytest.fail("it was entered")


def test_an_array_that_is_not_on_usb_is_refused() -> None:
    class Networked:
        array = array_model("autd3")
        serial = None

    with pytest.raises(WatchdogError, match="arrays on USB or at a serial port, which autd3 is not"):
        Watchdog(Networked())


def test_a_time_of_nothing_is_refused(unreachable: UsbLink) -> None:
    with pytest.raises(WatchdogError, match="silence_max is 0"):
        Watchdog(unreachable, silence_max=0)


ORDER = {
    "array": "pat16",
    "modules": ["palpate.device.boards.pat16.kind"],
    "serial": None,
    "baud": None,
    "silence_max": 2.0,
    "log": None,
}


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "[" * 100_000,
        "{}",
        *(
            json.dumps(ORDER | change)
            for change in ({"array": 3}, {"serial": ["a"]}, {"silence_max": True}, {"modules": [3]})
        ),
        *(json.dumps(ORDER | change) for change in ({"silence_max": -1}, {"silence_max": math.nan}, {"more": 1})),
        json.dumps(ORDER | {"silence_max": math.inf}),
    ],
)
def test_an_order_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(WatchdogError, match=r"order|silence_max"):
        read_order(text)


def test_an_order_is_read_back_and_names_what_cannot_be_imported() -> None:
    assert read_order(json.dumps(ORDER)).model() is array_model("pat16")
    with pytest.raises(WatchdogError, match=r"no other process can import no\.such\.module, which has array mine"):
        read_order(json.dumps(ORDER | {"array": "mine", "modules": ["no.such.module"]})).model()
    with pytest.raises(UnknownArrayError, match="unknown array 'mine'"):
        read_order(json.dumps(ORDER | {"array": "mine"})).model()
    with pytest.raises(WatchdogError, match="no other process can make array pat16 from their_array"):
        read_order(json.dumps(ORDER | {"modules": ["their_array"]})).model()  # theirs has taken a built-in one's name


def test_a_kind_of_a_users_own_is_found_in_its_module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "their_array.py").write_text(
        "from dataclasses import replace\n"
        "from palpate.device.boards.emulator.kind import KIND, emulator_model\n"
        "OWN = replace(KIND, name='theirs', build=lambda: replace(emulator_model(), name='theirs'))\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    modules = ["their_array", "palpate.device.boards.emulator.link"]  # it opens its link as the emulator does
    try:
        assert read_order(json.dumps(ORDER | {"array": "theirs", "modules": modules})).model().name == "theirs"
    finally:
        remove_array("theirs")
