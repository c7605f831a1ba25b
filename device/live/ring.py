"""What a paced writer writes: frames that another process puts into shared memory, or stored ones of a stimulus."""

from __future__ import annotations

import mmap
import os
import struct
from collections.abc import Sequence
from typing import Final, NamedTuple, Protocol

from ..playing.limits import Dose

_HEADER: Final = struct.Struct("<qqqq")  # first, count, pose number or -1, stamp
_DOSE: Final = struct.Struct("<qqdd")  # first on or -1, last on or -1, sum of duties, last duty
_CONTROL_BYTES: Final = 4096
_WRITTEN, _TAKEN, _START_NS = range(3)


class Slice(NamedTuple):
    """Consecutive frames, drawn at a time."""

    first: int
    """Number of the first one's sample."""
    frame_count: int
    pose_number: int | None
    """The pose that the first of them is the first of; None: they go on with the pose before."""
    stamp_ns: int
    """When that pose's hand was there, on the monotonic clock [ns]."""
    blocks: tuple[memoryview, ...] | None
    """Frames of each array, in memory that is reused after `done`; None: all are silent."""
    doses: tuple[Dose, ...]
    """What they do, of each array."""


class FrameRing:
    """Slices of frames from one process to another, without a lock: one puts, one takes.

    frame_bytes: of each array. frame_count: of a slice at most. slot_count: slices that wait at most. fd: of the memory
    that another process made; None makes it.

    >>> from palpate.device.live.ring import FrameRing
    >>> ring = FrameRing((4,), frame_count=2)
    >>> ring.put(0, 2, [bytes(8)], [])
    True
    >>> ring.take().frame_count, ring.take()
    (2, None)
    """

    def __init__(
        self, frame_bytes: Sequence[int], *, frame_count: int, slot_count: int = 64, fd: int | None = None
    ) -> None:
        self.frame_bytes, self.frame_count, self.slot_count = tuple(frame_bytes), frame_count, slot_count
        self._dose_at = _HEADER.size
        self._data_at = self._dose_at + _DOSE.size * len(self.frame_bytes)
        self._slot_bytes = self._data_at + frame_count * sum(self.frame_bytes)
        size = _CONTROL_BYTES + slot_count * self._slot_bytes
        self.fd = os.memfd_create("palpate-frames") if fd is None else fd
        if fd is None:
            os.ftruncate(self.fd, size)
        self._map = mmap.mmap(self.fd, size)
        self._memory = memoryview(self._map)
        self._control = self._memory[:_CONTROL_BYTES].cast("q")

    def put(
        self,
        first: int,
        count: int,
        blocks: Sequence[bytes | bytearray | memoryview] | None,
        doses: Sequence[Dose],
        *,
        pose_number: int | None = None,
        stamp_ns: int = 0,
    ) -> bool:
        """Add a slice; False, and nothing is added, if the other process has not made room.

        Raises ValueError for more frames than a slot has.
        """
        if not 0 < count <= self.frame_count:
            raise ValueError(f"a slice must have 1..{self.frame_count} frames, not {count}")
        written = self._control[_WRITTEN]
        if written - self._control[_TAKEN] >= self.slot_count:
            return False
        at = self._slot(written)
        number = -1 if pose_number is None else pose_number
        _HEADER.pack_into(self._map, at, first, -count if blocks is None else count, number, stamp_ns)
        for place, dose in enumerate(doses):
            on = (-1, -1) if dose.first_on is None or dose.last_on is None else (dose.first_on, dose.last_on)
            _DOSE.pack_into(self._map, at + self._dose_at + place * _DOSE.size, *on, dose.duty_sum, dose.duty_last)
        start = at + self._data_at
        for block in blocks or ():
            view = memoryview(block).cast("B")
            self._memory[start : start + len(view)] = view
            start += len(view)
        self._control[_WRITTEN] = written + 1  # after the content, which the other process reads from then on
        return True

    def take(self) -> Slice | None:
        """The oldest slice that was not taken, in memory that is free again after `done`; None if there is none."""
        taken = self._control[_TAKEN]
        if taken == self._control[_WRITTEN]:
            return None
        at = self._slot(taken)
        first, count, number, stamp_ns = _HEADER.unpack_from(self._map, at)
        is_silent, count = count < 0, abs(count)
        doses: list[Dose] = []
        for place in range(len(self.frame_bytes)):
            first_on, last_on, total, last = _DOSE.unpack_from(self._map, at + self._dose_at + place * _DOSE.size)
            on = (None, None) if first_on < 0 else (first_on, last_on)
            doses.append(Dose(count, *on, total, last))
        blocks: list[memoryview] = []
        start = at + self._data_at
        for size in () if is_silent else self.frame_bytes:
            blocks.append(self._memory[start : start + count * size])
            start += count * size
        found = None if is_silent else tuple(blocks)
        return Slice(first, count, None if number < 0 else number, stamp_ns, found, tuple(doses))

    def done(self) -> None:
        """The slice that `take` gave is no longer needed."""
        self._control[_TAKEN] += 1

    @property
    def start_ns(self) -> int:
        """When sample 0 is due, on the monotonic clock [ns]; 0 before the process that draws has begun."""
        return self._control[_START_NS]

    @start_ns.setter
    def start_ns(self, value: int) -> None:
        self._control[_START_NS] = value

    def close(self) -> None:
        """Let go of the memory."""
        self._control.release()
        self._memory.release()
        self._map.close()
        os.close(self.fd)

    def _slot(self, number: int) -> int:
        return _CONTROL_BYTES + number % self.slot_count * self._slot_bytes


