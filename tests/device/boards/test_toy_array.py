"""A made-up array, registered as a user's package would do it, in the hands of all that plays to arrays."""

from __future__ import annotations

import inspect
import json
import pickle
from array import array
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner

from palpate.datasets.focus_files.ptlist import write_ptlist
from palpate.device import (
    ArrayKind,
    ArrayKindError,
    ArrayModel,
    Descriptors,
    EmulatedBus,
    EmulationRequest,
    Layout,
    LinkRequest,
    Peripheral,
    Player,
    StreamLink,
    UnknownArrayError,
    UsbIdentity,
    VirtualClock,
    WatchdogError,
    array_model,
    array_names,
    encode_frames,
    find_arrays,
    flat_array,
    flat_grid,
    linear_levels,
    off_frame,
    open_bulk,
    open_link,
    register_array,
    remove_array,
    udev_rule,
)
from palpate.device.codec import duty, is_emitting, switched_count
from palpate.device.playing.watchdog import Watchdog
from palpate.device.registry import emulated_backend
from palpate.render.cli.app import app
from palpate.render.playback.file_playback import Connection, play_file

PAGE = next(folder for folder in Path(__file__).parents if (folder / "docs").is_dir()) / "docs/develop/add-an-array.md"
FRAME = 33


@cache
def toy_model() -> ArrayModel:
    return flat_array(
        "toy",
        flat_grid(4, 4, 10e-3),
        np.arange(16)[::-1],  # its wire begins at the last transducer
        frame_bytes=33,
        fifo_frames=64,
        usb=UsbIdentity(0x1209, 0x0002, "toy makers", "toy array"),
    )


LAYOUT = Layout(
    turn=255,  # steps of delay
    delay_at=slice(1, 17),
    levels=linear_levels(100),
    level_at=slice(17, 33),
    fixed={0: 0xA5},  # a frame starts here
)


class ToyLink(StreamLink):
    def start(self, divider: int) -> None:
        self.array.update_rate(divider)  # raises UpdateRateError
        self.expect_frames(divider)
        self.send_off()


def open_toy(model: ArrayModel, request: LinkRequest) -> ToyLink:
    usb = open_bulk(model, request, endpoint=0x01)
    off = off_frame(array=model).tobytes()
    return ToyLink(
        model,
        usb.transport,
        off,
        serial=usb.serial,
        clock=usb.clock,
        device=usb.device,
    )


class ToyBoard:
    """Takes what comes, at once; a frame plays as soon as all of it is there."""

    underruns = 0

    def __init__(self) -> None:
        self.received = bytearray()

    @property
    def bytes_received(self) -> int:
        return len(self.received)

    @property
    def frames_played(self) -> int:
        return len(self.received) // FRAME

    @property
    def played(self) -> NDArray[np.uint8]:
        return np.frombuffer(bytes(self.received[: self.frames_played * FRAME]), np.uint8).reshape(-1, FRAME)

    @property
    def played_ns(self) -> NDArray[np.int64]:
        return np.zeros(self.frames_played, np.int64)

    @property
    def emitting(self) -> bool:
        return bool(self.played[-1:, 17:].any())

    def accept(self, data: memoryview, *, since_ns: int | None = None) -> int:
        self.received += data
        return len(data)

    def room_at_ns(self, byte_count: int) -> int:
        return 0

    def power_off(self) -> None:
        self.received.clear()


def emulate_toy(request: EmulationRequest) -> EmulatedBus[ToyBoard]:
    def plug(clock: object, serial: str, on_for_ns: int) -> Peripheral[ToyBoard]:
        return Peripheral(Descriptors(0x1209, 0x0002, "toy makers", "toy array", serial, (0x01,), 512), ToyBoard())

    return EmulatedBus(plug, request.serials or ("TOY1",), clock=request.clock)


TOY = ArrayKind(
    name="toy",
    aliases=("plaything",),
    build=toy_model,
    layout=LAYOUT,
    open_link=open_toy,
    emulate=emulate_toy,
)


@pytest.fixture
def toy() -> Iterator[ArrayModel]:
    register_array(TOY)
    yield array_model("toy")
    remove_array("toy")


