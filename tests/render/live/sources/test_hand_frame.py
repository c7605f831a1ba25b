"""The protocol of sources is small enough to show, and its example runs."""

import doctest

from live_senders import ListedSource, palm_frames

from palpate.render.live.sources import hand_frame
from palpate.render.live.sources.hand_frame import PoseSource, SeenHand
from palpate.render.live.sources.replay import ReplaySource
from palpate.render.live.sources.udp import UdpSource
from palpate.render.live.sources.ultraleap import UltraleapSource


def test_the_example_of_a_source_runs():
    found = doctest.testmod(hand_frame)
    assert found.attempted >= 4
    assert found.failed == 0


def test_sources_keep_the_protocol_and_other_things_do_not():
    (frame,) = palm_frames(1.0, 1.0)
    own = ListedSource([frame])
    replay = ReplaySource(*(None, None))
    assert all(isinstance(one, PoseSource) for one in (own, replay, UdpSource(), UltraleapSource()))
    assert not isinstance([frame], PoseSource)


def test_a_frame_without_pose_and_joints_has_no_hand():
    (frame,) = palm_frames(1.0, 1.0)
    assert not frame.is_lost
    assert not SeenHand(0.0, joints=[[0.0] * 7] * 26).is_lost
    assert SeenHand(0.0, "right", "1").is_lost
