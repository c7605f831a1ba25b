"""The emulated buses of all boards through pyusb itself: chips, claims, kernel drivers, faults."""

from __future__ import annotations

import ast
import errno
import threading
import time
from array import array
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import usb.core
import usb.util
from injected_faults import Fault, FaultKind, inject

import palpate.device
from palpate.device.clock import VirtualClock
from palpate.device.emulation.usb_bus import EmulatedBus
from palpate.device.errors import UnknownArrayError
from palpate.device.registry import emulated_backend

DEVICE = Path(palpate.device.__file__).parent
OUT, IN = 0x40, 0xC0
RESET, FLOW, BAUD, LINE, SET_LATENCY, GET_LATENCY, BIT_MODE = 0, 2, 3, 4, 9, 0x0A, 0x0B
NAMES = ("emulator", "pat16")
ENDPOINT = {"emulator": 0x01, "pat16": 0x02}
FRAME = 512


def frames(count: int) -> array:
    """Frames that emit, each another."""
    number = np.arange(count, dtype=np.uint8)[:, None]
    wire = np.repeat(number % 64 + 1, FRAME, axis=1)
    wire[:, 0] |= 0x80
    return array("B", wire.astype(np.uint8).tobytes())


def bus_of(name: str, **options: object) -> EmulatedBus:
    return emulated_backend(name, clock=VirtualClock(), record=1000, **options)


def opened(bus: EmulatedBus, name: str) -> usb.core.Device:
    found = usb.core.find(backend=bus)
    if name != "emulator":
        found.detach_kernel_driver(0)
    found.set_configuration()
    usb.util.claim_interface(found, 0)
    return found