@pytest.fixture
def bus(toy: ArrayModel) -> EmulatedBus[ToyBoard]:
    return emulated_backend("toy", clock=VirtualClock(), serials=["one", "two"])


def drives(count: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    rng = np.random.default_rng(3)
    return rng.random((count, 16), np.float32), rng.uniform(0.1, 1, count).astype(np.float32)


def test_it_is_known_while_it_is_registered(toy: ArrayModel) -> None:
    assert array_names()[-1] == "toy"
    assert array_model("Play-Thing") is toy is array_model("toy")
    assert 'ATTR{idProduct}=="0002"' in udev_rule(toy)
    assert pickle.loads(pickle.dumps(toy)).name == "toy"
    remove_array("plaything")
    assert "toy" not in array_names()
    with pytest.raises(UnknownArrayError, match="unknown array 'toy'; known: emulator, pat16"):
        array_model("toy")
    register_array(TOY)


def test_its_frames_are_its_own(toy: ArrayModel) -> None:
    delay, amplitude = drives(5)
    frames = encode_frames(delay, amplitude, array="toy")
    assert frames.shape == (5, FRAME)
    assert (frames[:, 0] == 0xA5).all()
    np.testing.assert_array_equal(frames[:, 16:0:-1], np.rint(delay * 255) % 255)
    np.testing.assert_array_equal(frames[:, 17], np.rint(amplitude * 100))
    assert off_frame(array=toy).tolist() == [0xA5] + [0] * 32
    assert is_emitting(np.stack([frames[0], off_frame(array=toy)]), array=toy).tolist() == [True, False]
    np.testing.assert_allclose(duty(frames, array=toy), 2 / np.pi * np.arcsin(np.rint(amplitude * 100) / 100), 1e-6)
    assert switched_count(amplitude, array=toy) == 0


def test_it_is_found_opened_and_played_to(toy: ArrayModel, bus: EmulatedBus[ToyBoard]) -> None:
    assert [(i.array, i.serial, i.certain) for i in find_arrays(bus)] == [("toy", "one", True), ("toy", "two", True)]
    frames = encode_frames(*drives(500), array=toy)
    with open_link(toy, serial="two", backend=bus) as link:
        report = Player(link).play([array("B", frames.tobytes())], update_rate=10e3)
    assert (report.array, report.serial, report.frames, report.off_sent) == ("toy", "two", 500, True)
    played = bus.board(1).played
    off = off_frame(array=toy)
    np.testing.assert_array_equal(played, [off, *frames, off])
    assert not bus.board(0).frames_played


def test_it_is_emulated_where_that_is_asked_for(toy: ArrayModel) -> None:
    with open_link(toy, serial="mine", emulated=True) as link:
        assert link.serial == "mine"
    remove_array("toy")
    register_array(replace(TOY, emulate=None))
    with pytest.raises(UnknownArrayError, match="no board of array 'toy' is emulated; known: emulator, pat16, sonic"):
        open_link(toy, emulated=True)


@pytest.fixture
def points(tmp_path: Path) -> Path:
    path = tmp_path / "points.ptlist"
    position = np.tile(np.array([0.01, 0, 0.2], np.float32), (200, 1))
    write_ptlist(path, position, np.ones(200, np.float32), 10e3)
    return path


def test_a_file_is_played_to_it(toy: ArrayModel, bus: EmulatedBus[ToyBoard], points: Path) -> None:
    playback = play_file(points, array="toy", connection=Connection(backend=bus))
    assert (playback.played.array, playback.played.frames, playback.refused) == ("toy", 200, 0)
    played = bus.board().played
    assert is_emitting(played, array=toy).tolist() == [False, *[True] * 200, False]
    phase = (-np.linalg.norm(toy.position - np.float32([0.01, 0, 0.2]), axis=1) * 40e3 / 343) % 1
    off_by = (played[1, 16:0:-1] / 255 - phase) % 1  # but for a delay that all share
    assert np.ptp((off_by - off_by[0] + 0.5) % 1) < 0.06


def test_the_command_line_plays_to_it(toy: ArrayModel, points: Path) -> None:
    run = CliRunner().invoke(app, ["play", str(points), "--array", "plaything", "--emulate", "--json"])
    assert run.exit_code == 0, run.output
    told = json.loads(run.stdout)
    assert (told["array"], told["serial"], told["frames"]) == ("toy", "TOY1", 200)


def test_no_watchdog_is_said_to_stand_that_could_not_switch_it_off(toy: ArrayModel, bus: EmulatedBus) -> None:
    # The functions of this kind stand in a test, which the watchdog's process cannot import.
    unreachable = "array toy one from its own process: no other process can import"
    with open_link(toy, serial="one", backend=bus) as link, pytest.raises(WatchdogError, match=unreachable):
        Watchdog(link).__enter__()


def test_a_kind_that_cannot_be_is_refused(toy: ArrayModel) -> None:
    before = array_names()
    changes: list[tuple[dict[str, Any], str]] = [
        ({"name": "PAT16"}, r"name of array 'PAT16' is 'PAT16', but it must be small letters"),
        ({"name": "pat-16"}, r"array pat-16 cannot be registered: 'pat-16' is a name of array pat16"),
        ({"name": "openmpd"}, r"'openmpd' is a name of array pat16"),
        ({"name": ""}, r"name of array '' is ''"),
        ({"name": 3}, r"name of array 3 is 3"),
        (
            {"aliases": ("other", "Sonic Surface")},
            r"'Sonic Surface' is a name of array sonicsurface",
        ),
        ({"aliases": "plaything"}, r"aliases of array 'toy' is 'plaything', but it must be a tuple of names"),
        ({"aliases": ("-",)}, r"aliases of array 'toy' is \('-',\)"),
        ({"build": None}, r"build of array 'toy' is None, but it must be a function"),
        ({"layout": open_toy}, r"layout of array 'toy' is <function open_toy .*, but it must be a Layout"),
        ({"open_link": "usb"}, r"open_link of array 'toy' is 'usb', but it must be a function"),
        ({"emulate": 1}, r"emulate of array 'toy' is 1, but it must be a function or None"),
        ({"calibration_serial": True}, r"calibration_serial of array 'toy' is True, but it must be a function or None"),
        ({"takes_baud": 9600}, r"takes_baud of array 'toy' is 9600, but it must be True or False"),
        ({"emulates_itself": None}, r"emulates_itself of array 'toy' is None, but it must be True or False"),
        ({"not_listed": 0}, r"not_listed of array 'toy' is 0, but it must be a sentence or None"),
    ]
    remove_array("toy")
    for change, told in changes:
        with pytest.raises(ArrayKindError, match=told):
            register_array(replace(TOY, **change))
    with pytest.raises(ArrayKindError, match="registered as an ArrayKind, not as 'toy'"):
        register_array("toy")  # type: ignore[arg-type]
    register_array(TOY)
    assert array_names() == before
    with pytest.raises(ArrayKindError, match="array toy cannot be registered: 'toy' is a name of array toy"):
        register_array(TOY)


def test_a_kind_that_builds_something_else_is_told_so() -> None:
    for build, told in (
        (lambda: array_model("pat16"), "build of array toy gives a model named 'pat16'"),
        (lambda: None, "build of array toy gives None, but it must give an ArrayModel"),
    ):
        register_array(replace(TOY, build=build))
        try:
            with pytest.raises(ArrayKindError, match=told):
                array_model("toy")
        finally:
            remove_array("toy")


def test_a_model_of_an_unknown_name_is_refused_everywhere() -> None:
    stranger = toy_model()
    told = "array 'toy' has no wire format; known: emulator, pat16, sonicsurface, autd3"
    for use in (lambda: off_frame(array=stranger), lambda: open_link(stranger), lambda: remove_array("toy")):
        with pytest.raises(UnknownArrayError, match=told if use.__code__.co_freevars else "unknown array 'toy'"):
            use()


def test_the_page_shows_what_is_tried_here() -> None:
    page = PAGE.read_text()
    for part in (toy_model, ToyLink, open_toy):
        assert inspect.getsource(part) in page, part
    source = Path(__file__).read_text()
    assert source[source.index("LAYOUT = ") : source.index("class ToyLink")] in page
    assert len(page.splitlines()) <= 100
