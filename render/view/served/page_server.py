"""Serves pages to this machine's browser, and answers what they ask over a WebSocket.

Only the page's own address gets an answer: loopback, checked Host and Origin, and a token that each start makes anew,
so that neither a page of another site nor another user of this machine reads what is shown. What goes wrong with one
connection is logged by LOGGER, which prints nothing unless a program gives it a handler.
"""

import contextlib
import hmac
import http.client
import json
import logging
import os
import secrets
import socket
import struct
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any, Protocol, Self
from urllib.parse import parse_qs, urlsplit
from weakref import WeakSet

from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response
from websockets.sync.server import ServerConnection, serve

from ....datasets.errors import DatasetError
from ....datasets.json_text import parse_json
from ....device.errors import DeviceError
from ...errors import RenderError, StrategyError, ViewError
from ...terminal.foreign_text import visible
from ..packing import Packer

HOST = "127.0.0.1"
FIRST_PORT, PORTS_TRIED = 8080, 200
NAMES = (HOST, "localhost")
"""What a browser on this machine calls this server; any other name came from another site's DNS."""
REQUEST_BYTES_MOST = 1 << 16  # of one message of a page
PAGES_MOST = 64  # that are open: each has threads of its own
OPEN_SECONDS_MOST = 5  # for a request to come
CLOSE_SECONDS_MOST = 0.3  # for the port to be closed
SEND_SECONDS_MOST = 1  # then a page that does not read what it asked for is cut off: others wait meanwhile
NEW = "new"  # asks for a ticket
CLOSED = {"Cache-Control": "no-store", "Referrer-Policy": "no-referrer", "Connection": "close"}
HEADERS = CLOSED | {
    "Content-Type": "text/html; charset=utf-8",
    "Cross-Origin-Resource-Policy": "same-origin",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",  # another site must not show the page in a frame and have it clicked
}
LOGGER = logging.getLogger("palpate.view")
LOGGER.addHandler(logging.NullHandler())
LOGGER.propagate = False

Send = Callable[[dict[str, Any], Packer | None], None]
"""Sends what JSON takes, and the arrays that it describes, to the page that asked."""


class Conversation(Protocol):
    """What a page that is open in a browser asks, and what it gets."""

    @property
    def slow(self) -> frozenset[str]:
        """Requests whose answer waits for something: other pages are answered meanwhile."""
        ...

    def answer(self, request: "PageRequest", send: Send) -> None:
        """Answer one request by one message or several; errors of palpate become a message with their text."""

    def close(self) -> None:
        """Release what this page alone has opened."""


@dataclass(frozen=True)
class ServedPage:
    """A page and who talks to it."""

    document: Callable[[list[str]], str]
    """Its HTML, given the addresses of the WebSocket that its policy must allow."""
    converse: Callable[[], Conversation]
    """Begins a conversation with one browser."""


@dataclass(frozen=True)
class PageRequest:
    """One message of a page. Its values are foreign: each is checked when it is taken."""

    values: Mapping[str, Any]

    @property
    def ask(self) -> str:
        """What the page asks for; "" where it does not say so."""
        value = self.values.get("ask")
        return value if isinstance(value, str) else ""

    def has(self, name: str) -> bool:
        """Whether a value is given."""
        return self.values.get(name) is not None

    def number(self, name: str, low: float, high: float) -> float:
        """A number within bounds, which are included."""
        value = self.values.get(name)
        if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
            raise StrategyError(f"{name} must be a number from {low:g} to {high:g}, not {_short(value)}")
        return value

    def integers(self, name: str, count: int, limits: tuple[int, ...]) -> list[int]:
        """As many whole numbers as asked for, each from 0 up to, and without, its limit."""
        value = self.values.get(name)
        listed = value if isinstance(value, list) else []
        if len(listed) != count or not all(
            type(each) is int and 0 <= each < limit for each, limit in zip(listed, limits, strict=False)
        ):
            bounds = " and ".join(f"0..{limit - 1}" for limit in limits)
            wanted = "one whole number" if count == 1 else f"{count} whole numbers"
            raise StrategyError(f"{name} must be {wanted} of {bounds}, not {_short(value)}")
        return listed

    def text(self, name: str, most: int = 1000) -> str:
        """A text of at most so many characters; "" where none is given."""
        value = self.values.get(name, "")
        if not isinstance(value, str) or len(value) > most:
            raise StrategyError(f"{name} must be a text of {most} characters at most, not {_short(value)}")
        return value

    def choice(self, name: str, options: tuple[str, ...]) -> str:
        """One of some texts."""
        value = self.values.get(name)
        if value not in options:
            raise StrategyError(f"{name} must be one of {', '.join(options)}, not {_short(value)}")
        return value


