"""`palpate play`: what it says of lateness and of what it cannot know, and how signals and a closed pipe end it."""

import json
import os
import random
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
from command_line import run
from typer.testing import CliRunner

from palpate.datasets import HandMotion
from palpate.datasets.contour_file.reader import ContourFile
from palpate.datasets.focus_files.ptlist import write_ptlist
from palpate.render import MeshObject, Palm, closed_contour, exploration, record, render
from palpate.render.cli.app import app
from palpate.render.cli.play_commands import _too_fast
from palpate.render.playback import file_playback
from palpate.render.playback import focal_points as source_module
from palpate.render.sampling.strategy import SamplingStrategy

STORM = int(os.environ.get("PALPATE_STORM", "12"))  # 240 were run for docs/develop/tiers.md


@pytest.fixture(scope="module")
def moving(tmp_path_factory):
    tube = MeshObject.load("tube")
    whole = exploration(tube.bounds, duration=6.0, rate=90.0, seed=3)
    path = tmp_path_factory.mktemp("moving") / "tube.h5"
    record(path, tube, Palm(), HandMotion(whole.time[:90] - whole.time[0], whole.pose[:90]), closed_contour())
    return path


@pytest.fixture(scope="module")
def still(tmp_path_factory):
    tube = MeshObject.load("tube")
    motion = exploration(tube.bounds, duration=6.0, rate=90.0, seed=3)
    pose = motion.pose[[int(np.argmax(render(tube, Palm(), motion, closed_contour()).length()))]]
    path = tmp_path_factory.mktemp("still") / "still.h5"
    record(path, tube, Palm(), HandMotion(None, pose), closed_contour())
    return path


def play(*arguments):
    return CliRunner(env={"COLUMNS": "400"}).invoke(app, ["play", *map(str, arguments)])


@pytest.fixture
def slow(monkeypatch):
    """A disk that takes two seconds for a read in the middle: longer than what is queued by then."""
    slept, contours = [], ContourFile.contours

    def slowly(file, first, stop):
        if first > file.pose_count // 2 and not slept:
            slept.append(first)
            time.sleep(2.0)
        return contours(file, first, stop)

    monkeypatch.setattr(source_module, "POINTS_A_READ", 20)
    monkeypatch.setattr(ContourFile, "contours", slowly)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("options", "begin", "own"),
    [
        (("emulator",), "warning: array emulator ran out of frames", "by the board's own count"),
        (("pat16", "--emulate"), "note: this machine was busy, so the model waited", "--clock virtual plays to it"),
    ],
)
def test_a_playback_that_starved_says_so_in_its_last_line(options, begin, own, moving, slow):
    done = play(moving, "--array", *options)
    assert done.exit_code == 0
    last = done.stderr.strip().splitlines()[-1]
    assert last.startswith(begin)
    assert own in last
    assert ("warning" in done.stderr) == begin.startswith("warning")


@pytest.mark.exhaustive
@pytest.mark.parametrize("options", [("emulator",), ("pat16", "--emulate")])
def test_strict_fails_where_frames_were_late_and_json_says_why(options, moving, slow):
    strict = play(moving, "--array", *options, "--strict", "--json")
    assert strict.exit_code == 1
    told = json.loads(strict.stdout)
    assert told["underruns"] > 0
    assert told["starved"] > 0.5
    assert len(told["warnings"]) == 1


def test_a_rate_that_a_pat16_cannot_keep_up_is_refused_as_misuse_before_anything_is_played(still):
    options = ("--array", "pat16", "--emulate", "--clock", "virtual", "--duration", "0.1", "--update-rate", "20000")
    done = play(still, *options)
    assert done.exit_code != 0
    (line,) = [line for line in done.stderr.splitlines() if "playing" not in line]
    assert line.startswith("error: array pat16 cannot keep up 20000 Hz (divider 2): beyond 28 frames")
    assert "played until then" not in done.stderr
    refused = json.loads(play(still, *options, "--json").stdout)
    assert "report" not in refused


