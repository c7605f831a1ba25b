"""The queue of transfers, over a pipe that stands for libusb: order, exact counts, and what each failure comes to."""

from __future__ import annotations

import errno
from array import array
from collections import deque
from types import SimpleNamespace

import numpy as np
import pytest
import usb.core
from hypothesis import given
from hypothesis import strategies as st

from palpate.device import EmulatorBackend
from palpate.device.clock import VirtualClock
from palpate.device.errors import DeviceLostError, DeviceStallError, DeviceTimeoutError, LinkError
from palpate.device.transports.bulk import open_transport
from palpate.device.transports.libusb import CANCELLED, COMPLETED, BulkQueue, Completion, hidden_name
from palpate.device.transports.queued import QueuedTransport
from palpate.device.transports.transport import SyncTransport

STALL, NO_DEVICE = 4, 5


class Pipe:
    """Takes `rate` bytes each time that it is waited for; what is in `ends` ends a transfer at that byte instead."""

    def __init__(self, clock: VirtualClock, *, rate: int = 1000) -> None:
        self.done: deque[Completion] = deque()
        self.taken = bytearray()
        self.offered: list[array] = []
        self.cancelled: list[int] = []  # places in the queue
        self.ends: dict[int, int] = {}
        self.goes_on = False  # with what is behind a transfer that has ended too early
        self.submit_codes: list[int] = []
        self.in_flight: list[list] = []  # [slot, data, count]
        self.flight_max = 0
        self.closed = False
        self._clock = clock
        self._rate = rate
        self._room = 0

    def submit(self, slot: int, data: array) -> int:
        if self.submit_codes and (code := self.submit_codes.pop(0)):
            return code
        assert slot not in [flight[0] for flight in self.in_flight]
        self.in_flight.append([slot, data, 0])
        self.offered.append(data)
        self.flight_max = max(self.flight_max, len(self.in_flight))
        return 0

    def cancel(self, slot: int) -> int:
        flight = next(flight for flight in self.in_flight if flight[0] == slot)
        self.cancelled.append(self.in_flight.index(flight))
        self.in_flight.remove(flight)
        self.done.append(Completion(slot, CANCELLED, flight[2]))
        return 0

    def handle_events(self, timeout: float) -> int:
        if timeout:
            self._clock.advance(timeout)
            self._room += self._rate
        while self.in_flight and self._room:
            slot, data, count = flight = self.in_flight[0]
            end = next((byte for byte in sorted(self.ends) if byte < len(self.taken) + len(data) - count), None)
            want = len(data) - count if end is None else max(end - len(self.taken), 0)
            part = min(want, self._room)
            self.taken += data[count : count + part].tobytes()
            flight[2] += part
            self._room -= part
            if part == want:
                self.in_flight.pop(0)
                self.done.append(Completion(slot, COMPLETED if end is None else self.ends.pop(end), flight[2]))
                if end is not None and not self.goes_on:
                    break
        return 0

    def close(self) -> None:
        self.closed = True


class Bench(SimpleNamespace):
    clock: VirtualClock
    pipe: Pipe
    transport: QueuedTransport
    halts: list[int]  # endpoints whose halt was ended


def bench(*, depth: int = 4, rate: int = 1000) -> Bench:
    clock = VirtualClock()
    pipe = Pipe(clock, rate=rate)
    halts: list[int] = []
    device = SimpleNamespace(clear_halt=halts.append)
    return Bench(
        clock=clock, pipe=pipe, halts=halts, transport=QueuedTransport(device, 1, depth=depth, clock=clock, pipe=pipe)
    )


def some_bytes(count: int, seed: int = 0) -> array:
    return array("B", np.random.default_rng(seed).integers(0, 256, count, np.uint8).tobytes())


@given(st.lists(st.integers(0, 3000), max_size=30), st.integers(1, 9), st.integers(200, 5000))
def test_all_bytes_arrive_once_and_in_order(sizes: list[int], depth: int, rate: int) -> None:
    b = bench(depth=depth, rate=rate)
    parts = [some_bytes(size, seed) for seed, size in enumerate(sizes)]
    submitted = 0
    for part in parts:
        b.transport.submit(part)
        submitted += len(part)
        assert b.transport.bytes_under_way + b.transport.bytes_taken == submitted
    assert b.transport.drain()
    assert b.pipe.taken == b"".join(part.tobytes() for part in parts)
    assert (b.transport.bytes_taken, b.transport.bytes_under_way) == (len(b.pipe.taken), 0)
    assert b.pipe.flight_max <= depth


