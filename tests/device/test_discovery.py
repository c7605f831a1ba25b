"""What is plugged in: listed with the reason when it cannot be opened, and opened by the right link."""

from __future__ import annotations

import errno
from pathlib import Path

import numpy as np
import pytest
import usb.core
from board_file_cases import board_lines, write
from injected_faults import Fault, FaultKind, inject

from palpate.device.boards.discovery import UDEV_FILE, find_arrays, open_link, udev_rule
from palpate.device.boards.emulator.link import UsbLink
from palpate.device.boards.pat16.ftdi import FtdiPort
from palpate.device.boards.pat16.link import PatLink
from palpate.device.boards.sonicsurface.link import SonicLink
from palpate.device.clock import VirtualClock
from palpate.device.errors import (
    CalibrationError,
    DeviceBusyError,
    DeviceNotFoundError,
    DevicePermissionError,
    NoBackendError,
)
from palpate.device.registry import array_model, array_names, emulated_backend
from palpate.device.transports import lookup
from palpate.device.transports.lookup import DeviceStrings

USB_BOARDS = ["emulator", "pat16"]
EACH_BOARD = pytest.mark.parametrize("name", USB_BOARDS)


@EACH_BOARD
def test_boards_are_listed_with_their_serial_numbers(name: str) -> None:
    bus = emulated_backend(name, clock=VirtualClock(), serials=["one", "two"])
    found = find_arrays(bus)
    assert [(info.array, info.serial, info.accessible) for info in found] == [(name, "one", True), (name, "two", True)]
    assert [info.certain for info in found] == [name == "emulator"] * 2
    bus.unplug()
    assert [info.serial for info in find_arrays(backend=bus)] == ["two"]


def test_what_has_an_ftdi_chip_is_only_said_to_be_a_likely_array(tmp_path: Path) -> None:
    board = write(tmp_path / "b.pat", board_lines(np.random.default_rng(0))[0])
    bus = emulated_backend("pat16", clock=VirtualClock(), serials=["FT4TKZL8", "AB0CDE"])
    unknown = find_arrays(bus)
    assert all("may be a pat16" in (info.reason or "") and not info.certain for info in unknown)
    known, other = find_arrays(bus, calibrations=[board])
    assert (known.certain, known.serial) == (True, "FT4TKZL8")
    assert "may be" not in (known.reason or "")
    assert "no board file given has its serial number" in (other.reason or "")
    with pytest.raises(CalibrationError, match="cannot be read"):
        find_arrays(bus, calibrations=[tmp_path / "none.pat"])


@EACH_BOARD
def test_without_permission_the_rule_that_gives_it_is_told(name: str) -> None:
    bus = emulated_backend(name, clock=VirtualClock())
    inject(bus, Fault(FaultKind.DENIED, count=None))
    (info,) = find_arrays(bus)
    assert (info.accessible, info.serial) == (False, None)
    assert udev_rule(array_model(name)) in (info.reason or "")
    assert UDEV_FILE in (info.reason or "")
    with pytest.raises(DevicePermissionError, match=f"array {name} may not be opened"):
        open_link(array_model(name), backend=bus)


@EACH_BOARD
def test_a_board_that_is_played_to_is_listed_as_in_use_and_plays_on(name: str) -> None:
    bus = emulated_backend(name, clock=VirtualClock())
    with open_link(array_model(name), backend=bus) as link:
        (info,) = find_arrays(bus)
        assert not info.accessible
        assert "in use by another program" in (info.reason or "")
        link.start(array_model(name).divider_default)
        with pytest.raises(DeviceBusyError, match="in use"):
            open_link(array_model(name), backend=bus)
    assert find_arrays(bus)[0].accessible


@EACH_BOARD
def test_a_kernel_driver_is_told_of_and_left_alone(name: str) -> None:
    bus = emulated_backend(name, clock=VirtualClock())
    bus.bind_kernel_driver()
    (info,) = find_arrays(bus)
    assert info.accessible
    assert "serial driver, which is detached" in (info.reason or "")
    assert bus._ports[0].driver


def test_a_system_that_knows_no_kernel_drivers_is_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown(*_: object) -> bool:
        raise NotImplementedError

    bus = emulated_backend("emulator", clock=VirtualClock())
    monkeypatch.setattr(type(bus), "is_kernel_driver_active", unknown)
    assert find_arrays(bus)[0].accessible
    pat = emulated_backend("pat16", clock=VirtualClock())
    pat._ports[0].driver = False
    open_link(array_model("pat16"), backend=pat).close()


def test_a_device_that_cannot_be_asked_is_told_of_and_one_that_is_gone_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    for code, listed in ((errno.ENODEV, []), (errno.EIO, ["cannot be opened: [Errno 5] Input/Output Error"])):

        def fail(*_: object, code: int = code) -> None:
            raise usb.core.USBError("Input/Output Error", None, code)

        bus = emulated_backend("emulator", clock=VirtualClock())
        monkeypatch.setattr(type(bus), "open_device", fail)
        assert [info.reason for info in find_arrays(bus)] == listed


