"""A stream of frames: pieces, and off from wherever it was cut, whatever the transport knows of it."""

from __future__ import annotations

from array import array

import numpy as np
import pytest

from palpate.device import BoardStatus, VirtualClock, array_model
from palpate.device.codec import off_frame
from palpate.device.transports.stream import PIECE_BYTES, StreamLink

MODEL = array_model("pat16")
FRAME = MODEL.frame_bytes
OFF = off_frame(array=MODEL).tobytes()


class Wire:
    """A transport that takes everything, up to `limit` bytes in all."""

    name = "wire"
    is_exact = True
    short_writes = 0
    bytes_under_way = 0
    window_bytes: int | None = None

    def __init__(self) -> None:
        self.taken = bytearray()
        self.pieces: list[array] = []
        self.calls: list[str] = []
        self.limit: int | None = None

    @property
    def bytes_taken(self) -> int:
        return len(self.taken)

    def submit(self, data: array, *, abandon=lambda: False) -> None:
        self.pieces.append(data)
        self.taken += data.tobytes()[: None if self.limit is None else max(self.limit - len(self.taken), 0)]

    def drain(self, *, abandon=lambda: False) -> bool:
        self.calls.append("drain")
        return True

    def cancel(self) -> None:
        self.calls.append("cancel")

    def forget_doubt(self) -> None:
        self.is_exact = True

    def close(self) -> None:
        self.calls.append("close")


class PlainLink(StreamLink):
    start = StreamLink.expect_frames


def link_over(wire: Wire) -> StreamLink:
    link = PlainLink(MODEL, wire, OFF, clock=VirtualClock())
    link.expect_frames(4)
    return link


def frames(count: int) -> array:
    return array("B", np.random.default_rng(0).integers(1, 128, count * FRAME, np.uint8).tobytes())


@pytest.mark.parametrize("torn", [0, 1, 255, 256, 257, 511])
def test_off_completes_the_torn_frame_with_silence_from_the_count(torn: int) -> None:
    wire = Wire()
    link = link_over(wire)
    sent = frames(3)
    wire.limit = 2 * FRAME + torn
    link.write(sent)
    assert link.torn_bytes == torn
    wire.limit = None
    link.send_off()
    assert wire.calls == ["cancel", "drain"]
    rest = OFF[torn:] if torn else b""
    assert wire.taken == sent.tobytes()[: 2 * FRAME + torn] + rest + OFF
    assert not any(rest[max(256 - torn, 0) :])  # duties of what has not come
    assert link.torn_bytes == 0


def test_a_board_that_answers_is_asked_when_the_count_is_lost() -> None:
    class Answering(PlainLink):
        def status(self) -> BoardStatus:
            return BoardStatus(0, 0, 0, 0, torn_bytes=300, level=9, divider=4)

    wire = Wire()
    link = Answering(MODEL, wire, OFF)
    assert link.torn_bytes is None  # before the start
    link.expect_frames(4)
    wire.is_exact = False
    assert link.torn_bytes is None
    link.send_off()
    assert wire.taken == OFF[300:] + OFF
    assert link.torn_bytes == 0  # it is known again


def test_a_piece_has_at_most_64_kib_and_a_tenth_of_a_second_and_else_goes_as_it_is() -> None:
    wire = Wire()
    link = link_over(wire)
    sent = frames(300)
    link.write(sent)
    assert [len(piece) for piece in wire.pieces] == [PIECE_BYTES, PIECE_BYTES, 44 * FRAME]
    small = frames(1)
    link.write(small)
    assert wire.pieces[-1] is small
    link.expect_frames(255)
    wire.pieces.clear()
    link.write(sent)
    assert {len(piece) // FRAME for piece in wire.pieces} == {15}  # 157 Hz
    assert wire.taken == sent.tobytes() + small.tobytes() + sent.tobytes()


def test_an_abandoned_write_stops_between_pieces() -> None:
    wire = Wire()
    link_over(wire).write(frames(300), abandon=lambda: True)
    assert len(wire.pieces) == 1


def test_an_off_frame_of_another_size_is_refused() -> None:
    with pytest.raises(ValueError, match="off frame has 3 bytes, but a frame of pat16 512"):
        PlainLink(MODEL, Wire(), b"off")
