"""The link to an Ultraleap array: focal points to `palpate-ultraleap`, by docs/formats/ultraleap-bridge.md."""

from __future__ import annotations

import contextlib
import struct
from array import array
from collections.abc import Callable
from types import TracebackType
from typing import Final, NamedTuple, Self

from ...array import ArrayModel
from ...array_kind import LinkRequest
from ...clock import Clock, MonotonicClock
from ...codec import off_frame
from ...errors import DeviceBusyError, DeviceTimeoutError, FrameError, LinkError
from ...link import BoardStatus, never
from .bridge_side import EmulatedBridge
from .channel import BridgeChannel, TcpChannel

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
_STALL_NS: Final = 1_000_000_000  # without a sample begun, while some wait
_WAIT_NS: Final = 20_000_000  # between two looks at a full queue


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


class BridgeLink:
    """An opened Ultraleap array; a context manager that closes it. Made by `open_bridge`, and by `open_link`.

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

    off_frames = 1
    hold_ns = 0
    short_writes = 0  # TCP takes all or fails
    bytes_under_way = 0  # what is sent has room in the bridge

    def __init__(self, model: ArrayModel, channel: BridgeChannel, clock: Clock) -> None:
        self.array = model
        self.clock = clock
        self.transport = channel.name
        """Name of the transport."""
        self.bytes_sent = 0
        """Bytes that the bridge has taken, or has room for, since the link was opened."""
        self.is_exact = True
        """Whether `bytes_sent` is exact: False once sending has failed."""
        self._channel = channel
        self._unread = b""
        self._sent = 0  # samples since `start`
        self._freed = 0  # of these, those that no longer wait, as far as is known
        self._before = 0  # samples played before `start`
        self._dry_before = self._starved_before = 0
        self._counts = _Counts(0, 0, 0, 0, 0, 0, 0, 0, 0.0)
        self._divider = model.divider_default
        self._samples_a_frame = 1.0  # device samples
        self._send(b"HELO", _HELLO.pack(_MAGIC, _VERSION))
        greeting = self._answer(b"HELO", _HELLO_TIMEOUT)
        magic, version, self._capacity, self._points_most, _ = _GREETING.unpack(greeting[: _GREETING.size].ljust(24))
        if magic != _MAGIC or version != _VERSION:
            raise LinkError(
                f"the bridge at {channel.where} speaks version {version} of the protocol, this palpate {_VERSION}: "
                "build the bridge from the same version of palpate"
            )
        about = greeting[_GREETING.size :].decode(errors="replace").split("\n")
        self.library = about[0]
        """Version of the vendor's library, as it calls itself."""
        self.serial: str | None = about[1] if len(about) > 1 else None
        """Identifier of the array, such as USX:00000001."""

    def __repr__(self) -> str:
        """One line."""
        return f"BridgeLink({self.array.name!r}, serial={self.serial!r})"

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

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
        self._send(b"OPEN", _OPEN.pack(self.array.point_count, 0, rate))
        (device_rate,) = _RATE.unpack(self._answer(b"OPEN", _OPEN_TIMEOUT)[: _RATE.size].ljust(_RATE.size))
        self._divider, self._samples_a_frame = divider, max(device_rate / rate, 1.0)
        self._counts = _Counts(0, 0, 0, 0, 0, 0, 0, 0, 0.0)
        self._sent = self._freed = 0

    def refresh(self) -> bool:
        """False: the bridge forgets nothing in a pause."""
        return False

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
            self.bytes_sent += count * size

    def drain(self, *, abandon: Callable[[], bool] = never) -> bool:
        """True: nothing is under way."""
        return True

    def cancel(self) -> None:
        """Nothing is under way that could be ended."""

    def status(self) -> BoardStatus:
        """Ask the bridge; `level` is None, as the library does not say what its array does."""
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
        """Drop the frames that wait: True. The library is handed silence."""
        self._send(b"STOP", b"")
        self._note(self._answer(b"STAT", _ANSWER_TIMEOUT))
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
        moved_ns, begun = self.clock.now_ns(), self._counts.begun
        while (room := self._capacity - (self._sent - self._freed)) < max(wanted, 1):
            self._look()
            room = self._capacity - (self._sent - self._freed)
            if room >= max(wanted, 1):
                break
            now_ns = self.clock.now_ns()
            if self._counts.begun != begun:
                moved_ns, begun = now_ns, self._counts.begun
            if now_ns - moved_ns > _STALL_NS:
                raise DeviceTimeoutError(f"array {self._who}: its library has asked for no samples for 1 s")
            if abandon():
                return 0
            missing_ns = round((wanted - room) * 1e9 / self.array.update_rate(self._divider))
            self.clock.sleep_until_ns(now_ns + min(max(missing_ns, 1), _WAIT_NS))
        return room

    def _look(self) -> None:
        self._send(b"PING", b"")
        self._note(self._answer(b"STAT", _ANSWER_TIMEOUT))

    def _note(self, content: bytes) -> None:
        if len(content) < _STATUS.size:
            raise LinkError(f"array {self._who} answered a status of {len(content)} bytes instead of {_STATUS.size}")
        self._counts = counts = _Counts(*_STATUS.unpack(content[: _STATUS.size]))
        self._freed = self._sent - counts.waiting

    def _send(self, name: bytes, content: bytes) -> None:
        try:
            self._channel.send(_HEAD.pack(name, len(content)) + content)
        except LinkError as error:
            self.is_exact = False
            if (reason := self._last_words()) is not None:
                raise self._failure(reason) from error
            raise

    def _last_words(self) -> bytes | None:
        """What a bridge said before it closed the connection; None if it said nothing."""
        with contextlib.suppress(LinkError):
            while True:
                name, content = self._message(_LAST_TIMEOUT)
                if name == b"FAIL":
                    return content
        return None

    def _answer(self, wanted: bytes, timeout: float) -> bytes:
        """Content of the next message, which must have the wanted name."""
        name, content = self._message(timeout)
        if name == b"FAIL":
            raise self._failure(content)
        if name != wanted:
            raise self._stranger(_HEAD.pack(name, len(content)))
        return content

    def _failure(self, content: bytes) -> LinkError:
        text = content.decode(errors="replace")
        kind = DeviceBusyError if "in use" in text else LinkError
        return kind(f"the bridge at {self._channel.where} refuses: {text}")

    def _message(self, timeout: float) -> tuple[bytes, bytes]:
        while True:
            if len(self._unread) >= _HEAD.size:
                name, size = _HEAD.unpack_from(self._unread)
                if not (name.isalpha() and name.isupper()) or size > _MESSAGE_BYTES:
                    raise self._stranger(self._unread)
                end = _HEAD.size + size
                if len(self._unread) >= end:
                    content, self._unread = self._unread[_HEAD.size : end], self._unread[end:]
                    return name, content
            data = self._channel.receive(timeout)
            if not data:
                raise DeviceTimeoutError(
                    f"what listens at {self._channel.where} gives no answer of palpate-ultraleap within {timeout:g} s"
                )
            self._unread += data

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
