"""Kernels of playback on the command line: compiled while `render` and `demo` work, and told of by `play`."""

import json
import time

import pytest

from palpate.kernels import PLAYING_STAGES
from palpate.render.cli import render_command
from palpate.render.playback import file_playback
from palpate.render.runtime import kernel_compiling
from tests.cases.command_line import run


class Recorder:
    """Stands for `CompilingAhead`, and notes what is done with it."""

    events: list = []  # noqa: RUF012  # a fresh one for each test
    waiting: BaseException | None = None

    def __init__(self, stages):
        self.events.append(stages)

    def __enter__(self):
        self.events.append("begin")
        return self

    def __exit__(self, *given):
        self.events.append("end")

    def wait(self, report=None):
        self.events.append("wait")
        if self.waiting is not None:
            raise self.waiting


@pytest.fixture
def events(monkeypatch):
    monkeypatch.setattr(Recorder, "events", [])
    monkeypatch.setattr(render_command, "CompilingAhead", Recorder)
    return Recorder.events


def noting(events, name, function):
    def call(*given, **options):
        events.append(name)
        return function(*given, **options)

    return call


@pytest.fixture
def motion(tmp_path):
    path = tmp_path / "motion.csv"
    path.write_text("x,y,z,qx,qy,qz,qw\n0,0,0.2,0,0,0,1\n")
    return path


def test_render_compiles_while_it_records_and_waits_once_all_is_shown(events, motion, tmp_path, monkeypatch):
    monkeypatch.setattr(render_command, "record", noting(events, "record", render_command.record))
    monkeypatch.setattr(render_command.console, "show_values", lambda *given, **options: events.append("shown"))
    assert run("render", "cube", motion, "-o", tmp_path / "cube.h5", "--device", "cpu").exit_code == 0
    assert events == [PLAYING_STAGES, "begin", "record", "end", "shown", "wait"]


def test_ctrl_c_while_render_only_waits_for_a_compiler_leaves_its_result(events, motion, tmp_path, monkeypatch):
    monkeypatch.setattr(Recorder, "waiting", KeyboardInterrupt())
    result = run("render", "cube", motion, "-o", tmp_path / "cube.h5", "--device", "cpu", "--json")
    assert (result.exit_code, json.loads(result.stdout)["poses_rendered"]) == (0, 1)


def test_an_interrupted_render_waits_for_no_compiler(events, motion, tmp_path, monkeypatch):
    def interrupt(*given, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr(render_command, "record", interrupt)
    result = run("render", "cube", motion, "-o", tmp_path / "cube.h5", "--device", "cpu")
    assert (result.exit_code, events) == (1, [PLAYING_STAGES, "begin", "end"])
    assert "--resume goes on" in result.stderr


def test_a_warm_render_starts_no_process(motion, tmp_path, monkeypatch):
    monkeypatch.setattr(kernel_compiling, "uncompiled", lambda stages: ())
    monkeypatch.setattr(kernel_compiling.subprocess, "Popen", lambda *given, **options: pytest.fail("started"))
    assert run("render", "cube", motion, "-o", tmp_path / "cube.h5", "--device", "cpu").exit_code == 0


def test_demo_waits_for_all_kernels_before_it_plays(events, tmp_path, monkeypatch):
    for name in ("record", "draw_figure", "play_file"):
        monkeypatch.setattr(render_command, name, lambda *given, name=name, **options: events.append(name))
    run("demo", "-o", tmp_path, "--clock", "virtual")  # fails afterwards, as nothing was played
    expected = [PLAYING_STAGES, "begin", "record", "record", "draw_figure", "wait", "end", "play_file"]
    assert events[: len(expected)] == expected


def test_play_tells_of_the_compiler_before_it_begins_and_when_the_first_frame_came(motion, tmp_path, monkeypatch):
    path = tmp_path / "cube.h5"
    assert run("render", "cube", motion, "-o", path, "--device", "cpu").exit_code == 0
    monkeypatch.setattr(file_playback, "uncompiled", lambda stages: stages[:2])
    monkeypatch.setattr(file_playback, "compile_now", lambda stages: time.sleep(0.2))
    begun = time.perf_counter()
    result = run("play", path, "--duration", "0.01", "--clock", "virtual", "--json")
    taken = time.perf_counter() - begun
    first, second = result.stderr.splitlines()
    assert first == "compiling 2 modules of kernels that sample contours: some seconds, once on a machine"
    assert second.startswith(f"playing {path} to emulator, first frame after ")
    values = json.loads(result.stdout)
    assert 0.2 <= values["first_frame_seconds"] <= taken
    assert abs(values["first_frame_seconds"] - float(second.split(" after ")[1].split(" s;")[0])) < 0.15
