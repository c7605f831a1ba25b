"""What a tracker saw, and the protocol that a source of live poses keeps."""

from collections.abc import Iterator, Sequence
from types import TracebackType
from typing import NamedTuple, Protocol, Self, runtime_checkable

from ....datasets.rigid import Numbers

MONOTONIC, OWN = "monotonic", "own"
"""Clocks of a source: this host's CLOCK_MONOTONIC (`time.monotonic()`), or one of its own, which is mapped to it."""


class SeenHand(NamedTuple):
    """One hand at one time, in the tracker's frame; without pose and joints: the tracker sees no hand at that time."""

    time: float
    """When it was there [s], on the source's clock."""
    side: str | None = None
    """`left` or `right`; None if the tracker does not say."""
    hand_id: str = ""
    """Name of the hand: the same as long as the tracker follows it."""
    pose: Numbers | None = None
    """Hand frame -> tracker's frame, x y z [m] and quaternion xyzw, float64, shape [7]: the middle of the palm's skin,
    +Y out of the back of the hand, +Z to the wrist. None: it follows from the joints."""
    joints: Numbers | None = None
    """OpenXR's 26 joints in its order and axes, x y z [m] and quaternion xyzw, shape [26, 7]; NaN where missing."""
    radius: Numbers | None = None
    """From each joint to the skin [m], shape [26]; NaN, or None for all: a usual one for the hand's breadth."""

    @property
    def is_lost(self) -> bool:
        """Whether there is no hand."""
        return self.pose is None and self.joints is None


class SourceFault(NamedTuple):
    """What a source yields in place of a frame where something is wrong with it or with what it received."""

    kind: str
    """Faults of one kind are reported once, then counted."""
    text: str
    """One sentence, with value and bound."""


Seen = SeenHand | SourceFault | Sequence[SeenHand]
"""What a source yields: a frame; frames of several hands at the same time; or a fault."""


@runtime_checkable
class PoseSource(Protocol):
    """A source of live poses: something to enter, and then to iterate over. It runs in a process of its own.

    So its class is in a module that another process can import, and it can be pickled before it is entered. What
    waits for a tracker waits in the iterator. The source ends when its iterator does, and may raise any exception
    before: its text is reported, and the array fades. A source that can take a flood of frames leaves old ones out.

    >>> import math, time
    >>> from palpate.render.live.sources.hand_frame import SeenHand
    >>> class Circle:  # ten poses on a circle 200 mm above the array, 100 a second, palm down
    ...     clock = "monotonic"
    ...     def __enter__(self):
    ...         return self
    ...     def __exit__(self, *error):
    ...         pass
    ...     def __iter__(self):
    ...         for k in range(10):
    ...             time.sleep(0.01)
    ...             x, y = 0.03 * math.cos(k / 10), 0.03 * math.sin(k / 10)
    ...             yield SeenHand(time.monotonic(), "right", pose=[x, y, 0.2, 0.5**0.5, 0.0, 0.0, 0.5**0.5])
    >>> with Circle() as source:
    ...     print(len(list(source)))
    10
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
        """Frames as they come, oldest first, for as long as the source lasts."""
        ...
