"""What comes before a playback's first frame: kernels are compiled before a board is started, and the time is told."""

import time
from dataclasses import replace

import pytest
import warp as wp

from palpate.datasets import static_pose
from palpate.device.boards.emulator.link import UsbLink
from palpate.device.clock import VirtualClock
from palpate.device.errors import DeviceError
from palpate.device.registry import emulated_backend
from palpate.kernels import PLAYING_STAGES
from palpate.render import DriveStrategy, Palm, closed_contour, record
from palpate.render.playback import file_playback
from palpate.render.playback.file_playback import Connection, play_file
from palpate.render.playback.placed_arrays import load_rig
from palpate.render.sampling.presets import preset
from palpate.render.sampling.strategy import Dwell

VIRTUAL = Connection(clock="virtual")
PACKAGE = "palpate.kernels."


@pytest.fixture(scope="module")
def still(tmp_path_factory):
    path = tmp_path_factory.mktemp("still") / "cube.h5"
    record(path, "cube", Palm(), static_pose([0, 0, 0.2]), closed_contour())
    return path


@pytest.fixture
def loaded(monkeypatch):
    """Stages that Warp loads for launches, in the order in which it first does so."""
    seen, load = [], wp.Module.load

    def note(module, *given, **options):
        stage = module.name.removeprefix(PACKAGE)
        if module.name.startswith(PACKAGE) and stage not in seen:
            seen.append(stage)
        return load(module, *given, **options)

    monkeypatch.setattr(wp.Module, "load", note)
    return seen


@pytest.mark.parametrize(
    ("sampling", "drive"),
    [
        (replace(preset("stm"), dwell=Dwell(time=0.01)), DriveStrategy()),
        (preset("multi-focus"), DriveStrategy()),
        (preset("stm"), DriveStrategy(slew=4 / 256)),
    ],
    ids=["dwelling", "several foci", "slew"],
)
def test_no_kernel_is_loaded_that_was_not_compiled_before_the_start(sampling, drive, still, loaded, monkeypatch):
    ahead = []
    monkeypatch.setattr(file_playback, "uncompiled", lambda stages: ahead.extend(stages) or ())
    play_file(still, duration=0.02, sampling=sampling, drive=drive, connection=VIRTUAL)
    assert set(loaded) <= set(ahead), set(loaded) - set(ahead)
    assert {"sampling.cycles", "sampling.focus"} <= set(loaded)


def test_kernels_are_compiled_between_opening_an_array_and_starting_it(still, monkeypatch):
    events, start = [], UsbLink.start
    monkeypatch.setattr(file_playback, "uncompiled", lambda stages: stages[:2])
    monkeypatch.setattr(file_playback, "compile_now", lambda stages: events.append(("compiled", stages)))
    monkeypatch.setattr(UsbLink, "start", lambda link, divider: events.append("started") or start(link, divider))
    play_file(still, duration=0.01, connection=VIRTUAL, compiling=lambda count: events.append(("told", count)))
    assert events == [("told", 2), ("compiled", PLAYING_STAGES[:2]), "started"]


def test_an_array_that_is_not_there_is_refused_before_anything_is_compiled(still, monkeypatch):
    compiled = []
    monkeypatch.setattr(file_playback, "uncompiled", lambda stages: stages)
    monkeypatch.setattr(file_playback, "compile_now", compiled.append)
    empty = Connection(backend=emulated_backend("pat16", clock=VirtualClock(), serials=("ONE",)), uncalibrated=True)
    with pytest.raises(DeviceError, match="OTHER"):
        play_file(still, array=load_rig("pat16", serial="OTHER"), duration=0.01, connection=empty)
    assert compiled == []


def test_the_time_of_compiling_is_part_of_the_first_frames_and_makes_no_frame_late(still, monkeypatch):
    monkeypatch.setattr(file_playback, "uncompiled", lambda stages: stages)
    monkeypatch.setattr(file_playback, "compile_now", lambda stages: time.sleep(0.3))
    begun = time.perf_counter()
    playback = play_file(still, duration=0.05, connection=VIRTUAL)
    assert 0.3 <= playback.first_frame_seconds <= time.perf_counter() - begun
    assert playback == replace(playback, first_frame_seconds=0.0)  # what is played does not depend on it
    assert (playback.underruns, playback.played.lateness.max) == (0, 0.0)
