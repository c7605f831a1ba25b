"""Only this machine's own page gets answers; tried by a client of the standard library and one by websockets."""

import http.client
import json
import socket
import threading
import time
from contextlib import contextmanager

import numpy as np
import pytest
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from palpate.render.errors import StrategyError, ViewError
from palpate.render.view.packing import Packer
from palpate.render.view.served.page_server import HOST, PageRequest, PageServer, ServedPage, refusal, ticket_address


class Echo:
    """Answers with what was asked."""

    slow = frozenset({"slow"})
    released = threading.Event()

    def answer(self, request, send):
        match request.ask:
            case "slow":
                self.released.wait(10)
                send({"kind": "slow"})
            case "fault":
                raise RuntimeError("a fault of ours")
            case "number":
                request.number("value", 0, 99)
            case "much":
                send({"kind": "much"}, packed(np.zeros(5_000_000)))
            case _:
                send({"kind": "echo", "ask": request.ask})

    def close(self):
        pass


def packed(values):
    packer = Packer(exact=True)
    packer.numbers(values, "f8")
    return packer


@contextmanager
def serving(port=None):
    with PageServer({"/": ServedPage(lambda sockets: f"<html>{sockets}</html>", Echo)}, port) as server:
        yield server


@pytest.fixture(scope="module")
def server():
    with serving() as started:
        yield started


def token_of(server):
    return server.address().split("?")[1]


def get(server, headers, path=None):
    asked = http.client.HTTPConnection(HOST, server.port, timeout=10)
    asked.request("GET", f"/?{token_of(server)}" if path is None else path, headers=headers)
    answer = asked.getresponse()
    body = answer.read().decode()
    asked.close()
    return answer.status, body


def visit(server, **options):
    """A connection as the page makes it."""
    return connect(f"ws://{HOST}:{server.port}/?{token_of(server)}", open_timeout=10, compression=None, **options)


def ask(connection, **request):
    connection.send(json.dumps(request))
    return answer_of(connection.recv(timeout=10))


def answer_of(message):
    size = int.from_bytes(message[:4], "little")
    return json.loads(message[4 : 4 + size])


def test_pages_are_for_the_servers_own_names(server):
    for host in (f"127.0.0.1:{server.port}", f"localhost:{server.port}"):
        status, body = get(server, {"Host": host})
        assert status == 200
        assert f"ws://{host}" in body
    others = ("example.org", f"example.org:{server.port}", "127.0.0.1", f"127.0.0.1:{server.port}.example.org")
    for host in (*others, "127.0.0.1:80"):
        assert get(server, {"Host": host})[0] == 403, host


@pytest.mark.parametrize("query", ["", "?token=", "?token=x", "?token=%C3%A9", "?other=1"])
def test_an_address_without_the_token_gets_nothing(server, query):
    status, body = get(server, {"Host": f"{HOST}:{server.port}"}, f"/{query}")
    assert status == 403
    assert "lacks the token" in body
    with pytest.raises(InvalidStatus, match="403"):
        connect(f"ws://{HOST}:{server.port}/{query}", open_timeout=10)


def test_a_ticket_leads_to_the_page_once_and_is_not_its_token(server):
    address = ticket_address(server.address())
    assert token_of(server) not in address
    path, host = address.split(str(server.port))[1], {"Host": f"{HOST}:{server.port}"}
    asked = http.client.HTTPConnection(HOST, server.port, timeout=10)
    asked.request("GET", path, headers=host)
    answer = asked.getresponse()
    assert (answer.status, answer.headers["Location"]) == (303, f"/?{token_of(server)}")
    asked.close()
    assert get(server, host, path)[0] == 403
    assert get(server, host, "/?ticket=new")[0] == 403  # only who has the token gets a ticket


def test_each_server_has_a_token_of_its_own_and_other_paths_have_no_page(server):
    with serving() as other:
        assert token_of(other) != token_of(server)
        assert len(token_of(other)) > 30
        with pytest.raises(InvalidStatus, match="403"):
            connect(f"ws://{HOST}:{other.port}/?{token_of(server)}")
    assert get(server, {"Host": f"{HOST}:{server.port}"}, f"/other?{token_of(server)}")[0] == 404


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
    asked = {"origin": None if origin is None else origin.format(server.port)}
    if is_let_in:
        with visit(server, **asked) as connection:
            assert ask(connection, ask="hello") == {"kind": "echo", "ask": "hello"}
    else:
        with pytest.raises(InvalidStatus, match="403"):
            visit(server, **asked)


def test_two_hosts_or_origins_pass_for_none():
    good = [("Host", "127.0.0.1:8080"), ("Origin", "http://127.0.0.1:8080")]
    assert refusal(Headers(good), 8080) is None
    assert refusal(Headers([]), 8080)
    for name, value in (("Host", "127.0.0.1:8080"), ("Origin", "http://example.org")):
        assert refusal(Headers([*good, (name, value)]), 8080)


