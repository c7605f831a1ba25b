"""Signals while the first hour is under way: the array is off, the report is kept."""

import os
import signal

import pytest
from acceptance_script import Emulated, answers_of, shorten, spend_hour, steps_of

from palpate.render.selftest.frames import FeltStimulus

FAILED = 1
SIGNALS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]


@pytest.fixture(autouse=True)
def _hangup_ends():
    """Whatever runs the tests, such as nohup, may ignore SIGHUP."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.fixture
def emulated(monkeypatch):
    """The emulated buses of a run, kept to look at their boards afterwards."""
    emulated = Emulated(monkeypatch)
    monkeypatch.setattr("acceptance_script.Emulated", lambda *_, **__: emulated)
    return emulated


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize(
    ("step", "signum", "array"),
    [
        ("stopping", signal.SIGINT, "pat16"),
        ("corner-y", signal.SIGTERM, "emulator"),
        ("replug", signal.SIGHUP, "sonicsurface"),
    ],
)
def test_a_signal_in_the_middle_of_a_step(step, signum, array, capsys, monkeypatch, tmp_path, emulated):
    """It comes while the step's frames are taken; the board's own model says whether it emits, 10 s later."""
    shorten(monkeypatch, 3000)
    before, answers = steps_of(array).index(step), answers_of(array)
    whole, asked = FeltStimulus.blocks, []

    def blocks(self, model):
        for number, block in enumerate(whole(self, model)):
            if number == 2 and len(asked) == before:
                os.kill(os.getpid(), signum)
            yield block

    monkeypatch.setattr(FeltStimulus, "blocks", blocks)
    done = spend_hour(capsys, monkeypatch, tmp_path / "r.json", answers, array=array, look=asked.append)
    assert done.code == FAILED
    assert (done.report["ended_by"], done.report["steps"][-1]["step"]) == (signum.name, step)
    assert [entry["answer"] for entry in done.report["steps"]] == [*answers[:before], None]
    last = done.report["steps"][-1]["played"][-1]
    assert (last["report"]["stopped_by"], last["report"]["off_sent"]) == (signum.name, True)
    emulated.bus.clock.advance(10.0)
    assert not emulated.bus.board().emitting
    assert {signal.getsignal(one) for one in SIGNALS} == {signal.SIG_IGN}  # the process ends: a second one is too late


def test_a_signal_while_an_answer_is_awaited(capsys, monkeypatch, tmp_path, emulated):
    shorten(monkeypatch, 200)

    def look(number):
        if number == 5:
            os.kill(os.getpid(), signal.SIGTERM)

    done = spend_hour(capsys, monkeypatch, tmp_path / "r.json", answers_of("pat16"), look=look)
    assert (done.code, done.report["ended_by"], done.result["error"]) == (FAILED, "SIGTERM", "interrupted")
    assert [entry["answer"] for entry in done.report["steps"]] == [*answers_of("pat16")[:5], None]
    assert done.step("turn")["played"][0]["report"]["off_sent"]
    emulated.bus.clock.advance(10.0)
    assert not emulated.bus.board().emitting
