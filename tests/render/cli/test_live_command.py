"""`palpate live`: what is refused and with which exit code, what keys do, and one object of JSON at the end."""

import fcntl
import json
import os
import pty
import signal
import struct
import subprocess
import sys
import termios
import threading
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

from palpate.render import LiveRecording
from palpate.render.cli.app import app
from palpate.render.cli.live_command import Choices, Keys

REFUSED = {
    "": "Missing argument 'OBJECT...'",
    "nosuch": "nosuch: no such file; built-in objects are",
    "cube --source nosuch": "nosuch: is no source of poses: give exploration",
    "cube --lead 1e-9": "--lead must lie in 0.002..0.1 s (4 frames at 10000 Hz at least), not 1e-09",
    "cube --lead nan": "not nan",
    "cube --lead 6": "6 ms are 0.006",
    "cube --intensity 2": "--intensity must lie in 0..1, not 2.0\n",
    "cube --record there.h5": "there.h5: exists already; --overwrite replaces it",
    "cube --record run.txt": "must end in .h5 or .hdf5",
    "cube --record nowhere/run.h5": "there is no folder nowhere",
    "cube --sampling stm --sampling fast.json": "--sampling: all must have one update rate, not [10000.0, 20000] Hz",
    "cube --sampling nosuch": "unknown sampling 'nosuch'",
    "cube --strategy nosuch": "unknown strategy 'nosuch'",
    "cube --palm 0.1 0.1 --hand planes": "--palm is the size of --hand palm, which planes is not",
    "cube --duration 0": "--duration must be above 0 s, not 0.0",
    "cube --duration nan": "--duration must be above 0 s, not nan",
    "cube --update-rate 0": "--update-rate must lie in",
    "cube --side middle --source udp": "--side must be one of any, left, right, not 'middle'",
    "cube --transport fast": "transport must be one of",
    "cube --watchdog": "a watchdog is for real arrays, not for emulator",
    "cube --prediction 20": "20 ms are 0.02",
    "cube --port 8090": "--port is of the page that --view shows",
    "cube --no-browser": "--no-browser is of the page that --view shows",
    "cube --view --no-browser --port 70000": "port must be 1 to 65535, not 70000",
}


