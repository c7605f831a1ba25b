"""Frames become messages: at 60, 90 and 120 Hz, with jitter, loss, reordering, two hands and what sources do wrong.

Time is virtual: each frame is given with the time of its arrival.
"""

import numpy as np
import pytest
from live_senders import arrivals, joint_frames, palm_at, palm_frames, seen_at

from palpate.datasets import Y_UP
from palpate.render.live.sources.hand_frame import SeenHand, SourceFault
from palpate.render.live.sources.named_sources import live_hand, patch_layout
from palpate.render.live.sources.pose_stream import ABSENT, BURST, FAULT_PERIOD_NS, HandSelection, PoseStream

PLANES = patch_layout(live_hand("planes"))
MOVE = np.array([1.0, 0, 0, 0, 0, 0, 0])
SECOND = 1_000_000_000


def messages_of(stream, seen):
    """All messages for (arrival [ns], what was seen)."""
    return [message for at, one in seen for message in stream.taken(one, at)]


def poses_in(messages):
    return [message for message in messages if message.pose is not None]


def faults_in(messages):
    return [message.fault for message in messages if message.fault]


def steady(frames, rate):
    """Frames that arrive at once, at a rate [Hz]."""
    return [(round((1.0 + k / rate) * SECOND), frame) for k, frame in enumerate(frames)]


def test_every_frame_in_order_becomes_a_pose_and_the_others_are_counted():
    frames = palm_frames(90.0, 5.0)
    seen = arrivals(frames, np.random.default_rng(1), jitter=2e-3, loss=0.1, swaps=0.03)
    messages = messages_of(PoseStream("own"), seen)
    assert not faults_in(messages)
    assert len(messages) + sum(message.skipped for message in messages) == pytest.approx(len(seen), abs=1)
    assert len(messages) > 0.9 * len(seen)
    by_time = {frame.time: frame for frame in frames}
    for message in messages:
        assert np.allclose(message.pose, palm_at(message.source_time - 500.0), atol=1e-12)
        early = message.stamp_ns * 1e-9 - seen_at(by_time[message.source_time], 500.0)
        assert 0.0 < early < 10e-3
    assert np.all(np.diff([message.stamp_ns for message in messages]) > 0)


def test_joints_become_a_palm_and_patches():
    frames = joint_frames(90.0, 0.5)
    messages = messages_of(PoseStream("own", alignment=Y_UP, patches=PLANES), steady(frames, 90.0))
    assert len(messages) == len(frames)
    for message in messages:
        assert 0.15 < message.pose[2] < 0.25
        assert message.patch_pose.shape == (15, 7)
        assert np.isfinite(message.patch_pose).all()


def test_two_hands_and_one_of_them_is_followed():
    left = palm_frames(90.0, 2.0, side="left", hand_id="4", x=-0.1)
    right = palm_frames(90.0, 2.0, side="right", hand_id="5", x=0.1)
    both = [[b, a] if k % 2 else [a, b] for k, (a, b) in enumerate(zip(left, right, strict=True))]
    for side, x in (("left", -0.1), ("right", 0.1), ("any", -0.1)):
        messages = messages_of(PoseStream("own", side=side), steady(both, 90.0))
        assert len(poses_in(messages)) == len(both)
        assert all(abs(message.pose[0] - x) < 0.04 for message in messages)


def test_hands_that_come_on_their_own_are_told_apart():
    pairs = zip(palm_frames(90.0, 1.0, hand_id="4"), palm_frames(90.0, 1.0, hand_id="5", x=0.3), strict=True)
    seen = steady([frame for pair in pairs for frame in pair], 180.0)
    messages = messages_of(PoseStream("own"), seen)
    assert len(messages) == 90
    assert all(message.pose[0] < 0.1 for message in messages)
    assert sum(message.skipped for message in messages) == 0


def test_a_hand_that_is_lost_is_reported_in_each_frame_and_comes_back():
    frames = palm_frames(90.0, 1.0)
    seen = [SeenHand(frame.time) if 30 <= k < 60 else frame for k, frame in enumerate(frames)]
    messages = messages_of(PoseStream("own"), steady(seen, 90.0))
    assert [message.is_lost for message in messages] == [30 <= k < 60 for k in range(90)]


def test_the_other_hand_alone_is_reported_once():
    frames = [[frame] for frame in palm_frames(90.0, 1.0, side="right")]
    messages = messages_of(PoseStream("own", side="left"), steady(frames, 90.0))
    assert faults_in(messages) == ["side: only a right hand is seen, and a left one is asked for"]
    assert sum(message.is_lost for message in messages) == 90


def test_a_flood_is_thinned_to_a_message_a_millisecond_and_counted():
    frames = palm_frames(10_000.0, 1.0)
    messages = messages_of(PoseStream("own"), steady(frames, 10_000.0))
    assert 990 <= len(messages) <= 1000 + BURST
    assert sum(message.skipped for message in messages) == pytest.approx(len(frames) - len(messages), abs=10)
    assert max(np.diff([message.source_time for message in messages])) < 1.2e-3  # each the newest at its time