def test_without_libusb_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(**_: object) -> None:
        raise usb.core.NoBackendError("No backend available")

    monkeypatch.setattr(usb.core, "find", missing)
    with pytest.raises(NoBackendError, match="libusb is not installed"):
        find_arrays()
    with pytest.raises(NoBackendError, match="libusb is not installed"):
        open_link(array_model("pat16"), uncalibrated=True)


@pytest.mark.parametrize(("name", "kind"), [("emulator", UsbLink), ("pat16", PatLink), ("sonicsurface", SonicLink)])
def test_each_array_is_opened_by_its_own_link(name: str, kind: type) -> None:
    bus = emulated_backend(name, clock=VirtualClock(), serials=["one", "two"])
    with open_link(array_model(name), serial="two", backend=bus) as link:
        assert isinstance(link, kind)
        assert (link.serial, link.array.name, link.clock) == ("two", name, bus.clock)
    with pytest.raises(DeviceNotFoundError, match=f"array {name} three was not found: found instead: one.*, two"):
        open_link(array_model(name), serial="three", backend=bus)


def test_one_of_several_ftdi_chips_must_be_named() -> None:
    name = "pat16"
    bus = emulated_backend(name, clock=VirtualClock(), serials=["one", "two"])
    with pytest.raises(DeviceNotFoundError, match=f"array {name} is one of 2 .*: one, two. Say which .*serial=NUMBER"):
        open_link(array_model(name), backend=bus)
    bus.unplug()
    with open_link(array_model(name), backend=bus) as link:
        assert link.serial == "two"


def test_adapters_of_one_serial_number_cannot_be_told_apart() -> None:
    bus = emulated_backend("pat16", clock=VirtualClock(), serials=["one", "one", "two"])
    with pytest.raises(DeviceNotFoundError, match="2 adapters have the serial number one of array pat16"):
        open_link(array_model("pat16"), serial="one", backend=bus)
    open_link(array_model("pat16"), serial="two", backend=bus).close()


def test_the_board_file_of_another_board_is_refused_with_what_is_plugged_in(tmp_path: Path) -> None:
    board = write(tmp_path / "b.pat", board_lines(np.random.default_rng(0))[0])
    bus = emulated_backend("pat16", clock=VirtualClock(), serials=["FT0THER0"])
    with pytest.raises(DeviceNotFoundError, match="pat16 FT4TKZL8 was not found: found instead: FT0THER0"):
        FtdiPort.open(array_model("pat16", calibration=board), backend=bus)  # an emulated `PatLink` takes any board


def test_a_chip_that_may_not_be_asked_counts_among_several(monkeypatch: pytest.MonkeyPatch) -> None:
    name = "pat16"
    read = lookup.strings_of

    def refused(device: lookup.UsbDevice) -> DeviceStrings:
        strings = read(device)
        if strings.serial == "one":
            raise usb.core.USBError("Access denied", None, errno.EACCES)
        return strings

    monkeypatch.setattr(lookup, "strings_of", refused)
    bus = emulated_backend(name, clock=VirtualClock(), serials=["one", "two"])
    with pytest.raises(DeviceNotFoundError, match=r"one of 2 adapters .* two, and 1 that this user may not ask"):
        open_link(array_model(name), backend=bus)
    open_link(array_model(name), serial="two", backend=bus).close()
    with pytest.raises(DevicePermissionError):
        open_link(array_model(name), backend=emulated_backend(name, clock=VirtualClock(), serials=["one"]))


def test_a_rule_names_the_chip_and_arrays_that_libusb_does_not_open_have_none() -> None:
    assert udev_rule(array_model("pat16")) == (
        'SUBSYSTEM=="usb", ATTR{idVendor}=="0403", ATTR{idProduct}=="6014", TAG+="uaccess"'
    )
    assert {udev_rule(array_model(name)) for name in set(array_names()) - set(USB_BOARDS)} == {""}


# The emulated serial ports; what is real of serial ports is in test_device_serial.py.


def test_an_emulated_port_is_refused_and_busy_as_a_real_one() -> None:
    ports = emulated_backend("sonicsurface", clock=VirtualClock())
    inject(ports, Fault(FaultKind.DENIED))
    inject(ports, Fault(FaultKind.BUSY))
    for error in (DevicePermissionError, DeviceBusyError):
        with pytest.raises(error):
            open_link(array_model("sonicsurface"), backend=ports)
    with open_link(array_model("sonicsurface"), backend=ports), pytest.raises(DeviceBusyError, match="in use"):
        open_link(array_model("sonicsurface"), backend=ports)
    open_link(array_model("sonicsurface"), backend=ports).close()
