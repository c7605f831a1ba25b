"""Events of a study as lines of JSON on a TCP socket, and keys that other programs send back.

docs/formats/study-events.md describes the lines. One thread serves all clients, without waiting for any of them; what a
client sends is judged before it reaches the desk, and never reaches the terminal.
"""

import contextlib
import hmac
import json
import math
import os
import re
import selectors
import socket
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from importlib.metadata import version
from typing import Any, Literal, Self

from ....datasets.json_text import parse_json
from ...errors import StudyError
from ...terminal.foreign_text import visible
from .desk import LOST_SECONDS, Screen, StudyDesk

CONTENT_TYPE = "Markers"
"""By which recorders and toolboxes find streams of events."""


class LslOutlet:
    """An LSL stream of texts: one line of JSON an event, at the event's own time on LSL's clock.

    name: of the stream. Raises StudyError where pylsl or its library is missing. Programs of the whole local network
    see LSL streams, as LSL itself is configured.
    """

    def __init__(self, name: str) -> None:
        if not name or len(name) > 100 or not name.isprintable():
            raise StudyError(f"name of the LSL stream must be a text of 1 to 100 characters, not {name!r}")
        self.name = name
        self._lsl = _pylsl()
        # The source makes a recorder find the stream again after a study was resumed.
        info = self._lsl.StreamInfo(
            name, CONTENT_TYPE, 1, self._lsl.IRREGULAR_RATE, self._lsl.cf_string, f"palpate {name}"
        )
        self._outlet = self._lsl.StreamOutlet(info)

    def __repr__(self) -> str:
        return f"LslOutlet({self.name!r})"

    def push(self, line: str, array_time: float) -> None:
        """Push an event that happened at a time of the array's clock [s of time.monotonic()]; returns at once."""
        # Both clocks are CLOCK_MONOTONIC on Linux, but LSL promises no clock: so their offset is measured each time.
        before = time.monotonic()
        now = self._lsl.local_clock()
        offset = now - (before + time.monotonic()) / 2
        self._outlet.push_sample([line], array_time + offset)


def _pylsl() -> Any:
    way_out = "pip install 'palpate[lsl]'"
    try:
        import pylsl  # only where it is asked for: it loads a library of C++ and starts threads
    except ModuleNotFoundError as error:
        raise StudyError(f"an LSL stream needs pylsl, which is not installed: {way_out}") from error
    except (ImportError, RuntimeError, OSError) as error:  # RuntimeError: pylsl itself finds no liblsl
        reason = visible((str(error) or type(error).__name__).splitlines()[0])
        raise StudyError(
            f"pylsl cannot load its library liblsl ({reason}): {way_out} brings it to Linux on x86-64 with glibc 2.35 "
            "or newer; elsewhere install liblsl, and name its file in the environment variable PYLSL_LIB"
        ) from error
    return pylsl


FORMAT = 1
"""Of the lines; it changes when a client of the older format would misread them."""
CLIENTS_MOST = 16
LINE_BYTES_MOST = 1 << 16  # of a client
BACKLOG_BYTES_MOST = 1 << 20  # that wait for a client that does not read; later lines are lost to it
FAULTS_MOST = 100  # bad lines of a client, after which it is cut off: answering them takes time from the study
CLOSE_SECONDS_MOST = 0.5  # for the last lines to be read
SECONDS_MOST = 86_400.0  # of an answer
INTEGER_MOST = 2**53  # that JSON keeps in every language
LOST_LINK = {"TCP_KEEPIDLE": 1, "TCP_KEEPINTVL": 1, "TCP_KEEPCNT": 2, "TCP_USER_TIMEOUT": 2500}
"""Options of the page's connection [s; the last one ms]: a cable that is pulled closes the page, as a killed client
does."""

EventName = Literal[
    "study_begun",
    "block_begun",
    "trial_begun",
    "stimulus_onset",
    "stimulus_ended",
    "answer",
    "rest",
    "stopped",
    "gone_on",
    "study_ended",
    "screen",
]


