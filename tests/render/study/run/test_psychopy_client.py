"""The documents' PsychoPy client runs a participant; PsychoPy is a stand-in with the functions of version 2026.2.5."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from palpate.render.study.plan.study_plan import Question
from palpate.render.study.run.desk import KeyChoice, StudyDesk
from palpate.render.study.run.event_stream import EventStream

CLIENT = Path(__file__).parents[4] / "docs" / "how-to" / "psychopy_client.py"
FAKE = {  # names, parameters and results as PsychoPy 2026.2.5 has them, written for this test
    "core.py": """
import sys, time
_base = time.perf_counter()
class MonotonicClock:
    def __init__(self): self._last = time.perf_counter()
    def getTime(self): return time.perf_counter() - self._last
    def getLastResetTime(self): return self._last
class Clock(MonotonicClock):
    def reset(self, newT=0.0): self._last = time.perf_counter() + newT
monotonicClock = MonotonicClock()
def getTime(applyZero=True): return monotonicClock.getTime()
def quit(): sys.exit(0)
""",
    "event.py": """
from . import core
_buffer = []
def clearEvents(eventType=None): _buffer.clear()
def getKeys(keyList=None, modifiers=False, timeStamped=False):
    taken = [key for key in _buffer if keyList is None or key[0] in keyList]
    _buffer[:] = [key for key in _buffer if key not in taken]
    if timeStamped is False: return [name for name, _ in taken]
    offset = 0 if timeStamped is True else timeStamped.getLastResetTime() - core.monotonicClock.getLastResetTime()
    return [[name, at - offset] for name, at in taken]
""",
    "visual.py": """
import json, os, time
from . import core, event
_script = json.loads(os.environ["SCRIPT"])
_drawn, _pressed_at, _keys = [], None, []
class TextStim:
    def __init__(self, win, text="Hello World", *, wrapWidth=None, height=None, autoDraw=False):
        self.text, self.autoDraw = text, autoDraw
        win.stims.append(self)
    def draw(self, win=None): _drawn.append(self.text)
class Window:
    def __init__(self, size=(800, 600), *, fullscr=None): self.stims, self.calls = [], []
    def callOnFlip(self, function, *args, **kwargs): self.calls.append((function, args, kwargs))
    def flip(self, clearBuffer=True):
        global _pressed_at, _keys
        for stim in self.stims:
            if stim.autoDraw: stim.draw()
        time.sleep(0.002)
        for function, args, kwargs in self.calls: function(*args, **kwargs)
        self.calls.clear()
        with open("drawn.txt", "a") as file:
            file.write("".join(json.dumps(text) + "\\n" for text in _drawn))
        if _pressed_at is None and _script and _script[0][0] in _drawn[-1]:
            _keys, _pressed_at = _script.pop(0)[1], time.perf_counter() + 0.03
        elif _pressed_at is not None and time.perf_counter() > _pressed_at:
            event._buffer += [(key, core.getTime()) for key in _keys]
            _pressed_at = None
        _drawn.clear()
""",
}
SPACE = (KeyChoice(key=" ", label="Go on"),)
ARROWS = (KeyChoice(key="ArrowLeft", label="First", value=0), KeyChoice(key="ArrowRight", label="Second", value=1))
DENSER = Question(name="denser", text="Which one?", kind="choice", options=("First", "Second"))
SIZE = Question(name="size", text="How large?", kind="number", low=0, high=100)
WHY = Question(name="why", text="Why?", kind="text")
SCRIPT = [
    ("Welcome", ["x", "space"]),
    ("Which one?", ["left"]),
    ("How large?", ["1", "lshift", "2", "3", "return"]),
    ("size must be from 0 to 100, not 123", ["7", "8", "backspace", "period", "5", "return"]),
    ("Why?", ["a", "space", "minus", "b", "return"]),
]


@pytest.fixture
def psychopy(tmp_path):
    folder = tmp_path / "fake" / "psychopy"
    folder.mkdir(parents=True)
    (folder / "__init__.py").touch()
    for name, text in FAKE.items():
        (folder / name).write_text(text)
    return folder.parent


def test_a_participant_reads_and_answers_in_a_psychopy_window(tmp_path, psychopy):
    desk, onset = StudyDesk(), time.monotonic() - 0.125
    with EventStream(desk, port=None, token="a-token") as stream:
        desk.show("text", "Welcome", hint="Press the space bar.", keys=SPACE)
        environment = {**os.environ, "PYTHONPATH": str(psychopy), "SCRIPT": json.dumps(SCRIPT)}
        words = [sys.executable, "-S", str(CLIENT), str(stream.port), "a-token"]
        client = subprocess.Popen(words, cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True)
        try:
            end = time.monotonic() + 10
            while not desk.has_page and time.monotonic() < end:
                desk.await_change(0.1)
            answers = [desk.await_response(10)]
            stream.send("stimulus_onset", array_time=onset, stimulus="cc")
            for fields in (
                {"text": "Which one?", "keys": ARROWS, "question": DENSER},
                {"text": "How large?", "question": SIZE},
                {"text": "Why?", "question": WHY},
            ):
                desk.show("question", **fields)
                answers.append(desk.await_response(10))
            desk.show("ended", "Thank you")
            stream.close()
            _, errors = client.communicate(timeout=10)
        finally:
            client.kill()
            client.wait()
    assert (client.returncode, errors) == (0, "")
    assert [(answer.value, answer.key) for answer in answers] == [
        (None, " "), (0, "ArrowLeft"), (7.5, "Enter"), ("a -b", "Enter")
    ]  # fmt: skip
    assert all(0.03 <= answer.seconds < 1 for answer in answers)  # from the flip that showed the screen
    assert desk.extra_presses == 0
    assert not desk.has_page
    drawn = [json.loads(line) for line in (tmp_path / "drawn.txt").read_text().splitlines()]
    assert "Which one?\n\n← First     → Second\n\n\n\n" in drawn
    lines = [json.loads(line) for line in (tmp_path / "events.jsonl").read_text().splitlines()]
    kinds = [line["event"] for line in lines]
    assert kinds.count("reply") == 5
    assert kinds.count("error") == 1
    (told,) = [line for line in lines if line["event"] == "stimulus_onset"]
    assert (told["stimulus"], told["array_time"]) == ("cc", onset)
    # Each line's difference of both clocks is the same: PsychoPy's clock began at one moment.
    starts = [line["array_time"] - line["psychopy_time"] for line in lines]
    assert max(starts) - min(starts) < 1e-3
    assert onset < starts[0] < time.monotonic()


def test_the_client_has_thirty_lines_and_stands_in_its_page():
    text = CLIENT.read_text()
    lines = [
        line for line in text.partition('"""\n')[2].splitlines() if line.strip() and not line.strip().startswith("#")
    ]
    assert len(lines) <= 30
    page = CLIENT.with_name("psychopy.md").read_text()
    assert f'```python title="psychopy_client.py"\n{text}```' in page