class PageServer:
    """Pages by their paths, on 127.0.0.1; use it in a `with`, or `close()` it.

    port: exactly this one; None: the first free one from 8080 on. Answers are computed one at a time, since they share
    files and kernels. Raises ViewError for a port that is taken or that this process may not have, StrategyError for a
    number of no port.
    """

    def __init__(self, pages: Mapping[str, ServedPage], port: int | None = None) -> None:
        self._pages, self._turn = pages, threading.Lock()
        self._token = secrets.token_urlsafe(24)
        self._connections: WeakSet[ServerConnection] = WeakSet()
        self._conversations: set[int] = set()
        self._tickets: set[str] = set()
        self._socket = _listening_socket(port)
        self.port: int = self._socket.getsockname()[1]
        self._server = serve(
            self._converse,
            sock=self._socket,
            process_request=self._check_request,
            compression=None,  # loopback carries more bytes a second than deflate packs
            server_header=None,
            open_timeout=OPEN_SECONDS_MOST,
            max_size=REQUEST_BYTES_MOST,
            close_timeout=1,
            ping_interval=None,  # a suspended browser is none that has gone
            logger=LOGGER,
            create_connection=self._connection,
        )
        self._thread = threading.Thread(target=self._server.serve_forever, name="palpate view", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def address(self, path: str = "/") -> str:
        """Where a browser on this machine finds a page; who has the address may see it."""
        return f"http://{HOST}:{self.port}{path}?token={self._token}"

    def close(self) -> None:
        """Stop serving at once: pages that do not read are cut off, others see that the viewer has ended."""
        # From version 17 on, `shutdown` waits for all connections, which are cut off only after it has closed the port.
        threading.Thread(target=self._server.shutdown, daemon=True).start()
        self._thread.join(CLOSE_SECONDS_MOST)
        for connection in tuple(self._connections):
            with contextlib.suppress(OSError):
                connection.socket.shutdown(socket.SHUT_RDWR)

    def _connection(self, *arguments: Any, **options: Any) -> ServerConnection:
        connection = ServerConnection(*arguments, **options)
        connection.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, struct.pack("ll", SEND_SECONDS_MOST, 0))
        self._connections.add(connection)
        return connection

    def _check_request(self, connection: ServerConnection, request: Request) -> Response | None:
        """The page, or why it is refused; None: the connection may become a WebSocket."""
        try:
            target = urlsplit(request.path)
        except ValueError:
            return connection.respond(HTTPStatus.BAD_REQUEST, "This is no address.\n")
        sentence = refusal(request.headers, self.port)
        query = parse_qs(target.query)
        token = query.get("token", [""])[0]
        if sentence is None and query.get("ticket", [""])[0] in self._tickets:
            self._tickets.clear()
            headers = Headers({"Location": f"{target.path}?token={self._token}", "Content-Length": "0"} | CLOSED)
            return Response(HTTPStatus.SEE_OTHER, HTTPStatus.SEE_OTHER.phrase, headers)
        if sentence is None and not hmac.compare_digest(token.encode(), self._token.encode()):
            sentence = "This address lacks the token that palpate printed when it started."
        if sentence is not None:
            return connection.respond(HTTPStatus.FORBIDDEN, sentence + "\n")
        if query.get("ticket") == [NEW]:
            self._tickets.add(ticket := secrets.token_urlsafe(24))
            return connection.respond(HTTPStatus.OK, ticket)
        if target.path not in self._pages:
            return connection.respond(HTTPStatus.NOT_FOUND, "This server has no such page.\n")
        if request.headers.get_all("Upgrade"):
            if len(self._conversations) >= PAGES_MOST:
                return connection.respond(HTTPStatus.SERVICE_UNAVAILABLE, "Too many pages are open.\n")
            return None
        sockets = [f"ws://{name}:{self.port}" for name in NAMES]
        body = self._pages[target.path].document(sockets).encode()
        headers = Headers(HEADERS | {"Content-Length": str(len(body))})
        return Response(HTTPStatus.OK, HTTPStatus.OK.phrase, headers, body)

    def _converse(self, connection: ServerConnection) -> None:
        """Answer what a page asks until it is closed."""
        assert connection.request is not None  # its handshake is over
        conversation = self._pages[urlsplit(connection.request.path).path].converse()
        self._conversations.add(id(connection))

        def send(described: dict[str, Any], packer: Packer | None = None) -> None:
            connection.send(message_of(described, packer))

        try:
            for message in connection:
                self._answer(conversation, message, send)
        except (ConnectionClosed, OSError):
            LOGGER.debug("a page was closed", exc_info=True)
        finally:
            self._conversations.discard(id(connection))
            with self._turn:
                conversation.close()

    def _answer(self, conversation: Conversation, message: str | bytes, send: Send) -> None:
        try:
            request = request_of(message)
            with contextlib.nullcontext() if request.ask in conversation.slow else self._turn:
                conversation.answer(request, send)
        except (ConnectionClosed, TimeoutError):
            raise
        except (RenderError, DatasetError, DeviceError, OSError) as error:
            send({"kind": "failure", "text": visible(str(error))}, None)
        except Exception as error:
            # A fault of ours in one answer must not end the page; the log has its place in the source.
            LOGGER.exception("a request of a page failed")
            send({"kind": "failure", "text": f"this could not be shown ({visible(repr(error))})"}, None)


