"""Only this machine's own page gets answers; tried by a client of the standard library and one by websockets."""

import http.client
import socket
import time

import numpy as np
import pytest

viser = pytest.importorskip("viser")

import msgspec  # noqa: E402  # viser's own encoder
from websockets.exceptions import ConnectionClosed, InvalidStatus  # noqa: E402
from websockets.sync.client import connect  # noqa: E402

from palpate.render.errors import StrategyError, ViewError  # noqa: E402  # after the skip
from palpate.render.view.live import guarded_server  # noqa: E402
from palpate.render.view.live.guarded_server import HOST, refusal, start_server  # noqa: E402


@pytest.fixture(scope="module")
def server():
    started = start_server("test")
    yield started
    started.stop()


def status_of(port, headers):
    asked = http.client.HTTPConnection(HOST, port, timeout=10)
    asked.request("GET", "/", headers=headers)
    status = asked.getresponse().status
    asked.close()
    return status


def test_pages_are_for_the_servers_own_names(server):
    port = server.get_port()
    for host in (f"127.0.0.1:{port}", f"localhost:{port}"):
        assert status_of(port, {"Host": host}) == 200
    for host in ("example.org", f"example.org:{port}", "127.0.0.1", f"127.0.0.1:{port}.example.org", "127.0.0.1:80"):
        assert status_of(port, {"Host": host}) == 403, host


@pytest.mark.parametrize(
    ("origin", "is_let_in"),
    [
        ("http://127.0.0.1:{}", True),
        ("http://localhost:{}", True),
        (None, True),  # no browser: it always sends one
        ("http://example.org", False),
        ("https://127.0.0.1:{}", False),
        ("http://127.0.0.1:1", False),
        ("null", False),  # a page from disk
    ],
)
def test_connections_are_for_the_servers_own_page(server, origin, is_let_in):
    port = server.get_port()
    asked = {"origin": None if origin is None else origin.format(port), "open_timeout": 10}
    protocol = [f"viser-v{viser.__version__}"]
    if is_let_in:
        with connect(f"ws://{HOST}:{port}", subprotocols=protocol, **asked) as connection:
            assert connection.recv(timeout=10)
    else:
        with pytest.raises(InvalidStatus, match="403"):
            connect(f"ws://{HOST}:{port}", subprotocols=protocol, **asked)


def test_closed_sockets_and_malformed_messages_print_nothing(server, capfd, caplog):
    port = server.get_port()
    beginnings = (
        b"",
        b"GET / HTT",
        b"\x16\x03\x01 no HTTP\r\n\r\n",
        f"GET / HTTP/1.1\r\nHost: {HOST}:{port}\r\n".encode(),
    )
    for sent in beginnings:
        with socket.create_connection((HOST, port)) as visitor:
            visitor.sendall(sent)
    with visit(port) as connection:
        connection.send(b"\xff\xff\xff")
        with pytest.raises(ConnectionClosed):
            consume(connection)
    assert status_of(port, {"Host": f"{HOST}:{port}"}) == 200  # it still serves, and has seen all that came before
    assert capfd.readouterr() == ("", "")
    assert {record.name for record in caplog.records} <= {"palpate.view"}  # other loggers would print


