"""Prepared frames: the bytes that playing the contour file sends, on the same arrays only, whole or refused."""

import os
import shutil
import signal
import subprocess
import sys
import time

import h5py
import numpy as np
import pytest
from command_line import FAILED, MISUSED, answer, refused

from palpate.datasets import HandMotion
from palpate.datasets.errors import ContourFileError
from palpate.datasets.focus_files.frame_reader import check_frames
from palpate.datasets.focus_files.ptlist import write_ptlist
from palpate.device import Limits, array_model
from palpate.device.clock import VirtualClock
from palpate.device.codec import is_emitting
from palpate.device.errors import SafetyLimitError
from palpate.device.registry import emulated_backend
from palpate.render import (
    Connection,
    MeshObject,
    Palm,
    PlacedArray,
    closed_contour,
    exploration,
    play_file,
    prepare_frames,
    record,
    render,
)
from palpate.render.errors import StrategyError
from palpate.render.playback.drive import DriveStrategy
from palpate.render.playback.prepared_frames import PreparedFrames
from palpate.render.sampling.strategy import SamplingStrategy

VIRTUAL = Connection(clock="virtual", emulate=True)
ABOVE = [0, 0, 0.4, 1, 0, 0, 0]
SLOW = SamplingStrategy(update_rate=2000.0)


@pytest.fixture(scope="module")
def contours(tmp_path_factory):
    path = tmp_path_factory.mktemp("prepared") / "tube.h5"
    tube = MeshObject.load("tube")
    whole = exploration(tube.bounds, duration=3.0, rate=90.0, seed=3, model="around")
    first = int(np.argmax(render(tube, Palm(), whole, closed_contour()).length() > 0))
    kept = slice(first, first + 90)  # the hand touches the tube from the beginning on
    motion = HandMotion(whole.time[kept] - whole.time[first], whole.pose[kept])
    record(path, tube, Palm(), motion, closed_contour())
    return path


@pytest.fixture(scope="module")
def prepared(contours):
    prepare_frames(contours, contours.with_name("prepared.h5"), sampling=SLOW)
    return contours.with_name("prepared.h5")


@pytest.fixture
def frames(prepared, tmp_path):
    """A copy, which a test may damage."""
    return shutil.copy(prepared, tmp_path / "frames.h5")


def played(path, name="emulator", **options):
    """What the emulated board of an array has played, and the result."""
    bus = emulated_backend(name, clock=VirtualClock(), record=1 << 16)
    playback = play_file(path, array=name, connection=Connection(backend=bus, uncalibrated=True), **options)
    return bus.board().played, playback


@pytest.mark.parametrize(
    ("name", "sampling", "drive"),
    [
        ("emulator", "stm", DriveStrategy()),
        ("pat16", "am", DriveStrategy(amplitude="force", level_max=0.6)),
        ("emulator", "multi-focus", DriveStrategy(solver="gs-pat")),
        ("emulator", "stm", DriveStrategy(slew=0.01)),
    ],
)
def test_bytes_and_counts_are_those_of_playing_the_contours(contours, name, sampling, drive, tmp_path):
    wanted, source = played(contours, name, sampling=sampling, drive=drive, duration=0.3)
    made = prepare_frames(contours, tmp_path / "frames.h5", array=name, sampling=sampling, drive=drive, duration=0.3)
    found, playback = played(tmp_path / "frames.h5", name)
    np.testing.assert_array_equal(found, wanted)
    assert is_emitting(found, array=name).mean() > 0.5
    assert made.frames == playback.frames == 3000
    assert playback == source
    assert made.as_dict()["jumps"] == source.as_dict()["jumps"]


def test_repeats_play_the_frames_again(frames, contours):
    wanted, source = played(contours, sampling=SLOW, repeats=3)
    found, playback = played(frames, repeats=3)
    np.testing.assert_array_equal(found, wanted)
    assert (playback.frames, playback.repeats, playback.count) == (6000, 3, source.count)
    with pytest.raises(StrategyError, match=r"repeats must lie in 1\.\..*, not 0"):
        play_file(frames, repeats=0)


