"""Slices go from one process to another in order, with their doses."""

import subprocess
import sys

import pytest

from palpate.device.live.ring import FrameRing
from palpate.device.playing.limits import Dose

DOSE = Dose(2, 0, 1, 1.5, 0.75)
SILENT = Dose(2, None, None, 0.0, 0.0)


def test_what_is_put_is_taken_in_order_with_its_doses():
    ring = FrameRing((4, 2), frame_count=3, slot_count=4)
    blocks = [bytes(range(8)), bytes([9, 8, 7, 6])]
    assert ring.put(5, 2, blocks, [DOSE, SILENT], pose_number=7, stamp_ns=123)
    assert ring.put(7, 1, [bytes(4), bytes(2)], [SILENT, SILENT])
    first = ring.take()
    assert (first.first, first.frame_count, first.pose_number, first.stamp_ns) == (5, 2, 7, 123)
    assert [bytes(block) for block in first.blocks] == blocks
    assert first.doses == (DOSE, SILENT)
    ring.done()
    second = ring.take()
    assert (second.first, second.frame_count, second.pose_number) == (7, 1, None)
    ring.done()
    assert ring.take() is None


def test_silent_slices_carry_no_frames():
    ring = FrameRing((4,), frame_count=3)
    ring.put(0, 3, None, [])
    assert ring.take().blocks is None
    assert ring.take().frame_count == 3


def test_a_full_ring_takes_no_more_until_a_slice_is_done_with():
    ring = FrameRing((1,), frame_count=1, slot_count=2)
    assert [ring.put(k, 1, [bytes([k])], [SILENT]) for k in range(3)] == [True, True, False]
    ring.take()
    assert not ring.put(2, 1, [bytes([2])], [SILENT])  # it may still be read
    ring.done()
    assert ring.put(2, 1, [bytes([2])], [SILENT])
    seen = []
    while (piece := ring.take()) is not None:
        seen.append(piece.blocks[0][0])
        ring.done()
    assert seen == [1, 2]


@pytest.mark.parametrize("count", [0, 4])
def test_a_slice_of_another_size_is_refused(count):
    with pytest.raises(ValueError, match=rf"1\.\.3 frames, not {count}"):
        FrameRing((1,), frame_count=3).put(0, count, [bytes(count)], [SILENT])


def test_another_process_takes_what_this_one_puts():
    ring = FrameRing((4,), frame_count=2)
    ring.start_ns = 77
    ring.put(3, 2, [b"abcdefgh"], [DOSE])
    code = (
        "import sys; from palpate.device.live.ring import FrameRing; "
        "ring = FrameRing((4,), frame_count=2, fd=int(sys.argv[1])); piece = ring.take(); ring.done(); "
        "print(piece.first, bytes(piece.blocks[0]).decode(), ring.start_ns)"
    )
    command = [sys.executable, "-c", code, str(ring.fd)]
    output = subprocess.run(command, pass_fds=[ring.fd], capture_output=True, text=True, check=True).stdout
    assert output.split() == ["3", "abcdefgh", "77"]
    assert ring.take() is None  # it was taken there
    ring.close()
