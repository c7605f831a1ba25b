"""A motion or recording comes again at its own times. Time is virtual here: nothing waits."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest
from live_senders import palm_at

from palpate.datasets import Y_UP, HandMotion, static_pose
from palpate.datasets.recordings.recording import HandRecording
from palpate.datasets.recordings.sample import sample_recording
from palpate.render.errors import PoseError
from palpate.render.live.sources import replay
from palpate.render.live.sources.replay import LATE_MOST, START_DELAY, ReplaySource

MOTION = HandMotion([0.0, 0.1, 0.4], np.stack([palm_at(t) for t in (0.0, 0.1, 0.4)]))


@pytest.fixture
def now(monkeypatch):
    """The time [s], which only waiting moves."""
    clock = SimpleNamespace(at=1000.0)

    def sleep(seconds):
        clock.at += seconds

    monkeypatch.setattr(replay, "time", SimpleNamespace(monotonic=lambda: clock.at, sleep=sleep))
    return clock


def test_poses_come_at_their_times_and_the_last_one_lasts_as_long_as_the_others(now):
    seen = [(now.at, frame) for frame in ReplaySource.of_motion(MOTION)]
    start = 1000.0 + START_DELAY
    assert [at - start for at, _ in seen] == pytest.approx([0.0, 0.1, 0.4])
    assert [frame.time for _, frame in seen] == pytest.approx([at for at, _ in seen])
    assert now.at - start == pytest.approx(0.4 + 0.2)  # the median interval
    assert all(np.array_equal(frame.pose, pose) for (_, frame), pose in zip(seen, MOTION.pose, strict=True))


def test_it_begins_again_if_that_is_asked_for(now):
    source = ReplaySource.of_motion(MOTION, loops=True)
    times = [frame.time - 1000.0 - START_DELAY for frame in itertools.islice(source, 7)]
    assert times == pytest.approx([0.0, 0.1, 0.4, 0.6, 0.7, 1.0, 1.2])


def test_what_is_over_when_the_process_goes_on_is_not_played(now):
    times = np.arange(100) / 100
    source = iter(ReplaySource.of_motion(HandMotion(times, np.stack([palm_at(t) for t in times]))))
    next(source)
    now.at += 0.5  # the process was stopped
    later = next(source)
    assert now.at - LATE_MOST <= later.time <= now.at


def test_a_recording_gives_its_palm_its_joints_and_its_gaps(now):
    made = sample_recording(frame_count=20, rate=50.0).transformed(Y_UP)
    pose = made.joint_pose.copy()
    pose[5:9] = np.nan
    recording = HandRecording(made.time, pose, made.joint_radius)
    frames = list(ReplaySource.of_recording(recording))
    assert [frame.is_lost for frame in frames] == [k in range(5, 9) for k in range(20)]
    there = [frame for frame in frames if not frame.is_lost]
    assert np.array_equal([frame.pose for frame in there], recording.skin_pose())
    assert np.allclose([frame.joints for frame in there], recording.joint_pose[recording.present], atol=1e-15)
    assert {frame.side for frame in frames} == {"right"}


def test_poses_without_times_are_refused():
    made = sample_recording(frame_count=2)
    untimed = HandRecording(None, made.joint_pose, made.joint_radius)
    for of, given in ((ReplaySource.of_motion, static_pose([0, 0, 0.2])), (ReplaySource.of_recording, untimed)):
        with pytest.raises(PoseError, match="without times cannot be played in real time"):
            of(given)
