"""Keys of a terminal without Enter, and none where there is no terminal."""

import os
import pty
import sys
import termios
import time
from types import SimpleNamespace

from palpate.render.terminal.keys import pressed_keys


def read(keys):
    end, found = time.monotonic() + 5, ""
    while not found and time.monotonic() < end:
        found = keys()
    return found


def test_keys_are_read_as_they_are_pressed_and_the_terminal_is_as_before(monkeypatch):
    master, terminal = pty.openpty()
    before = termios.tcgetattr(terminal)
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(fileno=lambda: terminal))
    with pressed_keys() as keys:
        assert keys() == ""
        os.write(master, b"o+")
        assert read(keys) == "o+"
        assert not termios.tcgetattr(terminal)[3] & termios.ECHO
        os.write(master, "ä".encode()[:1])  # half a letter, as when many bytes come
        assert read(keys) == "\N{REPLACEMENT CHARACTER}"
    assert termios.tcgetattr(terminal) == before
    for descriptor in (master, terminal):
        os.close(descriptor)


def test_the_end_of_a_terminal_is_no_key(monkeypatch):
    master, terminal = pty.openpty()
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(fileno=lambda: terminal))
    with pressed_keys() as keys:
        os.close(master)
        assert keys() == ""
    os.close(terminal)


def test_without_a_terminal_there_are_no_keys(monkeypatch):
    end, other = os.pipe()
    os.write(other, b"q")
    for stdin in (SimpleNamespace(fileno=lambda: end), None, SimpleNamespace()):
        monkeypatch.setattr(sys, "stdin", stdin)
        with pressed_keys() as keys:
            assert keys() == ""
    os.close(end)
    os.close(other)
