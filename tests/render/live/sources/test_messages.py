"""Messages keep what they were given, and one that cannot be sent is counted in the next."""

import os

import numpy as np
import pytest

from palpate.render.live.sources.messages import (
    FAULT_BYTES,
    PoseMessage,
    PoseSender,
    message_pair,
    received_messages,
)

POSE = np.array([0.01, -0.02, 0.2, 0.6, 0.0, 0.0, 0.8])


@pytest.fixture
def ends():
    receiver, descriptor = message_pair()
    sender = PoseSender(descriptor)
    yield receiver, sender
    sender.close()
    os.close(receiver)


@pytest.mark.parametrize("pose", [None, POSE], ids=["lost", "pose"])
@pytest.mark.parametrize("patches", [None, 15, 0], ids=["rigid", "patches", "none"])
@pytest.mark.parametrize("fault", ["", "zu spät: 3 µs"], ids=["", "fault"])
def test_a_message_comes_back_as_it_was(pose, patches, fault):
    patch_pose = None if patches is None else np.arange(patches * 7, dtype=np.float32).reshape(patches, 7)
    if patches:
        patch_pose[0] = np.nan
    sent = PoseMessage(123_456_789_012_345_678, -7.25, pose, patch_pose, 3, fault)
    got = PoseMessage.unpacked(sent.packed())
    assert (got.stamp_ns, got.source_time, got.skipped, got.fault) == (123_456_789_012_345_678, -7.25, 3, fault)
    assert (got.pose is None) == (pose is None)
    assert pose is None or (got.pose.dtype == np.float64 and np.array_equal(got.pose, pose))
    assert (got.patch_pose is None) == (patch_pose is None)
    assert patches is None or np.array_equal(got.patch_pose, patch_pose, equal_nan=True)
    assert got.is_lost == (pose is None and not fault)


def test_a_long_fault_is_cut_between_letters():
    fault = PoseMessage(1, 0.0, None, fault="x" + "µ" * FAULT_BYTES).packed()
    assert PoseMessage.unpacked(fault).fault == "x" + "µ" * ((FAULT_BYTES - 1) // 2)


def test_messages_arrive_in_order_and_the_end_is_seen(ends):
    receiver, sender = ends
    assert received_messages(receiver) == []
    for k in range(3):
        assert sender.send(PoseMessage(k, 0.0, POSE))
    assert [one.stamp_ns for one in received_messages(receiver)] == [0, 1, 2]
    sender.send(PoseMessage(3, 0.0, None))
    sender.close()
    assert [one.stamp_ns for one in received_messages(receiver)] == [3]
    with pytest.raises(EOFError, match="has ended"):
        received_messages(receiver)


def test_a_receiver_that_does_not_read_costs_messages_and_learns_how_many(ends):
    receiver, sender = ends
    for k in range(2000):
        assert sender.send(PoseMessage(k, 0.0, POSE, fault="first fault" if k == 1500 else ""))
    got = received_messages(receiver)
    sender.send(PoseMessage(2000, 0.0, POSE, skipped=5))
    (last,) = received_messages(receiver)
    assert len(got) < 1500
    assert len(got) + last.skipped == 2000 + 5
    assert last.fault == "first fault"


def test_the_sender_notices_that_its_receiver_has_ended():
    receiver, descriptor = message_pair()
    sender = PoseSender(descriptor)
    os.close(receiver)
    assert not sender.send(PoseMessage(1, 0.0, POSE))
    sender.close()
