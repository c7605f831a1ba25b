"""An Ultraleap tracking service's WebSocket, played by a stand-in that speaks LeapJS's protocol 6 and 7.

Outside truth: the fields and the faults of UltraleapTrackingWebSocket, as the stand-in writes them, and the recording
that it plays, which was made without this code.
"""

import itertools

import numpy as np
import pytest
from live_senders import empty_leapjs_frame, leapjs_frame, tracking_service

from palpate.datasets import Y_UP
from palpate.datasets.hand_model.joints import Joint
from palpate.datasets.recordings.sample import sample_recording
from palpate.render.errors import StrategyError
from palpate.render.live.sources import ultraleap
from palpate.render.live.sources.hand_frame import SeenHand, SourceFault
from palpate.render.live.sources.hand_poses import HandPoses
from palpate.render.live.sources.ultraleap import URL, UltraleapSource, seen_in

RIGHT, LEFT = sample_recording(frame_count=6), sample_recording(frame_count=6, is_left=True)


@pytest.mark.parametrize("recording", [RIGHT, LEFT], ids=["right", "left"])
@pytest.mark.parametrize("restored", [True, False], ids=["restored", "legacy"])
def test_a_frame_gives_the_joints_that_were_sent(recording, restored):
    (frame,) = seen_in(leapjs_frame(recording, 3, restored=restored))
    assert frame.time == pytest.approx(12.0 + recording.time[3], abs=1e-6)
    assert (frame.side, frame.hand_id) == ("left" if recording.is_left else "right", "7")
    sent = recording.joint_pose[3]
    given = [joint for joint in Joint if joint != Joint.PALM]
    assert np.allclose(frame.joints[given, :3], sent[given, :3], atol=1e-9)
    turned = [joint for joint in given if not joint.name.endswith("TIP")]
    dots = np.abs(np.sum(frame.joints[turned, 3:] * sent[turned, 3:], axis=1))
    assert np.allclose(dots, 1.0, atol=1e-6)


def test_the_palm_is_where_the_recordings_palm_is():
    (frame,) = seen_in(leapjs_frame(RIGHT, 0))
    pose, _ = HandPoses(Y_UP).posed(frame)
    expected = RIGHT.transformed(Y_UP).skin_pose()[0]
    assert np.linalg.norm(pose[:3] - expected[:3]) < 4e-3  # PALM and its radius are derived
    assert abs(pose[3:] @ expected[3:]) > 0.9999


@pytest.mark.parametrize(
    ("content", "text"),
    [
        ("no", "is no JSON"),
        ("[1]", r"must be an object, not \[1\]"),
        ('{"version": 5}', "version: the tracking service speaks 5; 6 and 7 are understood"),
        ('{"event": {"state": {"attached": false, "streaming": false}}}', "device: the tracker is not attached"),
        ('{"event": {"state": {"attached": true, "streaming": false}}}', "device: the tracker does not stream"),
        ('{"timestamp": 1, "hands": [{"id": 1}]}', "frame 0, hand 1: 'palmPosition' is missing"),
        ('{"timestamp": "now", "hands": []}', "frame 0, timestamp: must be a number"),
    ],
)
def test_what_a_service_cannot_mean_is_a_fault(content, text):
    fault = seen_in(content)
    assert isinstance(fault, SourceFault)
    with pytest.raises(AssertionError, match=text):
        raise AssertionError(fault.text)


@pytest.mark.parametrize(("version", "path"), [(6, "/v6.json"), (7, "/v7.json")])
def test_the_source_asks_for_frames_reads_them_and_connects_again(monkeypatch, version, path):
    monkeypatch.setattr(ultraleap, "RECONNECT_DELAY", 0.0)
    frames = [leapjs_frame(RIGHT, k) for k in range(3)] + [empty_leapjs_frame(12_500_000)]
    with tracking_service(frames, version=version, path=path) as (url, wishes), UltraleapSource.at(url) as source:
        frames_of = iter(source)
        seen = list(itertools.takewhile(lambda one: not isinstance(one, SourceFault), frames_of))
        again = next(frames_of)
        fault = next(one for one in frames_of if isinstance(one, SourceFault))
    assert wishes[:1] == ['{"background":true}']  # byte for byte: the restored service compares it so
    *first, last, lost = seen  # of frames that come faster than they are read, the newest
    assert {round(one[0].time, 3) for one in first} <= {12.0, 12.033, 12.067}
    assert last == [SeenHand(12.5)]
    assert lost == SeenHand(12.5 + 1e-6)  # cut off: no hand
    assert isinstance(again, list)
    assert fault.kind == "connection"
    assert f"no connection to the tracking service at {url}" in fault.text


def test_urls_are_read_and_others_refused():
    assert UltraleapSource.at("").url == URL
    assert UltraleapSource.at("ws://host:1/v7.json").url == "ws://host:1/v7.json"
    for text in ("http://host/v6.json", "6437", "ws://"):
        with pytest.raises(StrategyError, match="must be like ws://localhost:6437"):
            UltraleapSource.at(text)
