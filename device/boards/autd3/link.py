"""An AUTD3 through the vendor's own package, which is optional: frames go to its two banks by turns.

A bank holds up to 1024 patterns, and the array's own clock plays them, each for divider x 25 us. While one bank is
played the other is filled, and told the time at which the first one ends, so that there is no gap. Each bank ends with
an off pattern: an array that starves is silent. If it hears nothing from the host for 0.5 s, it stops its output.
Full datagrams at the array's 100 Mbit/s carry 10 kHz of any frames, 20 kHz where all transducers and frames of a bank
share one level; a short loop is sent once, so it plays at 40 kHz.

The transducers of a frame are in the vendor's order. The vendor's geometry has its origin in transducer 0, the array
frame in the middle of the face: what is at (x, y, z) there is at (x - 86.36 mm, y - 66.04 mm, z) here.
"""

from __future__ import annotations

from array import array
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from ...array import ArrayModel
from ...clock import Clock
from ...codec import off_frame
from ...errors import DeviceTimeoutError, FrameError, LinkError, NoBackendError
from ...link import BoardStatus, Link, never

if TYPE_CHECKING:
    from .vendor_client import Controller

BANK_FRAMES_MAX: Final = 1023  # and the off pattern
BANK_DURATION: Final = 0.1  # [s]: less is filled too slowly, more would make the start later
LEAD_NS: Final = 15_000_000  # between telling a bank its time and that time: the array refuses less than 10 ms
ATTEMPTS: Final = 5  # each with twice the lead
SWITCH_NS: Final = 100_000_000  # within which a bank is seen to be played once its time has come
LOOK_NS: Final = 1_000_000  # from then to the first look at it, and on to the next one
SLICE_NS: Final = 50_000_000  # between two questions to `abandon`
PERIOD_NS: Final = 25_000  # of the carrier
LOOP_GUESSES: Final = 8  # lengths of a loop that are tried
LEVEL_UNKNOWN: Final = 255  # it plays what it should not: that may be full pressure


