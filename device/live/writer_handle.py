"""The parent's side of a writer's process: started, told what to play, and heard."""

from __future__ import annotations

import contextlib
import json
import os
import pickle
import select
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

from .. import errors
from ..errors import DeviceError, DeviceTimeoutError, UpdateRateError
from ..playing.limits import Dose, Limits
from .paced_writer import WriterPace
from .ring import FrameRing
from .writer_process import MESSAGE_MOST, ArrayRequest, WriterSettings

READY_TIMEOUT: Final = 60.0  # [s]: a board may have to be aligned, an interpreter to import NumPy
OFF_TIMEOUT: Final = 10.0  # [s]
SLICE_DURATION: Final = 4e-3  # [s] of frames at most; a process that draws has a turn each millisecond


class WriterHandle:
    """A writer in a process of its own, which holds arrays open: off while nothing plays, and off at its end.

    Args:
        arrays: how each is opened.
        update_rate: frames a second [Hz], one that all arrays have.
        pace: how far ahead frames are written, and what happens when none come.
        limits: of on-time and duty; None: the defaults.
        realtime: whether the process asks for real-time scheduling and locked memory.

    Raises:
        DeviceError: an array cannot be opened, or lacks the rate, or keeps it up for a burst only; as in the process,
            by its kind and sentence.
    """

    def __init__(
        self,
        arrays: Sequence[ArrayRequest],
        *,
        update_rate: float,
        pace: WriterPace | None = None,
        limits: Limits | None = None,
        realtime: bool = True,
    ) -> None:
        models = [request.model for request in arrays]
        (self.divider,) = {model.divider(update_rate) for model in models}
        for model in models:
            if self.divider < model.divider_sustained:
                raise UpdateRateError(
                    f"array {model.name} keeps up {update_rate:g} Hz for a burst only: what goes on needs "
                    f"{model.update_rate(model.divider_sustained):.6g} Hz at most"
                )
        self.update_rate = models[0].update_rate(self.divider)
        self.arrays = tuple(arrays)
        self.slice_frames = max(1, round(SLICE_DURATION * self.update_rate))
        self.ring = FrameRing([model.frame_bytes for model in models], frame_count=self.slice_frames)
        self.wake_fd = os.eventfd(0, os.EFD_NONBLOCK)
        self.pace = pace or WriterPace()
        self._own, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._own.settimeout(OFF_TIMEOUT)  # a process that hangs and reads nothing must not keep `close` from its end
        self._lock = threading.Lock()
        self._settings = WriterSettings(
            arrays=self.arrays,
            divider=self.divider,
            pace=self.pace,
            limits=limits or Limits(),
            realtime=realtime,
            control_fd=other.fileno(),
            ring_fd=self.ring.fd,
            wake_fd=self.wake_fd,
            slice_frames=self.slice_frames,
        )
        self._folder = tempfile.TemporaryDirectory(prefix="palpate-stimuli-")
        self._stimulus_count = 0
        kinds = [request.kind for request in arrays]  # the process registers them before it reads the arrays' models
        self._process = start_process(
            "palpate.device.live.writer_process", (kinds, self._settings), other, self.ring.fd, self.wake_fd
        )
        other.close()
        try:
            self.ready = self._await_ready()
        except BaseException:
            self.close()
            self.release()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def fileno(self) -> int:
        """Of the socket that messages come through, for `select`."""
        return self._own.fileno()

    @property
    def process_id(self) -> int:
        """Of the writer."""
        return self._process.pid

    def send(self, do: str, **values: Any) -> None:
        """Tell the process to do something, see `writer_process`; nothing happens if it has ended."""
        with self._lock, contextlib.suppress(OSError):
            self._own.send(json.dumps({"do": do, **values}).encode())

    def messages(self, timeout: float = 0.0) -> Iterator[dict[str, Any]]:
        """What it has told; waits for the first message for `timeout` [s] at most. The last one is `gone`."""
        while select.select([self._own], [], [], timeout)[0]:
            timeout = 0.0
            try:
                data = self._own.recv(MESSAGE_MOST)
            except OSError:
                data = b""
            if not data:
                yield {"event": "gone"}
                return
            yield json.loads(data)

    def load(self, frames: Sequence[memoryview], doses: Sequence[Sequence[Dose]]) -> int:
        """Hand over a stimulus: its frames for each array, and the doses of its slices; returns its number."""
        number, self._stimulus_count = self._stimulus_count, self._stimulus_count + 1
        path = Path(self._folder.name) / str(number)
        with open(path, "wb") as file:
            for block in frames:
                file.write(block)
        Path(f"{path}.doses").write_text(json.dumps([[list(dose) for dose in own] for own in doses]))
        self.send("load", path=str(path), counts=[len(block) for block in frames])
        return number

    def close(self) -> None:
        """Switch off and end the process; waits for it, 10 s at most."""
        self.send("end")
        with contextlib.suppress(OSError):
            self._own.shutdown(socket.SHUT_WR)
        try:
            self._process.wait(OFF_TIMEOUT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._folder.cleanup()

    def release(self) -> None:
        """Let go of the memory and of the socket, once nobody reads messages any more."""
        self._own.close()
        self.ring.close()
        os.close(self.wake_fd)

    def _await_ready(self) -> dict[str, Any]:
        end = time.monotonic() + READY_TIMEOUT
        while (left := end - time.monotonic()) > 0:
            for message in self.messages(left):
                if message["event"] == "ready":
                    return message
                if message["event"] == "failed":
                    raise error_of(message)
                if message["event"] == "gone":
                    raise DeviceError("the process that writes to the array ended before it had opened it")
        raise DeviceTimeoutError(f"the process that writes to the array was not ready after {READY_TIMEOUT:g} s")


def start_process(module: str, settings: object, *files: Any) -> subprocess.Popen[bytes]:
    """Start a module as a process that reads its pickled settings from standard input, and shares open files.

    files: descriptors, or what has `fileno`. The process is in a session of its own: the terminal's signals are not for
    it.
    """
    content = pickle.dumps(settings)  # before anything runs: it may be refused
    shared = [file if isinstance(file, int) else file.fileno() for file in files]
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", module],  # -P: no module of the current folder is imported
        stdin=subprocess.PIPE,
        pass_fds=shared,
        start_new_session=True,
    )
    if process.stdin is not None:
        with contextlib.suppress(BrokenPipeError):  # it has ended: its other pipes say so
            process.stdin.write(content)
            process.stdin.close()
    return process


def error_of(message: dict[str, Any]) -> DeviceError:
    """The error that a `failed` message tells of."""
    kind = getattr(errors, message["kind"], None)
    if not (isinstance(kind, type) and issubclass(kind, DeviceError)):
        return DeviceError(f"the process that writes to the array failed: {message['kind']}: {message['text']}")
    return kind(message["text"])
