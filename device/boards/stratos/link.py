"""The link to an Ultraleap array: focal points to `palpate-ultraleap`, by docs/formats/ultraleap-bridge.md."""

from __future__ import annotations

import contextlib
import math
import struct
import time
from array import array
from collections import deque
from collections.abc import Callable
from typing import Final, NamedTuple

from ...array import ArrayModel
from ...array_kind import LinkRequest
from ...clock import Clock, MonotonicClock
from ...codec import off_frame
from ...errors import DeviceBusyError, DeviceTimeoutError, FrameError, LinkError
from ...link import BoardStatus, Link, never
from .channel import BridgeChannel, TcpChannel
from .model import EmulatedBridge

_MAGIC: Final = b"PALPATEU"
_VERSION: Final = 1
_HEAD: Final = struct.Struct("<4sI")
_HELLO: Final = struct.Struct("<8sI")
_GREETING: Final = struct.Struct("<8sIIII")
_OPEN: Final = struct.Struct("<IId")
_RATE: Final = struct.Struct("<d")
_STATUS: Final = struct.Struct("<8Qf")
_MESSAGE_BYTES: Final = 1 << 20
_PIECE_BYTES: Final = 1 << 16

_HELLO_TIMEOUT: Final = 3.0  # [s]
_OPEN_TIMEOUT: Final = 15.0  # [s]; the vendor's library sets up its array
_ANSWER_TIMEOUT: Final = 1.0  # [s]
_LAST_TIMEOUT: Final = 0.05  # [s]
_LOOK_NS: Final = 20_000_000  # between two questions for what waits
_STALL_NS: Final = 1_000_000_000  # without a sample begun, while some wait
_WAIT_NS: Final = 20_000_000  # between two looks at a full queue
_HEARTBEAT_NS: Final = 100_000_000  # since its last answer, after which a bridge whose samples wait is asked


class _Counts(NamedTuple):
    """What a bridge says of the samples since `OPEN`."""

    taken: int
    begun: int
    passed: int
    dropped: int
    dry: int
    dry_device_samples: int
    missed_callbacks: int
    device_samples: int
    intensity: float

    @property
    def waiting(self) -> int:
        return self.taken - self.begun - self.passed - self.dropped


