"""A live run on opened arrays: a source of poses, the process that draws, its successor when something changes."""

import contextlib
import fcntl
import json
import os
import select
import socket
import subprocess
import threading
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from ...device.live.writer_handle import WriterHandle, start_process
from .. import errors
from ..errors import RenderError, StrategyError
from ..stages.registry import Stage, StageEntry, find_stage
from ..validation import require_number
from .drawn_log import PIPE_BYTES, LogReader
from .held_arrays import HeldArrays
from .moment import LiveMoment, LiveScene, moment_of
from .moment_slot import COPY_NS, DRAWING, MomentSlot
from .recorder import RunRecorder, SegmentRecorder
from .renderer_process import QUICK_SHARE, LiveRendering, RendererSettings
from .sources.shipped_settings import ship
from .sources.source_process import SourceSettings, start_source

NUMBERS_EACH = 1 << 40  # pose numbers of a renderer
STOP_TIMEOUT = 2.0  # [s]
MOMENT_TIMEOUT = 0.05  # [s] that a first moment may take
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


class DrawingRun:
    """Poses of a source, drawn for an array: one of several renderings at a time, or one that changes.

    Raises what a renderer's process failed with.
    """

    def __init__(
        self,
        renderings: Sequence[LiveRendering],
        source: SourceSettings,
        held: HeldArrays,
        *,
        intensity: float,
        realtime: bool,
        is_recorded: bool,
    ) -> None:
        require_intensity(intensity)
        self._held, self._writer, self._supervisor = held, held.writer, held.supervisor
        self._realtime, self._is_recorded = realtime, is_recorded
        self.intensity = intensity
        self._made: list[RendererHandle] = []
        self._running: list[RendererHandle] = []  # two of them while one takes over from the other
        self._is_ending = False
        self._recorder: RunRecorder | None = None
        self._stopped = threading.Event()
        self._stopped_at: int | None = None
        self._changing = threading.Lock()
        self._index = 0  # of the rendering that is drawn
        self._scenes: dict[int, LiveScene] = {}  # of renderings of the renderer that draws
        self._source = start_source(source)
        try:
            self._renderer = self._prepare(renderings)
        except BaseException:
            self._source.close()
            raise
        self._renderer.send("listen")

    @property
    def rendering(self) -> LiveRendering:
        """What is rendered, where there is one rendering."""
        return self._renderer.renderings[0]

    def begin(self, index: int = 0, recorder: RunRecorder | None = None) -> None:
        """Draw a rendering from the next pose on. recorder: gets all that is drawn."""
        self._recorder, self._index = recorder, index
        own = self._renderer
        self._held.counts.begin()
        own.segment = None if recorder is None else recorder.segment(own.renderings[index], own.numbers)
        self._writer.ring.start_ns = 0
        self._writer.send("live")
        own.send("go", base=None, index=index)

    def change(self, **fields: Any) -> None:
        """Another object, hand, strategy, sampling or drive, prepared beside what runs, which fades into it in 20 ms.

        Raises StrategyError for a sampling of another update rate, which the array was started with, and what the new
        rendering is refused for; then what runs goes on.
        """
        with self._changing:
            old = self._renderer
            rendering = replace(self.rendering, **fields)
            rate = self.rendering.sampling.update_rate
            if rendering.sampling.update_rate != rate:
                raise StrategyError(
                    f"sampling.update_rate must be {rate:g} Hz, at which the array runs, not "
                    f"{rendering.sampling.update_rate:g} Hz: end the run to change it"
                )
            new = self._prepare([rendering])
            try:
                new.segment = None if self._recorder is None else self._recorder.segment(rendering, new.numbers)
                self._stopped.clear()
                old.send("stop", hands_over=True)
                has_stopped = self._stopped.wait(STOP_TIMEOUT)
            except BaseException:  # Ctrl-C while it waits
                self._end(new)
                raise
            self._renderer = new
            new.send("intensity", value=self.intensity)  # it may have changed while this one was prepared
            new.send("go", base=self._stopped_at if has_stopped else 0)  # 0: from the present on
            self._end(old)

    def set_intensity(self, intensity: float) -> None:
        """Intensity of all focal points from now on, 0..1, reached within 10 ms."""
        require_intensity(intensity)
        self.intensity = intensity
        self._renderer.send("intensity", value=intensity)

    def scene(self, index: int | None = None) -> LiveScene:
        """What a viewer draws of a rendering, by default the one that is drawn; it is worked out once."""
        rendering = self._renderer.renderings[self._index if index is None else index]
        if id(rendering) not in self._scenes:
            there = {id(own): self._scenes[id(own)] for own in self._renderer.renderings if id(own) in self._scenes}
            self._scenes = there | {id(rendering): LiveScene.of(rendering)}
        return self._scenes[id(rendering)]

    def moment(self) -> LiveMoment | None:
        """What is drawn now; None while nothing is. The first call may wait for 50 ms, later ones do not wait."""
        if not self._held.is_running:  # what was copied last would stay for ever
            return None
        renderer = self._renderer
        slot, end_ns = renderer.moments, time.monotonic_ns() + round(MOMENT_TIMEOUT * 1e9)
        slot.ask(now_ns := time.monotonic_ns())
        copied, noted = slot.read(), slot.noted()
        while noted[0] == DRAWING and (copied is None or now_ns - copied.copied_ns > 2 * COPY_NS) and now_ns < end_ns:
            time.sleep(1e-3)
            copied, noted, now_ns = slot.read(), slot.noted(), time.monotonic_ns()
        if renderer is not self._renderer:  # another rendering has taken over meanwhile
            return self.moment()
        number = renderer.numbers.start + (0 if copied is None else copied.number)
        index = self._index if copied is None else copied.index
        rendering = renderer.renderings[index]
        return moment_of(
            copied,
            noted,
            self.scene(index),
            hold=rendering.hold,
            now_ns=now_ns,
            number=number,
            **self._held.counts.recent(),
        )

    def fade(self) -> None:
        """Fade within 10 ms, and draw nothing more."""
        self._stopped.clear()
        self._renderer.send("stop")
        self._stopped.wait(STOP_TIMEOUT)

    def end(self) -> None:
        """End the source and the renderers; the writer goes on, silent."""
        self._is_ending = True
        for renderer in list(self._running):
            if renderer is not self._renderer:  # a change under way waits for it no longer
                renderer.kill()
        with self._changing:
            for renderer in list(self._running):
                self._end(renderer)
            self._source.close()

    def _prepare(self, renderings: Sequence[LiveRendering]) -> RendererHandle:
        """A renderer that is ready."""
        renderer = RendererHandle(
            renderings,
            self._writer,
            pose_fd=self._source.socket_fd,
            numbers=range(len(self._made) * NUMBERS_EACH, (len(self._made) + 1) * NUMBERS_EACH),
            intensity=self.intensity,
            realtime=self._realtime,
            is_recorded=self._is_recorded,
        )
        self._made.append(renderer)
        self._running.append(renderer)
        if self._is_ending:
            renderer.kill()
        try:
            ready = renderer.await_ready()
        except BaseException:
            self._end(renderer)
            raise
        self._held.counts.realtime &= ready["realtime"]
        self._held.counts.pose_seconds = ready["pose_seconds"]
        names = ", ".join(dict.fromkeys(own.solid.name for own in renderings))
        if (text := slow_text(names, ready["pose_seconds"], self._writer.pace.lead)) is not None:
            self._held.tell(text)
        self._supervisor.watch(renderer.fileno(), lambda: self._hear(renderer))
        if (log_fd := renderer.log_fd) is not None:
            reader = LogReader()
            self._supervisor.watch(log_fd, lambda: self._read_log(log_fd, reader, renderer))
        return renderer

    def _end(self, renderer: RendererHandle) -> None:
        self._running.remove(renderer)  # first: that it is gone is no failure from here on
        renderer.end()
        self._supervisor.settle()
        self._supervisor.forget(renderer.fileno())
        if renderer.log_fd is not None:
            self._supervisor.forget(renderer.log_fd)
        renderer.release()

    def _hear(self, renderer: RendererHandle) -> bool:
        for message in renderer.messages():
            match message.pop("event"):
                case "began":
                    if self._recorder is not None and renderer.segment is not None:
                        self._recorder.begin(renderer.segment, message["base"], self._writer.ring.start_ns)
                case "stopped":
                    self._stopped_at = message["at"]
                    self._stopped.set()
                case "poses":
                    if message["records_lost"] > renderer.counts.get("records_lost", 0):
                        self._held.tell("this process was too slow to read all that was drawn: its record has gaps")
                    renderer.counts = message
                    total: Counter[str] = Counter()
                    for own in self._made:
                        total.update(own.counts)
                    self._held.counts.set_counts(total)
                case "fault":
                    self._held.counts.add_fault(message["text"])
                    self._held.tell(message["text"])
                case "failed":
                    reason = f"{message['kind']}: {message['text']}"
                    self._held.fail(RenderError(f"the process that draws failed: {reason}"))
                case "gone":
                    if renderer in self._running:
                        self._held.fail(RenderError("the process that draws ended without a word; the array is off"))
                    return False
        return True

    def _read_log(self, descriptor: int, reader: LogReader, renderer: RendererHandle) -> bool:
        try:
            data = os.read(descriptor, PIPE_BYTES)
        except BlockingIOError:  # it was another descriptor of that number that could be read
            return True
        for record in reader.feed(data):
            if self._recorder is not None and renderer.segment is not None:
                self._recorder.add(renderer.segment, record)
        return bool(data)


def require_intensity(value: float) -> None:
    """Raise StrategyError for an intensity outside 0..1."""
    require_number("intensity", value, 0.0, 1.0)
