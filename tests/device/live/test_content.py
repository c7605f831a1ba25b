"""Stored contents: slices in order, repeated, late ones left out."""

from palpate.device.live.ring import StoredContent
from palpate.device.playing.limits import Dose

DOSES = [Dose(4, 0, 3, 4.0, 1.0), Dose(2, 0, 1, 2.0, 1.0)]


def content(**more):
    return StoredContent(
        [memoryview(bytes(range(12)))], [2], [DOSES], slice_frames=4, **{"start_ns": 5, "repeats": 1} | more
    )


def taken(own, head=0, until=100):
    pieces = []
    while (piece := own.take(head, until)) is not None:
        pieces.append((piece.first, bytes(piece.blocks[0]), piece.doses))
        own.done()
    return pieces


def test_slices_come_in_order_with_their_doses_and_again():
    whole = [(0, bytes(range(8)), (DOSES[0],)), (4, bytes(range(8, 12)), (DOSES[1],))]
    assert taken(content()) == whole
    assert taken(content(repeats=2)) == whole + [(first + 6, data, doses) for first, data, doses in whole]
    assert content(repeats=2).end == 12


def test_slices_that_are_wholly_late_are_left_out():
    assert [first for first, _, _ in taken(content(repeats=2), head=7)] == [6, 10]


def test_no_slice_comes_before_it_is_wanted():
    own = content(repeats=2)
    assert [first for first, _, _ in taken(own, until=4)] == [0]
    assert [first for first, _, _ in taken(own, until=7)] == [4, 6]


def test_the_first_slice_marks_the_onset():
    own = content()
    assert own.take(0, 1).pose_number == 0
    own.done()
    assert own.take(0, 5).pose_number is None
