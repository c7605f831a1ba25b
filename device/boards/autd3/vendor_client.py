"""The vendor's package `autd3` 0.12, contained: its commands, its errors, its event loop.

The package is optional, so this module is imported only where an AUTD3 is opened. Nothing of the vendor's leaves it.
"""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Awaitable, Callable, Generator
from concurrent.futures import TimeoutError as FutureTimeoutError
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Final, Protocol, TypeVar

import numpy as np
from autd3 import Autd3Error, Client, ClientConfig, Duration, Interface, UdpEmulator, UdpOption, commands
from autd3.geometry import Autd3, Geometry
from autd3.value import LoopBehavior, PatternBank, SamplingConfig, SysTime, TransitionMode
from autd3_pattern import IntensityBuffer, PhaseBuffer
from numpy.typing import NDArray

from ...clock import Clock, MonotonicClock
from ...errors import DeviceLostError, DeviceNotFoundError, DeviceTimeoutError, LinkError

T = TypeVar("T")

TRANSDUCERS: Final = 249
FAILSAFE: Final = 0.5  # [s], the vendor's default: the array stops its output after so long without this host
STEP_MAX: Final = 0xFFFF  # of the silencer: any change is done in one period of the carrier
SEND_TIMEOUT: Final = 5.0  # [s] for a full bank; the vendor gives up on each frame far earlier
OPEN_TIMEOUT: Final = 45.0  # [s]; the vendor's own limits, 10 s of search and 30 s until clocks agree, come first
# More patient than the vendor's own, for the host may be busy; less than the failsafe.
LOST_AFTER_MS: Final = 400  # without a reply; vendor: 100
ACK_MS: Final = 200  # until a command is carried out; vendor: 10
REPLY_MS: Final = 50  # until an idle array says that it is there; vendor: 1
_BANKS: Final = (PatternBank.B0, PatternBank.B1)
_OFF: Final = PhaseBuffer.from_array(np.zeros((1, TRANSDUCERS), np.uint8))


@dataclass(frozen=True)
class OutputState:
    """What an AUTD3 says of its output."""

    bank: int
    """Bank that is played, 0 or 1."""
    silent: bool
    """A single pattern stands (here always the off pattern), the frames of the bank have ended, or the failsafe holds.
    """
    pending: bool
    """A change of the bank waits for its time."""
    failsafe: bool
    """It stopped its output, because it heard nothing from the host."""


class Channel(Protocol):
    """Carries the vendor's commands to an AUTD3; may raise the vendor's errors and `LinkError`s."""

    @property
    def clock(self) -> Clock:
        """The host's clock, which runs as fast as the array's."""
        ...

    def send(self, command: commands.Command) -> None:
        """Return when the array has carried it out."""
        ...

    def now_ns(self) -> int:
        """Time of the array [ns]."""
        ...

    def state(self) -> OutputState | None:
        """Ask the array; None where it cannot be asked."""
        ...

    def is_lost(self) -> bool:
        """Whether the array has gone; waits as long as it takes to find out, at most about LOST_AFTER_MS."""
        ...

    def close(self) -> None:
        """Let go of the array. Raises nothing."""
        ...


