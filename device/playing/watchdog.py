"""A process that switches an array off when the one that plays dies without a word (SIGKILL, a crash).

| the player | the watchdog |
|---|---|
| sends a goodbye: it left `Watchdog`'s context, whatever for | ends, exit code 0 |
| is gone: its pipe closed without goodbye | opens the array, sends off; exit code 3, or 4 if that failed |
| is silent (SIGSTOP, a hang) for `silence_max` | tries the same once, logs that the player holds the array, waits |

What no process can help against: the host's power or its USB fails, or both processes are killed at once (a control
group). A child that the player forked without exec keeps the pipe open: then only the silence shows.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import os
import select
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self, cast

from ..array import ArrayModel
from ..array_kind import ArrayKind
from ..boards.discovery import open_link
from ..errors import DeviceBusyError, DeviceError, DeviceTimeoutError, LinkError, WatchdogError
from ..link import Link
from ..registry import array_model, array_names, kind_of, register_array
from ..silence import is_switched_off, wait_silent
from ..transports.lookup import choose_port, find_device
from ..transports.pyusb import Backend, libusb_backend
from ..transports.serial_line import SerialPorts, SystemPorts

EXIT_GOODBYE: Final = 0
EXIT_OFF: Final = 3
EXIT_FAILED: Final = 4

SILENCE_MAX: Final = 2.0  # [s]
_SILENCE_BOUND = 86_400.0  # [s]
_READY_TIMEOUT = 30.0  # [s]; a new interpreter imports NumPy
_GOODBYE_TIMEOUT = 10.0  # [s]
_RELEASE_TIMEOUT = 5.0  # [s] in which the system takes the array from a process that is dead
_RETRY = 0.05  # [s]

_BEAT, _GOODBYE = b".", b"G"
_READY = b"ready"


@dataclass(frozen=True)
class WatchOrder:
    """What a watchdog is to watch; it goes to its process as one line of JSON."""

    array: str
    """Name of the array's kind."""
    modules: list[str]
    """Modules of the kind's functions: importing them makes it known, where it is not built in."""
    serial: str | None
    baud: int | None
    silence_max: float
    """Longest time without a sign of life [s]."""
    log: str | None
    """File that it appends to; None: standard error."""

    @property
    def who(self) -> str:
        """Name and serial number."""
        return f"{self.array} {self.serial}" if self.serial else self.array

    def model(self) -> ArrayModel:
        """The array, without its calibration, which off frames do not need; raises WatchdogError if it is unknown."""
        for name in self.modules if self.array not in array_names() else ():
            try:
                module = importlib.import_module(name)
            except ImportError as error:
                raise WatchdogError(
                    f"no other process can import {name}, which has array {self.array}: {error}"
                ) from error
            kinds = [value for value in vars(module).values() if isinstance(value, ArrayKind)]
            for kind in kinds:  # one that the module has, but leaves to others to register
                if kind.name == self.array and self.array not in array_names():
                    register_array(kind)
        model = array_model(self.array, baud=self.baud)
        if _modules(kind_of(model)) != self.modules:  # the player has another kind of that name
            raise WatchdogError(f"no other process can make array {self.array} from {', '.join(self.modules)}")
        return model


def read_order(text: str) -> WatchOrder:
    """Read the line back; raises WatchdogError, with the field, for anything else."""
    try:
        values: object = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise WatchdogError(f"a watchdog's order must be JSON: {error}") from error
    if not isinstance(values, dict) or values.keys() != _ORDER_TYPES.keys():
        raise WatchdogError(f"a watchdog's order must have the fields {', '.join(_ORDER_TYPES)}")
    for name, types in _ORDER_TYPES.items():
        if isinstance(values[name], bool) or not isinstance(values[name], types):
            raise WatchdogError(f"{name} of a watchdog's order is {values[name]!r}")
    if not all(isinstance(name, str) and name for name in cast("list[object]", values["modules"])):
        raise WatchdogError(f"modules of a watchdog's order is {values['modules']!r}")
    order = WatchOrder(**cast("dict[str, Any]", values))
    _require_time(order.silence_max)
    return order


_ORDER_TYPES: Final[Mapping[str, tuple[type, ...]]] = {
    "array": (str,),
    "modules": (list,),
    "serial": (str, type(None)),
    "baud": (int, type(None)),
    "silence_max": (int, float),
    "log": (str, type(None)),
}