@pytest.mark.parametrize("words", REFUSED)
def test_bad_input_is_refused_with_a_sentence_and_exit_code_2(words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("palpate.render.live.held_arrays.WriterHandle", None)  # no array is opened
    Path("there.h5").write_bytes(b"")
    Path("fast.json").write_text('{"update_rate": 20000}')
    done = CliRunner(env={"COLUMNS": "400"}).invoke(app, ["live", *words.split()])
    assert done.exit_code == 2
    assert REFUSED[words] in done.output
    assert "Traceback" not in done.output


class Run:
    """What keys do with a run."""

    def __init__(self):
        self.intensity, self.changes = 1.0, []
        self.goes_on = threading.Event()

    def set_intensity(self, value):
        self.intensity = value

    def change(self, **fields):
        self.changes.append(fields)
        self.goes_on.wait(5)
        if fields.get("solid") == "bad":
            raise ValueError("bad is refused")


def test_keys_change_intensity_within_its_range_and_back():
    run = Run()
    keys = Keys(run, Choices(["a"], ["b"], ["c"]))
    found = []
    for key in "+--- " + " " + "-" * 12 + " +":
        keys.press(key)
        found.append(run.intensity)
    assert found[:6] == [1.0, 0.9, 0.8, 0.7, 0.0, 0.7]
    assert found[6:18] == [0.6, 0.5, 0.4, 0.3, 0.2, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    assert found[-1] > 0
    assert not keys.is_ended
    keys.press("x")  # no key of it
    keys.press("q")
    assert keys.is_ended


def test_keys_choose_in_turn_one_at_a_time_and_a_refused_choice_is_told(capfd):
    run = Run()
    keys = Keys(run, Choices(["a", "bad", "c"], ["cc"], ["stm", "am"]))
    keys.press("o")
    keys.press("m")  # while the object is prepared
    run.goes_on.set()
    keys.finish()
    for key in "som":
        keys.press(key)
        keys.finish()
    assert run.changes == [{"solid": "bad"}, {"solid": "c"}, {"sampling": "am"}]
    told = capfd.readouterr().err
    for sentence in ("still preparing the one before", "bad is refused", "there is no other strategy: give several"):
        assert sentence in told


def live(*words, **options):
    return subprocess.run(
        [sys.executable, "-m", "palpate.render.cli", "live", *words], capture_output=True, text=True, **options
    )


@pytest.mark.exhaustive
def test_json_is_one_object_and_the_record_is_given_again_bit_for_bit(tmp_path):
    done = live("cube", "--duration", "1", "--json", "--record", str(tmp_path / "run.h5"), "--no-realtime")
    assert done.returncode == 0, done.stderr
    values = json.loads(done.stdout)
    assert values["off_confirmed"] is True
    assert values["ended_by"] is None
    assert values["poses"] > 50
    assert 0 < values["latency_p50"] < 0.1
    assert values["files"] == [str(tmp_path / "run.h5")]
    with LiveRecording(tmp_path / "run.h5") as recording:
        assert recording.compare().differing == 0


@pytest.mark.exhaustive
def test_a_signal_ends_the_run_and_the_report_follows():
    process = subprocess.Popen(
        [sys.executable, "-m", "palpate.render.cli", "live", "cube", "--json", "--no-realtime"],
        stdout=subprocess.PIPE,
        text=True,
    )
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    end = time.monotonic() + 60
    while len(children.read_text().split()) < 3 and time.monotonic() < end:
        time.sleep(0.1)
    time.sleep(5.0)  # the process that draws prepares itself
    process.send_signal(signal.SIGTERM)
    values = json.loads(process.communicate(timeout=20)[0])
    assert process.returncode == 128 + signal.SIGTERM
    assert (values["ended_by"], values["off_confirmed"]) == ("SIGTERM", True)


@pytest.mark.exhaustive
def test_keys_of_a_terminal_change_what_runs(tmp_path, request):
    """Keys o, s, m, +, -, space and q, typed into a pseudoterminal."""
    record = tmp_path / "run.h5"
    words = ["cube", "tube", "--strategy", "cc", "--strategy", "oc", "--sampling", "stm", "--sampling", "pendulum"]
    master, terminal = pty.openpty()
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", 40, 200, 0, 0))
    process = subprocess.Popen(
        [sys.executable, "-m", "palpate.render.cli", "live", *words, "--no-realtime", "--record", str(record)],
        stdin=terminal,
        stdout=subprocess.PIPE,
        stderr=terminal,
        text=True,
    )
    request.addfinalizer(process.kill)  # if a key did not do what it should
    os.close(terminal)
    shown = []

    def read():
        while True:
            try:
                shown.append(os.read(master, 4096))
            except OSError:
                return

    reader = threading.Thread(target=read, daemon=True)
    reader.start()

    def wait_for(text, timeout=30.0):
        end = time.monotonic() + timeout
        while text not in b"".join(shown) and time.monotonic() < end:
            time.sleep(0.05)
        assert text in b"".join(shown), b"".join(shown)[-2000:]

    def processes():
        found = Path(f"/proc/{process.pid}/task").glob("*/children")
        return {child for path in found for child in path.read_text().split()}

    wait_for(b"cube, ")
    os.write(master, b"--")
    wait_for(b"intensity 0.8")
    os.write(master, b" ")
    wait_for(b"intensity 0: ")
    os.write(master, b" +")
    wait_for(b"intensity 0.9")
    os.write(master, b"o")
    wait_for(b"tube, ")
    time.sleep(1.0)  # the process that drew the cube ends
    for key in (b"s", b"m"):
        before, end = processes(), time.monotonic() + 60
        os.write(master, key)
        while time.monotonic() < end and (len(processes()) != 3 or processes() == before):
            time.sleep(0.1)  # one that draws takes over from the other
        time.sleep(0.5)
    os.write(master, b"q")
    output = process.communicate(timeout=30)[0]
    os.close(master)
    assert process.returncode == 0, b"".join(shown)[-2000:]
    assert "off confirmed" in output
    assert "poses refused" in output  # not "silenced", as focal points are
    assert len(list(tmp_path.glob("run*.h5"))) == 4


@pytest.mark.exhaustive
def test_the_page_of_a_run_shows_the_hand_that_moves_now(tmp_path):
    from browser import Browser

    words = [sys.executable, "-m", "palpate.render.cli", "live", "tube", "--view", "--no-browser"]
    with subprocess.Popen(words, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as run:
        try:
            printed = next(line for line in run.stderr if "palpate shows the hand that moves now on " in line)
            address = printed.split(" on ")[1].split(" until ")[0]
            with Browser(tmp_path) as browser:
                browser.open(address)
                browser.wait("document.querySelector('[data-ready]')")
                readout = "document.querySelector('.readout output').value"
                browser.wait(f"/[0-9.]+ s · tracking · [0-9.]+ ms from hand to array/.test({readout})")
                before = browser.run(readout)
                browser.wait(f"{readout} !== {json.dumps(before)}")
                assert browser.errors == []
                run.send_signal(signal.SIGINT)
                browser.wait("document.body.innerText.includes('The run has ended')")
            report = run.communicate(timeout=30)[0]
        finally:
            run.kill()
    assert run.returncode == 0
    assert "off confirmed    True" in report
