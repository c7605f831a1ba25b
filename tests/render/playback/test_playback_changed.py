"""A file that is cut off or changed while it plays ends the playback by an error, with the array off."""

import os
import shutil

import numpy as np
import pytest

from palpate.datasets import HandMotion
from palpate.datasets.contour_file.reader import ContourFile
from palpate.datasets.errors import ContourFileError
from palpate.device.clock import VirtualClock
from palpate.device.registry import emulated_backend
from palpate.render import MeshObject, Palm, closed_contour, exploration, record
from palpate.render.playback import focal_points as source_module
from palpate.render.playback.file_playback import Connection, play_file


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    tube = MeshObject.load("tube")
    whole = exploration(tube.bounds, duration=6.0, rate=90.0, seed=3)
    path = tmp_path_factory.mktemp("recorded") / "tube.h5"
    record(path, tube, Palm(), HandMotion(whole.time[:200] - whole.time[0], whole.pose[:200]), closed_contour())
    return path


def cut(path):
    os.truncate(path, path.stat().st_size // 2)


def zero(path):
    """Zeros in place of everything behind the first 16 KiB: they pass a Fletcher-32 checksum."""
    with path.open("r+b") as file:
        file.seek(1 << 14)
        file.write(bytes(path.stat().st_size - (1 << 14)))


def lengthen(path):
    with path.open("ab") as file:
        file.write(b"more")


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (cut, r"changed from \d+ to \d+ bytes while it was read"),
        (zero, "in place"),
        (lengthen, r"from \d+ to \d+ bytes"),
    ],
)
@pytest.mark.parametrize("points_a_read", [200, 1 << 16])
def test_a_change_while_playing_is_an_error_at_the_next_block(
    change, message, points_a_read, recorded, tmp_path, monkeypatch
):
    path = tmp_path / "own.h5"
    shutil.copy(recorded, path)
    whole = play_file(path, connection=Connection(clock="virtual")).played.frames
    monkeypatch.setattr(source_module, "POINTS_A_READ", points_a_read)
    bus = emulated_backend("emulator", clock=VirtualClock(), record=100_000)
    frames_before, contours = [], ContourFile.contours

    def then_change(file, first, stop):
        arrays = contours(file, first, stop)
        if stop == file.pose_count and not frames_before:
            frames_before.append(bus.board().frames_played)
            os.utime(path, ns=(0, 0))  # as if it were old: else the change may fall into the same tick of the clock
            change(path)
        return arrays

    monkeypatch.setattr(ContourFile, "contours", then_change)
    with pytest.raises(ContourFileError, match=message):
        play_file(path, connection=Connection(backend=bus))
    assert frames_before
    assert bus.board().frames_played < whole
    assert not bus.board().emitting


def test_a_static_pose_that_is_read_once_is_looked_at_all_the_same(recorded, tmp_path, monkeypatch):
    with ContourFile(recorded) as file:
        lengths = np.diff(file.contours(0, 200)["pose_start"])
        pose = file.motion(0, 200)["pose"][[int(np.argmax(lengths))]]
    path = tmp_path / "still.h5"
    record(path, MeshObject.load("tube"), Palm(), HandMotion(None, pose), closed_contour())
    bus = emulated_backend("emulator", clock=VirtualClock())
    with pytest.raises(ContourFileError, match="bytes while it was read"):
        play_file(path, duration=30.0, connection=Connection(backend=bus), watch=lambda live, total: cut(path))
    assert not bus.board().emitting
    assert bus.board().frames_played < 300_000


def test_the_error_carries_what_was_played_until_then(recorded, tmp_path):
    path = shutil.copy(recorded, tmp_path / "own.h5")
    with pytest.raises(ContourFileError) as raised:
        play_file(path, connection=Connection(clock="virtual"), watch=lambda live, total: cut(path))
    report = raised.value.report
    assert (report.stopped_by, report.off_sent, report.may_emit) == ("exception", True, False)