def _modules(kind: ArrayKind) -> list[str]:
    """Modules of a kind's functions, its model's first: a kind may open its link by a function of palpate's."""
    return list(dict.fromkeys((kind.build.__module__, kind.open_link.__module__)))


def _require_time(silence_max: float) -> None:
    """Raise WatchdogError unless threads and `select` can wait for so long."""
    if not 0 < silence_max <= _SILENCE_BOUND:
        raise WatchdogError(f"silence_max is {silence_max!r}, but it must be above 0 s, and at most a day")


def is_watchable(model: ArrayModel) -> bool:
    """Whether another process can reach such an array: on USB, or at a serial port."""
    return model.usb is not None or model.baud is not None


class Watchdog:
    """While its context lasts, a process of its own watches this one, and switches the array off if it dies.

    Make it of an opened link, around everything that plays. It takes half a second to start.

    Args:
        link: the array: a real one (or one that libusb takes for real), so that another process can reach it.
        silence_max: how long this process may give no sign of life [s].
        log: file that it appends a line to when it does something; None is this process's standard error.

    Raises:
        WatchdogError: the array is neither on USB nor at a serial port, or `silence_max` is no time; on entering, if
            another process cannot reach the array; on leaving, if the watchdog has ended before.
    """

    def __init__(self, link: Link, *, silence_max: float = SILENCE_MAX, log: Path | None = None) -> None:
        model = link.array
        if not is_watchable(model):
            raise WatchdogError(f"a watchdog is for arrays on USB or at a serial port, which {model.name} is not")
        _require_time(silence_max)
        path = None if log is None else os.path.abspath(log)
        self._order = WatchOrder(
            model.name, _modules(kind_of(model)), link.serial, model.baud, float(silence_max), path
        )
        self._process: subprocess.Popen[bytes] | None = None
        self._goodbye = threading.Event()
        self._heart = threading.Thread(target=self._beat, name="palpate-heartbeat", daemon=True)

    def __enter__(self) -> Self:
        module = "palpate.device.playing.watchdog"
        self._process = process = subprocess.Popen(
            # -P: no module of the current folder is imported
            [sys.executable, "-P", "-m", module, json.dumps(asdict(self._order))],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            bufsize=0,
            start_new_session=True,  # the terminal's SIGINT and SIGHUP are not for it
        )
        if (answer := self._answer()) != _READY:
            process.kill()
            self._reap()
            reason = answer.decode(errors="replace") or "it did not start"
            raise WatchdogError(f"a watchdog cannot reach array {self._order.who} from its own process: {reason}")
        self._heart.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._goodbye.set()
        self._heart.join()
        code = self._reap()
        if code != EXIT_GOODBYE and error is None:
            raise WatchdogError(f"the watchdog of array {self._order.who} had ended before (exit code {code})")

    @property
    def process_id(self) -> int | None:
        """Id of the watchdog's process; None before it was started."""
        return self._process.pid if self._process else None

    def _answer(self) -> bytes:
        """The line that the watchdog writes when it stands ready, or why it cannot."""
        stdout = self._process.stdout if self._process else None
        if stdout is None or not select.select([stdout], [], [], _READY_TIMEOUT)[0]:
            return b""
        return stdout.readline().strip()

    def _beat(self) -> None:
        stdin = self._process.stdin if self._process else None
        if stdin is None:
            return
        with contextlib.suppress(OSError):  # it has ended: `__exit__` says so
            while not self._goodbye.wait(self._order.silence_max / 4):
                stdin.write(_BEAT)
            stdin.write(_GOODBYE)

    def _reap(self) -> int | None:
        """Close the pipes and wait for the end of the process; its exit code."""
        process = self._process
        if process is None:
            return None
        for pipe in (process.stdin, process.stdout):
            if pipe:
                pipe.close()
        try:
            return process.wait(_GOODBYE_TIMEOUT)
        except subprocess.TimeoutExpired:
            process.kill()
            return process.wait()


