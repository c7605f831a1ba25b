"""The protocol of sources is small enough to show, and its example runs."""

import doctest
import itertools
import pickle
import socket
import struct
import sys

import numpy as np
from live_senders import ListedSource, palm_frames
from page_blocks import ROOT, blocks_of

from palpate.render.live.sources import hand_frame
from palpate.render.live.sources.hand_frame import PoseSource, SeenHand, SourceFault
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


def test_the_source_of_the_document_is_one_that_another_process_can_make(tmp_path, monkeypatch):
    (block,) = (one for one in blocks_of(ROOT / "docs/formats/live-poses.md") if one.name == "my_tracker.py")
    (tmp_path / block.name).write_text(block.text)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "my_tracker", raising=False)
    from my_tracker import OldTracker

    made = pickle.loads(pickle.dumps(OldTracker(port=0)))
    assert isinstance(made, PoseSource)
    with made as source, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for data in (struct.pack("<5f", 1.5, 10, 20, 200, 1), b"x", struct.pack("<5f", 2, 0, 0, 0, 0)):
            sender.sendto(data, source.socket.getsockname())
        hand, fault, gone = itertools.islice(source, 3)
    assert np.allclose(hand.pose[:3], [0.01, 0.02, 0.2])
    assert fault == SourceFault("size", "a datagram must have 20 bytes, not 1")
    assert gone == SeenHand(2.0)