class Controller:
    """What a link asks of an AUTD3, in the vendor's commands. Raises only `LinkError`s."""

    def __init__(self, channel: Channel, *, who: str) -> None:
        self.clock = channel.clock
        self._channel = channel
        self._who = who

    def now_ns(self) -> int:
        """Time of the array [ns]."""
        return self._channel.now_ns()

    def reset(self) -> None:
        """Forget everything, a failsafe too; then silent, unsmoothed, bank 0 standing, and off if the host dies."""
        failsafe = commands.CpuConfig(failsafe_timeout=Duration.from_millis(round(FAILSAFE * 1e3)))
        # SetSilencer.disable() leaves a few per cent of the phase steps smoothed (measured with 0.12.0).
        unsmoothed = commands.SetSilencer(commands.FixedUpdateRate(STEP_MAX, STEP_MAX))
        with self._guard():
            self._channel.send([commands.Clear(), unsmoothed, commands.SetCpuConfig(failsafe), *_off_patterns()])

    def write_bank(self, bank: int, frame: NDArray[np.uint8], divider: int) -> None:
        """Fill an idle bank with frames, shape [frame, 498], to be played once, then silence."""
        count = len(frame)
        phase = [PhaseBuffer.from_array(row) for row in frame[:, None, :TRANSDUCERS]]
        level = frame[:, TRANSDUCERS:]
        sampling = SamplingConfig(divider)
        option = commands.PatternStmOption(
            bank=_BANKS[bank], loop_behavior=LoopBehavior.Once, transition_mode=TransitionMode.Later
        )
        if count > 1 and (level == level[0, 0]).all():  # phases alone: 5 frames a datagram, not 2
            stm = commands.PatternStm(sampling, phase, int(level[0, 0]), option)
        else:
            intensity = [IntensityBuffer.from_array(row) for row in frame[:, None, TRANSDUCERS:]]
            # a bank has at least 2
            stm = commands.PatternStm(sampling, [*phase, _OFF], [*intensity, IntensityBuffer(1)], option)
        with self._guard():
            self._channel.send([stm, *_ending(bank, count, divider)])

    def cut_bank(self, bank: int, count: int, divider: int) -> None:
        """Leave an idle bank only its first `count` frames, then silence."""
        with self._guard():
            self._channel.send(_ending(bank, count, divider))

    def activate(self, bank: int, time_ns: int) -> bool:
        """Play a bank from a time of the array on; False if that is too near by now."""
        with self._guard():
            try:
                at = TransitionMode.SysTime(SysTime.from_nanos(time_ns))
                self._channel.send(commands.ActivatePatternBank(_BANKS[bank], at))
            except Autd3Error as error:
                if "too close" not in str(error):
                    raise
                return False
        return True

    def silence(self) -> None:
        """Off now: both banks, so that a change of the bank under way finds silence too; bank 0 stands."""
        with self._guard():
            self._channel.send(_off_patterns())

    def state(self) -> OutputState | None:
        """Ask the array; None where it cannot be asked."""
        with self._guard():
            return self._channel.state()

    def close(self) -> None:
        """Silence, put everything back as the array is at power-up, the silencer too, and let go. Raises nothing."""
        with suppress(LinkError), self._guard():
            self.silence()
            self._channel.send(commands.Clear())
        self._channel.close()

    @contextmanager
    def _guard(self) -> Generator[None]:
        try:
            yield
        except Autd3Error as error:
            raise self._translate(error) from error

    def _translate(self, error: Autd3Error) -> LinkError:
        if error.code in (Autd3Error.TIMEOUT, Autd3Error.NETWORK):
            if self._channel.is_lost():
                return DeviceLostError(f"array {self._who} is gone: unplugged, switched off, or taken by another host")
            return DeviceTimeoutError(f"array {self._who} did not answer in time: {error}")
        return LinkError(f"array {self._who} refused: {error}")