def test_closed_sockets_and_malformed_messages_print_nothing(server, capfd, caplog):
    beginnings = (
        b"",
        b"GET / HTT",
        b"\x16\x03\x01 no HTTP\r\n\r\n",
        f"GET / HTTP/1.1\r\nHost: {HOST}:{server.port}\r\n".encode(),
    )
    thread_count = threading.active_count()
    for sent in beginnings:
        with socket.create_connection((HOST, server.port)) as visitor:
            visitor.sendall(sent)
    with visit(server) as connection:
        for message in ("", "[", "[]", "3", '"x"', "null", "[" * 5000, b"\xff\xff\xff"):
            connection.send(message)
            assert "must be a JSON object" in answer_of(connection.recv(timeout=10))["text"]
        assert "value must be a number from 0 to 99" in ask(connection, ask="number", value="x")["text"]
        assert "a fault of ours" in ask(connection, ask="fault")["text"]
        assert ask(connection, ask=3) == {"kind": "echo", "ask": ""}
        connection.send("x" * 70_000)
        with pytest.raises(ConnectionClosed):
            connection.recv(timeout=10)
    assert get(server, {"Host": f"{HOST}:{server.port}"})[0] == 200  # it still serves
    deadline = time.monotonic() + 8
    while threading.active_count() > thread_count and time.monotonic() < deadline:
        time.sleep(0.01)  # each connection has threads, which log how it ended
    assert capfd.readouterr() == ("", "")
    assert {record.name for record in caplog.records} <= {"palpate.view"}  # other loggers would print


def test_what_takes_long_lets_other_pages_be_answered(server):
    with visit(server) as patient, visit(server) as other:
        patient.send('{"ask": "slow"}')
        assert ask(other, ask="hello")["kind"] == "echo"
        Echo.released.set()
        assert answer_of(patient.recv(timeout=10))["kind"] == "slow"


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"poses": [1, 9]}, "poses must be 2 whole numbers of 0..4 and 0..9"),
        ({"poses": [5, 0]}, "not [5, 0]"),
        ({"poses": [1.0, 1]}, "not [1.0, 1]"),
        ({"poses": [True, 1]}, "not [True, 1]"),
        ({"poses": 3}, "not 3"),
        ({}, "not None"),
    ],
)
def test_numbers_of_poses_are_whole_and_in_the_file(values, sentence):
    limits = (5, 9) if values.get("poses") == [1, 9] else (5, 10)
    with pytest.raises(StrategyError) as caught:
        PageRequest(values).integers("poses", 2, limits)
    assert sentence.replace("0..9", f"0..{limits[1] - 1}") in str(caught.value)
    assert PageRequest({"poses": [4, 9]}).integers("poses", 2, (5, 10)) == [4, 9]


def test_it_is_bound_to_this_machine(server):
    other = "127.0.0.2"  # all of 127.0.0.0/8 are this machine's own on Linux
    with socket.socket() as outside, pytest.raises(OSError, match="refused"):
        outside.connect((other, server.port))


def test_a_port_that_is_taken_is_refused_and_no_other_is_taken(server):
    with pytest.raises(ViewError, match=rf"port {server.port} of 127\.0\.0\.1 cannot be had"):
        PageServer({}, server.port)
    with pytest.raises(StrategyError, match="port must be 1 to 65535, not 65536"):
        PageServer({}, 65536)


ASKED = {
    "a browser that connects in advance": "",
    "half a request": "GET / HT",
    "a page that is not read": "GET /?{1} HTTP/1.1\r\nHost: {0}\r\n\r\n",
}


@pytest.mark.parametrize("asked", ASKED.values(), ids=ASKED)
def test_it_stops_at_once_whatever_visitors_send(asked):
    server = PageServer({"/": ServedPage(lambda _: "x" * 5_000_000, Echo)})
    with silent_visitor(server) as visitor:
        visitor.sendall(asked.format(f"{HOST}:{server.port}", token_of(server)).encode())
        time.sleep(0.05)
        begun = time.monotonic()
        server.close()
        assert time.monotonic() - begun < 1
    with pytest.raises(OSError, match="refused"), socket.create_connection((HOST, server.port), timeout=5):
        pass


@contextmanager
def silent_visitor(server):
    with socket.socket() as visitor:
        visitor.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        visitor.connect((HOST, server.port))
        yield visitor


@pytest.mark.exhaustive
def test_a_page_that_does_not_read_is_cut_off_and_others_get_their_answers():
    with serving() as server, silent_visitor(server) as deaf, visit(server) as other:
        deaf.sendall(
            (
                f"GET /?{token_of(server)} HTTP/1.1\r\nHost: {HOST}:{server.port}\r\nConnection: Upgrade\r\n"
                "Upgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
                "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
            ).encode()
        )
        time.sleep(0.2)
        text = b'{"ask": "much"}'
        deaf.sendall(bytes([0x81, 0x80 | len(text), 0, 0, 0, 0]) + text)  # a text frame, masked by zeros
        time.sleep(0.2)
        begun = time.monotonic()
        assert ask(other, ask="hello")["kind"] == "echo"
        assert time.monotonic() - begun < 5
