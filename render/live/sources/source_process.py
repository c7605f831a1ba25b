"""The process that a source runs in: reads a tracker, and sends a message for each pose.

It ends once all receivers of its messages have closed their end, however they ended.
A source that stalls sends nothing: the age of its last pose shows that.
"""

import gc
import os
import pickle
import select
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

from ....datasets.known_names import find_name
from ....datasets.recordings.alignment import Alignment, split_alignment
from ....device.live.realtime import SOURCE_PRIORITY, enter_realtime
from ....device.live.writer_handle import start_process
from ...errors import RenderError, StrategyError
from .hand_frame import PoseSource, Seen, SourceFault
from .hand_poses import PatchLayout
from .messages import PoseSender, message_pair
from .pose_stream import ANY, SIDES, PoseStream
from .shipped_settings import ship, unship

if TYPE_CHECKING:
    from .shaping import PoseShaping  # scipy.signal takes seconds to import, and only smoothing needs it

EXIT_FAILED = 1
_END_TIMEOUT = 2.0  # [s]


@dataclass(frozen=True)
class SourceSettings:
    """What a source's process is started with.

    Raises StrategyError for an unknown side, and RecordingError for an alignment that is none.
    """

    source: PoseSource
    """Not entered yet; its class is in a module that another process can import, and it can be pickled."""
    alignment: Alignment | None = None
    """Tracker's frame -> array's, as `load_recording` takes it; None: the source's frame is the array's."""
    side: str = ANY
    """Which hand is followed: any, left or right."""
    patches: PatchLayout | None = None
    """Of an articulated hand: `patch_layout`."""
    shaper: "PoseShaping | None" = None
    """Smooths or predicts poses."""
    realtime: bool = False
    """Whether the process asks for SCHED_FIFO."""

    def __post_init__(self) -> None:
        side = find_name(self.side, SIDES)
        if side is None:
            raise StrategyError(f"side must be one of {', '.join(SIDES)}, not {self.side!r:.60}")
        object.__setattr__(self, "side", side)
        if self.alignment is not None:
            split_alignment(self.alignment)


class SourceProcess:
    """A source that runs; as a context manager it ends with its context.

    The socket may be given to another process (`pass_fds`): messages come out of it by `received_messages`.
    """

    def __init__(self, process: "subprocess.Popen[bytes]", socket_fd: int) -> None:
        self.socket_fd = socket_fd
        """The receiver's end, non-blocking."""
        self._process = process

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def is_alive(self) -> bool:
        """Whether the process runs."""
        return self._process.poll() is None

    @property
    def process_id(self) -> int:
        """Its id."""
        return self._process.pid

    def close(self) -> None:
        """End the process and close the socket; a second time does nothing."""
        if self.socket_fd >= 0:
            os.close(self.socket_fd)
            self.socket_fd = -1
        try:
            self._process.wait(_END_TIMEOUT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def start_source(settings: SourceSettings) -> SourceProcess:
    """Start the process of a source; whether its tracker answers shows in its messages.

    Raises StrategyError for a source that another process cannot make.
    """
    if not isinstance(settings.source, PoseSource):
        raise StrategyError(
            "a source of poses has clock, __iter__, __enter__ and __exit__, and "
            f"{type(settings.source).__name__} lacks one of them"
        )
    content = ship(settings)
    receiver, sender = message_pair()
    try:
        process = start_process("palpate.render.live.sources.source_process", (sender, content), sender)
    except OSError as error:
        os.close(receiver)
        raise StrategyError(f"the source's process cannot be started: {error}") from error
    finally:
        os.close(sender)
    return SourceProcess(process, receiver)


def main() -> int:
    """Send the messages of the source that standard input describes."""
    descriptor, content = pickle.load(sys.stdin.buffer)  # of the process that started this one
    sender = PoseSender(descriptor)
    try:
        settings: SourceSettings = unship(content)
    except Exception as error:  # of a user's module, perhaps
        _send_all(sender, PoseStream("own"), SourceFault("start", f"the source cannot be made: {error}"))
        return EXIT_FAILED
    threading.Thread(target=_end_with, args=(descriptor,), name="palpate-source-end", daemon=True).start()
    gc.collect()
    gc.freeze()  # what has been imported stays: each collection would look at all of it again
    if settings.realtime:
        enter_realtime(SOURCE_PRIORITY)
    return run_source(settings, sender)


def run_source(settings: SourceSettings, sender: PoseSender) -> int:
    """Read a source to its end; returns the exit code. Whatever ends it is reported, after the hand is."""
    source = settings.source
    stream = PoseStream(
        source.clock,
        alignment=settings.alignment,
        side=settings.side,
        patches=settings.patches,
        shaper=settings.shaper,
    )
    code, reason = 0, "the source has ended"
    try:
        with source:
            for seen in source:
                if not _send_all(sender, stream, seen):
                    return 0
    except Exception as error:  # of a tracker's library, or of the user's own code
        what = str(error) if isinstance(error, OSError | RenderError) else f"{type(error).__name__}: {error}"
        code, reason = EXIT_FAILED, f"the source failed: {what}"
    sender.send(stream.lost(time.monotonic_ns()))
    _send_all(sender, stream, SourceFault("end", reason))
    return code


def _send_all(sender: PoseSender, stream: PoseStream, seen: Seen) -> bool:
    return all(sender.send(message) for message in stream.taken(seen, time.monotonic_ns()))


def _end_with(descriptor: int) -> None:
    """End this process once nobody can receive messages; a source may wait in a tracker's library for ever."""
    poll = select.poll()
    poll.register(descriptor, 0)  # that the other end is closed is reported without being asked for
    poll.poll()
    os._exit(0)


if __name__ == "__main__":
    sys.exit(main())
