"""`palpate selftest`: what is played, what the report holds, and how it may end; the arrays are emulated."""

import json
import os
import signal
import subprocess
import sys

import numpy as np
import pytest
from command_line import FAILED, MISUSED, answer, refused
from typer.testing import CliRunner
from umockdev_session import write_pat_file

from palpate.device.errors import DeviceLostError
from palpate.render import SamplingStrategy
from palpate.render.cli.app import app
from palpate.render.playback.frames import MadeFrames
from palpate.render.selftest import report, stimuli
from palpate.render.selftest.stimuli import stimulus

ANSWERS = ["a buzz above the middle", "a ring", "it goes round"]
FAST = ("--clock", "virtual", "--duration", "0.1")


@pytest.fixture(autouse=True)
def _hangup_ends():
    """Whatever runs the tests, such as nohup, may ignore SIGHUP."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "report.json"


def answering(monkeypatch, lines):
    left = list(lines)
    monkeypatch.setattr(report, "read_answer", lambda: left.pop(0) if left else None)


def test_a_circle_has_2_cm_and_is_drawn_at_the_samplers_speed():
    place = stimulus("circle", 0.2, 0.1, SamplingStrategy()).position.astype(np.float64)
    assert np.hypot(place[:, 0], place[:, 1]) == pytest.approx(np.full(len(place), 0.02), abs=1e-6)
    assert np.linalg.norm(np.diff(place, axis=0), axis=1) == pytest.approx(np.full(len(place) - 1, 7e-4), rel=1e-3)
    assert np.cross(place[0], place[1])[2] > 0


def test_a_turn_is_anticlockwise_once_a_second_and_a_point_stays():
    sampling = SamplingStrategy(update_rate=1000.0)
    turn = stimulus("turn", 0.2, 1.0, sampling).position[::250, :2]
    assert turn == pytest.approx(np.array([[0.02, 0.0], [0.0, 0.02], [-0.02, 0.0], [0.0, -0.02]]), abs=1e-6)
    point = stimulus("point", 0.15, 1.0, sampling)
    assert (point.position == np.float32([0, 0, 0.15])).all()
    tones = np.abs(np.fft.rfft(point.intensity - point.intensity.mean()))
    assert tones.argmax() == 200  # [Hz], over one second


@pytest.mark.exhaustive
def test_the_report_has_boards_bytes_off_and_answers_in_their_order(path, monkeypatch, tmp_path):
    """A frame of a pat16 is 512 bytes. The digest is that of `sha256sum`, of coreutils."""
    board = tmp_path / "somebody" / "board.pat"
    board.parent.mkdir()
    write_pat_file(board, serial="FT4TKZL8")
    digest = subprocess.run(["sha256sum", str(board)], capture_output=True, text=True, check=True).stdout.split()[0]
    answering(monkeypatch, ANSWERS)
    answer("selftest", "--array", "pat16", "--emulate", "--calibration", board, *FAST, "--report", path)
    found = json.loads(path.read_text())
    (array,) = found["arrays"]
    assert (array["array"], array["serial"]) == ("pat16", "FT4TKZL8")
    assert array["emulated"]
    assert array["calibrated"]
    assert (found["board_file"], found["board_file_sha256"]) == ("board.pat", digest)
    assert "somebody" not in path.read_text()
    assert {"python", "palpate", "numpy", "pyusb"} <= found["versions"].keys()
    assert (found["ended_by"], found["failure"]) == ("end", None)
    assert [(entry["stimulus"], entry["answer"]) for entry in found["stimuli"]] == list(
        zip(("point", "circle", "turn"), ANSWERS, strict=True)
    )
    for entry in found["stimuli"]:
        (played,) = entry["played"]
        assert (played["frames"], played["bytes"], played["off_sent"]) == (1000, 512_000, True)


def test_an_input_that_ends_leaves_answers_open(path):
    done = CliRunner().invoke(app, ["selftest", *FAST, "--report", str(path)], input=f" {ANSWERS[0]}\n")
    assert done.exit_code == 0
    assert [entry["answer"] for entry in json.loads(path.read_text())["stimuli"]] == [ANSWERS[0], None, None]


def test_a_signal_while_an_answer_is_awaited_keeps_the_report(path, monkeypatch):
    left = ANSWERS[:1]
    monkeypatch.setattr(report, "read_answer", lambda: left.pop() if left else os.kill(os.getpid(), signal.SIGTERM))
    refused(FAILED, "interrupted", "selftest", *FAST, "--report", path)
    found = json.loads(path.read_text())
    assert found["ended_by"] == "SIGTERM"
    assert [entry["answer"] for entry in found["stimuli"]] == [ANSWERS[0], None]


@pytest.mark.parametrize("signum", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_amid_a_stimulus_switches_off_and_keeps_the_report(signum, path, monkeypatch):
    class Killed(MadeFrames):
        def __iter__(self):
            for number, block in enumerate(super().__iter__()):
                if number == 1:
                    os.kill(os.getpid(), signum)
                yield block

    monkeypatch.setattr(stimuli, "MadeFrames", Killed)
    refused(FAILED, "", "selftest", "--clock", "virtual", "--duration", "2", "--report", path)
    found = json.loads(path.read_text())
    assert found["ended_by"] == signum.name
    (played,) = found["stimuli"][-1]["played"]
    assert (played["stopped_by"], played["off_sent"], played["off_confirmed"]) == (signum.name, True, True)


def test_a_failure_keeps_what_was_answered(path, monkeypatch):
    whole, calls = stimuli.play_together, []

    def fail_second(*arguments, **options):
        calls.append(arguments)
        if len(calls) == 2:
            raise DeviceLostError("array emulator is gone")
        return whole(*arguments, **options)

    monkeypatch.setattr(stimuli, "play_together", fail_second)
    answering(monkeypatch, ANSWERS)
    refused(FAILED, "is gone", "selftest", *FAST, "--report", path)
    found = json.loads(path.read_text())
    assert (found["ended_by"], found["failure"]) == ("failure", "array emulator is gone")
    assert [entry["answer"] for entry in found["stimuli"]] == ANSWERS[:1]


def test_misuse_leaves_no_report(path):
    for options, message in (
        (("--height", "3"), "height must lie in"),
        (("--duration", "61"), "duration must lie between 0 and 60"),
        (("--clock", "sundial"), "clock must be one of"),
    ):
        refused(MISUSED, message, "selftest", *options, "--report", path)
        assert not path.exists()
    path.write_text("precious")
    refused(MISUSED, "exists; --overwrite replaces it", "selftest", *FAST, "--report", path)
    assert path.read_text() == "precious"
    refused(MISUSED, "--overwrite means nothing without --report", "selftest", *FAST, "--overwrite")


@pytest.mark.exhaustive
def test_a_new_process_prints_json_and_nothing_else():
    words = [sys.executable, "-m", "palpate.render.cli", "selftest", "--emulate", "--clock", "virtual", "--json"]
    done = subprocess.run([*words, "--duration", "0.1"], check=True, capture_output=True, text=True)
    assert json.loads(done.stdout)["point_frames"] == 1000