@dataclass(frozen=True, kw_only=True)
class StreamCounts:
    """Clients of an event stream, now and so far."""

    connected: int
    refused: int
    """Clients that came while as many as are allowed were connected."""
    cut_off: int
    """Clients whose connection was closed for what they sent, or because the page did not read."""
    lost_lines: int
    """Lines that a client never got because it did not read."""


@dataclass(eq=False)
class _Client:
    connection: socket.socket
    inbox: bytearray = field(default_factory=bytearray)
    outbox: bytearray = field(default_factory=bytearray)
    lost: int = 0
    """Lines since the last one that found room."""
    faults: int = 0
    page: int = 0
    """Number of the participant's page that it stands for; 0: it does not."""
    is_leaving: bool = False
    """It is cut off once its outbox is sent."""


class EventStream:
    """A TCP server that reports every event to other programs from when they connect; for a `with`, or `close()` it.

    port: exactly this one; None: a free one. token: allows a client to answer, to stop the study, and to stand for the
    participant's page; without it, it only reads. outlet: gets every event, too. Raises StudyError for an address that
    cannot be had.
    """

    def __init__(
        self,
        desk: StudyDesk,
        *,
        host: str = "127.0.0.1",
        port: int | None,
        token: str,
        outlet: LslOutlet | None = None,
    ) -> None:
        if not token:
            raise StudyError("token must not be empty: anybody could answer for the participant")
        self._desk, self._token, self._outlet = desk, token.encode(), outlet
        self._listener = _listening_socket(host, port)
        self.host, self.port = host, int(self._listener.getsockname()[1])
        self._woken, self._wake = socket.socketpair()
        self._lock = threading.Lock()
        self._clients: list[_Client] = []
        self._refused = self._cut_off = self._lost_lines = 0
        self._is_closed = False
        with self._lock:  # a screen that is shown meanwhile waits, and comes after this one
            self._unwatch = desk.watch(self._send_screen)
            self._screen = _described(desk.shown)
        self._thread = threading.Thread(target=self._serve, name="palpate study events", daemon=True)
        self._thread.start()

    def __repr__(self) -> str:
        return f"EventStream({self.host}:{self.port}, {len(self._clients)} clients)"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def counts(self) -> StreamCounts:
        """Clients now, and what they missed so far."""
        with self._lock:
            return StreamCounts(
                connected=len(self._clients),
                refused=self._refused,
                cut_off=self._cut_off,
                lost_lines=self._lost_lines,
            )

    def send(
        self, name: EventName, /, *, array_time: float | None = None, is_estimate: bool | None = None, **values: object
    ) -> None:
        """Send an event to all clients; returns at once, whether they read or not.

        array_time: when it happened, by the array's clock [s of time.monotonic()]; None: now. is_estimate: whether that
        time was not reported by the array; None: it was, if it is given. values: what the event reports, by names other
        than those of the times and `event`; what JSON has no form for is sent as text, and a number that is not finite
        as null.
        """
        with self._lock:
            self._send(name, array_time, array_time is None if is_estimate is None else is_estimate, values)

    def close(self) -> None:
        """Send what waits, for at most half a second, and close all connections; a page among them counts as closed."""
        self._unwatch()
        with self._lock:
            self._is_closed = True
        self._notify()
        self._thread.join(CLOSE_SECONDS_MOST + 1)

    # By the thread of the study.

    def _send_screen(self, screen: Screen) -> None:
        with self._lock:
            self._screen = _described(screen)
            self._send("screen", None, True, self._screen)

    def _send(self, name: str, array_time: float | None, is_estimate: bool, values: Mapping[str, object]) -> None:
        """Put an event into each outbox, under the lock."""
        if self._is_closed:
            return
        array_time = time.monotonic() if array_time is None else array_time
        line = _line(name, array_time, is_estimate, values)
        for client in self._clients:
            self._put(client, line)
        if self._outlet is not None:
            self._outlet.push(line.decode(), array_time)
        self._notify()

    def _put(self, client: _Client, line: bytes) -> None:
        if client.is_leaving:
            return
        if client.lost or len(client.outbox) + len(line) > BACKLOG_BYTES_MOST:
            client.lost += 1
            self._lost_lines += 1
            if client.page:  # a participant who misses a screen cannot go on
                self._cut(client)
            return
        client.outbox += line + b"\n"

    def _notify(self) -> None:
        """Wake the thread that serves; where bytes wait for it already, it is awake."""
        with contextlib.suppress(OSError):
            self._wake.send(b"1", socket.MSG_DONTWAIT)

    # By the thread that serves.

    def _serve(self) -> None:
        with selectors.DefaultSelector() as selector, self._listener, self._woken, self._wake:
            try:
                self._listener.setblocking(False)
                self._woken.setblocking(False)
                selector.register(self._listener, selectors.EVENT_READ)
                selector.register(self._woken, selectors.EVENT_READ)
                ends = float("inf")
                while not self._is_closed or (
                    any(client.outbox for client in self._clients) and time.monotonic() < ends
                ):
                    self._serve_once(selector)
                    if self._is_closed:
                        ends = min(ends, time.monotonic() + CLOSE_SECONDS_MOST)
            finally:  # whatever happens, no client believes that the study goes on, and no page stays open
                for client in tuple(self._clients):
                    self._drop(client, selector)

    def _serve_once(self, selector: selectors.BaseSelector) -> None:
        """Wait until there is something to do, and do it."""
        if has_page := any(self._desk.is_open(client.page) for client in self._clients if client.page):
            self._desk.screen()  # an open connection is a page that is open
        for key, mask in selector.select(0.02 if self._is_closed else LOST_SECONDS / 4 if has_page else None):
            if key.fileobj is self._listener:
                self._accept(selector)
            elif key.fileobj is self._woken:
                self._woken.recv(4096)
            elif mask & selectors.EVENT_READ:
                self._read(key.data)
        for client in tuple(self._clients):
            self._write(client)
            if client.is_leaving:
                self._drop(client, selector)
                continue
            is_full = len(client.outbox) > BACKLOG_BYTES_MOST / 2  # its answers have no room either
            reads = 0 if is_full else selectors.EVENT_READ
            selector.modify(client.connection, reads | (selectors.EVENT_WRITE if client.outbox else 0), client)

    def _accept(self, selector: selectors.BaseSelector) -> None:
        try:
            connection, _ = self._listener.accept()
        except OSError:
            time.sleep(0.02)  # no file descriptor is free, and the client waits on: asking at once would ask for ever
            return
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client = _Client(connection)
        with self._lock:
            if self._is_closed:
                connection.close()
                return
            if len(self._clients) >= CLIENTS_MOST:
                self._refused += 1
                text = f"{CLIENTS_MOST} programs are connected already, which is the most: close one of them"
                with connection, contextlib.suppress(OSError):
                    connection.send(_line("error", time.monotonic(), False, {"text": text}) + b"\n")
                return
            about = {"format": FORMAT, "palpate": version("palpate"), "screen": self._screen}
            self._put(client, _line("hello", time.monotonic(), False, about))
            self._clients.append(client)  # in one step with the screen: the next event is the next one after it
        selector.register(connection, selectors.EVENT_READ, client)

    def _read(self, client: _Client) -> None:
        """Take what a client has sent, and answer each line of it."""
        try:
            received = client.connection.recv(LINE_BYTES_MOST)
        except BlockingIOError:
            return
        except OSError:
            received = b""
        if not received:
            client.outbox.clear()
            client.is_leaving = True
            return
        client.inbox += received
        while not client.is_leaving and (end := client.inbox.find(b"\n")) >= 0:
            line = bytes(client.inbox[:end])
            del client.inbox[: end + 1]
            if line.strip():
                self._answer(client, line)
        if len(client.inbox) > LINE_BYTES_MOST:
            self._reply(client, "error", {"text": f"a line may have {LINE_BYTES_MOST} bytes at most"})
            self._cut(client, drains=True)

    def _answer(self, client: _Client, line: bytes) -> None:
        try:
            answer = self._obey(client, _request_of(line))
        except StudyError as error:
            client.faults += 1
            self._reply(client, "error", {"text": str(error)})
            if client.faults >= FAULTS_MOST:
                self._cut(client, drains=True)
            return
        client.faults = 0
        self._reply(client, "reply", answer)

    def _obey(self, client: _Client, request: Mapping[str, Any]) -> dict[str, object]:
        """Do what a line asks for, and give what is answered; raises StudyError for what may not be or cannot be."""
        asked = [name for name in FIELDS if name in request]
        if len(asked) != 1:
            raise StudyError(f"a line must hold exactly one of {', '.join(FIELDS)}, not {len(asked)} of them")
        (action,) = asked
        if unknown := sorted(request.keys() - {action, "token", *FIELDS[action]}):
            raise StudyError(f"a line with {action} has no key {_short(unknown[0])}")
        token = request.get("token")
        if not isinstance(token, str) or not hmac.compare_digest(token.encode(), self._token):
            raise StudyError("token must be the one that palpate printed: without it, events are read only")
        match action:
            case "page":
                if request["page"] is not True:
                    raise StudyError(f"page must be true, not {_short(request['page'])}; a closed connection closes it")
                client.page = self._desk.open_page()
                self._guard_page(client)
                return {"counts": True}
            case "stop":
                self._desk.stop(visible(_text_of(request, "stop", 200)))
                return {"counts": True}
        screen = request.get("screen")
        if type(screen) is not int or not 0 <= screen <= INTEGER_MOST:
            raise StudyError(f"screen must be the whole number of the screen that was answered, not {_short(screen)}")
        seconds = request.get("seconds")
        if isinstance(seconds, bool) or not isinstance(seconds, int | float) or not 0 <= seconds <= SECONDS_MOST:
            raise StudyError(f"seconds must be a number from 0 to {SECONDS_MOST:g}, not {_short(seconds)}")
        if action == "press":
            counts = self._desk.press(screen, _text_of(request, "press", 32), float(seconds))
        else:
            value = request["give"]
            shown = self._desk.shown
            is_number = shown.number == screen and shown.question is not None and shown.question.kind == "number"
            if is_number and isinstance(value, str) and NUMBER.fullmatch(value):
                value = float(value.replace(",", "."))  # programs that take keys have no other form of it
            is_large = type(value) is int and abs(value) > INTEGER_MOST
            if is_large or not isinstance(value, int | float | str | None):
                raise StudyError(f"give must be a number, a text or null, not {_short(value)}")
            counts = self._desk.give(screen, value, float(seconds))
        return {"counts": counts, "screen": screen}

    def _guard_page(self, client: _Client) -> None:
        with contextlib.suppress(OSError):  # its connection is closed already, which the next reading finds
            client.connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            for name, value in LOST_LINK.items():
                if (option := getattr(socket, name, None)) is not None:
                    client.connection.setsockopt(socket.IPPROTO_TCP, option, value)

    def _reply(self, client: _Client, name: str, values: Mapping[str, object]) -> None:
        with self._lock:
            self._put(client, _line(name, time.monotonic(), False, values))

    def _cut(self, client: _Client, *, drains: bool = False) -> None:
        """Have a client dropped; drains: after as much of its outbox as its connection takes at once."""
        client.is_leaving = True
        self._cut_off += 1
        if not drains:
            client.outbox.clear()

    def _write(self, client: _Client) -> None:
        with self._lock:
            try:
                while client.outbox:
                    del client.outbox[: client.connection.send(client.outbox[:LINE_BYTES_MOST])]
            except BlockingIOError:
                return
            except OSError:
                client.outbox.clear()
                client.is_leaving = True
                return
            if client.lost and not client.is_leaving:
                lost, client.lost = client.lost, 0
                self._put(client, _line("lost", time.monotonic(), False, {"count": lost}))

    def _drop(self, client: _Client, selector: selectors.BaseSelector) -> None:
        selector.unregister(client.connection)
        client.connection.close()
        with self._lock:
            self._clients.remove(client)
        if client.page:
            self._desk.close_page(client.page)  # what plays is stopped


