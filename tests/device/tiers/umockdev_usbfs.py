"""One USB device as Linux's usbfs shows it: ioctls in, answers out; behind it a chip in real time, and faults.

Runs in the interpreter that has umockdev's bindings, not in the tests'. Time is stepped: at each ioctl the chip is run
up to now, each transfer going on at the very moment at which the chip had room. So neither the scheduling of this
process nor a host that looks late for what has ended can starve a board whose bytes were queued in time.
"""

from __future__ import annotations

import errno
import struct
import threading
import time
from collections import deque
from dataclasses import dataclass, field

# linux/usbdevice_fs.h: the low 16 bits of an ioctl, type 'U' and number; the rest is size and direction
SETCONFIGURATION, GETDRIVER, SUBMITURB, DISCARDURB, REAPURB, REAPURBNDELAY = (
    0x5505, 0x5508, 0x550A, 0x550B, 0x550C, 0x550D,
)  # fmt: skip
CLAIM, RELEASE, IOCTL, CLEAR_HALT, DISCONNECT, CONNECT, GET_CAPABILITIES, GET_SPEED = (
    0x550F, 0x5510, 0x5512, 0x5515, 0x5516, 0x5517, 0x551A, 0x551F,
)  # fmt: skip
CAPABILITIES = 0x01 | 0x04 | 0x10  # zero packet, no limit of a transfer's size, reap after disconnect
HIGH_SPEED = 3
POINTER_SIZE, NAME_AT, NAME_SIZE = 8, 4, 256

URB_SIZE, URB_STATUS, URB_BUFFER, URB_LENGTH, URB_ACTUAL = 56, 4, 16, 24, 28
CONTROL, BULK = 2, 3
SETUP_SIZE = 8
VENDOR = 0x40  # of bmRequestType's bits 0x60
CONTROL_QUEUE = 0

REAP_WAIT = 1e-3  # [s] the file is always "ready" here and libusb would spin: a reap waits once it has been in vain
REAPS_IN_VAIN = 6  # so often, with no other ioctl between


class SteppedClock:
    """The chip's clock: moved by the bus alone, never ahead of real time."""

    name = "monotonic"

    def __init__(self) -> None:
        self.time_ns = time.monotonic_ns()

    def now_ns(self) -> int:
        return self.time_ns

    def sleep_until_ns(self, time_ns: int) -> None:
        raise RuntimeError("a chip on this bus never waits")


@dataclass(frozen=True)
class BusFault:
    """One fault, and the byte of the bulk stream before which, or the vendor request at which, it strikes.

    | kind | the transfer |
    |---|---|
    | stall | fails; on bulk all do until the halt is cleared |
    | nak | stays pending until the host discards it |
    | short | ends well with what was taken (bulk only) |
    | unplug | fails, as everything does from then on |
    """

    kind: str
    byte: int | None = None
    request: int | None = None
    count: int | None = 1  # how many times; from then on if None


@dataclass(eq=False)
class Urb:
    """A transfer that the host has submitted and not had back."""

    memory: object  # umockdev's view of it in the host
    address: int
    buffer: object
    data: memoryview  # bytes out
    length: int
    client: object
    taken: int = 0
    status: int = 0
    held: bool = False  # a fault NAKs it until it is discarded


@dataclass
class Tally:
    """What happened on the bus, for the report."""

    urbs: int = 0
    pending_max: int = 0  # on one endpoint
    discarded: int = 0
    discarded_partly: int = 0  # of which a part was taken
    discarded_out_of_order: int = 0  # with another pending behind it
    faults_struck: int = 0
    halts_cleared: int = 0
    opens: int = 0
    bytes_out: int = 0
    requests: list[tuple[int, int, int, int]] = field(default_factory=list)  # vendor's
    bindings: list[str] = field(default_factory=list)  # of the kernel's driver: "-name" and "+name"


