"""A USB bus under umockdev, and the program that plays on it: `umockdev-wrapper python3 umockdev_bus.py SPEC.json`.

Started by umockdev_session.py, in the interpreter that has umockdev's bindings (Debian's). The program runs as a child
with umockdev's library before libc, so its real libusb finds, opens and writes to the devices here.
"""

from __future__ import annotations

import errno
import json
import os
import signal
import site
import subprocess
import sys
import time
from pathlib import Path

SPEC = json.loads(Path(sys.argv[1]).read_text())
site.addsitedir(SPEC["site"])  # NumPy, and palpate's board models
sys.path.insert(0, str(Path(__file__).parent))

import gi  # noqa: E402  # after the path

gi.require_version("UMockdev", "1.0")
import numpy as np  # noqa: E402
from gi.repository import GLib, UMockdev  # noqa: E402
from umockdev_chips import CHIPS  # noqa: E402
from umockdev_usbfs import BusFault, SteppedClock, UsbfsDevice  # noqa: E402

HUB = "/devices/pci0000:00/0000:00:14.0/usb1"
POLL = 1e-3  # [s]


class Node(UMockdev.IoctlBase):
    """umockdev's side of a device node."""

    def __init__(self, device: UsbfsDevice) -> None:
        super().__init__()
        self.device = device

    def do_handle_ioctl(self, client) -> bool:
        try:
            result, code = self.device.handle(client.get_request(), client)
        except GLib.Error:  # it was killed in the middle of the ioctl
            self.device.forget(client)
            result, code = -1, errno.ENODEV
        except BaseException as error:  # whatever it is, the host must not wait for ever
            sys.stderr.write(f"bus: {error!r}\n")
            result, code = -1, errno.EIO
        client.complete(result, code)
        return True

    def do_client_connected(self, client) -> None:
        self.device.connected(client)


def sysfs_entry(number: int, chip) -> str:
    """What umockdev needs to know of a device; no MAJOR and MINOR, or libudev waits for udev's database."""
    descriptors = chip.device_descriptor() + chip.configuration_descriptor()
    lines = [
        f"P: {HUB}/1-{number - 1}",
        f"N: bus/usb/001/{number:03d}",
        f"E: DEVNAME=/dev/bus/usb/001/{number:03d}",
        "E: DEVTYPE=usb_device",
        "E: SUBSYSTEM=usb",
        "E: BUSNUM=001",
        f"E: DEVNUM={number:03d}",
        "A: busnum=1\\n",
        f"A: devnum={number}\\n",
        "A: bConfigurationValue=1\\n",
        f"A: speed={chip.speed}\\n",
        f"H: descriptors={descriptors.hex().upper()}",
    ]
    return "\n".join(lines) + "\n\n"


def hub_entry() -> str:
    descriptors = "12010002090001406B1D020015060302010109021900010100E0000904000001090000000705810304000C"
    return (
        f"P: {HUB}\nN: bus/usb/001/001\nE: DEVNAME=/dev/bus/usb/001/001\nE: DEVTYPE=usb_device\nE: SUBSYSTEM=usb\n"
        "E: BUSNUM=001\nE: DEVNUM=001\nA: busnum=1\\n\nA: devnum=1\\n\nA: bConfigurationValue=1\\n\nA: speed=480\\n\n"
        f"H: descriptors={descriptors}\n\n"
    )


def build(testbed) -> list[UsbfsDevice]:
    testbed.add_from_string(hub_entry())
    devices = []
    for number, item in enumerate(SPEC["devices"], start=2):
        clock = SteppedClock()
        chip = CHIPS[item["board"]](item["serial"], clock, item["record"])
        faults = [BusFault(**fault) for fault in item["faults"]]
        device = UsbfsDevice(chip, clock, driver=item["driver"], busy=item["busy"], faults=faults)
        testbed.add_from_string(sysfs_entry(number, chip))
        node = Node(device)
        testbed.attach_ioctl(f"/dev/bus/usb/001/{number:03d}", node)
        device.node = node  # kept alive
        devices.append(device)
    return devices


def watch(child: subprocess.Popen, devices: list[UsbfsDevice]) -> None:
    """Run the bus until the child ends, signalled when the spec says so; then until all is silent, or for a while."""
    kill = SPEC["kill"]
    holders: list[object | None] = []
    while child.poll() is None:
        if kill and devices[kill["device"]].tally.bytes_out >= kill["byte"]:
            holders = [device.holder for device in devices]
            os.kill(child.pid, getattr(signal, kill["signal"]))
            kill = None
        time.sleep(POLL)
    for device, holder in zip(devices, holders, strict=False):
        device.forget(holder)  # Linux ends the claims of a process that died; umockdev does not always say that it did
    run_to_now(devices)
    end = time.monotonic() + SPEC["linger"]
    while time.monotonic() < end and any(device.chip.board.emitting for device in devices):
        time.sleep(10 * POLL)
        run_to_now(devices)
    run_to_now(devices)


def run_to_now(devices: list[UsbfsDevice]) -> None:
    for device in devices:
        device.forget_closed()
        device.run_to_now()


def report(child: subprocess.Popen, devices: list[UsbfsDevice]) -> None:
    told, arrays = [], {}
    for number, device in enumerate(devices):
        facts, played = device.chip.report()
        state = {"driver": device.driver, "plugged": device.plugged, "claimed": device.claimed}
        told.append({**facts, **vars(device.tally), **state})
        arrays.update({f"{number}_{name}": value for name, value in played.items()})
    np.savez(SPEC["report"], meta=json.dumps({"returncode": child.returncode, "devices": told}), **arrays)


def main() -> None:
    testbed = UMockdev.Testbed.new()
    devices = build(testbed)
    environment = {**os.environ, "UMOCKDEV_DIR": testbed.get_root_dir(), **SPEC["environment"]}
    with open(SPEC["stdout"], "wb") as out, open(SPEC["stderr"], "wb") as err:
        child = subprocess.Popen(SPEC["command"], env=environment, stdout=out, stderr=err)
        try:
            watch(child, devices)
        finally:
            if child.poll() is None:
                child.kill()
                child.wait()
    report(child, devices)


if __name__ == "__main__":
    main()