FIELDS = {"press": ("screen", "seconds"), "give": ("screen", "seconds"), "stop": (), "page": ()}
"""What a client's line asks for -> the keys that it needs besides the token."""
SIGNS = {"ArrowLeft": "\u2190", "ArrowUp": "\u2191", "ArrowRight": "\u2192", "ArrowDown": "\u2193", " ": ""}
"""What keys are called in `choices`, in any language; a screen's own words name the space bar."""
NUMBER = re.compile(r"-?\d{1,15}([.,]\d{1,15})?")
"""A number as people type it."""


def _listening_socket(host: str, port: int | None) -> socket.socket:
    if port is not None and not 1 <= port <= 65535:
        raise StudyError(f"port must be 1 to 65535, not {port}")
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        return socket.create_server((host, port or 0), family=family)
    except (OSError, UnicodeError) as error:
        number = error.errno if isinstance(error, OSError) and error.errno else 0
        reason = os.strerror(number) if number > 0 else str(error)
        if port is None:
            raise StudyError(f"{visible(host)} is no address of this machine ({visible(reason)})") from error
        raise StudyError(
            f"port {port} of {visible(host)} cannot be had ({visible(reason)}); without a port a free one is taken"
        ) from error


def _described(screen: Screen) -> dict[str, object]:
    """A screen as its event describes it; pictures and noise are the browser's."""
    question = screen.question
    return {
        "number": screen.number,
        "kind": screen.kind,
        "title": screen.title,
        "text": screen.text,
        "hint": screen.hint,
        "keys": [{"key": choice.key, "label": choice.label} for choice in screen.keys],
        "choices": "     ".join(
            f"{SIGNS.get(choice.key, choice.key)} {choice.label}".strip() for choice in screen.keys
        ),
        "question": None if question is None else {"name": question.name, "kind": question.kind},
        "ends": screen.ends,
        "progress": screen.progress,
    }


