"""A made-up array of focal points, registered as a user's package would do it: others can have one."""

from __future__ import annotations

import struct
from array import array
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from palpate.datasets.focus_files.ptlist import write_ptlist
from palpate.device import (
    ArrayKind,
    ArrayKindError,
    ArrayModel,
    BoardStatus,
    EmulationRequest,
    FocusLayout,
    LinkRequest,
    Player,
    VirtualClock,
    array_model,
    flat_array,
    flat_grid,
    open_link,
    register_array,
    remove_array,
)
from palpate.device.boards.emulator.kind import KIND as EMULATOR
from palpate.device.codec import is_emitting
from palpate.device.link import Link, never
from palpate.device.registry import emulated_backend
from palpate.render import Driver
from palpate.render.cli.app import app
from palpate.render.playback.file_playback import Connection, play_file


def points_model() -> ArrayModel:
    return flat_array(
        "points",
        flat_grid(4, 4, 12e-3),
        np.arange(16),
        frame_bytes=16,
        fifo_frames=64,
        takes_points=True,
    )


class PointsLink(Link):
    """Takes all at once, plays it in no time, and confirms that it is silent."""

    transport, bytes_sent, bytes_under_way, off_bytes = "points", 0, 0, b""
    serial = "P1"

    def __init__(self, model: ArrayModel, bus: PointsBus) -> None:
        self.array, self.clock, self._bus = model, bus.clock, bus
        self.off_bytes = bytes(model.frame_bytes)

    def start(self, divider: int) -> None:
        self.array.update_rate(divider)
        self._divider = divider

    def write(self, data: array[int], *, abandon: Callable[[], bool] = never) -> None:
        self._bus.received += data.tobytes()
        self.bytes_sent += len(data)

    def drain(self, *, abandon: Callable[[], bool] = never) -> bool:
        return True

    def cancel(self) -> None: ...

    def status(self) -> BoardStatus:
        size = self.array.frame_bytes
        last = self._bus.received[-size:]
        return BoardStatus(len(self._bus.received) // size, 0, 0, 0, 0, int(any(last[12::16])), self._divider)

    def send_off(self) -> None:
        self.write(array("B", self.off_bytes))

    def close(self) -> None: ...


class PointsBus:
    def __init__(self, request: EmulationRequest) -> None:
        self.clock = request.clock or VirtualClock()
        self.received = b""

    def unplug(self, *, index: int = 0) -> None: ...

    def replug(self, *, index: int = 0) -> None: ...


def open_points(model: ArrayModel, request: LinkRequest) -> PointsLink:
    assert isinstance(request.backend, PointsBus)
    return PointsLink(model, request.backend)


POINTS = ArrayKind(name="points", build=points_model, layout=FocusLayout(), open_link=open_points, emulate=PointsBus)


@pytest.fixture
def bus() -> Iterator[PointsBus]:
    register_array(POINTS)
    yield emulated_backend("points", clock=VirtualClock())
    remove_array("points")


def test_it_is_played_to_and_confirms_that_it_is_off(bus: PointsBus) -> None:
    frames = [struct.pack("<4f", 0.01, 0.0, 0.2, k / 100) for k in range(100)]
    with open_link(array_model("points"), backend=bus) as link:
        report = Player(link).play([b"".join(frames)], update_rate=10e3)
    assert bus.received == b"".join(frames) + bytes(16)
    assert (report.array, report.frames, report.off_confirmed, report.off_doubt) == ("points", 100, True, None)


def test_a_file_is_played_to_it_as_its_focal_points(bus: PointsBus, tmp_path: Path) -> None:
    path = tmp_path / "points.ptlist"
    rng = np.random.default_rng(2)
    position = rng.uniform([-0.05, -0.05, 0.1], [0.05, 0.05, 0.3], (50, 3)).astype(np.float32)
    write_ptlist(path, position, np.ones(50, np.float32), 10e3)
    playback = play_file(path, array="points", connection=Connection(backend=bus))
    assert (playback.played.frames, playback.refused) == (50, 0)
    values = np.frombuffer(bus.received, "<f4").reshape(-1, 4)
    np.testing.assert_array_equal(values[:-1, :3], position)
    assert values[:, 3].tolist() == [1.0] * 50 + [0.0]


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        (
            replace(EMULATOR, name="points", aliases=(), build=points_model),
            r"build of array points gives a model with takes_points=True, but its layout is Layout\(256 steps",
        ),
        (
            replace(POINTS, build=lambda: replace(points_model(), takes_points=False)),
            r"build of array points gives a model with takes_points=False, but its layout is FocusLayout\(\)",
        ),
    ],
)
def test_a_model_that_does_not_take_what_its_kind_says_is_refused(kind: ArrayKind, message: str) -> None:
    register_array(kind)
    try:
        with pytest.raises(ArrayKindError, match=message):
            array_model("points")
    finally:
        remove_array("points")


def test_the_command_line_and_predictions_know_it(bus: PointsBus, tmp_path: Path) -> None:
    path = tmp_path / "points.ptlist"
    write_ptlist(path, np.full((20, 3), 0.1, np.float32), np.ones(20, np.float32), 10e3)
    run = CliRunner().invoke(app, ["play", str(path), "--array", "points", "--emulate"])
    assert run.exit_code == 0, run.output
    assert Driver("points").takes_points
    assert is_emitting(np.ones((1, 16), np.uint8), array="points").tolist() == [True]