def keep_watch(pipe: int, silence_max: float, off: Callable[[float], str | None], say: Callable[[str], object]) -> int:
    """Watch a player until it says goodbye, or is gone and the array is off.

    Args:
        pipe: file descriptor that its heartbeats come from.
        silence_max: longest time between two of them [s].
        off: switches the array off within a time [s], longer than which it does not wait for it to be free; returns
            why it could not, None if it could.
        say: takes a sentence on what happened.

    Returns:
        The exit code.
    """
    limit: float | None = silence_max
    while True:
        if not select.select([pipe], [], [], limit)[0]:
            reason = off(0.0)
            say(
                f"the player has given no sign of life for {silence_max:g} s; "
                + ("the array was switched off" if reason is None else f"the array may be emitting: {reason}")
            )
            limit = None
            continue
        data = os.read(pipe, 4096)
        if _GOODBYE in data:
            return EXIT_GOODBYE
        if not data:
            reason = off(_RELEASE_TIMEOUT)
            say(
                "the player ended without goodbye; "
                + ("the array was switched off" if reason is None else f"the array may still be emitting: {reason}")
            )
            return EXIT_OFF if reason is None else EXIT_FAILED
        limit = silence_max  # a player that has come back is watched anew


def switch_off(
    model: ArrayModel,
    serial: str | None,
    *,
    backend: Backend | SerialPorts | None,
    patience: float = _RELEASE_TIMEOUT,
) -> None:
    """Open an array, silence what a dead player left behind, and send the off frame.

    Args:
        model: which kind.
        serial: which one; None is the first.
        backend: pyusb's, or what has serial ports.
        patience: how long the array may be held by another process [s].

    Raises:
        DeviceError: it cannot be opened, or does not fall silent.
    """
    end = time.monotonic() + patience
    while True:
        try:
            with open_link(model, serial=serial, backend=backend, transport="sync", uncalibrated=True) as link:
                with contextlib.suppress(LinkError):  # a passing fault: what follows tries again
                    link.start(model.divider_default)
                if not is_switched_off(link):
                    raise LinkError(f"array {model.name} did not take the off frames: switch it off")
                if wait_silent(link, model.divider_default) is False:
                    raise DeviceTimeoutError(f"array {model.name} does not fall silent: switch it off")
                return
        except DeviceBusyError:
            if time.monotonic() >= end:
                raise
            time.sleep(_RETRY)


def main() -> int:
    """Stand watch over the player whose pipe is standard input, as the command line's one argument says."""
    for signum in (signal.SIGINT, signal.SIGHUP):
        signal.signal(signum, signal.SIG_IGN)
    try:
        order = read_order(sys.argv[1] if len(sys.argv) == 2 else "")
        model = order.model()
        if order.log is not None:
            open(order.log, "a", encoding="utf-8").close()
        backend = _reach(model, order.serial)
    except (DeviceError, OSError) as error:
        _answer(" ".join(str(error).split()).encode())
        return EXIT_FAILED
    _answer(_READY)

    def off(patience: float) -> str | None:
        try:
            switch_off(model, order.serial, backend=backend, patience=patience)
        except Exception as error:  # whatever it is, it is the answer: nobody is left to take an exception
            return str(error)
        return None

    return keep_watch(sys.stdin.fileno(), order.silence_max, off, lambda sentence: _log(order, sentence))


def _reach(model: ArrayModel, serial: str | None) -> Backend | SerialPorts:
    """What the array is opened through; raises `DeviceError` if it is not to be seen from here."""
    if model.usb is None:
        ports = SystemPorts()
        choose_port(model, serial, ports)
        return ports
    backend = libusb_backend()
    find_device(model, serial, backend)
    return backend


def _answer(line: bytes) -> None:
    os.write(sys.stdout.fileno(), line + b"\n")


def _log(order: WatchOrder, sentence: str) -> None:
    """Append a sentence; a log that cannot be written is no reason not to watch on."""
    news = f"palpate watchdog of array {order.who}: {sentence}"
    shown = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in news)  # names of devices come from others
    line = f"{time.strftime('%Y-%m-%dT%H:%M:%S%z')} {shown}\n"
    with contextlib.suppress(OSError):
        if order.log is None:
            sys.stderr.write(line)
            sys.stderr.flush()
        else:
            with open(order.log, "a", encoding="utf-8") as file:
                file.write(line)


if __name__ == "__main__":
    sys.exit(main())