def test_several_arrays_have_their_bytes_side_by_side(contours, tmp_path, monkeypatch):
    rig = [PlacedArray(array_model("emulator")), PlacedArray(array_model("pat16").placed(ABOVE))]
    boards = []

    def recorded(placed, clock):
        boards.append(emulated_backend(placed.model.name, clock=clock, record=1 << 16))
        return boards[-1]

    monkeypatch.setattr("palpate.render.playback.file_playback.emulated_bus", recorded)
    prepare_frames(contours, tmp_path / "frames.h5", array=rig, duration=0.2)
    play_file(contours, array=rig, connection=VIRTUAL, duration=0.2)
    play_file(tmp_path / "frames.h5", array=rig, connection=VIRTUAL)
    first, second, first_again, second_again = (bus.board().played for bus in boards)
    np.testing.assert_array_equal(first_again, first)
    np.testing.assert_array_equal(second_again, second)
    assert len(first) > 0 < len(second)
    with pytest.raises(
        StrategyError, match=r"frames for emulator \(\w+\) and pat16 \(\w+\), not for emulator \(\w+\):"
    ):
        play_file(tmp_path / "frames.h5")


def test_focal_points_of_a_file_are_prepared_too(tmp_path):
    rng = np.random.default_rng(1)
    position = rng.uniform([-0.05, -0.05, 0.15], [0.05, 0.05, 0.25], (3000, 3)).astype(np.float32)
    position[7] = [0, 0, 9]
    write_ptlist(tmp_path / "a.ptlist", position, np.ones(3000, np.float32), 5000.0)
    made = prepare_frames(tmp_path / "a.ptlist", tmp_path / "frames.h5", duration=0.5)
    found, playback = played(tmp_path / "frames.h5")
    wanted, _ = played(tmp_path / "a.ptlist", duration=0.5)
    np.testing.assert_array_equal(found, wanted)
    assert (made.frames, playback.refused, playback.sampling) == (2500, 1, None)


@pytest.mark.exhaustive
def test_another_array_rate_drive_or_sampling_is_refused(frames, tmp_path):
    moved = [PlacedArray(array_model("emulator").placed([0.01, 0, 0, 0, 0, 0, 1]))]
    for array in ("pat16", "sonicsurface", moved):
        with pytest.raises(StrategyError, match=r"holds frames for emulator \(\w{12}\), not for \w+ \(\w{12}\): kind"):
            play_file(frames, array=array, connection=VIRTUAL)
    with pytest.raises(StrategyError, match="holds frames at 2000 Hz, which no sampling strategy changes"):
        play_file(frames, sampling=SLOW, connection=VIRTUAL)
    with pytest.raises(StrategyError, match=r"drives with level_max=1\.0, not 0\.5"):
        play_file(frames, drive=DriveStrategy(level_max=0.5), connection=VIRTUAL)
    with pytest.raises(StrategyError, match="played to their end, so duration cannot be asked for"):
        play_file(frames, duration=0.1, connection=VIRTUAL)
    refused(MISUSED, "holds frames at 2000 Hz, so not at 1000 Hz", "play", frames, "--update-rate", 1000)
    refused(MISUSED, "sampled before, so --sampling, --speed cannot", "play", frames, "--sampling", "stm", "--speed", 5)
    refused(MISUSED, "with --level-max 1.0, not 0.5", "play", frames, "--level-max", "0.5")
    assert answer("play", frames, "--update-rate", 2000, "--clock", "virtual")["frames"] == 2000
    refused(FAILED, "wire bytes of arrays, which palpate play plays", "prepare", frames, "-o", tmp_path / "b.h5")


def test_wire_identities_differ_where_bytes_do():
    model = array_model("pat16")
    calibrated = type(model)(**{**vars(model), "delay_offset": model.delay_offset + np.float32(0.1)})
    one, other = model.wire_identity(), calibrated.wire_identity()
    assert one == array_model("openmpd").wire_identity() != other
    assert model.identity() == calibrated.identity()
    assert one == model.placed(model.pose).wire_identity() != model.placed(ABOVE).wire_identity()
    assert one != array_model("emulator").wire_identity()


def test_limits_of_the_player_stay_in_force(frames):
    with pytest.raises(SafetyLimitError, match="on_time_max"):
        played(frames, limits=Limits(on_time_max=0.02))