@pytest.fixture(params=NAMES)
def name(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture
def bus(name: str) -> EmulatedBus:
    return bus_of(name)


@pytest.fixture
def plugged(bus: EmulatedBus, name: str) -> Iterator[usb.core.Device]:
    found = opened(bus, name)
    yield found
    usb.util.dispose_resources(found)


def raised(code: int, call: Callable[[], object]) -> None:
    with pytest.raises(usb.core.USBError) as error:
        call()
    assert error.value.errno == code


def test_boards_are_written_from_documents_alone() -> None:
    # Followed through: nothing that a board, chip or bus imports may lead to a codec, an array model or a link.
    waiting = [DEVICE / "boards" / side for side in ("emulator/model", "pat16/ftdi_model", "sonicsurface/model")]
    waiting.append(DEVICE / "emulation/usb_bus")
    reached: set[str] = set()
    while waiting:
        module = waiting.pop()
        reached.add(str(module.relative_to(DEVICE)))
        if module.name == "errors":  # which imports for annotations only
            continue
        for node in ast.walk(ast.parse(module.with_suffix(".py").read_text())):
            if isinstance(node, ast.ImportFrom) and node.level:
                imported = module.parents[node.level - 1] / (node.module or "").replace(".", "/")
                waiting += [] if str(imported.relative_to(DEVICE)) in reached else [imported]
    boards = {"emulator/model", "pat16/model", "pat16/ftdi_model", "sonicsurface/model"}
    buses = {"peripheral", "usb_bus", "serial_bus"}
    assert reached == (
        {f"boards/{name}" for name in boards}
        | {f"emulation/{name}" for name in buses}
        | {"clock", "errors", "transports/pyusb", "transports/serial_line"}
    )


def test_models_need_no_usb_library() -> None:
    # So that another interpreter can run them behind another bus.
    models = ("boards/emulator/model", "boards/pat16/model", "boards/sonicsurface/model", "boards/pat16/ftdi_model")
    for module in (*models, "emulation/peripheral", "clock"):
        for node in ast.walk(ast.parse((DEVICE / f"{module}.py").read_text())):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [(node.module or "").rpartition(".")[2]] if isinstance(node, ast.ImportFrom) else []
            assert not {name for name in names if name.startswith("usb") or name == "pyusb"}, module


def test_there_is_no_bus_for_an_array_that_has_none() -> None:
    with pytest.raises(UnknownArrayError, match="autd3"):
        emulated_backend("autd3")


@pytest.mark.parametrize(
    ("name", "ids", "strings", "endpoints"),
    [
        ("emulator", (0x1209, 0x0001), ("palpate", "emulated 256-transducer array"), [0x01]),
        ("pat16", (0x0403, 0x6014), ("FTDI", "Single RS232-HS"), [0x81, 0x02]),
    ],
)
def test_enumeration(name: str, ids: tuple[int, int], strings: tuple[str, str], endpoints: list[int]) -> None:
    bus = bus_of(name, serials=["one", "two"])
    found = list(usb.core.find(find_all=True, backend=bus))
    assert [(d.idVendor, d.idProduct, d.serial_number) for d in found] == [(*ids, "one"), (*ids, "two")]
    assert (found[0].manufacturer, found[0].product) == strings
    assert found[0].speed == usb.util.SPEED_HIGH
    [interface] = found[0].configurations()[0].interfaces()
    assert [(e.bEndpointAddress, e.bmAttributes, e.wMaxPacketSize) for e in interface] == [
        (address, 2, 512) for address in endpoints
    ]
    assert usb.core.find(backend=bus, idProduct=2) is None
    for each in found:
        usb.util.dispose_resources(each)


def test_a_board_may_be_looked_at_while_another_thread_writes(name: str) -> None:
    bus = emulated_backend(name, record=1000)  # in real time
    plugged = opened(bus, name)
    sent = frames(150)
    writer = threading.Thread(target=lambda: plugged.write(ENDPOINT[name], sent, timeout=0))
    writer.start()
    while writer.is_alive():
        assert bus.board().frames_played <= len(sent) // FRAME
        assert len(bus.board().played) <= len(bus.board().played_ns)
    while bus.board().frames_played < len(sent) // FRAME:
        time.sleep(0.001)
    assert bus.board().played.tobytes() == sent.tobytes()
    usb.util.dispose_resources(plugged)


def test_a_write_blocks_until_the_board_has_room(bus: EmulatedBus, name: str, plugged: usb.core.Device) -> None:
    # Of pat16, a frame is taken after 64 us, read until 74.24 us, and followed at the end of the 255th period from
    # there; then 512 bytes leave the chip.
    holds, room_at_ns = {
        "emulator": (2048 * 512, 100_000),
        "pat16": (31 * 512, 75_000 + 254 * 25_000 + 512 * 125),
    }[name]
    sent = frames(holds // FRAME + 2)
    if name == "pat16":
        sent[26:35] = array("B", [0xFF] * 9)
    plugged.write(ENDPOINT[name], sent[:holds], timeout=1000)
    assert bus.clock.now_ns() < room_at_ns / 2
    plugged.write(ENDPOINT[name], sent[holds : holds + FRAME], timeout=1000)
    assert bus.clock.now_ns() == pytest.approx(room_at_ns, abs=2)


def test_a_write_blocked_at_its_timeout_is_short_and_without_any_byte_an_error(
    bus: EmulatedBus, name: str, plugged: usb.core.Device
) -> None:
    sent = frames(2200)
    taken = plugged.write(ENDPOINT[name], sent, timeout=2)
    assert 0 < taken < len(sent)
    assert bus.clock.now_ns() == 2_000_000
    inject(bus, Fault(FaultKind.TIMEOUT, byte=taken))
    raised(errno.ETIMEDOUT, lambda: plugged.write(ENDPOINT[name], sent[taken:], timeout=1))
    assert bus.board().bytes_received == taken


def test_a_kernel_driver_keeps_the_interface_until_it_is_detached(bus: EmulatedBus, name: str) -> None:
    found = usb.core.find(backend=bus)
    assert found.is_kernel_driver_active(0) == (name != "emulator")
    bus.bind_kernel_driver()
    if name == "emulator":
        raised(errno.EBUSY, found.set_configuration)
    else:
        assert found.get_active_configuration().bConfigurationValue == 1
        raised(errno.EBUSY, lambda: usb.util.claim_interface(found, 0))
    found.detach_kernel_driver(0)
    raised(errno.ENOENT, lambda: found.detach_kernel_driver(0))
    found.set_configuration()
    usb.util.claim_interface(found, 0)
    raised(errno.EBUSY, lambda: found.attach_kernel_driver(0))
    usb.util.release_interface(found, 0)
    found.attach_kernel_driver(0)
    assert found.is_kernel_driver_active(0)
    usb.util.dispose_resources(found)


def test_after_replugging_a_board_is_as_from_power_up(bus: EmulatedBus, name: str, plugged: usb.core.Device) -> None:
    plugged.write(ENDPOINT[name], frames(5), timeout=1000)
    bus.clock.advance(0.5)
    bus.unplug()
    assert not bus.board().emitting
    bus.replug()
    emits_at_first = name == "pat16"  # for a second, until its gateware loads an off frame
    assert (bus.board().emitting, bus.board().frames_played, bus.board().bytes_received) == (emits_at_first, 0, 0)
    again = opened(bus, name)
    again.write(ENDPOINT[name], frames(5), timeout=1000)
    bus.clock.advance(0.5)
    assert bus.board().frames_played == (0 if name == "pat16" else 5)  # a PAT board waits for a second
    usb.util.dispose_resources(again)


# The FTDI chip.

chips = pytest.mark.parametrize("name", ["pat16"], indirect=True)


@chips
def test_status_packets_come_at_the_latency(bus: EmulatedBus, name: str, plugged: usb.core.Device) -> None:
    plugged.ctrl_transfer(OUT, SET_LATENCY, 2, 1)
    assert plugged.ctrl_transfer(IN, GET_LATENCY, 0, 1, 1).tolist() == [2]
    assert len(plugged.read(0x81, 64, timeout=100)) == 2
    assert bus.clock.now_ns() == 2_000_000
    plugged.ctrl_transfer(OUT, SET_LATENCY, 255, 1)
    raised(errno.ETIMEDOUT, lambda: plugged.read(0x81, 64, timeout=100))
    raised(errno.EOVERFLOW, lambda: plugged.read(0x81, 1, timeout=1000))


@chips
def test_an_unknown_request_and_another_port_stall(name: str, plugged: usb.core.Device) -> None:
    for request in ((OUT, 0x77, 0, 1), (OUT, RESET, 3, 1), (OUT, RESET, 0, 2), (OUT, SET_LATENCY, 0, 1)):
        raised(errno.EPIPE, lambda request=request: plugged.ctrl_transfer(*request))
    for known in ((OUT, RESET, 0, 1), (OUT, BIT_MODE, 0x00FF, 1), (OUT, FLOW, 0, 1)):
        assert plugged.ctrl_transfer(*known) == 0


@chips
def test_in_another_bit_mode_nothing_leaves_the_chip(bus: EmulatedBus, name: str, plugged: usb.core.Device) -> None:
    plugged.ctrl_transfer(OUT, BIT_MODE, 0x40FF, 1)
    sent = frames(3)
    raised(errno.ETIMEDOUT, lambda: plugged.write(0x02, sent, timeout=100))
    assert bus.board().frames_played == 0
    plugged.ctrl_transfer(OUT, BIT_MODE, 0x00FF, 1)
    plugged.write(0x02, sent, timeout=100)
    bus.clock.advance(1.0)
    assert bus.board().played.tobytes() == sent.tobytes()


@chips
@pytest.mark.parametrize("purges", [(1,), (2,), (1, 2), (2, 1), (1, 1)])
def test_both_purges_empty_the_chip(
    bus: EmulatedBus, name: str, plugged: usb.core.Device, purges: tuple[int, ...]
) -> None:
    sent = frames(40)
    sent[26:35] = array("B", [0xFF] * 9)  # the first frame plays for 6.4 ms
    taken = plugged.write(0x02, sent, timeout=5)
    for purge in purges:
        plugged.ctrl_transfer(OUT, RESET, purge, 1)
    bus.clock.advance(0.5)
    kept = taken - 1024 if set(purges) == {1, 2} else taken
    assert bus.board().frames_played == kept // 512
