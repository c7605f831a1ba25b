"""A viser server that only this machine's browser can use: loopback, checked Host and Origin, no tunnel, exact port.

What a visitor sends is checked, too: the server passes it on to all others. What goes wrong with one connection is
logged by LOGGER, which prints nothing unless a program gives it a handler.
"""

import asyncio
import contextlib
import http.client
import io
import logging
import socket
from collections.abc import Iterator, Mapping
from http import HTTPStatus
from typing import Any
from weakref import WeakSet

import viser
import websockets.asyncio.server
from viser._messages import GuiUpdateMessage

from ...errors import StrategyError, ViewError

HOST = "127.0.0.1"
FIRST_PORT = 8080
NAMES = (HOST, "localhost")
"""What a browser on this machine calls this server; any other name came from another site's DNS."""


TEXT_MOST = 1000  # characters of a text that a visitor enters
LOGGER = logging.getLogger("palpate.view")
LOGGER.addHandler(logging.NullHandler())
LOGGER.propagate = False


class GuardedServer(viser.ViserServer):
    """A viser server whose share tunnel is off, and which ignores impossible values; make it by `start_server`."""

    def check_values(self) -> None:
        """Have values of visitors checked before viser stores them and passes them on; it has no option for it."""
        interface, take = self.gui._websock_interface, self.gui._handle_gui_updates

        async def take_checked(client: Any, message: GuiUpdateMessage) -> None:
            handle = self.gui._gui_input_handle_from_uuid.get(message.uuid)
            if handle is not None and is_possible(handle, message.updates):
                await take(client, message)

        interface.unregister_handler(GuiUpdateMessage, take)
        interface.register_handler(GuiUpdateMessage, take_checked)

    connections: WeakSet[Any] | tuple[()] = ()
    """Those of websockets, each with its loop and transport."""

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Refuse: a tunnel would show the files on an outside server."""
        return None

    def stop(self) -> None:
        """Stop serving, in silence, and at once: visitors that do not read are cut off, others see the same."""
        for connection in tuple(self.connections):
            with contextlib.suppress(RuntimeError):  # its loop has ended
                connection.loop.call_soon_threadsafe(connection.transport.abort)
        with contextlib.redirect_stdout(io.StringIO()):
            super().stop()


def start_server(label: str, port: int | None = None) -> GuardedServer:
    """Start a server on 127.0.0.1; port: exactly this one; None: the first free one from 8080 on.

    Requests whose Host is not this server's, and connections whose Origin is another page, get 403: a page of another
    site must not read files through the visitor's browser. Whether these are refused is tried before this returns.
    Raises ViewError for a port that is taken or that this process may not have, StrategyError for a number of no port.
    """
    if port is not None:
        _require_free(port)
    with _guarded_serving() as connections, contextlib.redirect_stdout(io.StringIO()):  # viser prints a panel
        server = GuardedServer(host=HOST, port=FIRST_PORT if port is None else port, label=label, verbose=False)
    server.connections = connections
    try:
        if port is not None and server.get_port() != port:
            raise ViewError(f"port {port} was taken while the viewer started; choose another one")
        _require_guard(server.get_port())
        server.check_values()
        server.gui.configure_theme(show_share_button=False, show_logo=False)
    except BaseException:
        server.stop()
        raise
    return server


def refusal(host: str | None, origin: str | None, port: int) -> str | None:
    """Why a request must be refused, by its headers Host and Origin; None: it may pass."""
    if host not in {f"{name}:{port}" for name in NAMES}:
        return f"This viewer answers to http://{HOST}:{port} only."
    if origin is not None and origin not in {f"http://{name}:{port}" for name in NAMES}:
        return "This viewer answers to its own page only."
    return None


def is_possible(handle: Any, updates: Mapping[str, Any]) -> bool:
    """Whether an input of the page could have such a value: nothing but a value, of its type, and in its bounds."""
    if updates.keys() != {"value"}:
        return False
    value = updates["value"]
    match handle:
        case viser.GuiSliderHandle():
            is_number = isinstance(value, int | float) and not isinstance(value, bool)
            return is_number and handle.min <= value <= handle.max  # not NaN
        case viser.GuiDropdownHandle() | viser.GuiButtonGroupHandle():
            return value in handle.options
        case viser.GuiTextHandle():
            return isinstance(value, str) and len(value) <= TEXT_MOST
        case _:  # a checkbox, a button
            return isinstance(value, bool)


def _require_free(port: int) -> None:
    if not 1 <= port <= 65535:
        raise StrategyError(f"port must be 1 to 65535, not {port}")
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except OSError as error:
            reason = error.strerror or str(error)
            raise ViewError(
                f"port {port} of {HOST} cannot be had ({reason}); without a port the first free one is taken"
            ) from error


@contextlib.contextmanager
def _guarded_serving() -> Iterator[WeakSet[Any]]:
    """Have the server that is started meanwhile check requests first, and note its connections, which this gives.

    viser has no option for either.
    """
    connections: WeakSet[Any] = WeakSet()

    class Noted(websockets.asyncio.server.ServerConnection):
        def connection_made(self, transport: Any) -> None:
            super().connection_made(transport)
            connections.add(self)

    serve = websockets.asyncio.server.serve

    def guarded(*arguments: Any, process_request: Any = None, **options: Any) -> Any:
        options["create_connection"] = Noted

        def check(connection: Any, request: Any) -> Any:
            port = connection.local_address[1]
            origins = request.headers.get_all("Origin")
            hosts = request.headers.get_all("Host")
            sentence = refusal(
                hosts[0] if len(hosts) == 1 else None,
                origins[0] if len(origins) == 1 else "; ".join(origins) or None,
                port,
            )
            if sentence is not None:
                return connection.respond(HTTPStatus.FORBIDDEN, sentence + "\n")
            return None if process_request is None else process_request(connection, request)

        asyncio.get_running_loop().set_exception_handler(_log_error)
        return serve(*arguments, process_request=check, logger=LOGGER, **options)

    websockets.asyncio.server.serve = guarded  # pyright: ignore[reportAttributeAccessIssue]  # viser looks it up here
    try:
        yield connections
    finally:
        websockets.asyncio.server.serve = serve  # pyright: ignore[reportAttributeAccessIssue]


def _log_error(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """An error that one message of a visitor caused is no news for the terminal."""
    del loop
    LOGGER.error(context["message"], exc_info=context.get("exception"))


def _require_guard(port: int) -> None:
    """Raise ViewError unless a foreign Host and a foreign Origin are refused, for pages and for connections."""
    connecting = {
        "Connection": "Upgrade",
        "Upgrade": "websocket",
        "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA==",
    }
    own, foreign = {"Host": f"{HOST}:{port}"}, {"Host": "example.org"}
    for headers in (foreign, foreign | connecting, own | connecting | {"Origin": "http://example.org"}):
        asked = http.client.HTTPConnection(HOST, port, timeout=10)
        try:
            asked.request("GET", "/", headers=headers)
            status = asked.getresponse().status
        except (OSError, http.client.HTTPException) as error:
            raise ViewError(f"the viewer on port {port} does not answer ({error})") from error
        finally:
            asked.close()
        if status != HTTPStatus.FORBIDDEN:
            raise ViewError(
                f"viser {viser.__version__} let a request of a foreign page pass, so the viewer is not started; "
                "install a version that palpate's pyproject.toml names"
            )
