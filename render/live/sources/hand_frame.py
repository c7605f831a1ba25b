"""What a tracker saw, and the protocol that a source of live poses keeps."""

from collections.abc import Iterator, Sequence
from types import TracebackType
from typing import NamedTuple, Protocol, Self, runtime_checkable

from ....datasets.rigid import Numbers

MONOTONIC, OWN = "monotonic", "own"
"""Clocks of a source: this host's CLOCK_MONOTONIC (`time.monotonic()`), or one of its own, which is mapped to it."""


class SeenHand(NamedTuple):
    """One hand at one time, in the tracker's frame; without pose and joints: the tracker sees no hand at that time.

    >>> from palpate.render import SeenHand
    >>> hand = SeenHand(12.5, "right", "1", pose=[0.0, 0.0, 0.2, 0.5**0.5, 0.0, 0.0, 0.5**0.5])  # palm down
    >>> SeenHand(12.6).is_lost
    True
    >>> hand
    SeenHand(12.5 s, right hand '1', pose)
    """

    time: float
    """When it was there [s], on the source's clock."""
    side: str | None = None
    """`left` or `right`; None if the tracker does not say."""
    hand_id: str = ""
    """Name of the hand: the same as long as the tracker follows it."""
    pose: Numbers | Sequence[float] | None = None
    """Hand frame -> tracker's frame, x y z [m] and quaternion xyzw, shape [7]: the middle of the palm's skin, +Y out of
    the back of the hand, +Z to the wrist. None: it follows from the joints."""
    joints: Numbers | None = None
    """OpenXR's 26 joints in its order and axes, x y z [m] and quaternion xyzw, shape [26, 7]; NaN where missing."""
    radius: Numbers | None = None
    """From each joint to the skin [m], shape [26]; NaN, or None for all: a usual one for the hand's breadth."""

    @property
    def is_lost(self) -> bool:
        """Whether there is no hand."""
        return self.pose is None and self.joints is None

    def __repr__(self) -> str:
        given = [name for name in ("pose", "joints") if getattr(self, name) is not None] or ["not seen"]
        return f"SeenHand({self.time:.6g} s, {self.side or 'a'} hand {self.hand_id!r}, {' and '.join(given)})"


class SourceFault(NamedTuple):
    """What a source yields in place of a frame if something is wrong with it, or with what it received.

    >>> from palpate.render import SourceFault
    >>> fault = SourceFault("battery", "battery: 3 % are left, and tracking stops at 2 %")
    >>> fault
    SourceFault(kind='battery', text='battery: 3 % are left, and tracking stops at 2 %', left_out=0)
    """

    kind: str
    """Faults of one kind are reported once, then counted."""
    text: str
    """One sentence, with value and bound; empty: nothing is reported, only `left_out` counted."""
    left_out: int = 0
    """Frames that the source left out, because newer ones had come."""


Seen = SeenHand | SourceFault | Sequence[SeenHand]
"""What a source yields: a hand; all hands of one time; or a fault."""


@runtime_checkable
class PoseSource(Protocol):
    """A source of live poses: an object to enter, and then to iterate over, in a process of its own.

    Its class is in a module that another process can import, and it can be pickled before it is entered. What waits for
    a tracker waits in the iterator. The source ends when its iterator does, or with any exception, whose text is
    reported: then there is no hand any more. A list of hands has all that the tracker sees; a hand on its own says
    nothing about others. A source that can be flooded leaves old frames out.

    >>> import time
    >>> from palpate.render import PoseSource, SeenHand
    >>> class Still:
    ...     '''A palm 200 mm above the array, palm down, a hundred times a second.'''
    ...     clock = "monotonic"
    ...
    ...     def __enter__(self):
    ...         return self
    ...
    ...     def __exit__(self, *error):
    ...         pass
    ...
    ...     def __iter__(self):
    ...         while True:
    ...             time.sleep(0.01)
    ...             yield SeenHand(time.monotonic(), "right", "1", [0.0, 0.0, 0.2, 0.5**0.5, 0.0, 0.0, 0.5**0.5])
    ...
    ...     def __repr__(self):
    ...         return "Still()"
    >>> source = Still()
    >>> isinstance(source, PoseSource)
    True
    >>> with source:
    ...     next(iter(source)).side
    'right'
    """

    clock: str
    """`monotonic`: its times are those of `time.monotonic()` on this host; `own`: of another clock, in seconds."""

    def __enter__(self) -> Self:
        """Open what it reads from."""
        ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Close it."""
        ...

    def __iter__(self) -> Iterator[Seen]:
        """Hands as they come, oldest first, for as long as the source lasts."""
        ...
