"""The parent's side of a process that draws: started with an object and a strategy, told when to begin and to stop."""

import contextlib
import fcntl
import json
import os
import select
import socket
import subprocess
import time
from collections.abc import Iterator, Sequence
from typing import Any

from ...device.live.writer_handle import WriterHandle, start_process
from .. import errors
from ..errors import RenderError, StrategyError
from ..stages.registry import Stage, StageEntry, find_stage
from .drawn_log import PIPE_BYTES
from .moment_slot import MomentSlot
from .recorder import SegmentRecorder
from .renderer_process import QUICK_SHARE, LiveRendering, RendererSettings
from .shipped_settings import ship

READY_TIMEOUT = 180.0  # [s]: kernels may have to be compiled
END_TIMEOUT = 5.0  # [s]
_SET_PIPE_SIZE = 1031  # F_SETPIPE_SZ


class RendererHandle:
    """A process that draws renderings, one at a time, into the ring of a writer; made, it prepares itself.

    pose_fd: where pose messages come from. numbers: of its poses. is_recorded: whether it sends all that it draws
    through `log_fd`.
    """

    def __init__(
        self,
        renderings: Sequence[LiveRendering],
        writer: WriterHandle,
        *,
        pose_fd: int,
        numbers: range,
        intensity: float,
        realtime: bool,
        is_recorded: bool,
    ) -> None:
        self.renderings, self.numbers = tuple(renderings), numbers
        self.segment: SegmentRecorder | None = None
        """Where what it draws is recorded now."""
        self.counts: dict[str, int] = {}
        """What it has counted, as it told last."""
        self.moments = MomentSlot()
        """What it draws now, for viewers."""
        self._own, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.log_fd, log_end = os.pipe() if is_recorded else (None, None)
        if self.log_fd is not None:
            os.set_blocking(self.log_fd, False)
        if log_end is not None:
            with contextlib.suppress(OSError):  # a user may have all pipes that large
                fcntl.fcntl(log_end, _SET_PIPE_SIZE, PIPE_BYTES)
        settings = RendererSettings(
            renderings=self.renderings,
            kinds=tuple(request.kind for request in writer.arrays),
            arrays=tuple(request.model for request in writer.arrays),
            lead=writer.pace.lead,
            intensity=intensity,
            first_number=numbers.start,
            realtime=realtime,
            slice_frames=writer.slice_frames,
            ring_fd=writer.ring.fd,
            wake_fd=writer.wake_fd,
            pose_fd=pose_fd,
            control_fd=other.fileno(),
            log_fd=log_end,
            moment_fd=self.moments.fd,
        )
        shared = [writer.ring.fd, writer.wake_fd, self.moments.fd]
        files = [other, pose_fd, *shared, *([] if log_end is None else [log_end])]
        try:
            content = ship((_stages_of(renderings), settings))
            self._process = start_process("palpate.render.live.renderer_process", (other.fileno(), content), *files)
        except BaseException:
            self.release()
            raise
        finally:
            other.close()
            if log_end is not None:
                os.close(log_end)

    def fileno(self) -> int:
        """Of the socket that messages come through."""
        return self._own.fileno()

    @property
    def process_id(self) -> int:
        """Of the process."""
        return self._process.pid

    def await_ready(self) -> dict[str, Any]:
        """Wait until it is prepared; raises what it failed with."""
        end = time.monotonic() + READY_TIMEOUT
        while (left := end - time.monotonic()) > 0:
            for message in self.messages(left):
                match message["event"]:
                    case "ready":
                        return message
                    case "failed":
                        kind = getattr(errors, message["kind"], StrategyError)
                        is_known = isinstance(kind, type) and issubclass(kind, RenderError)
                        raise (kind if is_known else StrategyError)(message["text"])
                    case "gone":
                        raise StrategyError("the process that draws ended before it was ready")
        raise StrategyError(f"the process that draws was not ready after {READY_TIMEOUT:g} s")

    def send(self, do: str, **values: Any) -> None:
        """Tell the process to do something, see `renderer_process`; nothing happens if it has ended."""
        with contextlib.suppress(OSError):
            self._own.send(json.dumps({"do": do, **values}).encode())

    def messages(self, timeout: float = 0.0) -> Iterator[dict[str, Any]]:
        """What it has told; waits for the first message for `timeout` [s] at most. The last one is `gone`."""
        poll = select.poll()  # `select` refuses descriptors from 1,024 on
        poll.register(self._own, select.POLLIN)
        while poll.poll(timeout * 1e3):
            timeout = 0.0
            try:
                data = self._own.recv(65536)
            except OSError:
                data = b""
            if not data:
                yield {"event": "gone"}
                return
            yield json.loads(data)

    def kill(self) -> None:
        """End the process at once: `await_ready` then fails."""
        self._process.kill()

    def end(self) -> None:
        """End the process and wait for it."""
        self.send("end")
        with contextlib.suppress(OSError):
            self._own.shutdown(socket.SHUT_WR)
        try:
            self._process.wait(END_TIMEOUT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def release(self) -> None:
        """Close what nobody reads any more."""
        self._own.close()
        self.moments.close()
        if self.log_fd is not None:
            os.close(self.log_fd)


def _stages_of(renderings: Sequence[LiveRendering]) -> list[StageEntry]:
    """The user-defined stages of strategies, which the process that draws registers again."""
    entries = [
        find_stage(role, Stage.read(own, role).name)
        for role in ("prune", "transform")
        for rendering in renderings
        for own in getattr(rendering.strategy, role)
    ]
    return [entry for entry in entries if not entry.own]


def slow_text(name: str, seconds: float, lead: float) -> str | None:
    """A sentence where a pose of an object takes more of the lead [s] than it may; None where it does not."""
    if seconds <= QUICK_SHARE * lead:
        return None
    return (
        f"a pose of {name} takes {seconds * 1e3:.1f} ms here, but focal points go out {lead * 1e3:g} ms "
        f"ahead: frames will be dropped. lead={2 * seconds:.2g} leaves it the time; a simplified object or another "
        "hand takes less"
    )