def test_values_that_an_input_cannot_have_reach_no_other_visitor(server, capfd, caplog):
    gui, port = server.gui, server.get_port()
    slider, text = gui.add_slider("pose", 0, 99, 1, 0), gui.add_text("rows", "")
    dropdown, box = gui.add_dropdown("speed", ("1", "2"), initial_value="1"), gui.add_checkbox("layer", True)
    bad = [
        *((slider, {"value": value}) for value in (1e300, -5, 100, "x", [1], True, float("nan"))),
        *((slider, updates) for updates in ({"max": 1e300}, {"nothing": 3}, {}, {"value": 7, "label": "other"})),
        *((dropdown, {"value": value}) for value in ("3", 1, ["1"], None)),
        *((text, {"value": value}) for value in (3, "x" * 1001, None)),
        *((box, {"value": value}) for value in (0.5, "yes", None)),
    ]
    with visit(port) as other, visit(port) as connection:
        for handle, updates in bad:
            connection.send(update(handle, updates))
        for value in (0, 99, 41):
            connection.send(update(slider, {"value": value}))  # after the others, and messages are taken in order
        consume(other, until=b"\xa5value)")  # msgpack's {"value": 41}
    assert (slider.value, slider.max, slider.label, dropdown.value, text.value, box.value) == (
        41,
        99,
        "pose",
        "1",
        "",
        True,
    )
    with visit(port) as connection:
        assert connection.recv(timeout=10)
    assert capfd.readouterr() == ("", "")
    assert {record.name for record in caplog.records} <= {"palpate.view"}  # other loggers would print


def visit(port):
    """A connection as the page makes it."""
    return connect(f"ws://{HOST}:{port}", subprotocols=[f"viser-v{viser.__version__}"], open_timeout=10)


def consume(connection, until=None):
    """Read messages until one holds these bytes, or for ever."""
    while True:
        message = connection.recv(timeout=10)
        if until is not None and until in message:
            return


def update(handle, updates):
    """The message by which the page reports what a visitor entered."""
    return msgspec.msgpack.encode({"type": "GuiUpdateMessage", "uuid": handle._impl.uuid, "updates": updates})


def test_two_hosts_or_origins_pass_for_none():
    assert refusal(None, None, 8080)
    assert refusal("127.0.0.1:8080", "http://127.0.0.1:8080; http://example.org", 8080)
    assert refusal("127.0.0.1:8080", "http://127.0.0.1:8080", 8080) is None


def test_it_is_bound_to_this_machine_and_has_no_tunnel(server):
    with socket.socket() as outside, pytest.raises(OSError, match="refused"):
        outside.connect((other_address(), server.get_port()))
    assert server.request_share_url() is None


def other_address():
    """An address of this machine that is not 127.0.0.1: all of 127.0.0.0/8 are its own on Linux."""
    return "127.0.0.2"


def test_a_port_that_is_taken_is_refused_and_no_other_is_taken(server):
    with pytest.raises(ViewError, match=rf"port {server.get_port()} of 127\.0\.0\.1 cannot be had"):
        start_server("test", server.get_port())


def test_a_port_out_of_range_is_refused():
    for port in (0, -1, 65536):
        with pytest.raises(StrategyError, match=f"port must be 1 to 65535, not {port}"):
            start_server("test", port)


def test_a_viser_that_lets_foreign_pages_pass_is_not_started(monkeypatch):
    monkeypatch.setattr(guarded_server, "refusal", lambda *_: None)
    with pytest.raises(ViewError, match="let a request of a foreign page pass"):
        start_server("test")


ASKED = {
    "a browser that connects in advance": "",
    "half a request": "GET / HT",
    "a page that is not read": "GET / HTTP/1.1\r\nHost: {0}\r\n\r\n",
    "a visitor that does not read": (
        "GET / HTTP/1.1\r\nHost: {0}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
        "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Protocol: viser-v{1}\r\n\r\n"
    ),
}


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("asked", ASKED.values(), ids=ASKED)
def test_it_stops_at_once_whatever_visitors_do_not_read(asked):
    server = start_server("test")
    address = (HOST, server.get_port())
    with socket.socket() as visitor:
        visitor.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        visitor.connect(address)
        visitor.sendall(asked.format(f"{HOST}:{address[1]}", viser.__version__).encode())
        server.scene.add_point_cloud("/points", points=np.zeros((10**6, 3), np.float32), colors=(1, 2, 3))
        deadline = time.monotonic() + 5
        while not server.connections:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        begun = time.monotonic()
        server.stop()
        assert time.monotonic() - begun < 3  # before 6 s: viser's own time for visitors
    with pytest.raises(OSError, match="refused"), socket.create_connection(address, timeout=5):
        pass
