"""The first hour with a board, by scripted answers to emulated ones: what is asked, recorded, and how it may end."""

import json
import subprocess
import sys

import pytest
from acceptance_script import EXPECTED, Emulated, answers_of, shorten, spend_hour, steps_of
from injected_faults import Fault, FaultKind, inject
from typer.testing import CliRunner
from umockdev_session import write_pat_file

from palpate.device.clock import VirtualClock
from palpate.device.registry import array_model, emulated_backend
from palpate.render.cli.app import app
from palpate.render.playback.file_playback import Connection
from palpate.render.playback.placed_arrays import PlacedArray
from palpate.render.selftest.board import BoardSession
from palpate.render.selftest.steps import STEPS

DONE, FAILED, MISUSED = 0, 1, 2


@pytest.fixture
def path(tmp_path):
    return tmp_path / "report.json"


@pytest.fixture
def hour(capsys, monkeypatch, path):
    """Runs an hour of few frames with scripted lines."""

    def spend(lines, **options):
        shorten(monkeypatch, 200)
        return spend_hour(capsys, monkeypatch, path, lines, **options)

    return spend


@pytest.mark.exhaustive
def test_a_whole_hour_of_expected_answers_exits_0_and_records_everything(capsys, monkeypatch, path):
    done = spend_hour(capsys, monkeypatch, path, answers_of("pat16"))
    assert done.code == DONE
    report = done.report
    assert (report["array"], report["serial"], report["emulated"]) == ("pat16", "PATEMU01", True)
    assert (report["clock"], report["ended_by"], report["failure"]) == ("virtual", "end", None)
    assert {"python", "palpate", "numpy", "pyusb"} <= report["versions"].keys()
    assert report["date"][:2] == "20"
    assert {entry["step"]: entry["answer"] for entry in report["steps"]} == EXPECTED
    assert all(entry["as_expected"] for entry in report["steps"])
    minute = done.step("minute")["played"][0]
    assert minute["report"]["frames"] == 600_000  # 10 kHz for 60 s
    assert minute["report"]["duration"] == pytest.approx(60.0)
    assert minute["report"]["underruns"] == 0
    assert done.step("fast")["played"][0]["parameters"]["update_rate"] == pytest.approx(40_000 / 3)
    assert [entry["parameters"]["divider"] for entry in done.step("divider")["played"]] == [None, 45]
    assert "gone" in done.step("unplug")["played"][0]["error"]
    assert done.step("replug")["played"][0]["report"]["frames"] == 60_000  # 10 kHz for 6 s
    assert done.step("silent")["played"] == []
    assert done.result["answered"] == done.result["steps"] == 14


def test_the_report_names_the_board_file_and_its_digest(hour, tmp_path):
    """The digest is that of `sha256sum`, of coreutils; the folder, which may name a person, is left out."""
    folder = tmp_path / "somebody"
    folder.mkdir()
    board = folder / "board.pat"
    write_pat_file(board, serial="FT4TKZL8")
    digest = subprocess.run(["sha256sum", str(board)], capture_output=True, text=True, check=True).stdout.split()[0]
    done = hour(answers_of("pat16"), calibration=board)
    assert done.report["calibration"] == {"calibrated": True, "file": "board.pat", "sha256": digest}
    assert done.report["serial"] == "FT4TKZL8"
    assert "somebody" not in json.dumps(done.report)


def test_a_wrong_answer_is_told_with_its_meaning(hour):
    """The meaning and the change are those that the page has (`test_page.py`)."""
    step = next(step for step in STEPS if step.name == "corner-x")
    answer = next(answer for answer in step.answers if answer.key != EXPECTED[step.name])
    done = hour(answers_of("pat16", **{step.name.replace("-", "_"): answer.key}))
    assert done.code == FAILED
    assert {entry["step"]: entry["answer"] for entry in done.report["steps"]} == EXPECTED | {step.name: answer.key}
    assert [entry["step"] for entry in done.report["steps"] if not entry["as_expected"]] == [step.name]
    assert [finding["step"] for finding in done.result["unexpected"]] == [step.name]
    assert done.result["unexpected"][0]["meaning"] == answer.meaning
    assert f"{step.name}: {answer.sentence} {answer.meaning} Change: {answer.change}" in done.shown
    assert done.report["ended_by"] == "end"


def test_a_step_is_skipped_with_its_reason(hour):
    answers = answers_of("pat16")
    place = steps_of("pat16").index("pitch")
    done = hour([*answers[:place], "S  no tuner at hand ", *answers[place + 1 :]])
    assert done.code == FAILED
    entry = done.step("pitch")
    assert (entry["answer"], entry["as_expected"]) == (None, None)
    assert entry["skipped_because"] == "no tuner at hand"
    assert done.result["skipped"] == {"pitch": "no tuner at hand"}
    assert done.result["not_asked"] == done.result["unexpected"] == []
    assert done.step("replug")["answer"] == "again"


def test_the_end_of_input_ends_it_with_a_clear_message(hour):
    count = 7
    done = hour(answers_of("pat16")[:count])
    assert (done.code, done.report["ended_by"]) == (FAILED, "end of input")
    name = steps_of("pat16")[count]
    assert done.result["error"] == f"the input ended before step {name!r} was answered"
    assert [entry["answer"] for entry in done.report["steps"]] == [*answers_of("pat16")[:count], None]
    assert f"Answers in the report: {count} (" in done.shown