def test_several_transfers_are_under_way_and_none_is_copied() -> None:
    b = bench(depth=3, rate=0)
    parts = [some_bytes(512, seed) for seed in range(3)]
    for part in parts:
        b.transport.submit(part)
    assert b.pipe.flight_max == 3
    assert all(offered is part for offered, part in zip(b.pipe.offered, parts, strict=True))
    assert b.transport.bytes_under_way == 3 * 512


def test_transfers_are_no_larger_than_64_kib() -> None:
    b = bench(depth=2, rate=50_000)
    sent = some_bytes(150_000)
    b.transport.submit(sent)
    b.transport.drain()
    assert [len(data) for data in b.pipe.offered] == [65536, 65536, 150_000 - 2 * 65536]
    assert b.pipe.taken == sent.tobytes()


@given(st.integers(0, 4000), st.integers(1, 8))
def test_cancel_ends_the_last_first_so_one_transfer_is_torn_and_the_count_is_exact(taken: int, depth: int) -> None:
    b = bench(depth=depth, rate=taken)
    for seed in range(depth):
        b.transport.submit(some_bytes(512, seed))
    b.transport.drain(abandon=lambda: b.clock.now_ns() > 0)  # waits once
    b.transport.cancel()
    assert b.pipe.cancelled == [*range(len(b.pipe.cancelled))][::-1]
    assert b.transport.bytes_taken == len(b.pipe.taken) == min(taken, depth * 512)
    assert b.transport.bytes_under_way == 0
    assert not b.pipe.in_flight


def test_an_abandoned_submit_hands_nothing_over() -> None:
    b = bench(depth=1, rate=0)
    b.transport.submit(some_bytes(10))
    b.transport.submit(some_bytes(10), abandon=lambda: True)
    assert len(b.pipe.offered) == 1
    assert not b.transport.drain(abandon=lambda: True)


def test_a_device_that_takes_nothing_is_given_up_after_a_second() -> None:
    b = bench(depth=1, rate=0)
    b.transport.submit(some_bytes(10))
    with pytest.raises(DeviceTimeoutError, match="did not answer in time"):
        b.transport.submit(some_bytes(10))
    assert 1e9 <= b.clock.now_ns() < 1.2e9
    b.transport.cancel()
    assert b.transport.bytes_under_way == 0


def test_a_device_that_goes_on_slowly_is_not() -> None:
    b = bench(depth=2, rate=1)
    b.transport.submit(some_bytes(40))  # 0.8 s
    b.transport.submit(some_bytes(40))
    b.transport.submit(some_bytes(40))
    assert b.transport.drain()
    assert b.clock.now_ns() > 2e9


@pytest.mark.parametrize(
    ("status", "error"), [(STALL, DeviceStallError), (NO_DEVICE, DeviceLostError), (1, LinkError), (6, LinkError)]
)
@pytest.mark.parametrize("at", [0, 700, 1024])
def test_a_failed_transfer_is_an_error_of_our_own_once_and_the_count_stays_exact(
    status: int, error: type[LinkError], at: int
) -> None:
    b = bench(depth=4, rate=100)
    b.pipe.ends[at] = status
    for seed in range(4):
        b.transport.submit(some_bytes(512, seed))
    with pytest.raises(error) as raised:
        b.transport.drain()
    assert type(raised.value) is error
    b.transport.cancel()
    assert b.transport.bytes_taken == len(b.pipe.taken)
    assert b.transport.bytes_under_way == 0
    b.transport.submit(some_bytes(5, 9))
    assert b.halts == ([1] if status == STALL else [])
    assert b.transport.drain()
    assert b.pipe.taken.endswith(some_bytes(5, 9).tobytes())


@pytest.mark.parametrize("at", [0, 1, 511, 600, 1023])
def test_the_rest_of_a_short_transfer_goes_before_what_was_behind_it(at: int) -> None:
    b = bench(depth=4, rate=512)
    b.pipe.ends[at] = COMPLETED
    parts = [some_bytes(512, seed) for seed in range(6)]
    for part in parts:
        b.transport.submit(part)
    assert b.transport.drain()
    assert b.pipe.taken == b"".join(part.tobytes() for part in parts)
    assert b.transport.short_writes == 1
    assert b.transport.bytes_taken == len(b.pipe.taken)


