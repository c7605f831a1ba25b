"""The command line of palpate-ultraleap, and arrays that cannot be had."""

import os
import subprocess

import pytest
from ultraleap_bridge import Bridge, shared_program


@pytest.fixture(scope="session")
def program(tmp_path_factory):
    return shared_program(tmp_path_factory)


FAULTS = {
    "unconnected": "cannot reach its service (is the Ultraleap haptics service running? --connect direct goes "
    "without it): LibraryNotConnected",
    "absent": "cannot find an array that takes focal points (is it plugged in and switched on?): NoMatches",
    "claimed": "array USX:00000001 is claimed by another program",
}


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("fault", FAULTS)
def test_an_array_that_cannot_be_had_is_named(program, fault):
    done = subprocess.run(
        [program], env=os.environ | {"STUB_FAULT": fault}, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout) == (1, "")
    assert FAULTS[fault] in done.stderr


MISUSES = {
    "--port": "--port needs a value",
    "--port 65536": "--port must be a whole number from 0 to 65535, not '65536'",
    "--port -1": "not '-1'",
    "--port 4x": "not '4x'",
    "play": "play needs a file of focal points",
    "play a --repeat 0": "--repeat must be a whole number from 1 to 999999999, not '0'",
    "play a --once": "--once is not for play",
    "--repeat 2": "--repeat is not for serving",
    "serve": "'serve' is unknown: --help lists what there is",
    "--connect tcp:1": "--connect must be direct or local:PATH, not 'tcp:1'",
}


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("words", MISUSES)
def test_a_wrong_command_line_is_misuse(program, words):
    done = subprocess.run([program, *words.split()], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert MISUSES[words] in done.stderr


def test_a_port_that_is_taken_and_an_address_that_is_not_here(program):
    with Bridge(program) as bridge:
        other = subprocess.run([program, "--port", str(bridge.port)], capture_output=True, text=True, check=False)
        assert other.returncode == 1
        assert "if another palpate-ultraleap runs, --port takes another port" in other.stderr
    other = subprocess.run([program, "--listen", "192.0.2.1"], capture_output=True, text=True, check=False)  # RFC 5737
    assert other.returncode == 1
    assert "192.0.2.1" in other.stderr


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize(
    ("address", "is_open"), [("0.0.0.0", True), ("127.0.0.2", False), ("::1", False), ("localhost", False)]
)
def test_an_address_that_others_reach_is_warned_of(program, address, is_open):
    with Bridge(program, "--listen", address, "--device", "MockDevice:USX", "--connect", "direct") as bridge:
        if not bridge.ready and address == "::1":
            pytest.skip("this machine has no IPv6")
        assert "MockDevice:USX" in bridge.ready
        assert bridge.end() == 0
    assert ("warning" in bridge.output) == is_open
