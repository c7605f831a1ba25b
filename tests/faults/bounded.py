"""Runs a call in a process of its own, within bounds of time and memory: signals and hangs are outcomes, too."""

import json
import os
import resource
import select
import signal
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from palpate.datasets.errors import DatasetError
from palpate.device.errors import DeviceError
from palpate.render.errors import RenderError

ACCEPTED, CLEAR, RAW, SIGNAL, HANG, MEMORY, WRONG = (
    "accepted", "clear error", "raw error", "signal", "hang", "memory", "wrong",
)  # fmt: skip
KINDS = (ACCEPTED, CLEAR, RAW, SIGNAL, HANG, MEMORY, WRONG)
BAD = KINDS[2:]

SECONDS = 25.0
"""How long a call may take on a busy machine."""
ADDRESS_BYTES = 4 << 30
"""Address space that a call may take beside what its process has already."""
RESIDENT_BYTES = 1 << 30
"""Memory that a call may take beside what its process has already."""


class Refused(Exception):
    """A problem that was reported without an exception; the text is the report."""


class Wrong(Exception):
    """Something was accepted that must not be; the text says what."""


class Outcome(NamedTuple):
    """The result of a call."""

    kind: str
    """One of `KINDS`."""
    text: str = ""
    """The error; for a raw error and for memory, its type and the last function of palpate that it came through."""
    details: str = ""


def outcome_of(call: Callable[[], Any]) -> Outcome:
    """The outcome of a call in this process."""
    try:
        call()
    except (Refused, DatasetError, RenderError, DeviceError) as error:
        return Outcome(CLEAR, str(error)[:2000])
    except Wrong as error:
        return Outcome(WRONG, str(error)[:500])
    except BaseException as error:
        kind = MEMORY if isinstance(error, MemoryError) else RAW
        return Outcome(kind, _place_of(error), "".join(traceback.format_exception(error))[-4000:])
    return Outcome(ACCEPTED)


def outcome_in_child(call: Callable[[], Any], *, seconds: float = SECONDS, resident: int = RESIDENT_BYTES) -> Outcome:
    """The outcome of a call in a child process. resident: memory that it may take [byte]."""
    receiving, sending = os.pipe()
    child = os.fork()
    if child == 0:
        _answer(call, sending, resident)
    os.close(sending)
    content, ends = b"", time.monotonic() + seconds
    while select.select([receiving], [], [], max(0.0, ends - time.monotonic()))[0]:
        if not (block := os.read(receiving, 1 << 16)):
            break
        content += block
    else:
        os.kill(child, signal.SIGKILL)
    os.close(receiving)
    _, status = os.waitpid(child, 0)
    if content.endswith(b"]"):
        return Outcome(*json.loads(content))
    if time.monotonic() >= ends:
        return Outcome(HANG, f"over {seconds:g} s")
    return Outcome(SIGNAL, f"signal {os.WTERMSIG(status)}")


def _answer(call: Callable[[], Any], sending: int, resident: int) -> None:
    """Send the outcome of a call to the parent process, and end."""
    try:
        quiet = os.open(os.devnull, os.O_RDWR)
        for stream in (0, 1, 2):
            os.dup2(quiet, stream)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        limit = pages * resource.getpagesize() + ADDRESS_BYTES
        resource.setrlimit(resource.RLIMIT_AS, (limit, resource.getrlimit(resource.RLIMIT_AS)[1]))
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        outcome = outcome_of(call)
        taken = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) << 10
        if taken > resident:
            outcome = Outcome(MEMORY, f"{taken / 1e9:.1f} GB", outcome.text)
        os.write(sending, json.dumps(outcome).encode())
    finally:
        os._exit(0)


def _place_of(error: BaseException) -> str:
    own = [
        f"{Path(frame.filename).parent.name}/{Path(frame.filename).name} {frame.name}"
        for frame in traceback.extract_tb(error.__traceback__)
        if {"kernels", "render", "device", "datasets"} & set(Path(frame.filename).parts)
        and not {"site-packages", "tests"} & set(Path(frame.filename).parts)
    ]
    return f"{type(error).__name__} in {own[-1] if own else 'no function of palpate'}"