def test_bytes_taken_behind_a_short_transfer_are_a_torn_stream() -> None:
    b = bench(depth=4, rate=800)
    b.pipe.goes_on = True
    b.pipe.ends[100] = COMPLETED  # and 700 bytes of the next ones, before the host learns of it
    for seed in range(4):
        b.transport.submit(some_bytes(512, seed))
    with pytest.raises(LinkError, match="took 100 bytes of a transfer of 512, and then 700 bytes of what was behind"):
        b.transport.drain()
    assert b.transport.bytes_taken == len(b.pipe.taken) == 800


def test_memory_that_is_short_is_waited_for_unless_nothing_would_free_it() -> None:
    b = bench(depth=4, rate=512)
    b.transport.submit(some_bytes(512, 1))
    b.pipe.submit_codes = [errno.ENOMEM, 0]
    b.transport.submit(some_bytes(512, 2))
    b.transport.drain()
    assert b.pipe.taken == some_bytes(512, 1).tobytes() + some_bytes(512, 2).tobytes()
    b.pipe.submit_codes = [errno.ENOMEM]
    with pytest.raises(LinkError, match="usbfs_memory_mb"):
        b.transport.submit(some_bytes(512))


def test_close_cancels_and_frees_and_returns_although_a_transfer_does_not_end() -> None:
    b = bench(depth=2, rate=0)
    b.transport.submit(some_bytes(10))
    b.transport.close()
    assert (b.pipe.closed, b.pipe.in_flight) == (True, [])
    b = bench(depth=2, rate=0)
    b.transport.submit(some_bytes(10))
    b.pipe.cancel = lambda slot: 0
    with pytest.raises(DeviceTimeoutError):
        b.transport.cancel()
    assert b.clock.now_ns() < 1.2e9
    b.transport.close()
    assert b.pipe.closed


def test_other_backends_are_refused_for_queued_and_take_sync_for_auto() -> None:
    (device,) = usb.core.find(find_all=True, backend=EmulatorBackend(clock=VirtualClock()))
    assert "backend is palpate" in (hidden_name(device) or "")
    with pytest.raises(LinkError, match=r"the backend is palpate.*use the transport 'sync'"):
        open_transport(device, 1, kind="queued")
    assert isinstance(open_transport(device, 1), SyncTransport)


def libusb_device(**context: object) -> SimpleNamespace:
    backend = type("_LibUSB", (), {"__module__": "usb.backend.libusb1"})()
    return SimpleNamespace(_ctx=SimpleNamespace(backend=backend, **context))


def test_a_pyusb_that_hides_its_handle_is_played_by_blocking_writes_with_a_warning() -> None:
    device = libusb_device(opened=SimpleNamespace(handle=1))  # a pyusb that has moved its handle
    with pytest.warns(RuntimeWarning, match=r"array left .*keeps its handle elsewhere.*pip install 'pyusb==") as noted:
        transport = open_transport(device, 1, who="left")
    assert len(noted) == 1
    assert isinstance(transport, SyncTransport)


@pytest.mark.filterwarnings("error")
def test_blocking_writes_that_are_asked_for_are_no_surprise() -> None:
    assert isinstance(open_transport(libusb_device(), 1, kind="sync"), SyncTransport)


def test_a_pyusb_that_hides_its_handle_is_refused_by_name() -> None:
    device = libusb_device(handle=None)
    with pytest.raises(LinkError, match="keeps its handle elsewhere"):
        BulkQueue(device, 1, slots=1)
    device._ctx.handle = SimpleNamespace(handle=1)
    with pytest.raises(LinkError, match="keeps libusb elsewhere"):
        BulkQueue(device, 1, slots=1)
    with pytest.raises(ValueError, match="depth is 0"):
        bench(depth=0)


def test_no_more_bytes_are_under_way_than_its_owner_wants_but_one_transfer_always_is() -> None:
    b = bench(depth=8, rate=100)
    b.transport.window_bytes = 1000
    for size in (400, 400, 400, 3000, 10, 20):
        b.transport.submit(some_bytes(size))
        assert b.transport.bytes_under_way <= 1000 or len(b.pipe.in_flight) == 1
    assert b.transport.drain()
    assert b.pipe.flight_max == 2
    assert b.transport.bytes_taken == 4230