def ticket_address(address: str) -> str:
    """An address that leads to a page once, and lacks its token: other users may read it, in a browser's command line.

    Raises ViewError where no server of ours answers there.
    """
    target = urlsplit(address)
    asked = http.client.HTTPConnection(target.netloc, timeout=OPEN_SECONDS_MOST)
    try:
        asked.request("GET", f"{target.path}?{target.query}&ticket={NEW}")
        ticket = asked.getresponse().read().decode()
    except (OSError, http.client.HTTPException) as error:
        raise ViewError(f"the viewer on {target.netloc} does not answer ({error})") from error
    finally:
        asked.close()
    return f"{target.scheme}://{target.netloc}{target.path}?ticket={ticket}"


def refusal(headers: Headers, port: int) -> str | None:
    """Why a request must be refused, by its headers Host and Origin; None: it may pass."""
    if headers.get_all("Host") not in ([f"{name}:{port}"] for name in NAMES):
        return f"This viewer answers to http://{HOST}:{port} only."
    if headers.get_all("Origin") not in ([], *([f"http://{name}:{port}"] for name in NAMES)):
        return "This viewer answers to its own page only."
    return None


def request_of(message: str | bytes) -> PageRequest:
    """A message of a page as a request; raises StrategyError for one that is no JSON object."""
    try:
        values = parse_json(message, allow_nan=True, allow_halves=True)  # what people typed
    except ValueError:
        values = None
    if not isinstance(values, dict):
        raise StrategyError(f"a request must be a JSON object, not {_short(message)}")
    return PageRequest(values)


def message_of(described: dict[str, Any], packer: Packer | None) -> bytes:
    """A message to a page: the length of its JSON as uint32, little-endian; the JSON; the bytes of its arrays."""
    text = json.dumps(described, separators=(",", ":"), allow_nan=False).encode()
    return len(text).to_bytes(4, "little") + text + (b"" if packer is None else packer.content())


def _listening_socket(port: int | None) -> socket.socket:
    if port is None:
        for number in range(FIRST_PORT, FIRST_PORT + PORTS_TRIED):
            with contextlib.suppress(OSError):
                return socket.create_server((HOST, number))
        return socket.create_server((HOST, 0))
    if not 1 <= port <= 65535:
        raise StrategyError(f"port must be 1 to 65535, not {port}")
    try:
        return socket.create_server((HOST, port))
    except OSError as error:
        reason = os.strerror(error.errno or 0)
        raise ViewError(
            f"port {port} of {HOST} cannot be had ({reason}); without a port the first free one is taken"
        ) from error


def _short(value: object) -> str:
    text = visible(repr(value))
    return text if len(text) <= 60 else f"{text[:60]}..."