class BridgeLink(Link):
    """An opened Ultraleap array, by `open_bridge`.

    A frame counts as taken once it is on its way: no more are sent than the bridge has room for. Played is what the
    vendor's library was handed, or whose time went by in a callback that it missed; both missed callbacks and times
    without a next frame count as underruns. The library does not say whether its array is silent.

    Args:
        model: the array `stratos`, with as many focal points a frame as are to be played.
        channel: the way to the bridge.
        clock: clock for waiting.

    Raises:
        LinkError: what answers is no bridge, or one of another version.
        DeviceBusyError: the bridge has another client.
    """

    def __init__(self, model: ArrayModel, channel: BridgeChannel, clock: Clock) -> None:
        self.array = model
        self.clock = clock
        self._bytes_sent = 0
        self._is_exact = True
        self._channel = channel
        self._unread = b""
        self._awaited: deque[tuple[bytes, int]] = deque()  # answers that are due: names, and samples sent before
        self._refusal: bytes | None = None  # what a bridge said when it failed: then it is silent, and gone
        self._looked_ns = clock.now_ns()
        self._sent = 0  # samples since `start`
        self._freed = 0  # of these, those that no longer wait, as far as is known
        self._before = 0  # samples played before `start`
        self._dry_before = self._starved_before = 0
        self._counts = _Counts(0, 0, 0, 0, 0, 0, 0, 0, 0.0)
        self._divider = model.divider_default
        self._samples_a_frame = 1.0  # device samples
        greeting = self._ask(b"HELO", _HELLO.pack(_MAGIC, _VERSION), b"HELO", _HELLO_TIMEOUT)
        if len(greeting) < _GREETING.size or not greeting.startswith(_MAGIC):
            raise self._stranger(greeting)
        _, version, room, self._points_most, _ = _GREETING.unpack_from(greeting)
        self._capacity = min(room, model.fifo_frames)  # samples that wait at most: no more is stopped late
        if version != _VERSION:
            raise LinkError(
                f"the bridge at {channel.where} speaks version {version} of the protocol, this palpate {_VERSION}: "
                "build the bridge from the same version of palpate"
            )
        about = greeting[_GREETING.size :].decode(errors="replace").split("\n")
        self.library = about[0]
        """Version of the vendor's library, as it calls itself."""
        self.serial = about[1] if len(about) > 1 else None
        """Identifier of the array, such as USX:00000001."""

    @property
    def transport(self) -> str:
        """Name of the channel; it takes all bytes or fails, so there are no short writes."""
        return self._channel.name

    @property
    def bytes_sent(self) -> int:
        """Bytes that the bridge has taken, or has room for, since the link was opened."""
        return self._bytes_sent

    @property
    def is_exact(self) -> bool:
        """Whether `bytes_sent` is exact: False once sending has failed."""
        return self._is_exact

    @property
    def bytes_under_way(self) -> int:
        """0, as what was sent has room in the bridge.

        A player asks for it also while it has nothing to send. Then the bridge is asked something, so that it does not
        take its client for dead while samples wait. What fails is raised by the next call that has to do with frames.
        """
        self._keep_informed(_HEARTBEAT_NS)
        return 0

    @property
    def queue_frames(self) -> int:
        """Samples that wait in the bridge: asked 50 times a second, and reckoned by the rate in between.

        What fails is raised by the next call that has to do with frames.
        """
        self._keep_informed(_LOOK_NS)
        elapsed_ns = self.clock.now_ns() - self._looked_ns
        return max(self._sent - self._freed - int(elapsed_ns * 1e-9 * self.array.update_rate(self._divider)), 0)

    @property
    def off_bytes(self) -> bytes:
        """A frame of silence."""
        return off_frame(array=self.array).tobytes()

    def start(self, divider: int) -> None:
        """Have the bridge set its library up for the rate of a divider; silent afterwards.

        Raises `UpdateRateError` for a divider that the array lacks, `LinkError` for what the library refuses: the rate
        for so many focal points, or their number.
        """
        rate = self.array.update_rate(divider)
        if self.array.point_count > self._points_most:
            raise LinkError(
                f"array {self._who} takes {self._points_most} focal points a frame at most, not "
                f"{self.array.point_count}"
            )
        self._keep_counts()
        answer = self._ask(b"OPEN", _OPEN.pack(self.array.point_count, 0, rate), b"OPEN", _OPEN_TIMEOUT)
        device_rate = _RATE.unpack_from(answer)[0] if len(answer) >= _RATE.size else math.nan
        if not rate * (1 - 1e-6) <= device_rate < math.inf:
            raise LinkError(
                f"array {self._who} was asked for {rate:g} samples a second of {self.array.point_count} focal points, "
                f"but its library takes {device_rate:g}"
            )
        self._divider, self._samples_a_frame = divider, max(device_rate / rate, 1.0)
        self._counts = _Counts(0, 0, 0, 0, 0, 0, 0, 0, 0.0)
        self._sent = self._freed = 0
        self._looked_ns = self.clock.now_ns()

    def write(self, data: array[int], *, abandon: Callable[[], bool] = never) -> None:
        """Send whole frames; wait while the bridge has no room for them.

        Args:
            data: the bytes.
            abandon: asked at least every 50 ms while waiting; once it holds, the rest is not sent.

        Raises:
            FrameError: no whole number of frames.
            DeviceTimeoutError: the library has asked for nothing for a second.
            LinkError: what happened to the bridge.
        """
        size = self.array.frame_bytes
        if len(data) % size:
            raise FrameError(f"{len(data)} bytes are no multiple of {size}, the size of a frame")
        done = 0
        while done < len(data):
            left = (len(data) - done) // size
            room = self._room(min(left, self._capacity // 4), abandon)
            if not room:
                return
            count = min(left, room, _PIECE_BYTES // size)
            self._send(b"FOCI", data[done : done + count * size].tobytes())
            done += count * size
            self._sent += count
            self._bytes_sent += count * size

    def drain(self, *, abandon: Callable[[], bool] = never) -> bool:
        """True: nothing is under way."""
        return True

    def cancel(self) -> None:
        """Nothing is under way that could be ended."""

    def status(self) -> BoardStatus:
        """Ask the bridge; `level` is None, as the library does not say what its array does.

        Of a bridge that failed, the last that it said.
        """
        if self._refusal is None:
            self._look()
        counts = self._counts
        return BoardStatus(
            frames_played=self._before + counts.begun + counts.passed,
            underruns=self._dry_before + counts.dry + counts.missed_callbacks,
            starved_periods=self._starved_before + round(counts.dry_device_samples / self._samples_a_frame),
            fifo_frames=self._sent - self._freed,
            torn_bytes=0,
            level=None,
            divider=self._divider,
        )

    def clear(self) -> bool:
        """Drop the frames that wait: True once the library was handed silence.

        Raises DeviceTimeoutError if the library asks for nothing for a second, so that it cannot be handed any.
        """
        if self._refusal is not None:  # then the bridge has done so by itself
            self._freed = self._sent
            return True
        end_ns = self.clock.now_ns() + _STALL_NS
        self._ask(b"STOP", b"", b"STAT", _ANSWER_TIMEOUT)
        while self._counts.intensity > 0 or self._counts.waiting:
            if self.clock.now_ns() > end_ns:
                raise DeviceTimeoutError(
                    f"array {self._who}: its library has asked for nothing for 1 s, so it was handed no silence"
                )
            self.clock.sleep_until_ns(self.clock.now_ns() + _WAIT_NS)
            self._look()
        return True

    def send_off(self) -> None:
        """Off now, whatever waits."""
        self.clear()

    def close(self) -> None:
        """End the connection: the bridge silences the array and stops the library."""
        self._channel.close()

    @property
    def _who(self) -> str:
        return f"{self.array.name} {self.serial} at {self._channel.where}"

    def _keep_counts(self) -> None:
        """Counts run from the link's opening on, the bridge's from `OPEN`."""
        status = self.status() if self._sent else None
        if status is not None:
            self._before, self._dry_before = status.frames_played, status.underruns
            self._starved_before = status.starved_periods

    def _room(self, wanted: int, abandon: Callable[[], bool]) -> int:
        """Samples that there is room for, `wanted` at least, once there is; 0 if abandoned."""
        moved_ns, waiting = self.clock.now_ns(), self._counts.waiting
        while (room := self._capacity - (self._sent - self._freed)) < max(wanted, 1):
            self._look()
            room = self._capacity - (self._sent - self._freed)
            if room >= max(wanted, 1):
                break
            now_ns = self.clock.now_ns()
            if self._counts.waiting != waiting:
                moved_ns, waiting = now_ns, self._counts.waiting
            if now_ns - moved_ns > _STALL_NS:
                raise DeviceTimeoutError(f"array {self._who}: its library has asked for no samples for 1 s")
            if abandon():
                return 0
            missing_ns = round((wanted - room) * 1e9 / self.array.update_rate(self._divider))
            self.clock.sleep_until_ns(now_ns + min(max(missing_ns, 1), _WAIT_NS))
        return room

    def _look(self) -> None:
        """Have the bridge say what has become of the samples."""
        self._ask(b"PING", b"", b"STAT", _ANSWER_TIMEOUT)

    def _keep_informed(self, after_ns: int) -> None:
        """While samples wait, ask after a time what has become of them; the answer is taken when it has come."""
        with contextlib.suppress(LinkError):
            if self._sent > self._freed and not self._awaited and self.clock.now_ns() - self._looked_ns > after_ns:
                self._post(b"PING", b"", b"STAT")
            while self._awaited:
                if (message := self._parsed()) is not None:
                    self._take(*message)
                elif data := self._channel.receive(0.0):
                    self._unread += data
                else:
                    return

    def _note(self, content: bytes, sent: int) -> None:
        """Take over a status whose question was asked when so many samples had been sent."""
        if len(content) < _STATUS.size:
            raise LinkError(f"array {self._who} answered a status of {len(content)} bytes instead of {_STATUS.size}")
        counts = _Counts(*_STATUS.unpack_from(content))
        if counts.taken != sent or not 0 <= counts.waiting <= counts.taken:
            raise LinkError(f"array {self._who} was sent {sent} samples, but its bridge counts {counts}")
        self._counts = counts
        self._freed = sent - counts.waiting
        self._looked_ns = self.clock.now_ns()

    def _send(self, name: bytes, content: bytes) -> None:
        if self._refusal is not None:
            raise self._failure(self._refusal)
        try:
            self._channel.send(_HEAD.pack(name, len(content)) + content)
        except LinkError as error:
            self._is_exact = False
            if (reason := self._last_words()) is not None:
                raise self._failure(reason) from error
            raise

    def _last_words(self) -> bytes | None:
        """What a bridge said before it closed the connection; None if it said nothing."""
        end = time.monotonic() + _LAST_TIMEOUT
        with contextlib.suppress(LinkError):
            while time.monotonic() < end:
                name, content = self._message(end)
                if name == b"FAIL":
                    return content
        return None

    def _post(self, name: bytes, content: bytes, wanted: bytes) -> None:
        """Send a message whose answer will have the wanted name."""
        self._send(name, content)
        self._awaited.append((wanted, self._sent))

    def _ask(self, name: bytes, content: bytes, wanted: bytes, timeout: float) -> bytes:
        """Content of the answer to a message; a bridge that gives none in time is left, and so falls silent.

        Answers come in the order of questions. So one that was asked for before is never taken for the answer to this
        one: an old status must not say that a later `STOP` was heard.
        """
        self._post(name, content, wanted)
        end, answer = time.monotonic() + timeout, b""
        try:
            while self._awaited:
                answer = self._take(*self._message(end))
        except DeviceTimeoutError:
            self._channel.close()
            raise
        return answer

    def _take(self, name: bytes, answer: bytes) -> bytes:
        """The content of a message, which must be the next answer that is due; a status is noted."""
        if name == b"FAIL":
            raise self._failure(answer)
        wanted, sent = self._awaited.popleft()
        if name != wanted:
            raise self._stranger(_HEAD.pack(name, len(answer)))
        if name == b"STAT":
            self._note(answer, sent)
        return answer

    def _failure(self, content: bytes) -> LinkError:
        self._refusal = content
        text = content.decode(errors="replace")
        kind = DeviceBusyError if "in use" in text else LinkError
        return kind(f"the bridge at {self._channel.where} says: {text}")

    def _message(self, end: float) -> tuple[bytes, bytes]:
        """Name and content of the next message, if it is there by a time [s of time.monotonic()]."""
        while (message := self._parsed()) is None:
            left = end - time.monotonic()
            data = self._channel.receive(left) if left > 0 else b""
            if not data:
                raise DeviceTimeoutError(
                    f"what listens at {self._channel.where} gave no answer of palpate-ultraleap in time; "
                    "serial=HOST:PORT names the bridge's place"
                )
            self._unread += data
        return message

    def _parsed(self) -> tuple[bytes, bytes] | None:
        """Name and content of the next message that has come whole; None if there is none."""
        if len(self._unread) < _HEAD.size:
            return None
        name, size = _HEAD.unpack_from(self._unread)
        if not (name.isalpha() and name.isupper()) or size > _MESSAGE_BYTES:
            raise self._stranger(self._unread)
        stop = _HEAD.size + size
        if len(self._unread) < stop:
            return None
        content, self._unread = self._unread[_HEAD.size : stop], self._unread[stop:]
        return name, content

    def _stranger(self, data: bytes) -> LinkError:
        return LinkError(
            f"what listens at {self._channel.where} is no palpate-ultraleap: it sent {data[:16]!r}; name the bridge's "
            "place with serial=HOST:PORT"
        )


def open_bridge(model: ArrayModel, request: LinkRequest) -> BridgeLink:
    """Connect to a bridge, or to the model of one.

    Raises:
        DeviceNotFoundError: nothing listens there.
        DeviceBusyError: the bridge has another client.
        LinkError: what listens is no bridge, or the address none.
    """
    bus = request.backend if isinstance(request.backend, EmulatedBridge) else None
    if bus is None:
        return _opened(model, TcpChannel(request.serial), request.clock or MonotonicClock())
    return _opened(model, bus.connect(request.serial), request.clock or bus.clock)


def _opened(model: ArrayModel, channel: BridgeChannel, clock: Clock) -> BridgeLink:
    try:
        return BridgeLink(model, channel, clock)
    except BaseException:
        channel.close()
        raise