class Content(Protocol):
    """Frames for the arrays of a writer, in order, each due at `start_ns` + its number / update rate."""

    @property
    def start_ns(self) -> int:
        """When frame 0 is due [ns]; 0 while that is not known yet."""
        ...

    @property
    def end(self) -> int | None:
        """Number of its frames; None: it goes on until it is stopped."""
        ...

    def take(self, head: int, until: int) -> Slice | None:
        """The next slice, or None if there is none yet.

        Args:
            head: number of the first frame that can still be in time.
            until: number of the frame before which what is written now should end.
        """
        ...

    def done(self) -> None:
        """The slice that `take` gave has been written."""
        ...


class DrawnContent:
    """Frames that another process draws while they are played; it draws no further ahead than they are wanted."""

    end = None

    def __init__(self, ring: FrameRing) -> None:
        self._ring = ring

    @property
    def start_ns(self) -> int:
        """When sample 0 is due, as the process that draws has set it; 0 before."""
        return self._ring.start_ns

    def take(self, head: int, until: int) -> Slice | None:
        """The oldest slice that waits; those that are late are left out by the writer, which counts them."""
        return self._ring.take()

    def done(self) -> None:
        """Make room for another slice."""
        self._ring.done()


class StoredContent:
    """Frames that are all there.

    frames: of each array, all bytes. doses: of each array, those of slices of `slice_frames`. repeats: how often they
    are played.
    """

    def __init__(
        self,
        frames: Sequence[memoryview],
        frame_bytes: Sequence[int],
        doses: Sequence[Sequence[Dose]],
        *,
        slice_frames: int,
        repeats: int = 1,
        start_ns: int,
    ) -> None:
        self.start_ns: int = start_ns
        self._frames, self._frame_bytes, self._doses, self._slice = frames, frame_bytes, doses, slice_frames
        self._count = len(frames[0]) // frame_bytes[0]
        self.end = self._count * repeats
        self._next = 0

    def take(self, head: int, until: int) -> Slice | None:
        """The next slice, those that are wholly late left out."""
        while self._next < self.end:
            first = self._next % self._count
            stop = min(first + self._slice, self._count)
            if self._next >= until:
                return None
            if self._next + stop - first > head:
                return self._made(first, stop)
            self._next += stop - first
        return None

    def done(self) -> None:
        """Go on behind the slice that was given."""
        first = self._next % self._count
        self._next += min(self._slice, self._count - first)

    def _made(self, first: int, stop: int) -> Slice:
        blocks = tuple(
            frames[first * size : stop * size] for frames, size in zip(self._frames, self._frame_bytes, strict=True)
        )
        doses = tuple(own[first // self._slice] for own in self._doses)
        is_first = 0 if self._next == 0 else None
        return Slice(self._next, stop - first, is_first, self.start_ns, blocks, doses)