def _line(name: str, array_time: float, is_estimate: bool, values: Mapping[str, object]) -> bytes:
    """An event as JSON; `time` is that of the wall clock at the very moment of `array_time`."""
    moment = datetime.now(UTC) + timedelta(seconds=array_time - time.monotonic())
    times = {"time": moment.isoformat(timespec="microseconds"), "array_time": array_time, "is_estimate": is_estimate}
    return json.dumps(dict(event=name, **times, **_plain(values)), allow_nan=False).encode()  # no value replaces these


def _plain(value: Any) -> Any:
    """A value as JSON has it."""
    if isinstance(value, Mapping):
        return {str(key): _plain(own) for key, own in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(own) for own in value]
    if hasattr(value, "tolist"):  # of NumPy
        return _plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value if isinstance(value, int | float | str | None) else str(value)


def _request_of(line: bytes) -> Mapping[str, Any]:
    try:
        request = parse_json(line, text_most=LINE_BYTES_MOST)
    except ValueError as error:
        raise StudyError(f"the line is not JSON: {error}") from error
    if not isinstance(request, dict):
        raise StudyError(f"a line must be a JSON object, not {_short(request)}")
    return request


def _text_of(request: Mapping[str, Any], name: str, most: int) -> str:
    value = request[name]
    if not isinstance(value, str) or not 0 < len(value) <= most:
        raise StudyError(f"{name} must be a text of 1 to {most} characters, not {_short(value)}")
    return value


def _short(value: object) -> str:
    text = visible(repr(value))
    return text if len(text) <= 60 else f"{text[:60]}..."