def test_am_at_200_hz_plays_on_a_sonicsurface(still):
    done = play(
        still,
        "--array",
        "sonicsurface",
        "--emulate",
        "--clock",
        "virtual",
        "--duration",
        "0.1",
        "--sampling",
        "am",
        "--strict",
        "--json",
    )
    assert done.exit_code == 0
    values = json.loads(done.stdout)
    assert (values["update_rate"], values["frames"], values["off_sent"]) == (23_040, 2304, True)
    assert values["duty"] == pytest.approx(0.5, abs=0.05)


def test_a_point_list_is_played_and_prepared(tmp_path):
    """Files of DOLPHIN, which no other command takes for contours."""
    path = tmp_path / "two.PTLIST"
    write_ptlist(path, [[0, 0, 0.2], [0.01, 0, 0.2]], [1, 0.5], update_rate=10_000)
    played = play(path, "--clock", "virtual", "--json")
    assert json.loads(played.stdout)["frames"] == 2
    prepared = CliRunner().invoke(app, ["prepare", str(path), "-o", str(tmp_path / "frames.h5"), "--json"])
    assert json.loads(prepared.stdout)["frames"] == 2


@pytest.mark.parametrize("rate", [230_400 / 10 / 258, 145_000 / 10 / 258, 1399.0, 2.0])
def test_the_speed_that_a_warning_asks_for_is_not_warned_of_again(rate):
    fast = SamplingStrategy(update_rate=rate)
    (asked,) = re.findall(r"--speed ([\d.]+) or less", _too_fast(fast))
    assert fast.step > 5e-3 >= replace(fast, speed=float(asked)).step > 4e-3


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize(("array", "known"), [("emulator", True), ("pat16", False), ("sonicsurface", False)])
def test_what_a_board_cannot_say_is_not_known_and_null(array, known, moving):
    options = ("--array", array, "--emulate", "--clock", "virtual")
    table = play(moving, *options)
    *lines, meaning = table.stdout.splitlines()[1:]
    rows = dict(re.split(r"\s{2,}", line.strip(), maxsplit=1) for line in lines)
    told = json.loads(play(moving, *options, "--json").stdout)
    for name in ("off_confirmed", "may_emit", "board_underruns"):
        assert (rows[name.replace("_", " ")] == "not known") != known
        assert (told[name] is None) != known
    assert f"{told['frames']} frames in {told['duration']:.3g} s, none of them late" in meaning
    assert f"each contour was drawn {told['draw_frequency']:.0f} times a second on average" in meaning
    assert told["off_sent"] is True
    assert (told["off_doubt"] is None) == known
    assert known or "never answers: it is off if no byte was lost" in rows["off doubt"]


PLAYS = """
import atexit, sys, time
from palpate.render.playback import file_playback as playback
from palpate.render.cli.app import main

emulated_bus = playback.emulated_bus

def opened(placed, clock):
    bus = emulated_bus(placed, clock)
    def last_word():
        time.sleep(0.05)
        print("ON" if bus.board().emitting else "OFF", bus.board().frames_played, flush=True)
    atexit.register(last_word)
    print("opened", flush=True)
    return bus

playback.emulated_bus = opened
sys.argv[0] = "palpate"
main()
"""


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", range(STORM))
def test_in_a_storm_of_signals_a_pat16_ends_off_and_the_command_with_1_and_one_sentence(seed, still):
    chance = random.Random(seed)
    command = [sys.executable, "-c", PLAYS, "play", str(still), "--array", "pat16", "--emulate", "--duration", "60"]
    child = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    signals = chance.choices([signal.SIGINT, signal.SIGTERM, signal.SIGHUP], k=chance.choice([1, 2, 2, 3]))
    try:
        assert child.stdout.readline() == "opened\n"
        for signum in signals:
            time.sleep(chance.uniform(0, 2.5) if signum is signals[0] else chance.expovariate(8))
            child.send_signal(signum)
        out, err = child.communicate(timeout=60)
    finally:
        child.kill()
        child.wait()
    assert out.split()[0] == "OFF", (signals, out, err)
    assert child.returncode == 1, (signals, out, err)
    assert err.count("error:") == 1, err
    assert "Traceback" not in err
    assert "Exception ignored" not in err


def test_play_tells_of_the_compiler_before_it_begins_and_when_the_first_frame_came(tmp_path, monkeypatch):
    motion = tmp_path / "motion.csv"
    motion.write_text("x,y,z,qx,qy,qz,qw\n0,0,0.2,0,0,0,1\n")
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