class Autd3Link(Link):
    """An opened AUTD3, by `open_autd3`.

    Not for several threads at once; a player uses it from one. A frame counts as sent, and as played, from the time at
    which it is played, by the array's clock as the host has it; until then it is under way.

    Args:
        model: the array `autd3`.
        controller: the vendor's device.
        serial: the address at which it was found.
    """

    @property
    def transport(self) -> str:
        """A lost datagram is sent again by the vendor's package, so there are no short writes."""
        return "udp"

    def __init__(self, model: ArrayModel, controller: Controller, *, serial: str | None = None) -> None:
        self.array = model
        self.serial = serial
        self.clock: Clock = controller.clock
        self.underruns = 0
        """Banks that were ready only after the one before had ended; the array was silent in between."""
        self._controller = controller
        self._bank = 0  # that was written last
        self._staged: deque[NDArray[np.uint8]] = deque()
        self._staged_frames = 0
        self._scheduled: deque[_Scheduled] = deque()
        self._held: dict[int, NDArray[np.uint8]] = {}  # frames in each bank
        self._end_ns: int | None = None  # of what is scheduled, by the array's clock; None: nothing is to follow it
        self._starved_ns = 0
        self._frames_past = 0  # of banks that are no longer scheduled, and off frames
        self._set_divider(model.divider_default)

    @property
    def off_bytes(self) -> bytes:
        """Wire bytes that end a content: an off frame."""
        return off_frame(array=self.array).tobytes()

    @property
    def bytes_sent(self) -> int:
        """Bytes of the frames that the array has begun to play since the link was opened, off frames included."""
        return self._frames_begun() * self.array.frame_bytes

    @property
    def bytes_under_way(self) -> int:
        """Bytes handed over whose frames are not played yet."""
        now_ns = self._controller.now_ns()
        waiting = self._staged_frames + sum(bank.waiting(now_ns) for bank in self._scheduled)
        return waiting * self.array.frame_bytes

    def start(self, divider: int) -> None:
        """Forget all that the array had been told, a failsafe too; it is silent then, and its smoothing is off.

        Raises `UpdateRateError` for a divider that the array lacks.
        """
        self.array.update_rate(divider)
        self._drop()
        self._controller.reset()
        self._set_divider(divider)

    def write(self, data: array[int], *, abandon: Callable[[], bool] = never) -> None:
        """Take whole frames, which must not change until they are sent; wait while both banks are full.

        Args:
            data: the bytes.
            abandon: asked at least every 50 ms while waiting; once it holds, the rest is not sent.

        Raises:
            FrameError: no whole number of frames.
            LinkError: what happened to the array.
        """
        if len(data) % self.array.frame_bytes:
            raise FrameError(f"{len(data)} bytes are no multiple of {self.array.frame_bytes}, the size of a frame")
        frame = np.frombuffer(data, np.uint8).reshape(-1, self.array.frame_bytes)
        self._staged.append(frame)
        self._staged_frames += len(frame)
        while self._staged_frames >= self._bank_frames:
            if not self._wait_bank(abandon):
                return
            frame = self._take(self._bank_frames)
            whole = _whole_loops(frame)
            if whole < len(frame):
                self._staged.appendleft(frame[whole:])
                self._staged_frames += len(frame) - whole
            self._schedule(frame[:whole])

    def drain(self, *, abandon: Callable[[], bool] = never) -> bool:
        """Wait until all frames are played, and the array is silent; False if abandoned."""
        while self._staged_frames:
            if not self._wait_bank(abandon):
                return False
            self._schedule(self._take(min(self._staged_frames, self._bank_frames)))
        if self._end_ns is not None and not self._wait_until(self._end_ns, abandon):
            return False
        self._retire(self._controller.now_ns())
        self._end_ns = None
        return True

    def cancel(self) -> None:
        """Drop what is not played yet: the array is silent at once."""
        self._staged.clear()
        self._staged_frames = 0
        if self._scheduled:
            try:
                self._controller.silence()
            finally:
                self._drop()

    def status(self) -> BoardStatus:
        """Ask the array whether it is silent; the counts are the host's, by the array's clock."""
        state = self._controller.state()
        now_ns = self._controller.now_ns()
        level = max((bank.level_at(now_ns) for bank in self._scheduled), default=0)
        if state is not None:
            level = 0 if state.silent else level or LEVEL_UNKNOWN
        return BoardStatus(
            frames_played=self._frames_begun(),
            underruns=self.underruns,
            starved_periods=self._starved_ns // self._step_ns,
            fifo_frames=sum(bank.waiting(now_ns) for bank in self._scheduled),
            torn_bytes=0,
            level=level,
            divider=self._divider,
        )

    def clear(self) -> bool:
        """Drop what is not played yet: True. The array is silent then."""
        self.cancel()
        return True

    def send_off(self) -> None:
        """Off now, whatever is being played."""
        self._staged.clear()
        self._staged_frames = 0
        try:
            self._controller.silence()
        finally:
            self._drop()
        self._frames_past += 1

    def close(self) -> None:
        """Silence the array, give it back its settings at power-up, let go of it. Raises nothing."""
        self._controller.close()

    def _set_divider(self, divider: int) -> None:
        self._divider, self._step_ns = divider, divider * PERIOD_NS
        frames = round(BANK_DURATION * self.array.update_rate(divider))
        self._bank_frames = min(max(frames, 1), BANK_FRAMES_MAX)

    def _frames_begun(self) -> int:
        now_ns = self._controller.now_ns()
        return self._frames_past + sum(len(bank.level) - bank.waiting(now_ns) for bank in self._scheduled)

    def _take(self, count: int) -> NDArray[np.uint8]:
        """The first `count` staged frames."""
        taken: list[NDArray[np.uint8]] = []
        self._staged_frames -= count
        while count:
            frame = self._staged.popleft()
            if len(frame) > count:
                self._staged.appendleft(frame[count:])
            taken.append(frame[:count])
            count -= len(taken[-1])
        return np.concatenate(taken)

    def _schedule(self, frame: NDArray[np.uint8]) -> None:
        """Fill the idle bank, and have it played when the other one ends, or as soon as can be."""
        bank = 1 - self._bank
        level = frame[:, self.array.transducer_count :].max(axis=1)
        content = frame[:-1] if len(frame) > 1 and level[-1] == 0 else frame  # a bank ends with the off pattern anyway
        self._fill(bank, content)
        lead_ns = LEAD_NS
        for _ in range(ATTEMPTS):
            start_ns = max(self._end_ns or 0, self._grid(self._controller.now_ns() + lead_ns))
            if self._controller.activate(bank, start_ns):
                break
            lead_ns *= 2
        else:
            raise DeviceTimeoutError(
                f"array {self.array.name} takes no bank in time: its clock or this host is too slow"
            )
        if self._end_ns is not None and start_ns > self._end_ns:
            self.underruns += 1
            self._starved_ns += start_ns - self._end_ns
        self._bank = bank
        self._scheduled.append(_Scheduled(bank, start_ns, self._step_ns, level))
        self._end_ns = self._scheduled[-1].end_ns

    def _fill(self, bank: int, content: NDArray[np.uint8]) -> None:
        """Put frames into the idle bank, unless it has them already: the next time round of a loop."""
        held = self._held.pop(bank, content[:0])  # unknown, should the writing fail
        if not np.array_equal(held[: len(content)], content):
            self._controller.write_bank(bank, content, self._divider)
        elif len(held) > len(content):
            self._controller.cut_bank(bank, len(content), self._divider)
        self._held[bank] = content

    def _grid(self, time_ns: int) -> int:
        """The next time at which a pattern may begin: the array counts them from its time 0."""
        return -(-time_ns // self._step_ns) * self._step_ns

    def _wait_bank(self, abandon: Callable[[], bool]) -> bool:
        """Wait until a bank is idle, because the other one is played; False if abandoned."""
        if not self._scheduled:
            return True
        last = self._scheduled[-1]
        if not self._wait_until(last.start_ns, abandon):
            return False
        self._see_played(last)
        self._retire(self._controller.now_ns())
        return True

    def _see_played(self, bank: _Scheduled) -> None:
        """Have the array say, if it can, that it plays the bank whose time has come."""
        deadline_ns = self.clock.now_ns() + SWITCH_NS
        while True:
            self.clock.sleep_until_ns(self.clock.now_ns() + LOOK_NS)
            state = self._controller.state()
            if state is None or (state.bank == bank.bank and not state.failsafe):
                return
            if state.failsafe:
                raise LinkError(f"array {self.array.name} stopped by itself: it heard nothing from this host for 0.5 s")
            if self.clock.now_ns() > deadline_ns:
                raise LinkError(f"array {self.array.name} did not change to its other bank when it should have")

    def _wait_until(self, time_ns: int, abandon: Callable[[], bool]) -> bool:
        """Wait for a time of the array; False if abandoned."""
        while (left_ns := time_ns - self._controller.now_ns()) > 0:
            if abandon():
                return False
            self.clock.sleep_until_ns(self.clock.now_ns() + min(left_ns, SLICE_NS))
        return True

    def _retire(self, now_ns: int) -> None:
        while self._scheduled and self._scheduled[0].end_ns <= now_ns:
            self._frames_past += len(self._scheduled.popleft().level)

    def _drop(self) -> None:
        """Forget what is staged and scheduled; what has begun counts."""
        self._frames_past = self._frames_begun()
        self._staged.clear()
        self._staged_frames = 0
        self._scheduled.clear()
        self._held.clear()
        self._end_ns, self._bank = None, 0


@dataclass(frozen=True)
class _Scheduled:
    """A bank that is being played, or will be."""

    bank: int
    start_ns: int
    step_ns: int
    level: NDArray[np.uint8]
    """Highest level of each frame, shape [frame]."""

    @property
    def end_ns(self) -> int:
        """Time at which its last frame has been played [ns]."""
        return self.start_ns + len(self.level) * self.step_ns

    def waiting(self, now_ns: int) -> int:
        """How many of its frames are still to begin."""
        begun = (now_ns - self.start_ns) // self.step_ns + 1
        return len(self.level) - min(max(begun, 0), len(self.level))

    def level_at(self, now_ns: int) -> int:
        """Highest level of the frame that is being played."""
        frame = (now_ns - self.start_ns) // self.step_ns
        return int(self.level[frame]) if 0 <= frame < len(self.level) else 0


def _whole_loops(frame: NDArray[np.uint8]) -> int:
    """How many of the frames to put into a bank: as many whole loops as there are, so that the next bank is the same.

    All of them, where nothing comes back after at most half of them.
    """
    count = len(frame)
    back = np.flatnonzero((frame[1 : count // 2 + 1] == frame[0]).all(axis=1)) + 1
    for length in back[:LOOP_GUESSES].tolist():
        if np.array_equal(frame[length:], frame[:-length]):
            return count // length * length
    return count


def open_autd3(model: ArrayModel, *, address: str | None = None, emulated: bool = False) -> Autd3Link:
    """Open the AUTD3 that is plugged into this host's network. Its firmware must be one for the package autd3 0.12.

    Args:
        model: the array `autd3`.
        address: name of the network interface that it hangs on, such as "eth1", or the socket address of an emulated
            one, such as "[::1]:44336"; None: each interface is asked, and exactly one array must answer.
        emulated: open a new emulated one of the vendor's, at this host's own address; then `address` says nothing.

    Returns:
        The link. The array is silent; whatever host had it before has lost it.

    Raises:
        NoBackendError: the vendor's package is not installed.
        DeviceNotFoundError: no array answers there.
        LinkError: it answers, but cannot be opened, such as one of several in a chain.
    """
    try:
        from .vendor_client import Controller, emulated_channel, network_channel
    except ModuleNotFoundError as error:
        if (error.name or "").partition("_")[0] != "autd3":
            raise
        raise NoBackendError(
            f"array {model.name} needs the vendor's package, which is not installed: "
            "pip install -e '.[autd3]' in palpate's folder"
        ) from None
    where = "emulated" if emulated else address
    who = f"{model.name} at {where}" if where else model.name
    controller = Controller(emulated_channel(who=who) if emulated else network_channel(address, who=who), who=who)
    try:
        controller.reset()
    except LinkError:
        controller.close()
        raise
    return Autd3Link(model, controller, serial=where)