def test_a_person_is_asked_again_and_waited_for_before_each_step_that_plays(hour):
    answers = answers_of("pat16")
    lines = [answers[0]]  # step silent plays nothing
    for line in answers[1:]:
        lines += ["", line]
    lines[1:3] = ["corner", "", "left", "CORNER"]  # an answer too early, Enter, no answer, and one in capitals
    done = hour(lines, is_person=True)
    assert done.code == DONE, done.shown
    assert "Nothing was played yet" in done.shown
    assert "Please one of corner, scattered, none" in done.shown
    assert len(done.step("corner")["played"]) == 1


def test_the_report_is_whole_after_each_step(hour, path):
    """Looked at whenever an answer is asked for: valid JSON, with all answers before that one."""
    seen = []

    def look(number):
        seen.append([entry["answer"] for entry in json.loads(path.read_text())["steps"]])
        assert [p.name for p in path.parent.iterdir()] == [path.name]

    answers = answers_of("pat16")
    done = hour(answers, look=look)
    assert seen == [answers[:count] for count in range(len(answers))]
    stopped = done.step("stopping")["played"][0]
    assert stopped["report"]["stopped_by"] == "stop"
    assert stopped["stopped_within"] < 0.1


def test_a_report_that_exists_is_refused_unless_it_may_be_overwritten(hour, path):
    path.write_text("precious")
    done = run(path, "--emulate", "--clock", "virtual")
    assert done.exit_code == MISUSED
    assert "exists; --overwrite replaces it" in done.stderr
    assert path.read_text() == "precious"
    assert hour(answers_of("pat16"), overwrite=True).code == DONE


def run(path, *arguments, array="pat16", lines=()):
    words = ["selftest", "--acceptance", str(path), "--array", array, *arguments]
    return CliRunner().invoke(app, words, input="\n".join(lines), catch_exceptions=False)


def test_misuse_is_refused_and_leaves_no_report(path):
    for arguments, said in (
        (["--emulate", "--height", "0.3"], "--height means nothing with --acceptance"),
        (["--emulate", "--watchdog"], "a watchdog is for real arrays, not for"),
        (["--emulate", "--clock", "sundial"], "clock must be one of"),
        (["--calibration", "none.pat"], "none.pat"),
        ([], "--calibration BOARD.pat, --emulate or --uncalibrated"),
    ):
        done = run(path, *arguments)
        assert said in " ".join(done.stderr.split())
        assert not path.exists()
        assert done.exit_code == MISUSED


def test_an_array_that_fails_in_a_step_keeps_what_was_answered(capsys, monkeypatch, path):
    """A stall in the second stimulus; bytes by the boards' own count."""
    emulated = Emulated(monkeypatch)
    shorten(monkeypatch, 200)

    def look(number):
        if number == 2:
            board = emulated.buses[-1].board()
            inject(emulated.bus, Fault(FaultKind.STALL, byte=board.bytes_received + 60_000))

    monkeypatch.setattr("acceptance_script.Emulated", lambda *_, **__: emulated)
    done = spend_hour(capsys, monkeypatch, path, answers_of("pat16"), look=look)
    assert (done.code, done.report["ended_by"]) == (FAILED, "failure")
    assert [entry["answer"] for entry in done.report["steps"]] == [*answers_of("pat16")[:3], None]
    failed = done.step("corner-y")["played"][0]
    assert failed["error"] == done.report["failure"] == done.result["error"]
    assert failed["report"]["stopped_by"] == "device"


class WaitingClock(VirtualClock):
    """Does something once so much time has passed."""

    def __init__(self):
        super().__init__()
        self.due = []

    def sleep_until_ns(self, time_ns):
        super().sleep_until_ns(time_ns)
        for when, act in list(self.due):
            if self.now_ns() >= when:
                self.due.remove((when, act))
                act()


def test_a_person_has_time_to_plug_it_in_again(monkeypatch):
    """A bus that the session takes for a real one: somebody pulls the plug, and puts it back 100 s later."""
    shorten(monkeypatch, 5000)
    clock = WaitingClock()
    bus = emulated_backend("pat16", clock=clock)
    notes, log = [], []
    model = array_model("pat16")
    unplug, replug = (next(step for step in STEPS if step.name == name) for name in ("unplug", "replug"))
    with BoardSession(PlacedArray(model), Connection(backend=bus), notes.append) as session:
        clock.due.append((clock.now_ns() + 1_100_000_000, bus.unplug))
        session.play(unplug, log)
        assert "gone" in log[0]["error"]
        clock.due.append((clock.now_ns() + 100_000_000_000, bus.replug))
        session.play(replug, log)
    assert log[1]["report"]["frames"] == 5000
    assert not bus.board().emitting
    assert "It is found." in notes


@pytest.mark.exhaustive
def test_the_command_reads_answers_from_a_pipe_as_it_stands_in_the_page(path):
    """The page's own line, in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-P", "-c", "from palpate.render.cli.app import main; main()", "selftest", "--acceptance",
         str(path), "--array", "sonicsurface", "--emulate", "--clock", "virtual"],
        input="\n".join(answers_of("sonicsurface")), capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == DONE, done.stderr
    assert json.loads(path.read_text())["ended_by"] == "end"
