"""Focal points of contours on the array `stratos`: what its bridge was handed, prepared frames, refusals."""

import threading
from itertools import pairwise

import numpy as np
import pytest
from bridge_cases import PlayingBridge, ScriptedBridge
from command_line import answer

from palpate.datasets import HandMotion
from palpate.datasets.focus_files.ptlist import write_ptlist
from palpate.device import VirtualClock, array_model
from palpate.device.boards.stratos.model import EmulatedBridge
from palpate.render import (
    Connection,
    DriveStrategy,
    PlacedArray,
    SamplingStrategy,
    exploration,
    play_file,
    prepare_frames,
    render,
)
from palpate.render.errors import StrategyError
from palpate.render.playback import file_playback

DURATION = 0.1
FOUR = SamplingStrategy(foci=4, update_rate=10e3)
ONE = SamplingStrategy(update_rate=20e3)


@pytest.fixture(scope="module")
def contours():
    whole = exploration("tube", duration=1.0, rate=90.0, seed=3)
    first = int(np.argmax(render("tube", "palm", whole, "cc").length() > 0))  # from then on the hand touches it
    return render("tube", "palm", HandMotion(whole.time[first:] - whole.time[first], whole.pose[first:]), "cc")


@pytest.fixture(scope="module")
def path(contours, tmp_path_factory):
    return contours.save(tmp_path_factory.mktemp("stratos") / "tube.h5")


def handed_over(bridge):
    """Values of all samples, float32, and the times between them [ns]."""
    assert bridge.board().frames_played >= 0  # plays what is due
    samples, began_ns = zip(*bridge.board().played, strict=True)
    return np.array([np.frombuffer(sample, "<f4") for sample in samples]), {b - a for a, b in pairwise(began_ns)}


def bridge_of(name="stratos"):
    return EmulatedBridge(clock=VirtualClock(), record=1 << 20)


@pytest.mark.parametrize("sampling", [ONE, FOUR], ids=["one", "four"])
def test_what_is_handed_over_are_the_focal_points_of_the_sampling_and_silence_after_them(contours, path, sampling):
    bridge = bridge_of()
    playback = play_file(
        path, array="stratos", sampling=sampling, duration=DURATION, connection=Connection(backend=bridge)
    )
    values, periods = handed_over(bridge)
    focus = contours.sample(sampling, duration=DURATION).focus
    position = np.asarray(focus.position, np.float32).reshape(len(values) - 1, sampling.foci, 3)
    intensity = np.asarray(focus.intensity, np.float32).reshape(len(values) - 1, sampling.foci)
    found = values.reshape(-1, sampling.foci, 4)
    sounds = intensity > 0
    assert sounds.mean() > 0.3
    np.testing.assert_array_equal(found[:-1, :, :3][sounds], position[sounds])
    np.testing.assert_allclose(found[:-1, :, 3], intensity, rtol=0, atol=0 if sampling.foci == 1 else 2**-17)
    assert not found[-1, :, 3].any()
    assert periods == {round(1e9 / sampling.update_rate)}
    assert (playback.played.frames, playback.played.board_underruns) == (len(values) - 1, 0)
    assert bridge.board().intensity == 0


@pytest.mark.parametrize("sampling", [ONE, FOUR], ids=["one", "four"])
def test_prepared_frames_are_those_of_playing(path, sampling, tmp_path):
    drive = DriveStrategy(amplitude="force", level_max=0.5)
    options = {"array": "stratos", "sampling": sampling, "drive": drive, "duration": DURATION}
    wanted, found = bridge_of(), bridge_of()
    source = play_file(path, **options, connection=Connection(backend=wanted))
    prepare_frames(path, tmp_path / "frames.h5", **options)
    playback = play_file(tmp_path / "frames.h5", array="stratos", connection=Connection(backend=found))
    assert list(found.board().played) == list(wanted.board().played)
    assert playback == source
    for other in ("emulator", "pat16", [PlacedArray(array_model("stratos").placed([0, 0, 0.4, 1, 0, 0, 0]))]):
        with pytest.raises(StrategyError, match=r"holds frames for stratos \(\w+\), not for"):
            play_file(tmp_path / "frames.h5", array=other, connection=Connection(emulate=True))
    prepare_frames(path, tmp_path / "other.h5", array="emulator", duration=DURATION)
    with pytest.raises(StrategyError, match=r"holds frames for emulator \(\w+\), not for stratos"):
        play_file(tmp_path / "other.h5", array="stratos", connection=Connection(emulate=True))


def test_what_it_cannot_be_asked_for_is_refused_before_it_is_opened(path, tmp_path):
    opened = Connection(backend=object())  # never opened, else it would fail otherwise
    for drive, field in (
        (DriveStrategy(slew=0.01), "slew is 0.01"),
        (DriveStrategy(solver="wgs"), "solver is wgs"),
        (DriveStrategy(sound_speed=340.0), "sound_speed is 340"),
    ):
        for play in (
            lambda drive=drive: play_file(path, array="stratos", drive=drive, duration=0.1, connection=opened),
            lambda drive=drive: prepare_frames(
                path, tmp_path / "x.h5", array="stratos", drive=drive, duration=0.1, overwrite=True
            ),
        ):
            with pytest.raises(StrategyError, match=f"{field}.*but array stratos takes focal points"):
                play()
    assert not (tmp_path / "x.h5").exists()


def test_a_watchdog_needs_no_process_where_the_bridge_is_one(path, monkeypatch):
    def no_watchdog(link):
        raise AssertionError(f"a watchdog was started for {link}")

    monkeypatch.setattr(file_playback, "Watchdog", no_watchdog)
    bridge, before = PlayingBridge(), threading.active_count()
    with ScriptedBridge(bridge) as server:
        own = [PlacedArray(array_model("stratos"), server.address)]
        playback = play_file(path, array=own, duration=0.05, sampling=ONE, connection=Connection(watchdog=True))
    assert playback.played.frames == 1000
    assert len(bridge.samples) == 1001 * 16
    assert threading.active_count() == before
    with pytest.raises(StrategyError, match="a watchdog is for real arrays"):
        play_file(path, array="stratos", duration=0.05, connection=Connection(watchdog=True, emulate=True))


@pytest.fixture
def points(tmp_path):
    path = tmp_path / "points.ptlist"
    write_ptlist(path, np.tile(np.float32([0.01, 0, 0.2]), (200, 1)), np.ones(200, np.float32), 40e3)
    return path


def test_the_command_line_plays_to_it_by_any_of_its_names(points):
    for name in ("stratos", "USX"):
        told = answer("play", points, "--array", name, "--emulate", "--clock", "virtual")
        assert (told["array"], told["serial"], told["frames"]) == ("stratos", "USX:EMULATED", 200)
        assert told["off_confirmed"] is None
        assert "does not say whether the array is silent" in told["off_doubt"]
