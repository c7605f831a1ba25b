"""The process that a source runs in: reads a tracker, and sends a message for each pose.

The process that starts it holds a pipe to its standard input; when that closes, however its holder ended, it ends, too.
A source that stalls sends nothing: the age of its last pose shows that.
"""

import contextlib
import gc
import os
import pickle
import select
import struct
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from types import TracebackType
from typing import IO, Self, cast

from ....datasets.known_names import find_name
from ....datasets.recordings.alignment import Alignment, split_alignment
from ...errors import RenderError, StrategyError
from .hand_frame import PoseSource, Seen, SourceFault
from .hand_poses import PatchLayout
from .messages import PoseSender, message_pair
from .pose_stream import PoseShaper, PoseStream
from .selection import ANY, SIDES

EXIT_FAILED = 1
_LENGTH = struct.Struct("<I")
_END_TIMEOUT = 2.0  # [s]
_UNPICKLABLE = (pickle.PickleError, AttributeError, ImportError, TypeError)


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
    shaper: PoseShaper | None = None
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

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
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
        if self._process.stdin is not None:
            with contextlib.suppress(OSError):
                self._process.stdin.close()
        try:
            self._process.wait(_END_TIMEOUT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self.socket_fd >= 0:
            os.close(self.socket_fd)
            self.socket_fd = -1


def start_source(settings: SourceSettings) -> SourceProcess:
    """Start the process of a source; whether its tracker answers shows in its messages.

    Raises StrategyError for a source that another process cannot make.
    """
    content = _pickled(settings)
    receiver, sender = message_pair()
    try:
        process = subprocess.Popen(
            # -P: no module of the current folder is imported
            [sys.executable, "-P", "-m", "palpate.render.live.sources.source_process", str(sender)],
            stdin=subprocess.PIPE,
            pass_fds=(sender,),
            bufsize=0,
            start_new_session=True,  # the terminal's SIGINT is for the process that started it, which ends this one
        )
    except OSError as error:
        os.close(receiver)
        raise StrategyError(f"the source's process cannot be started: {error}") from error
    finally:
        os.close(sender)
    pipe, rest = cast("IO[bytes]", process.stdin), memoryview(content)
    with contextlib.suppress(BrokenPipeError):  # it has ended already, which `is_alive` shows
        while rest:
            rest = rest[pipe.write(rest) :]
    return SourceProcess(process, receiver)


def _pickled(settings: SourceSettings) -> bytes:
    """Settings as the process reads them: the folder of the source's module, then everything."""
    kind = type(settings.source)
    for part in (settings.source, settings.shaper):
        if part is not None and type(part).__module__ == "__main__":
            raise StrategyError(
                f"{type(part).__name__} is in the program that was started, which another process cannot import: put "
                "the class into a module of its own"
            )
    if not isinstance(settings.source, PoseSource):
        raise StrategyError(
            f"a source of poses has clock, __iter__, __enter__ and __exit__, and {kind.__name__} lacks one of them"
        )
    try:
        parts = [pickle.dumps(_folder_of(kind.__module__)), pickle.dumps(settings)]
    except _UNPICKLABLE as error:
        raise StrategyError(f"source {kind.__name__} cannot be given to another process: {error}") from error
    return b"".join(_LENGTH.pack(len(part)) + part for part in parts)


def _folder_of(module: str) -> str:
    """The folder from which Python imports a module's package; empty for those of palpate."""
    top = module.partition(".")[0]
    spec = None if top == "palpate" else find_spec(top)
    if spec is None or spec.origin is None:
        return ""
    file = Path(spec.origin).resolve()
    return str(file.parent.parent if spec.submodule_search_locations else file.parent)


def main() -> int:
    """Send the messages of the source that standard input describes, to the socket that the first argument names."""
    sender = PoseSender(int(sys.argv[1]))
    pipe = sys.stdin.fileno()
    try:
        folder = pickle.loads(_part(pipe))
        if folder and folder not in sys.path:
            sys.path.append(folder)  # last: a module beside the source's hides none of others
        settings: SourceSettings = pickle.loads(_part(pipe))
    except _UNPICKLABLE as error:
        stream = PoseStream("own")
        _send_all(sender, stream, SourceFault("start", f"the source cannot be made in its process: {error}"))
        return EXIT_FAILED
    threading.Thread(target=_end_with, args=(pipe,), name="palpate-source-end", daemon=True).start()
    gc.collect()
    gc.freeze()  # what has been imported stays: each collection would look at all of it again
    if settings.realtime:
        from ....device.live.realtime import SOURCE_PRIORITY, enter_realtime

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


def _end_with(pipe: int) -> None:
    """End this process when the pipe closes; a source may wait in a tracker's library, which nothing else ends."""
    while True:
        select.select([pipe], [], [])
        if not os.read(pipe, 4096):
            os._exit(0)


def _part(pipe: int) -> bytes:
    return _read(pipe, _LENGTH.unpack(_read(pipe, _LENGTH.size))[0])


def _read(pipe: int, count: int) -> bytes:
    data = bytearray()
    while len(data) < count:
        part = os.read(pipe, count - len(data))
        if not part:
            raise SystemExit(EXIT_FAILED)
        data += part
    return bytes(data)


if __name__ == "__main__":
    sys.exit(main())
