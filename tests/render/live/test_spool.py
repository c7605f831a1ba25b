"""A live run's files: what was appended is the run, also after kill -9, and a last row that is torn is left out."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
from live_cases import regular, run_live

from palpate.datasets.errors import ContourFileError
from palpate.render import flat_hand
from palpate.render.intersection.named_inputs import solid_of
from palpate.render.live.recording import DROPPED, FADED, LiveRecording
from palpate.render.live.spool import FIELDS, FILES, LiveSpool, finish_spool
from palpate.render.sampling.strategy import SamplingStrategy


def spool_of(folder, segment, **changes):
    """A spool with a segment's description."""
    names = ("solid", "hand", "strategy", "sampling", *FIELDS)
    return LiveSpool(folder, **({name: getattr(segment, name) for name in names} | changes))


def append(spool, segment, *, block=100):
    """Append a segment block by block, poses numbered from 7 on."""
    first = np.round(segment.time * segment.sampling.update_rate).astype(int)
    for k in range(0, len(segment.intensity), block):
        for i in np.flatnonzero((first >= k) & (first < k + block)):
            own = None if segment.patch_pose is None else segment.patch_pose[i]
            spool.add_pose(int(first[i]), 7 + int(i), segment.stamp[i], segment.pose[i], own)
        gain = None if segment.gain is None else segment.gain[k : k + block]
        spool.add_samples(k, segment.position[k : k + block], segment.intensity[k : k + block], gain)
    for i in np.flatnonzero(np.isfinite(segment.emitted)):
        spool.add_emitted(7 + int(i), segment.emitted[i])
    for i in np.flatnonzero(segment.mark):
        spool.add_mark(int(i), 1, int(segment.mark[i]))
    for event in segment.events:
        spool.add_event(*event)


def marked_run(**given):
    """A run with a gain, marks, and a pose that was never emitted."""
    segment = run_live(regular(90, 5, 0.004), **given)
    segment.mark[3:9], segment.mark[-4:] = DROPPED, FADED
    segment.emitted[2] = np.nan
    return replace(segment, gain=np.linspace(0.5, 1, len(segment.mark), dtype=np.float32))


def assert_same_run(path, segment):
    with LiveRecording(path) as recording:
        for name in ("time", "pose", "patch_pose", "stamp", "emitted", "gain", "mark", "events", "position"):
            np.testing.assert_array_equal(getattr(recording, name), getattr(segment, name), err_msg=name)
        np.testing.assert_array_equal(recording.intensity, segment.intensity)
        assert recording.run == segment.run()
        assert recording.compare().differing == 0


def test_what_was_appended_becomes_the_file_of_the_run_and_the_folder_goes(tmp_path):
    segment = marked_run()
    spool = spool_of(tmp_path / "spool", segment)
    append(spool, segment)
    with pytest.raises(ContourFileError, match="its live run goes on, or another process finishes it"):
        finish_spool(tmp_path / "spool", tmp_path / "b.h5", segment.solid)
    spool.close()
    with pytest.raises(ContourFileError, match="the run was of another object, 'tube'"):
        finish_spool(tmp_path / "spool", tmp_path / "b.h5", solid_of("cube"))
    (tmp_path / "there.h5").touch()
    with pytest.raises(ContourFileError, match="exists already"):
        spool.finish(tmp_path / "there.h5")
    (tmp_path / "there.h5").unlink()
    assert_same_run(spool.finish(tmp_path / "a.h5"), segment)
    assert [path.name for path in tmp_path.iterdir()] == ["a.h5"]


@pytest.mark.exhaustive
def test_several_foci_and_patches_of_an_articulated_hand_are_kept(tmp_path):
    hand = flat_hand()
    rest = np.tile(np.array([patch.pose for patch in hand.patches], np.float32), (5, 1, 1))
    rest[3, 2] = np.nan
    segment = marked_run(
        hand=replace(hand, patch_pose=rest[:1]), patch_pose=rest, sampling=SamplingStrategy(foci=2), last=150
    )
    spool = spool_of(tmp_path / "spool", segment)
    append(spool, segment)
    spool.close()
    assert_same_run(finish_spool(tmp_path / "spool", tmp_path / "a.h5", segment.solid), segment)


def test_rows_that_are_torn_are_left_out(tmp_path):
    segment = replace(marked_run(), gain=None)
    spool = spool_of(tmp_path / "spool", segment)
    append(spool, segment)
    spool.close()
    for name in FILES:
        with open(tmp_path / "spool" / name, "ab") as file:
            file.write(b'[1, "torn')
    os.truncate(tmp_path / "spool" / "intensity", 4 * len(segment.intensity) - 3)
    last = len(segment.intensity) - 1
    expected = replace(
        segment, position=segment.position[:last], intensity=segment.intensity[:last], mark=segment.mark[:last]
    )
    assert_same_run(finish_spool(tmp_path / "spool", tmp_path / "a.h5", segment.solid), expected)


def test_a_run_that_drew_nothing_leaves_no_file_and_samples_must_follow_each_other(tmp_path):
    segment = marked_run()
    spool = spool_of(tmp_path / "spool", segment)
    with pytest.raises(ContourFileError, match=r"samples of 1 foci from 0 on are next, not arrays of .* from 5 on"):
        spool.add_samples(5, segment.position, segment.intensity)
    with pytest.raises(ContourFileError, match=r"cannot be used for a live run: .*exists"):
        spool_of(tmp_path / "spool", segment)
    assert spool.finish(tmp_path / "a.h5") is None
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(ContourFileError, match="is no folder of a live run that can be read"):
        finish_spool(tmp_path / "spool", tmp_path / "a.h5", segment.solid)


KILLED = """
import sys, pathlib
sys.path[:0] = sys.argv[1:3]
from test_spool import append, marked_run, spool_of
segment = marked_run()
spool = spool_of(pathlib.Path(sys.argv[3]), segment)
append(spool, segment)
print("appended", flush=True)
sys.stdin.read()
"""


@pytest.mark.exhaustive
def test_a_run_that_is_killed_keeps_all_that_was_appended(tmp_path):
    cases = os.path.dirname(sys.modules["contour_cases"].__file__)
    command = [sys.executable, "-P", "-c", KILLED, os.path.dirname(__file__), cases, str(tmp_path / "spool")]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout.readline() == b"appended\n"
        process.send_signal(signal.SIGKILL)
        process.wait()
    assert_same_run(finish_spool(tmp_path / "spool", tmp_path / "a.h5", solid_of("tube")), marked_run())


def test_files_are_brought_to_the_disk_off_the_thread_and_at_most_once_a_second(tmp_path, monkeypatch):
    segment, synced = marked_run(), []
    own = os.fsync
    spool = spool_of(tmp_path / "spool", segment)
    monkeypatch.setattr(os, "fsync", lambda handle: (synced.append(time.monotonic()), own(handle)))
    append(spool, segment, block=20)
    spool.add_event(0.0, "late", "")
    end = time.monotonic() + 5
    while not synced and time.monotonic() < end:
        time.sleep(0.01)
    time.sleep(0.05)
    assert 1 <= len(synced) <= len(FILES)
    spool.close()
