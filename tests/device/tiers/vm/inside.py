"""Inside the virtual machine: play to boards that vhci_hcd attaches over USB/IP."""

from __future__ import annotations

import json
import platform
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
import numpy as np
from umockdev_chips import CHIPS, Chip
from umockdev_player import DEFAULTS, content
from umockdev_session import write_pat_file
from usbip_bus import plugged_in

from palpate.device import MonotonicClock, array_model

PLAYER = str(Path(__file__).parents[1] / "umockdev_player.py")
VHCI = Path("/sys/devices/platform/vhci_hcd.0")
IMPORT_REQUEST, IMPORT_REPLY, VERSION = 0x8003, 0x0003, 0x0111
HIGH_SPEED = 3
UNUSED = 4  # vhci_hcd's word for a port without device
PAT = Path("/dev/shm/board.pat")


def tell(what: str, text: str) -> None:
    sys.stdout.write(f"vm: {what} {text}\n")
    sys.stdout.flush()


def play(**options: object) -> dict[str, object]:
    done = subprocess.run([sys.executable, PLAYER, json.dumps(options)], capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(done.stderr[-2000:])
    return json.loads(done.stdout)["plays"]


@contextmanager
def attached(port: int) -> Iterator[None]:
    """Have the kernel take the one device that is served there as plugged in."""
    connection = socket.create_connection(("127.0.0.1", port))
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    connection.sendall(struct.pack(">HHI32s", VERSION, IMPORT_REQUEST, 0, b"1-1"))
    reply = connection.recv(8 + 312, socket.MSG_WAITALL)
    version, code, status = struct.unpack_from(">HHI", reply)
    if (version, code, status) != (VERSION, IMPORT_REPLY, 0):
        raise RuntimeError(f"import was refused: {code:#x} {status}")
    bus, device, _ = struct.unpack_from(">III", reply, 8 + 256 + 32)
    rows = [line.split() for line in (VHCI / "status").read_text().splitlines()]
    free = next(int(row[1]) for row in rows if row[0] == "hs" and int(row[2]) == UNUSED)
    (VHCI / "attach").write_text(f"{free} {connection.fileno()} {bus << 16 | device} {HIGH_SPEED}")
    try:
        yield
    finally:
        (VHCI / "detach").write_text(str(free))
        connection.close()


def wait_for(chip: Chip) -> None:
    """Until the kernel has enumerated it."""
    for _ in range(300):
        for path in Path("/sys/bus/usb/devices").glob("*/serial"):
            if path.read_text().strip() == chip.serial:
                time.sleep(1)  # for drivers that bind
                return
        time.sleep(0.1)
    raise RuntimeError("the kernel did not enumerate the device")


def over_usbip(array: str, transport: str, **options: object) -> dict[str, object]:
    """Play to a board that the kernel sees on vhci_hcd; whether it played what was sent."""
    chosen = {"array": array, "transport": transport, "pat": str(PAT) if array == "pat16" else None, **options}
    chip = CHIPS[array]("VM0001", MonotonicClock(), 100_000)
    model = array_model(array, calibration=PAT if array == "pat16" else None)
    wire = content(int(chosen["frames"]), DEFAULTS["seed"], model)
    with plugged_in(chip) as (backend, _), attached(backend.port):
        wait_for(chip)
        (report,) = play(**chosen)
    played = chip.board.played
    on = played[:, 256:].any(axis=1) if array == "pat16" else played[:, 1::2].any(axis=1)
    equal = np.array_equal(played[on], wire)
    return {"what": f"{array} {transport} over vhci_hcd", "equal": equal, "off": not chip.board.emitting, **report}


def main() -> None:
    tell("kernel", platform.release())
    write_pat_file(PAT, serial="VM0001")
    for transport in ("sync", "queued"):
        for array, rate in (("emulator", 1000.0), ("pat16", 500.0)):
            row = over_usbip(array, transport, rate=rate, frames=1000)
            tell("result", json.dumps(row))


if __name__ == "__main__":
    main()