def test_commands_write_show_and_check_them(contours, tmp_path):
    out = tmp_path / "frames.h5"
    options = ["--update-rate", 2000, "--array", "pat16", "--level-max", 0.8, "--duration", 0.1]
    told = answer("prepare", contours, "-o", out, *options)
    assert (told["frames"], told["arrays"], told["device"], told["warnings"]) == (200, ["pat16"], "cpu", [])
    assert told["bytes"] == out.stat().st_size
    shown = answer("info", out)
    assert (shown["holds"], shown["frames"], shown["arrays"]) == ("wire frames", 200, ["pat16"])
    assert shown["identities"] == [array_model("pat16").wire_identity()]
    assert (shown["drive"]["level_max"], shown["sampling"]["update_rate"]) == (0.8, 2000)
    assert (shown["jumps"], shown["refused"], shown["switched"]) == (told["jumps"], 0, 0)
    assert answer("check", out)["whole"] is True


def test_damage_is_found_before_its_block_is_played(frames):
    with h5py.File(frames, "r") as file:
        dataset = file["wire/frames"]
        chunk = dataset.id.get_chunk_info_by_coord((1500 // dataset.chunks[0] * dataset.chunks[0], 0))
    with frames.open("r+b") as stream:
        stream.seek(chunk.byte_offset + 7)
        stream.write(b"\x55")
    (problem,) = check_frames(frames)
    assert "/wire/frames is damaged: the checksum of a chunk does not match" in problem
    bus = emulated_backend("emulator", clock=VirtualClock(), record=4000)
    with pytest.raises(ContourFileError, match="is damaged") as caught:
        play_file(frames, connection=Connection(backend=bus))
    assert caught.value.report.off_confirmed
    assert len(bus.board().played) <= 1024 + 2


def test_files_that_are_not_whole_are_refused(frames, tmp_path):
    damaged = tmp_path / "damaged.h5"
    for damage, message in (
        (
            lambda file: file.attrs.__delitem__("digests"),
            "has no digests of its frames: it is not finished, or was changed",
        ),
        (lambda file: file["wire"].attrs.__setitem__("update_rate", 4000.0), "attribute update_rate of /wire is not"),
        (lambda file: file["array"].attrs.__setitem__("identities", "[]"), "attribute identities of /array is not"),
        (lambda file: file["array"].attrs.__setitem__("frame_bytes", np.array([256])), "frame_bytes of /array is not"),
        (lambda file: file.attrs.__setitem__("version", np.array([2, 0])), "newer than this palpate reads"),
        (lambda file: file["wire"].__delitem__("frames"), "wire/frames"),
    ):
        shutil.copy(frames, damaged)
        with h5py.File(damaged, "r+") as file:
            damage(file)
        with pytest.raises(ContourFileError, match=message):
            play_file(damaged, connection=VIRTUAL)
        assert check_frames(damaged)
    os.truncate(frames, frames.stat().st_size - 5000)
    with pytest.raises(ContourFileError):
        play_file(frames, connection=VIRTUAL)


def test_an_interruption_leaves_no_file(contours, tmp_path):
    def stop(done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        prepare_frames(contours, tmp_path / "frames.h5", watch=stop)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.exhaustive
def test_a_killed_preparation_leaves_nothing_that_plays(contours, tmp_path):
    code = (
        "import os, signal, sys\nfrom palpate.render import prepare_frames\n"
        "prepare_frames(sys.argv[1], sys.argv[2], watch=lambda *_: os.kill(os.getpid(), signal.SIGKILL))\n"
    )
    outcome = subprocess.run([sys.executable, "-c", code, contours, tmp_path / "frames.h5"], check=False)
    assert outcome.returncode == -signal.SIGKILL
    (left,) = tmp_path.iterdir()
    assert left.name.startswith("frames.h5.")
    with pytest.raises(ContourFileError):
        play_file(left, connection=VIRTUAL)
    prepare_frames(contours, tmp_path / "frames.h5")
    assert [path.name for path in tmp_path.iterdir()] == ["frames.h5"]


def test_a_file_that_changes_while_it_plays_is_noticed(frames, monkeypatch):
    with PreparedFrames(frames) as prepared:
        blocks = iter(prepared)
        next(blocks)
        os.utime(frames, ns=(time.time_ns(), time.time_ns() + 10**9))
        with pytest.raises(ContourFileError, match="was changed"):
            next(blocks)
