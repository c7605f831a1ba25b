"""Datagrams as docs/formats/live-poses.md has them; what cannot be read is reported with its reason."""

import itertools
import json
import socket

import numpy as np
import pytest
from live_senders import datagram_of, palm_at, palm_frames
from page_blocks import ROOT, blocks_of

from palpate.render.errors import StrategyError
from palpate.render.live.sources.hand_frame import SeenHand, SourceFault
from palpate.render.live.sources.udp import DatagramError, UdpSource, frames_of

POSE = palm_at(0.5)
JOINTS = np.arange(26 * 8, dtype=np.float32).reshape(26, 8)


def test_json_gives_a_palm_alone():
    frame = frames_of(json.dumps({"time": 1.5, "side": "left", "id": 9, "palm": POSE.tolist()}).encode())
    assert frame[:3] == (1.5, "left", "9")
    assert np.array_equal(frame.pose, POSE)
    assert frame.joints is None


def test_json_gives_joints_of_which_some_are_not_known():
    joints = [None if k == 4 else row[:7] for k, row in enumerate(JOINTS.tolist())]
    frame = frames_of(json.dumps({"time": 2, "joints": joints, "radius": [0.01] * 25 + [None]}).encode())
    assert frame[:3] == (2.0, None, "")
    assert np.isnan(frame.joints[4]).all()
    assert np.array_equal(np.delete(frame.joints, 4, axis=0), np.delete(JOINTS[:, :7], 4, axis=0))
    assert np.isnan(frame.radius[25])


def test_json_gives_several_hands_or_none_of_a_time():
    hands = [{"side": "left", "id": "a", "palm": POSE.tolist()}, {"side": "right", "id": "b", "palm": POSE.tolist()}]
    frames = frames_of(json.dumps({"time": 2.0, "hands": hands}).encode())
    assert [frame[:3] for frame in frames] == [(2.0, "left", "a"), (2.0, "right", "b")]
    assert frames_of(b'{"time": 3.0, "hands": []}') == [SeenHand(3.0)]
    assert frames_of(b'{"time": 3.0}') == SeenHand(3.0)
    assert frames_of(b'{"time": 3.0, "palm": null}').is_lost


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "no JSON"),
        (b"\xff\x00\x01", "no JSON"),
        (b"[]", "must be one JSON object"),
        (b"{", "no JSON"),
        (b'{"time": 1' + b"[" * 100_000, "no JSON"),
        (b'{"palm": []}', "time: must be a number, not None"),
        (b'{"time": 1, "hands": 3}', "hands: must be a list of at most 8, not 3"),
        (b'{"time": 1, "side": "both"}', "side: must be left or right, not 'both'"),
        (b'{"time": 1, "id": 1.5}', "id: must be a text or a whole number, not 1.5"),
        (b'{"time": 1, "palm": [1, 2, 3]}', r"palm: must have shape \[7\], not \[3\]"),
        (b'{"time": 1, "joints": [[1], [1, 2]]}', "joints: must be numbers"),
        (b'{"time": 1, "radius": [1]}', r"radius: must have shape \[26\], not \[1\]"),
    ],
)
def test_a_datagram_that_cannot_be_read_is_refused_with_its_reason(data, reason):
    with pytest.raises(DatagramError, match=reason):
        frames_of(data)


def test_random_bytes_raise_nothing_else():
    rng = np.random.default_rng(5)
    whole = b'{"time": 1, "side": "left", "palm": [0,0,0.2,0,0,0,1]}'
    refused = 0
    for _ in range(400):
        data = bytearray(whole)
        for at in rng.integers(0, len(data), 3):
            data[at] = rng.integers(256)
        try:
            frames_of(bytes(data[: rng.integers(1, len(data) + 1)]))
        except DatagramError:
            refused += 1
    assert refused > 200


@pytest.mark.parametrize(
    ("text", "host", "port"),
    [("", "127.0.0.1", 5005), ("6000", "127.0.0.1", 6000), ("0.0.0.0:7", "0.0.0.0", 7), ("[::1]:8", "::1", 8)],
)
def test_addresses_are_read(text, host, port):
    source = UdpSource.at(text)
    assert (source.host, source.port) == (host, port)


@pytest.mark.parametrize("text", ["host", "127.0.0.1:", "1:70000", "a:b"])
def test_an_address_without_a_port_is_refused(text):
    with pytest.raises(StrategyError, match=r"must be HOST:PORT with a port of 0\.\.65535, not "):
        UdpSource.at(text)


@pytest.fixture
def listening():
    with UdpSource(port=0) as source, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        yield source, lambda data: sender.sendto(data, ("127.0.0.1", source.port))


def test_datagrams_come_as_frames_and_garbage_as_faults(listening):
    source, send = listening
    for data in (datagram_of(SeenHand(3.5, "right", "41", POSE)), b"nonsense", b'{"time": 4.0}'):
        send(data)
    first, fault, last = itertools.islice(source, 3)
    assert first.hand_id == "41"
    assert isinstance(fault, SourceFault)
    assert last == SeenHand(4.0)


def test_of_a_flood_the_newest_are_read_and_it_is_reported(listening):
    source, send = listening
    seen, faults = iter(source), []
    for start in (500.0, 501.0, 502.0, 503.0):
        for frame in palm_frames(10_000.0, 0.02, start=start):
            send(datagram_of(frame))
        fault, *frames = itertools.islice(seen, 5)
        faults.append(fault)
        times = [frame.time - start for frame in frames]
        assert times == pytest.approx([0.0196, 0.0197, 0.0198, 0.0199])
    assert [fault.kind for fault in faults] == ["flood"] * 4
    assert [fault.left_out for fault in faults] == [196] * 4
    assert [bool(fault.text) for fault in faults] == [False, False, True, True]  # once may be a busy machine
    assert "the newest 4 are read" in faults[2].text


def test_the_senders_of_the_document_are_understood(listening):
    source, _ = listening
    page = blocks_of(ROOT / "docs/formats/live-poses.md")
    program = "".join(block.text for block in page if block.language == "python" and not block.name)
    names = {}
    exec(program.replace("5005", str(source.port)).replace("range(90)", "range(2)"), names)
    names["sender"].close()
    first, second, gone = list(itertools.islice(source, 3))
    assert np.allclose(first.pose, [0.03, 0.0, 0.2, 0.5**0.5, 0.0, 0.0, 0.5**0.5])
    assert (second.side, second.hand_id) == ("right", "1")
    assert gone[0].is_lost


def test_an_address_that_is_taken_is_named(listening):
    source, _ = listening
    with pytest.raises(OSError, match=f"cannot listen at 127.0.0.1:{source.port}: Address already in use"):
        UdpSource(port=source.port).__enter__()


def test_a_hand_of_entries_that_mean_nothing_is_no_lost_hand():
    with pytest.raises(DatagramError, match=r"palm: neither it nor joints is there, but 'pose'"):
        frames_of(b'{"time": 1, "pose": [0, 0, 0.2, 0, 0, 0, 1]}')
    assert frames_of(b'{"time": 1, "id": 7}').is_lost
