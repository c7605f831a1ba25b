"""Scripted hours with emulated boards: answers line by line, and what the boards played between two of them."""

import json
from dataclasses import dataclass, field

import numpy as np

from palpate.device.registry import emulated_backend
from palpate.render.playback import file_playback as playback
from palpate.render.selftest import frames as acceptance_frames
from palpate.render.selftest.acceptance import run_acceptance
from palpate.render.terminal import console

EXPECTED = {
    "silent": "silent", "corner": "corner", "corner-x": "near-right", "corner-y": "far-left", "focus": "right-near",
    "turn": "anticlockwise", "ending": "ended", "stopping": "ended", "pitch": "a4", "divider": "same",
    "fast": "steady", "minute": "steady", "unplug": "silent", "replug": "again",
}  # fmt: skip
"""What a board that is as it should be makes a person answer, by step."""
LEFT_OUT = {
    "emulator": {"fast"},
    "pat16": set(),
    "sonicsurface": {"pitch", "divider", "fast"},
    "autd3": {"fast", "unplug", "replug"},
}
"""Steps that make no sense for an array."""


def steps_of(array):
    return [name for name in EXPECTED if name not in LEFT_OUT[array]]


def answers_of(array, **others):
    """A line for each step, the expected answers but for those given, underscores for hyphens."""
    changed = {name.replace("_", "-"): line for name, line in others.items()}
    return [changed.get(name, EXPECTED[name]) for name in steps_of(array)]


class Script:
    """Standard input: lines, and somebody who looks on each time one is asked for."""

    def __init__(self, lines, look=lambda number: None, *, is_person=False):
        self._lines, self._look, self._is_person = list(lines), look, is_person
        self._asked = 0

    def isatty(self):
        return self._is_person

    def readline(self):
        self._look(self._asked)
        self._asked += 1
        return self._lines.pop(0) + "\n" if self._lines else ""


@dataclass
class Hour:
    """What an acceptance left."""

    code: int
    report: dict | None
    shown: str
    result: dict | str
    played: list = field(default_factory=list)
    """By question: frames that the board played since the one before, and when [ns]."""

    def step(self, name):
        return next(entry for entry in self.report["steps"] if entry["step"] == name)


class Emulated:
    """Makes the buses of a run, with boards that record, and keeps them."""

    def __init__(self, monkeypatch, *, record=0):
        self.buses = []
        self._record = record
        monkeypatch.setattr(playback, "emulated_backend", self._make)

    @property
    def bus(self):
        return self.buses[-1]

    def _make(self, name, **options):
        self.buses.append(emulated_backend(name, record=self._record, **options))
        return self.buses[-1]


def shorten(monkeypatch, most):
    """Play at most so many frames of each stimulus."""
    stimulus = acceptance_frames.FeltStimulus
    whole = stimulus.frame_count
    monkeypatch.setattr(stimulus, "frame_count", lambda self, model: min(whole(self, model), most))


def spend_hour(capsys, monkeypatch, path, lines, *, array="pat16", record=0, look=None, is_person=False, **options):
    """Run the acceptance of an emulated array with scripted answers."""
    emulated = Emulated(monkeypatch, record=record)
    played, seen = [], {"board": None, "count": 0}

    def note(number):
        if record:
            board = emulated.bus.board()
            if board is not seen["board"]:
                seen.update(board=board, count=0)
            new = board.frames_played - seen["count"]
            seen["count"] += new
            cut = slice(len(board.played) - new, None)
            played.append((board.played[cut].copy(), board.played_ns[cut].copy()))
        if look is not None:
            look(number)

    script = Script(lines, note, is_person=is_person)
    monkeypatch.setattr("sys.stdin", script)
    given = {
        "acceptance": path, "overwrite": False, "array": array, "serial": None, "calibration": None, "baud": None,
        "emulate": True, "clock": "virtual", "watchdog": False, "uncalibrated": False, "height": None, "duration": None,
    }  # fmt: skip
    as_json = options.pop("as_json", True)
    code = console.run(lambda: run_acceptance(given | options, as_json=as_json), as_json=as_json)
    out, shown = capsys.readouterr()
    report = json.loads(path.read_text()) if path.is_file() else None
    return Hour(code, report, shown, json.loads(out) if as_json else out, played)


def emitting(drive):
    """Places [mm] that emit in a decoded frame."""
    return {place for place, (_, level) in drive.items() if level > 0.01}


def tone(level, time_ns):
    """Frequency [Hz] of the strongest component of a series of pressure amplitudes' squares, 0 if it is steady.

    Amplitudes hold until the next: they are read every 10 us of the board's own time. The resolution is 1 / duration.
    """
    step = 10_000
    when = np.arange(time_ns[0], time_ns[-1], step)
    held = np.asarray(level)[np.searchsorted(time_ns, when, side="right") - 1] ** 2
    spectrum = np.abs(np.fft.rfft((held - held.mean()) * np.hanning(len(held))))
    spectrum[np.fft.rfftfreq(len(held), step * 1e-9) > 10_000] = 0
    if spectrum.max() < 1e-3 * len(held):
        return 0.0
    return float(np.fft.rfftfreq(len(held), step * 1e-9)[spectrum.argmax()])
