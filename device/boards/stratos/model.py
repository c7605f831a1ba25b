"""Model of `palpate-ultraleap` and the array behind it, written from docs/formats/ultraleap-bridge.md.

It shares no code with the link and the layout, so that a mistake in one of them shows. The vendor's library is modelled
as one that hands its array a device sample every 25 us for one focal point, and n times as long for n; a callback takes
no time, and none is missed.
"""

from __future__ import annotations

import math
import struct
import threading
from collections import deque
from collections.abc import Sequence

from ...clock import Clock, MonotonicClock
from ...errors import DeviceBusyError, DeviceLostError, DeviceNotFoundError

VERSION = 1
QUEUE_SAMPLES = 4096
POINTS_MOST = 8
RATE_LEAST = 1
"""Samples a second [Hz]."""
DEVICE_RATE = 40_000
"""Device samples a second of one focal point [Hz]."""
HOLD_NS = 100_000_000
"""How long the last sample is held when no next one is there."""
SILENCE_NS = 500_000_000
"""How long a client may be silent while something waits or sounds."""

_MAGIC = b"PALPATEU"
_MESSAGE_MOST = 1 << 20


class _Refusal(Exception):
    """A message that the bridge answers with FAIL."""


class BridgeModel:
    """A bridge with one client at most.

    Nothing runs in the background: every call first plays what is due by the clock. Calls may come from several
    threads.

    Args:
        clock: what device samples are counted by.
        identifier: of the array.
        record: how many of the samples that were begun last are kept, for tests.
    """

    def __init__(self, clock: Clock, identifier: str, *, record: int = 0) -> None:
        self.clock = clock
        self.identifier = identifier
        self.played: deque[tuple[bytes, int]] = deque(maxlen=record)
        """The samples begun last: their bytes, and when each began [ns]."""
        self._lock = threading.Lock()
        self._total = 0  # samples begun since the model was made
        self._is_greeted = False
        self._unread = b""
        self._close()

    def receive(self, data: bytes) -> tuple[bytes, bool]:
        """Take bytes of the client; returns the answers, and whether the connection stays open."""
        with self._lock:
            self._play_due()
            if not self._is_heard:
                return _message(b"FAIL", b"nothing was heard for 0.5 s"), False
            self._heard_ns = self.clock.now_ns()
            self._unread += data
            answers = b""
            try:
                while (message := self._next_message()) is not None:
                    answers += self._answer(*message)
            except _Refusal as refusal:
                self._close()
                return answers + _message(b"FAIL", str(refusal).encode()), False
            return answers, True

    def leave(self) -> None:
        """The client is gone: silent, and ready for the next one."""
        with self._lock:
            self._play_due()
            self._close()
            self._is_greeted, self._unread = False, b""

    @property
    def frames_played(self) -> int:
        """Samples begun since the model was made."""
        with self._lock:
            self._play_due()
            return self._total

    @property
    def intensity(self) -> float:
        """Greatest intensity that sounds now."""
        with self._lock:
            self._play_due()
            return self._intensity

    def began_ns(self, number: int) -> int | None:
        """When a sample began, by its number since the model was made; None for one that is not kept, or not begun."""
        with self._lock:
            self._play_due()
            place = number - (self._total - len(self.played))
            return self.played[place][1] if 0 <= place < len(self.played) else None

    def _close(self) -> None:
        """Silence; nothing is open."""
        self._points = 0
        self._queue: deque[bytes] = deque()
        self._taken = self._begun = self._dropped = self._dry = self._dry_samples = 0
        self._intensity = 0.0
        self._period_ns = self._device_ns = self._open_ns = 0
        self._next_ns = 0  # when the next sample is due
        self._dry_from_ns: int | None = None  # since when no next one was there
        self._counts_dry = False  # whether that is no pause that was meant, as the last one sounded
        self._heard_ns = self.clock.now_ns()
        self._is_heard = True

    def _next_message(self) -> tuple[bytes, bytes] | None:
        if len(self._unread) < 8:
            return None
        name, size = struct.unpack_from("<4sI", self._unread)
        if size > _MESSAGE_MOST:
            raise _Refusal(f"a message of {size} bytes is longer than 1 MiB")
        if len(self._unread) < 8 + size:
            return None
        content, self._unread = self._unread[8 : 8 + size], self._unread[8 + size :]
        return name, content

    def _answer(self, name: bytes, content: bytes) -> bytes:
        if not self._is_greeted:
            if name != b"HELO" or content[:8] != _MAGIC or len(content) != 12:
                raise _Refusal("the first message must be HELO of palpate")
            (version,) = struct.unpack_from("<I", content, 8)
            if version != VERSION:
                raise _Refusal(f"version {version} of the protocol is not {VERSION}, the bridge's")
            self._is_greeted = True
            about = f"emulated\n{self.identifier}\nUSX".encode()
            return _message(b"HELO", struct.pack("<8sIIII", _MAGIC, VERSION, QUEUE_SAMPLES, POINTS_MOST, 0) + about)
        if name == b"OPEN":
            if len(content) != 16:
                raise _Refusal(f"OPEN has {len(content)} bytes instead of 16")
            return self._open(*struct.unpack("<IId", content))
        if name == b"FOCI":
            self._queue_samples(content)
            return b""
        if name == b"STOP":
            self._dropped += len(self._queue)
            self._queue.clear()
            self._dry_samples += self._dry_until(self.clock.now_ns())
            self._intensity, self._counts_dry = 0.0, False
        elif name != b"PING":
            raise _Refusal(f"a message {name!r} is not known")
        return self._status()

    def _open(self, points: int, _: int, rate: float) -> bytes:
        if not 1 <= points <= POINTS_MOST:
            raise _Refusal(f"the library takes 1 to {POINTS_MOST} focal points, not {points}")
        device_rate = DEVICE_RATE / points
        if not RATE_LEAST <= rate <= device_rate * (1 + 1e-9):
            raise _Refusal(
                f"a rate of {rate:g} Hz is outside {RATE_LEAST} to {device_rate:g} Hz, at which the library takes "
                f"{points} focal point{'s' * (points > 1)}"
            )
        self._close()
        self._points, self._period_ns = points, round(1e9 / rate)
        self._device_ns = round(1e9 / device_rate)
        self._open_ns = self._dry_from_ns = self.clock.now_ns()
        return _message(b"OPEN", struct.pack("<d", device_rate))

    def _queue_samples(self, content: bytes) -> None:
        size = 16 * self._points
        if not size:
            raise _Refusal("FOCI came before OPEN")
        if len(content) % size:
            raise _Refusal(f"{len(content)} bytes are no whole number of samples of {size} bytes")
        if len(content) // size > QUEUE_SAMPLES - len(self._queue):
            raise _Refusal(f"there is room for {QUEUE_SAMPLES - len(self._queue)} samples, not {len(content) // size}")
        for start in range(0, len(content), size):
            sample = content[start : start + size]
            values = struct.unpack(f"<{4 * self._points}f", sample)
            if not (all(map(math.isfinite, values)) and all(0 <= value <= 1 for value in values[3::4])):
                number = self._taken + start // size
                raise _Refusal(
                    f"sample {number} has values that are not finite, or an intensity outside 0..1: {values}"
                )
            self._queue.append(sample)
        self._taken += len(content) // size
        self._play_due()

    def _play_due(self) -> None:
        """Begin the samples that are due, hold the last one, fall silent where nobody is heard."""
        now_ns = self.clock.now_ns()
        is_busy = bool(self._queue) or self._intensity > 0
        if self._points and is_busy and now_ns - self._heard_ns > SILENCE_NS:
            self._begin_until(self._heard_ns + SILENCE_NS)
            is_over = bool(self._queue) or self._intensity > 0
            if is_over:  # else all had been played, and silence held, before the client was missed
                self._close()
                self._is_heard = False
                return
        self._begin_until(now_ns)

    def _begin_until(self, now_ns: int) -> None:
        while self._queue:
            if self._dry_from_ns is not None:  # the next device sample takes the next one
                self._next_ns = max(self._dry_from_ns, self._grid(self._heard_ns))
            begin_ns = self._begin_ns()
            if begin_ns > now_ns:
                return
            self._dry_samples += self._dry_until(begin_ns)
            self._dry_from_ns, self._counts_dry = None, False
            sample = self._queue.popleft()
            self._intensity = max(struct.unpack(f"<{4 * self._points}f", sample)[3::4])
            self.played.append((sample, begin_ns))
            self._begun += 1
            self._total += 1
            self._next_ns += self._period_ns
        if self._points and self._dry_from_ns is None and now_ns >= self._begin_ns():
            self._dry_from_ns = self._begin_ns()
            self._counts_dry = self._intensity > 0
            self._dry += self._counts_dry
        if self._dry_from_ns is not None and self._intensity > 0 and now_ns - self._dry_from_ns >= HOLD_NS:
            self._intensity = 0.0

    def _dry_until(self, end_ns: int) -> int:
        """Device samples from when it ran dry until a time."""
        if self._dry_from_ns is None or not self._counts_dry:
            return 0
        return -((self._dry_from_ns - end_ns) // self._device_ns)

    def _begin_ns(self) -> int:
        """The first device sample that is due, half of one added, when the next sample is."""
        return self._grid(self._next_ns - self._device_ns // 2)

    def _grid(self, time_ns: int) -> int:
        """The first device sample from a time on."""
        return self._open_ns - (self._open_ns - time_ns) // self._device_ns * self._device_ns

    def _status(self) -> bytes:
        now_ns = self.clock.now_ns()
        dry_samples = self._dry_samples + self._dry_until(now_ns)
        counts = self._taken, self._begun, 0, self._dropped, self._dry, dry_samples, 0
        device_samples = (now_ns - self._open_ns) // self._device_ns if self._points else 0
        return _message(b"STAT", struct.pack("<8Qf", *counts, device_samples, self._intensity))


def _message(name: bytes, content: bytes) -> bytes:
    return struct.pack("<4sI", name, len(content)) + content


class EmulatedBridge:
    """Bridges, each with an array: give them to `open_link` as the backend.

    Args:
        serials: identifier of each array.
        clock: clock of all; None takes the monotonic one.
        record: how many of its last samples each keeps.

    >>> from palpate.device import VirtualClock, array_model, emulated_backend, open_link
    >>> bridge = emulated_backend("stratos", clock=VirtualClock())
    >>> with open_link(array_model("stratos"), backend=bridge) as link:
    ...     link
    BridgeLink('stratos', serial='USX:EMULATED')
    """

    def __init__(
        self, serials: Sequence[str] = ("USX:EMULATED",), *, clock: Clock | None = None, record: int = 0
    ) -> None:
        self.clock: Clock = clock or MonotonicClock()
        self._record = record
        self._serials = tuple(serials)
        self._boards: list[BridgeModel | None] = [self._switched_on(serial) for serial in self._serials]
        self._channels: dict[int, _ModelChannel] = {}

    def board(self, *, index: int = 0) -> BridgeModel:
        """The model of a bridge; raises DeviceNotFoundError for one that is unplugged."""
        board = self._boards[index]
        if board is None:
            raise DeviceNotFoundError(f"array {self._serials[index]} is unplugged")
        return board

    def connect(self, serial: str | None) -> _ModelChannel:
        """A connection to the bridge of an array, or the first one's.

        Raises:
            DeviceNotFoundError: no bridge has that array, or it is unplugged.
            DeviceBusyError: it has another client.
        """
        if serial is not None and serial not in self._serials:
            raise DeviceNotFoundError(f"no emulated bridge has the array {serial!r}; known: {', '.join(self._serials)}")
        index = 0 if serial is None else self._serials.index(serial)
        board = self.board(index=index)
        before = self._channels.get(index)
        if before is not None and before.is_open:
            raise DeviceBusyError(f"array {self._serials[index]} is in use: stop the other player")
        channel = self._channels[index] = _ModelChannel(board)
        return channel

    def unplug(self, *, index: int = 0) -> None:
        """End a bridge: its array is silent, and its connection ends."""
        self._boards[index] = None
        if index in self._channels:
            self._channels[index].close()

    def replug(self, *, index: int = 0) -> None:
        """Start it again."""
        self._boards[index] = self._switched_on(self._serials[index])

    def _switched_on(self, serial: str) -> BridgeModel:
        return BridgeModel(self.clock, serial, record=self._record)


class _ModelChannel:
    """A connection to a model: its answers are there at once."""

    name = "emulated"

    def __init__(self, board: BridgeModel) -> None:
        self.where = f"emulated {board.identifier}"
        self.is_open = True
        self._board = board
        self._answers = b""

    def send(self, data: bytes) -> None:
        """Hand over all of the bytes."""
        if not self.is_open:
            raise self._lost()
        answers, stays = self._board.receive(data)
        self._answers += answers
        if not stays:
            self.close()

    def receive(self, timeout: float) -> bytes:
        """What the model has answered; b"" if nothing, since nothing comes later."""
        if not self._answers and not self.is_open:
            raise self._lost()
        answers, self._answers = self._answers, b""
        return answers

    def close(self) -> None:
        """End the connection."""
        if self.is_open:
            self.is_open = False
            self._board.leave()

    def _lost(self) -> DeviceLostError:
        return DeviceLostError(f"the bridge of {self.where} is gone")
