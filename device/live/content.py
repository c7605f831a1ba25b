"""What a paced writer writes: frames that another process draws now, or stored ones of a stimulus."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from ..playing.limits import Dose
from .ring import FrameRing, Slice


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