class UdpChannel:
    """An AUTD3 at the network.

    Args:
        interface: where it is, in the vendor's words.
        who: what to call it in messages.
        emulator: the emulated one that stands there; it ends with this.

    Raises:
        DeviceNotFoundError: none answers there.
        LinkError: whatever else the vendor's package says, such as another count of devices than one.
    """

    def __init__(self, interface: Interface, *, who: str, emulator: UdpEmulator | None = None) -> None:
        self.clock: Clock = MonotonicClock()
        self.emulator = emulator
        """For faults: `reboot(0)`."""
        self._who = who
        self._loop = _EventLoop()
        option = UdpOption(
            iface=interface,
            reply_timeout=Duration.from_millis(REPLY_MS),
            lost_timeout=Duration.from_millis(LOST_AFTER_MS),
        )
        config = ClientConfig(ack_timeout=Duration.from_millis(ACK_MS), require_supported_firmware=True)
        try:
            client = self._call(lambda: Client.open(Geometry([Autd3()]), option, config), OPEN_TIMEOUT)
        except BaseException as error:
            self._loop.close()
            if isinstance(error, Autd3Error):
                kind = DeviceNotFoundError if error.code == Autd3Error.NETWORK else LinkError
                raise kind(f"array {who} cannot be opened: {error}") from error
            raise
        self._client = client

    def send(self, command: commands.Command) -> None:
        """Return when the array has carried it out."""
        self._call(lambda: self._client.send(command))

    def now_ns(self) -> int:
        """Time of the array [ns]."""
        return self._client.device_time_now().sys_time

    def state(self) -> OutputState | None:
        """Ask the array."""
        state = self._call(self._client.read_fpga_state)[0]
        failsafe = state.is_failsafe_active()
        return OutputState(
            bank=_BANKS.index(state.current_pattern_bank()),
            silent=failsafe or not state.is_stm_mode() or state.is_pattern_stopped(),
            pending=state.is_transition_pending(),
            failsafe=failsafe,
        )

    def is_lost(self) -> bool:
        """Whether the array has gone."""
        checker = self._client.state_checker()
        deadline = time.monotonic() + 1.5e-3 * LOST_AFTER_MS
        while not (lost := checker.check().any_lost) and time.monotonic() < deadline:
            time.sleep(0.01)
        return lost

    def close(self) -> None:
        """Let go of the array: unless another host takes it, it is silent within FAILSAFE. Raises nothing."""
        with suppress(Autd3Error, LinkError):
            self._call(self._client.close)
        self._loop.close()

    def _call(self, make: Callable[[], Awaitable[T]], timeout: float = SEND_TIMEOUT) -> T:
        if self._loop.is_closed:
            raise DeviceLostError(f"array {self._who} was let go of: open it again")
        try:
            return self._loop.call(make, timeout)
        except FutureTimeoutError:
            raise DeviceTimeoutError(f"array {self._who} did not answer within {timeout:g} s") from None


def network_channel(address: str | None, *, who: str) -> UdpChannel:
    """The AUTD3 at the host's interface of that name, or at a socket address; None: each interface is asked.

    Raises `DeviceNotFoundError` for an address that is none, and what `UdpChannel` raises.
    """
    return UdpChannel(_interface(address), who=who)


def emulated_channel(*, who: str) -> UdpChannel:
    """An emulated AUTD3 of the vendor's: its real firmware, at an address of this host's own."""
    emulator = UdpEmulator(1)
    return UdpChannel(emulator.option().iface, who=who, emulator=emulator)


class _EventLoop:
    """An event loop on a thread of its own: the vendor's client is asynchronous, a link is not."""

    def __init__(self) -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="palpate-autd3", daemon=True)
        self._thread.start()

    def call(self, make: Callable[[], Awaitable[T]], timeout: float) -> T:
        """Make an awaitable in the loop and wait for it, at most `timeout` [s]."""

        async def task() -> T:
            return await make()

        future = asyncio.run_coroutine_threadsafe(task(), self._loop)
        try:
            return future.result(timeout)
        except BaseException:
            future.cancel()  # nothing, if it has ended
            raise

    @property
    def is_closed(self) -> bool:
        """Whether its thread has ended."""
        return self._loop.is_closed()

    def close(self) -> None:
        """End the thread; nothing happens if it has ended."""
        if not self.is_closed:
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join()
            self._loop.close()


def _ending(bank: int, count: int, divider: int) -> list[commands.Command]:
    """After so many frames the off pattern, and then nothing more."""
    return [
        commands.WritePatternBuffer(_BANKS[bank], count, _OFF, 0),
        commands.ConfigPattern(_BANKS[bank], SamplingConfig(divider), count + 1, LoopBehavior.Once),
    ]


def _off_patterns() -> list[commands.Command]:
    """Bank 0 last, so that it is the one that stands."""
    return [commands.Pattern(_OFF, 0, bank=bank) for bank in reversed(_BANKS)]


def _interface(address: str | None) -> Interface:
    if address is None:
        return Interface.Auto
    if ":" not in address:
        return Interface.Name(address)
    try:
        return Interface.Addr(address)
    except ValueError as error:
        raise DeviceNotFoundError(f"address of the array: {error}") from error
