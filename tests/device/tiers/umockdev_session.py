"""A program on a USB bus that umockdev emulates: start it, fault it, kill it, and see what the boards played.

The program is any Python; its libusb is the real one. The bus runs in another process (umockdev_bus.py), in the
interpreter for which umockdev's bindings are packaged.
"""

from __future__ import annotations

import functools
import json
import os
import shutil
import subprocess
import sys
import sysconfig
from dataclasses import dataclass, field
from pathlib import Path
from signal import SIGKILL
from typing import Any

import numpy as np

INTERPRETER = "/usr/bin/python3"  # Debian's, for which python3-gi is built
PACKAGES = "apt-get install umockdev gir1.2-umockdev-1.0 python3-gi libusb-1.0-0"
BUS = Path(__file__).with_name("umockdev_bus.py")
PROBE = """
import site, sys
site.addsitedir(sys.argv[1])
import gi
gi.require_version("UMockdev", "1.0")
from gi.repository import UMockdev
import numpy.linalg
import usb.backend.libusb1
assert usb.backend.libusb1.get_backend(), "no libusb-1.0"
"""


@functools.cache
def missing() -> str | None:
    """Why this tier cannot run here; None if it can."""
    wrapper = shutil.which("umockdev-wrapper")
    if wrapper is None or not Path(INTERPRETER).exists():
        return f"umockdev is not installed: {PACKAGES}"
    probe = [wrapper, INTERPRETER, "-c", PROBE, sysconfig.get_path("purelib")]
    try:
        done = subprocess.run(probe, capture_output=True, text=True, timeout=60, check=False)
    except subprocess.TimeoutExpired:
        return f"{INTERPRETER} did not import umockdev within 60 s"
    if done.returncode:
        last = done.stderr.strip().splitlines()[-1:] or [f"exit code {done.returncode}"]
        return f"{INTERPRETER} has not what the bus needs ({last[0]}): {PACKAGES}"
    return None


@dataclass(frozen=True)
class Plug:
    """A device on the bus."""

    board: str = "emulator"  # or pat16
    serial: str = "U1"
    faults: tuple[dict[str, Any], ...] = ()  # umockdev_usbfs.BusFault
    driver: str | None = None  # kernel driver that is bound to it
    busy: bool = False  # another program has claimed it
    record: int = 1_000_000


@dataclass(frozen=True)
class Outcome:
    """What the program and the boards came to."""

    returncode: int
    out: str
    err: str
    devices: list[dict[str, Any]]  # counts of each board and of its place on the bus
    arrays: dict[str, np.ndarray] = field(repr=False)

    def played(self, device: int = 0) -> np.ndarray:
        """Frames that the board played, shape [frame, byte]."""
        return self.arrays[f"{device}_played"]

    @property
    def told(self) -> dict[str, Any]:
        """The last line that the program printed, as JSON."""
        lines = self.out.strip().splitlines()
        if not lines:
            raise RuntimeError(f"the program told nothing (exit code {self.returncode}): {self.err}")
        return json.loads(lines[-1])


def run(
    command: list[str],
    folder: Path,
    *,
    plugs: tuple[Plug, ...] = (Plug(),),
    signal: str | None = None,
    signal_byte: int = 0,
    linger: float = 0.0,
    environment: dict[str, str] | None = None,
    timeout: float = 120.0,
) -> Outcome:
    """Run a program on a bus until it ends.

    signal: sent to it once the first board has taken `signal_byte` bytes. linger: how long [s] the bus stays up after
    the program's end while a board still emits.
    """
    spec = {
        "site": sysconfig.get_path("purelib"),
        "devices": [vars(plug) for plug in plugs],
        "command": command,
        "environment": environment or {},
        "kill": signal and {"signal": signal, "device": 0, "byte": signal_byte},
        "linger": linger,
        "report": str(folder / "report.npz"),
        "stdout": str(folder / "stdout"),
        "stderr": str(folder / "stderr"),
    }
    (folder / "spec.json").write_text(json.dumps(spec))
    bus = subprocess.Popen(
        [shutil.which("umockdev-wrapper") or "", INTERPRETER, str(BUS), str(folder / "spec.json")],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"},
        start_new_session=True,
    )
    try:
        said, _ = bus.communicate(timeout=timeout)
    finally:
        if bus.poll() is None:
            os.killpg(bus.pid, SIGKILL)  # and the program on it
            bus.wait()
    out, err = ((folder / name).read_text() if (folder / name).exists() else "" for name in ("stdout", "stderr"))
    if bus.returncode or said:
        raise RuntimeError(f"the bus failed ({bus.returncode}): {said}\n{err}")
    with np.load(folder / "report.npz") as stored:
        arrays = dict(stored)
    meta = json.loads(str(arrays.pop("meta")))
    return Outcome(meta["returncode"], out, err, meta["devices"], arrays)


def run_code(code: str, folder: Path, *arguments: str, **options: Any) -> Outcome:
    """`run` of a Python program."""
    return run([sys.executable, "-c", code, *arguments], folder, **options)


def write_pat_file(path: Path, *, serial: str, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A board file of a board wired like no other; gives position [m] of each pin, its own delay [turns], and its gain.

    In the order of the published files: x ascending, in each column y descending.
    """
    rng = np.random.default_rng(seed)
    axis = np.round((np.arange(16) - 7.5) * 10.5e-3, 5)
    place = np.array([(x, y, 0.0) for x in axis for y in axis[::-1]])
    pin = rng.permutation(256)
    offset = rng.choice([0.0, 180.0], 256) + rng.normal(0, 5, 256).round(2)  # wired either way round, and a scatter
    gain = rng.uniform(0.7, 1.0, 256).round(3)
    lines = [
        serial,
        "256",
        "128",
        ", ".join(f"({x:.5f}, {y:.5f}, {z:.1f})" for x, y, z in place),
        ", ".join(map(str, pin)),
        ", ".join(f"{value:.2f}" for value in offset),
        ", ".join(f"{value:.3f}" for value in gain),
    ]
    path.write_text("\n".join(lines) + "\n")
    of_pin = np.argsort(pin)
    return place[of_pin], offset[of_pin] / 360, gain[of_pin]