class UsbfsDevice:
    """The device node; `handle` answers one ioctl of one open file ("client")."""

    def __init__(self, chip, clock: SteppedClock, *, driver: str | None, busy: bool, faults: list[BusFault]) -> None:
        self.chip, self.clock, self.driver = chip, clock, driver
        self.tally = Tally()
        self.plugged = True
        self.halted = False
        self._busy = busy
        self._unbound = driver  # what CONNECT binds
        self._faults = [(fault, fault.count) for fault in faults]
        self._pending: dict[int, deque[Urb]] = {}  # by endpoint
        self._done: dict[object, deque[Urb]] = {}  # by client
        self._clients: list = []
        self._closed: list = []  # kept: umockdev complains of clients that go before their streams
        self._holder: object | None = None
        self._vain: dict[object, int] = {}  # by client: reaps in a row that found nothing
        self._lock = threading.RLock()
        self._answers = {
            GET_CAPABILITIES: self._get_capabilities,
            SUBMITURB: self._submit,
            DISCARDURB: self._discard,
            CLAIM: self._claim,
            RELEASE: self._release,
            GETDRIVER: self._get_driver,
            IOCTL: self._bind,
            SETCONFIGURATION: lambda arg, client: (-1, errno.EBUSY) if self._holder else (0, 0),
            CLEAR_HALT: self._clear_halt,
            GET_SPEED: lambda arg, client: (HIGH_SPEED, 0),
        }

    @property
    def claimed(self) -> bool:
        return self._holder is not None

    def handle(self, request: int, client) -> tuple[int, int]:
        """(result, errno) of an ioctl."""
        with self._lock:
            self.forget_closed()
            self.run_to_now()
            number = request & 0xFFFF
            if number in (REAPURB, REAPURBNDELAY):
                return self._reap(client)
            self._vain[client] = 0
            if not self.plugged:
                return -1, errno.ENODEV
            answer = self._answers.get(number)
            return answer(client.get_arg(), client) if answer else (-1, errno.ENOTTY)

    def connected(self, client) -> None:
        """A file was opened."""
        with self._lock:
            self.tally.opens += 1
            self._clients.append(client)

    @property
    def holder(self) -> object | None:
        """The file that has claimed the interface."""
        return self._holder

    def forget_closed(self) -> None:
        """End the transfers and claims of files that were closed; umockdev 0.17 does not say when, so all are asked."""
        with self._lock:
            for client in [client for client in self._clients if not client.get_connected()]:
                self.forget(client)

    def forget(self, client) -> None:
        """A file was closed, in order or by a kill: end its transfers and its claim; what was taken stays taken."""
        with self._lock:
            if client not in self._clients:
                return
            self.run_to_now()
            self._clients.remove(client)
            self._closed.append(client)
            for endpoint, queue in self._pending.items():
                self._pending[endpoint] = deque(urb for urb in queue if urb.client is not client)
            self._done.pop(client, None)
            self._vain.pop(client, None)
            if self._holder is client:
                self._holder = None

    # --- time

    def run_to_now(self) -> None:
        """Run chip and transfers up to real time."""
        with self._lock:
            now = time.monotonic_ns()
            for endpoint, queue in self._pending.items():
                advance = self._advance_in if endpoint & 0x80 else self._advance_out
                while queue and endpoint != CONTROL_QUEUE and advance(queue, now):
                    pass
            self.clock.time_ns = max(now, self.clock.time_ns)

    def _advance_out(self, queue: deque[Urb], now: int) -> bool:
        """Move the first transfer of a queue on by one step; False if it must wait."""
        urb = queue[0]
        if not self.plugged or self.halted:
            return self._complete(queue, -errno.EPIPE if self.plugged else -errno.ESHUTDOWN)
        if urb.held:
            return False
        fault, limit = self._next_fault(urb)
        stop = min(limit, urb.taken + self.chip.step_bytes)
        if urb.taken < stop:
            return self._pour(urb, stop, now)
        if fault is None:
            return self._complete(queue, 0)
        return self._strike(queue, fault)

    def _pour(self, urb: Urb, stop: int, now: int) -> bool:
        """Hand bytes to the chip, or step its clock to when it has room; False if that is yet to come."""
        took = self.chip.accept(urb.data[urb.taken : stop])
        urb.taken += took
        self.tally.bytes_out += took
        if took == 0:
            room_at = self.chip.room_at_ns(stop - urb.taken)
            if room_at > now:
                return False
            self.clock.time_ns = max(room_at, self.clock.time_ns + 1)
        return True

    def _advance_in(self, queue: deque[Urb], now: int) -> bool:
        reply = self.chip.read()[: queue[0].length] if self.plugged else b""
        if reply:
            queue[0].buffer.update(0, reply)
            queue[0].taken = len(reply)
        return (bool(reply) or not self.plugged) and self._complete(queue, 0 if self.plugged else -errno.ESHUTDOWN)

    def _next_fault(self, urb: Urb) -> tuple[BusFault | None, int]:
        """The first fault in the rest of a transfer, and how many of its bytes go before that."""
        start = self.tally.bytes_out - urb.taken
        ahead = [fault for fault, _ in self._faults if fault.byte is not None and fault.byte < start + urb.length]
        if not ahead:
            return None, urb.length
        fault = min(ahead, key=lambda fault: fault.byte)
        return fault, max(fault.byte - start, urb.taken)

    def _strike(self, queue: deque[Urb], fault: BusFault) -> bool:
        self._count(fault)
        if fault.kind == "nak":
            queue[0].held = True
            return False
        if fault.kind == "short":
            return self._complete(queue, 0)
        self.halted = fault.kind == "stall"
        if fault.kind == "unplug":
            self._unplug()
        return True  # the next step ends it

    def _count(self, fault: BusFault) -> None:
        self.tally.faults_struck += 1
        for place, (known, left) in enumerate(self._faults):
            if known is fault and left is not None:
                self._faults[place : place + 1] = [(known, left - 1)] if left > 1 else []
                return

    def _complete(self, queue: deque[Urb], status: int) -> bool:
        urb = queue.popleft()
        urb.status = status
        self._done.setdefault(urb.client, deque()).append(urb)
        return True

    def _unplug(self) -> None:
        self.plugged = False
        self.chip.power_off()

    # --- ioctls

    def _get_capabilities(self, arg, client) -> tuple[int, int]:
        arg.resolve(0, 4).update(0, struct.pack("=I", CAPABILITIES))
        return 0, 0

    def _submit(self, arg, client) -> tuple[int, int]:
        memory = arg.resolve(0, URB_SIZE)
        head = bytes(memory.retrieve())
        kind, endpoint = head[:2]
        (length,) = struct.unpack_from("=i", head, URB_LENGTH)
        buffer = memory.resolve(URB_BUFFER, length) if length else None
        data = bytes(buffer.retrieve()) if length else b""
        urb = Urb(memory, memory.client_addr, buffer, memoryview(data), length, client)
        self.tally.urbs += 1
        if kind == CONTROL:
            self._control(urb, self._pending.setdefault(CONTROL_QUEUE, deque()))
            return 0, 0
        if kind != BULK or self._holder is not client or endpoint not in self.chip.endpoints:
            return -1, errno.ENOENT
        queue = self._pending.setdefault(endpoint, deque())
        queue.append(urb)
        self.tally.pending_max = max(self.tally.pending_max, len(queue))
        self.run_to_now()
        return 0, 0

    def _control(self, urb: Urb, queue: deque[Urb]) -> None:
        """Answer a control transfer at once, unless a fault holds it; one that is held lets others pass."""
        kind, request, value, index, length = struct.unpack_from("<BBHHH", urb.data)
        fault = None
        if kind & 0x60 == VENDOR:
            self.tally.requests.append((kind, request, value, index))
            fault = next((fault for fault, _ in self._faults if fault.request == request), None)
        queue.appendleft(urb)
        if fault is not None:
            self._count(fault)
            urb.held = fault.kind == "nak"
            if fault.kind == "unplug":
                self._unplug()
            if not urb.held:
                self._complete(queue, -errno.EPIPE if self.plugged else -errno.ESHUTDOWN)
            return
        reply = self.chip.control(kind, request, value, index)
        if reply is not None and kind & 0x80:
            urb.buffer.update(SETUP_SIZE, reply[:length])
            urb.taken = len(reply[:length])
        elif reply is not None:
            urb.taken = length
        self._complete(queue, -errno.EPIPE if reply is None else 0)

    def _reap(self, client) -> tuple[int, int]:
        if not self._done.get(client) and self._vain.get(client, 0) >= REAPS_IN_VAIN and self.plugged:
            self._lock.release()  # the program that watches the bus may look meanwhile
            try:
                time.sleep(REAP_WAIT)
            finally:
                self._lock.acquire()
            self.run_to_now()
        done = self._done.get(client)
        self._vain[client] = 0 if done else self._vain.get(client, 0) + 1
        if not done:
            return -1, errno.EAGAIN if self.plugged else errno.ENODEV
        urb = done.popleft()
        urb.memory.update(URB_STATUS, struct.pack("=i", urb.status))
        urb.memory.update(URB_ACTUAL, struct.pack("=i", urb.taken))
        client.get_arg().resolve(0, POINTER_SIZE).set_ptr(0, urb.memory)
        return 0, 0

    def _discard(self, arg, client) -> tuple[int, int]:
        address = arg.resolve(0, URB_SIZE).client_addr
        for queue in self._pending.values():
            for place, urb in enumerate(queue):
                if urb.address == address and urb.client is client:
                    del queue[place]
                    urb.status = -errno.ENOENT
                    self.tally.discarded += 1
                    self.tally.discarded_partly += 0 < urb.taken < urb.length
                    self.tally.discarded_out_of_order += place < len(queue)
                    self._done.setdefault(client, deque()).append(urb)
                    return 0, 0
        return -1, errno.EINVAL

    def _claim(self, arg, client) -> tuple[int, int]:
        if self._busy or self.driver is not None or self._holder not in (None, client):
            return -1, errno.EBUSY
        self._holder = client
        return 0, 0

    def _release(self, arg, client) -> tuple[int, int]:
        if self._holder is not client:
            return -1, errno.EINVAL
        self._holder = None
        return 0, 0

    def _clear_halt(self, arg, client) -> tuple[int, int]:
        self.halted = False
        self.tally.halts_cleared += 1
        return 0, 0

    def _get_driver(self, arg, client) -> tuple[int, int]:
        name = "usbfs" if self._holder is not None else self.driver
        if name is None:
            return -1, errno.ENODATA
        arg.resolve(0, NAME_AT + NAME_SIZE).update(NAME_AT, name.encode().ljust(NAME_SIZE, b"\0"))
        return 0, 0

    def _bind(self, arg, client) -> tuple[int, int]:
        """Take the kernel's driver off the interface, or let it have it again."""
        code = struct.unpack_from("=ii", bytes(arg.resolve(0, 16).retrieve()))[1] & 0xFFFF
        if code == DISCONNECT and self.driver is not None:
            self.tally.bindings.append(f"-{self.driver}")
            self.driver = None
            return 0, 0
        if code == CONNECT and self._holder is None and self._unbound is not None:
            self.driver = self._unbound
            self.tally.bindings.append(f"+{self.driver}")
            return 1, 0  # how many drivers took it
        return -1, errno.EBUSY if self._holder is not None else errno.ENODATA