@pytest.mark.parametrize(("start", "text"), [(100.0, "jumped back by 400"), (9000.0, "jumped ahead by 8499.0")])
def test_a_jump_in_time_is_reported_once_and_poses_go_on(start, text):
    frames = palm_frames(90.0, 1.0) + palm_frames(90.0, 1.0, start=start)
    messages = messages_of(PoseStream("own"), steady(frames, 90.0))
    (fault,) = faults_in(messages)
    assert text in fault
    assert len(poses_in(messages)) == len(frames)


WRONG = {
    "NaN": (lambda frame: frame._replace(pose=frame.pose * np.nan), "pose[0]: must be finite, not nan"),
    "millimetres": (
        lambda frame: frame._replace(pose=frame.pose * [1e3, 1e3, 1e3, 1, 1, 1, 1]),
        "m from the array's centre, and must be within 3 m: are positions in millimetres",
    ),
    "norm": (lambda frame: frame._replace(pose=frame.pose * 2.0), "the quaternion's norm must be 1 within 0.01, not 2"),
    "time": (lambda frame: frame._replace(time=float("nan")), "the time of a frame must be finite"),
}


@pytest.mark.parametrize("name", WRONG)
def test_frames_that_are_wrong_are_reported_once_left_out_and_counted(name):
    change, text = WRONG[name]
    frames = palm_frames(90.0, 2.0)
    seen = [change(frame) if k % 3 == 1 else frame for k, frame in enumerate(frames)]
    messages = messages_of(PoseStream("own"), steady(seen, 90.0))
    (fault,) = faults_in(messages)
    assert text in fault
    assert len(poses_in(messages)) == 120
    assert sum(message.skipped for message in messages) in (59, 60)
    assert not any(message.is_lost for message in messages)


def test_faults_of_a_source_are_reported_and_go_on_being_counted():
    stream, fault = PoseStream("own"), SourceFault("flood", "too many came")
    seen = [(SECOND + k * FAULT_PERIOD_NS // 100, fault) for k in range(201)]
    texts = faults_in(messages_of(stream, seen))
    assert texts == ["too many came", *["too many came (100 times since it was reported last)"] * 2]


def test_frames_that_a_source_left_out_are_counted_with_and_without_a_report():
    stream = PoseStream("own")
    assert stream.taken(SourceFault("flood", "", 5), SECOND) == []
    (report,) = stream.taken(SourceFault("flood", "too many", 2), 2 * SECOND)
    assert (report.fault, report.skipped) == ("too many", 7)


class Shaper:
    """Moves poses by 1 m and notes what it was told."""

    def __init__(self):
        self.told = []

    def shaped(self, time, pose):
        self.told.append(time)
        return pose + MOVE

    def reset(self):
        self.told.append("reset")


def test_poses_are_shaped_and_the_shaper_learns_where_motion_breaks_off():
    frames = palm_frames(90.0, 4 / 90)
    seen = [*frames[:2], SeenHand(frames[2].time), frames[3]]
    shaper = Shaper()
    messages = messages_of(PoseStream("own", shaper=shaper), steady(seen, 90.0))
    assert np.allclose(messages[1].pose, palm_at(1 / 90) + MOVE)
    stamps = [message.stamp_ns * 1e-9 for message in messages]
    assert shaper.told == ["reset", stamps[0], stamps[1], "reset", stamps[3]]


def hand(side, hand_id, at=0.0):
    return SeenHand(at, side, hand_id, palm_at(at))


LEFT, RIGHT, OTHER = hand("left", "1"), hand("right", "2"), hand("right", "3")


@pytest.mark.parametrize(
    ("side", "frames", "followed"),
    [
        ("any", [[LEFT, RIGHT, OTHER]], ["1"]),
        ("right", [[LEFT, RIGHT, OTHER]], ["2"]),
        ("any", [[RIGHT], [LEFT, RIGHT], [OTHER, RIGHT, LEFT], [LEFT], [RIGHT, LEFT]], ["2", "2", "2", "1", "1"]),
        ("right", [[RIGHT, OTHER], [], [LEFT], [OTHER, RIGHT]], ["2", "", "", "3"]),
        ("left", [[hand(None, "7")]], ["7"]),  # the tracker does not say the side
        ("any", [[hand("left", "1")], [hand("right", "5"), hand("right", "1")]], ["1", "5"]),  # ids are of a side
    ],
)
def test_a_hand_is_followed_as_long_as_it_is_there_then_the_next_one(side, frames, followed):
    selection = HandSelection(side)
    assert [selection.chosen(hands or [SeenHand(0.0)], 0.0).hand_id for hands in frames] == followed


def test_a_hand_that_comes_on_its_own_is_ignored_until_the_followed_one_is_gone():
    selection = HandSelection()
    selection.chosen([RIGHT], 10.0)
    assert selection.ignores(LEFT._replace(time=10.0 + 0.9 * ABSENT))
    assert not selection.ignores(RIGHT._replace(time=10.1))
    assert not selection.ignores(LEFT._replace(time=10.0 + 1.1 * ABSENT))
    assert not selection.ignores(SeenHand(10.1))
    assert HandSelection("right").ignores(LEFT)
