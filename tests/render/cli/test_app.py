"""The command line: the main job, JSON, exit codes, and one clear sentence for every mistake."""

import contextlib
import json
import math
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
import trimesh
from command_line import FAILED, MISUSED, PALPATE, answer, refused, run
from contour_cases import redigest
from injected_faults import Fault, FaultKind, inject

from palpate.datasets import ContourFile, HandMotion, check_file, static_pose
from palpate.datasets.contour_file.blocks import block_files, work_folder
from palpate.device import EmulatorBackend, open_link
from palpate.device.clock import VirtualClock
from palpate.render import record
from palpate.render.cli import info_command, render_command
from palpate.render.playback import file_playback as playback


@pytest.fixture(scope="module")
def motion(tmp_path_factory):
    """A CSV of a palm that sinks through the objects in one second."""
    path = tmp_path_factory.mktemp("motion") / "sink.csv"
    z = np.linspace(0.3, 0.1, 91)
    pose = np.column_stack([0 * z, 0 * z, z, np.tile(static_pose([0, 0, 0.2]).pose[0, 3:], (91, 1))])
    HandMotion(np.arange(91) / 90.0, pose).save(path)
    return path


@pytest.fixture(scope="module")
def rendered(motion, tmp_path_factory):
    path = tmp_path_factory.mktemp("rendered") / "tube.h5"
    assert run("render", "tube", motion, "-o", path).exit_code == 0
    return path


@pytest.mark.exhaustive
def test_demo_runs_the_main_job_again_and_again(tmp_path):
    words = ("demo", "--out", tmp_path / "demo", "--clock", "virtual")
    answer(*words)
    refused(MISUSED, "--overwrite", *words)  # the folder is not the demonstration's own
    told = answer(*words, "--overwrite")
    assert told["poses"] == 2700
    assert told["frames"] == 300_000
    assert told["board_underruns"] == 0
    assert told["off_confirmed"] is True
    assert told["r"] > 1
    for name in ("motion", "open_contours", "closed_contours", "picture"):
        assert Path(told[name]).stat().st_size > 1000
    assert check_file(told["open_contours"]) == []
    assert answer("info", told["closed_contours"])["r"] == pytest.approx(told["r"])


def test_info_tells_what_design_promises(rendered):
    told = answer("info", rendered)
    assert told["poses"] == 91
    assert {"polylines", "points", "length_mean", "strategy", "r"} <= told.keys()
    assert told["duration"] == pytest.approx(91 / 90)
    assert told["strategy"] == {"raw": "section", "prune": ["outside"], "transform": ["close"]}


def test_options_of_rendering_reach_it_in_its_units(tmp_path, monkeypatch):
    """Megabytes become bytes; without any contour, --strict fails."""
    static_pose([0, 0, 0.9]).save(tmp_path / "far.csv")
    given, words = {}, ("render", "cube", tmp_path / "far.csv", "-o", tmp_path / "far.h5")

    def watched(*arguments, **options):
        given.update(options)
        return record(*arguments, **options)

    monkeypatch.setattr(render_command, "record", watched)
    assert run(*words, "--memory", "8", "--gzip", "3").exit_code == 0
    assert (given["memory"], given["gzip"], given["mode"]) == (8_000_000, 3, "create")
    assert run(*words, "--strict", "--overwrite").exit_code == FAILED
    assert given["mode"] == "overwrite"


def test_play_tells_what_design_promises(rendered):
    told = answer("play", rendered, "--clock", "virtual")
    assert told["frames"] == math.ceil(91 / 90 * 10_000)
    assert told["bytes"] == told["frames"] * 512
    assert (told["update_rate"], told["array"], told["clock"]) == (10_000, "emulator", "virtual")
    assert (told["underruns"], told["board_underruns"], told["off_confirmed"]) == (0, 0, True)
    assert told["duration"] == pytest.approx(91 / 90, abs=1e-3)
    assert told["jumps"] == sum(told["jumps_by_cause"].values())


def test_devices_lists_the_emulated_array_without_libusb_too():
    told = answer("devices")
    emulated = {entry["array"] for entry in told["devices"] if entry["where"] == "emulated"}
    assert emulated == {"emulator", "pat16", "sonicsurface", "autd3", "stratos"}
    assert 'ATTR{idVendor}=="0403"' in told["udev_rules"]["pat16"]


def test_r_is_null_where_nothing_of_the_object_is_drawn(motion, tmp_path):
    """A palm that stays inside the cube: closed contours, no open ones; poses outside count with length 0."""
    told = answer("render", "cube", motion, "-o", tmp_path / "inside.h5")
    assert told["poses_drawn"] < told["poses"]
    assert told["length_object_mean"] == 0
    assert told["r"] is None
    assert told["length_mean"] == pytest.approx(0.34 * told["poses_drawn"] / told["poses"], abs=1e-6)


def test_r_is_a_ratio_of_means_over_all_poses_not_a_mean_of_ratios(tmp_path):
    told = answer("render", "cube", "exploration", "-o", tmp_path / "cube.h5", "--duration", "20")
    with ContourFile(tmp_path / "cube.h5") as file:
        metrics = file.metrics()
    whole, own = metrics["length"].astype(float), metrics["length_object"].astype(float)
    assert ((whole > 0) & (own == 0)).any()  # palms inside: their own ratio would be infinite
    assert told["r"] == pytest.approx(whole.mean() / own.mean(), rel=1e-6)


def test_check_exits_with_1_and_names_the_place(rendered, tmp_path):
    assert run("check", rendered).exit_code == 0
    broken = tmp_path / "broken.h5"
    broken.write_bytes(rendered.read_bytes())
    with h5py.File(broken, "r+") as file:
        file["/contours/points"][3] = np.nan
    result = run("check", broken)
    assert result.exit_code == FAILED
    assert "/contours/points" in result.stderr
    assert json.loads(run("check", broken, "--json").stdout)["whole"] is False


@pytest.mark.exhaustive
def test_existing_file_is_refused_overwritten_or_resumed(rendered, motion, tmp_path):
    path = tmp_path / "again.h5"
    path.write_bytes(rendered.read_bytes())
    refused(FAILED, "exists already", "render", "tube", motion, "-o", path)
    assert path.read_bytes() == rendered.read_bytes()
    assert answer("render", "tube", motion, "-o", path, "--resume")["poses_rendered"] == 0
    refused(FAILED, "strategy", "render", "tube", motion, "-o", path, "--resume", "--strategy", "oc")
    refused(FAILED, "object", "render", "cube", motion, "-o", path, "--resume")
    refused(FAILED, "hand", "render", "tube", motion, "-o", path, "--resume", "--palm", "0.05", "0.05")
    assert answer("render", "cube", motion, "-o", path, "--overwrite")["object"]["name"] == "cube"
    refused(MISUSED, "exclude each other", "render", "cube", motion, "-o", path, "--overwrite", "--resume")


def test_faults_of_its_own_are_one_sentence_too(rendered, monkeypatch):
    def broken(path):
        raise KeyError("planted")

    monkeypatch.setattr(info_command, "summarise", broken)
    refused(FAILED, "KeyError: 'planted' (unexpected; PALPATE_TRACEBACK=1 shows the traceback)", "info", rendered)
    monkeypatch.setenv("PALPATE_TRACEBACK", "1")
    with pytest.raises(KeyError, match="planted"):
        run("info", rendered)


def test_json_has_no_nan_even_where_a_file_has(rendered, tmp_path):
    path = tmp_path / "nan.h5"
    path.write_bytes(rendered.read_bytes())
    with h5py.File(path, "r+") as file:
        file["/motion/time"][-1] = np.nan
    redigest(path)
    told = json.loads(run("info", path, "--json").stdout, parse_constant=lambda word: pytest.fail(word))
    assert told["duration"] is None
    refused(FAILED, "/motion/time does not increase", "play", path, "--clock", "virtual")


def test_mesh_in_millimetres_is_warned_of_and_scaled(tmp_path):
    motion = tmp_path / "still.csv"
    static_pose([0, 0, 0.2]).save(motion)
    mesh = trimesh.creation.box([130, 130, 130])
    mesh.export(tmp_path / "mm.stl")
    result = run("render", tmp_path / "mm.stl", motion, "-o", tmp_path / "mm.h5", "--json")
    assert result.exit_code == 0
    assert "warning" in result.stderr
    assert "130 x 130 x 130 m" in result.stderr
    placed = ("--scale", "0.001", "--at", "0", "0", "0.2")
    told = answer("render", tmp_path / "mm.stl", motion, "-o", tmp_path / "m.h5", *placed)
    assert told["length_mean"] > 0.05
    assert told["object"]["placement"]["scale"] == 0.001


@pytest.mark.exhaustive
def test_static_pose_needs_a_duration(tmp_path):
    static_pose([0, 0, 0.2]).save(tmp_path / "still.csv")
    path = tmp_path / "still.h5"
    assert answer("render", "tube", tmp_path / "still.csv", "-o", path)["duration"] is None
    refused(MISUSED, "--duration", "play", path, "--clock", "virtual")
    refused(MISUSED, "over 1e+12 frames", "play", path, "--clock", "virtual", "--duration", "1e300")
    refused(MISUSED, "not one frame", "play", path, "--clock", "virtual", "--duration", "1e-11")
    refused(MISUSED, "duration must be positive", "play", path, "--clock", "virtual", "--duration", "-1")
    told = answer("play", path, "--clock", "virtual", "--duration", "0.3")
    assert told["frames"] == 3000
    assert told["silent"] == 0


@pytest.mark.exhaustive
def test_files_that_are_not_contours_are_refused(rendered, tmp_path):
    foreign, cut, text = tmp_path / "foreign.h5", tmp_path / "cut.h5", tmp_path / "text.h5"
    with h5py.File(foreign, "w") as file:
        file["x"] = [1]
    cut.write_bytes(rendered.read_bytes()[:5000])
    text.write_text("hello")
    for path in (foreign, cut, text):
        assert run("check", path).exit_code == FAILED
        assert path.name in run("info", path).stderr
    refused(FAILED, cut.name, "play", cut)
    for command in ("info", "play", "check"):
        refused(MISUSED, "missing.h5 does not exist", command, tmp_path / "missing.h5")


def test_array_that_disappears_ends_the_playback_with_its_report(rendered, monkeypatch):
    bus = EmulatorBackend(clock=VirtualClock())
    inject(bus, Fault(FaultKind.UNPLUG, byte=1_000_000))
    monkeypatch.setattr(playback, "emulated_backend", lambda name, **options: bus)
    before = rendered.read_bytes()
    result = run("play", rendered, "--clock", "virtual", "--json")
    assert result.exit_code == FAILED
    told = json.loads(result.stdout)
    assert "gone" in told["error"]
    assert 0 < told["report"]["frames"] < 9000
    assert told["report"]["off_confirmed"] is False
    assert rendered.read_bytes() == before
    bus.replug()
    assert run("play", rendered, "--clock", "virtual").exit_code == 0


def test_second_player_on_the_same_array_is_refused(rendered, monkeypatch):
    from palpate.device.registry import array_model

    bus = EmulatorBackend(clock=VirtualClock())
    monkeypatch.setattr(playback, "emulated_backend", lambda name, **options: bus)
    with open_link(array_model("emulator"), backend=bus):
        refused(FAILED, "in use", "play", rendered, "--clock", "virtual")


@pytest.mark.exhaustive
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_switches_the_array_off(number, tmp_path):
    long = tmp_path / "long.h5"
    assert run("render", "tube", "exploration", "-o", long, "--duration", "30").exit_code == 0
    command = [*PALPATE, "play", str(long), "--json"]
    process = subprocess.Popen(command, stdout=-1, stderr=-1, text=True)
    assert process.stderr.readline().startswith("playing")
    process.send_signal(number)
    out, err = process.communicate(timeout=60)
    assert "Traceback" not in err
    assert process.returncode == FAILED
    told = json.loads(out)
    assert number.name in told["error"]
    assert told["report"]["off_confirmed"] is True


COMMITTING_AT_ONCE = """
from palpate.datasets.contour_file import writer
from palpate.render.cli.app import main

writer.COMMIT_SECONDS = 0.5
main()
"""


def rendering(path, *more):
    command = ["render", "tube", "exploration", "-o", str(path), "--duration", "5000", "--memory", "8", *more]
    return [sys.executable, "-c", COMMITTING_AT_ONCE, *command, "--json"]


def wait_for_commits(process, path, count):
    """Until so many blocks of poses are committed, or the process has ended."""
    while process.poll() is None:
        with contextlib.suppress(FileNotFoundError):
            if len(block_files(work_folder(path))) >= count:
                return
        time.sleep(0.005)


@pytest.mark.exhaustive
def test_interrupted_rendering_says_how_to_go_on(tmp_path):
    path = tmp_path / "stopped.h5"
    process = subprocess.Popen(rendering(path), stdout=-1, stderr=-1, text=True)
    wait_for_commits(process, path, 1)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == FAILED
    assert "Traceback" not in err
    with ContourFile(path) as file:
        done = sum(stop - first for first, stop in file.done)
    assert f"interrupted: {done} of 450000 poses are saved, --resume goes on" in json.loads(out)["error"]


@pytest.mark.exhaustive
def test_killed_rendering_is_resumed_to_the_same_data(tmp_path):
    killed, whole = tmp_path / "killed.h5", tmp_path / "whole.h5"
    subprocess.run(rendering(whole), check=True, capture_output=True, timeout=300)
    process = subprocess.Popen(rendering(killed, "--workers", "2"), stdout=-1, stderr=-1)
    wait_for_commits(process, killed, 2)
    process.kill()
    process.communicate()
    assert not killed.exists()
    with ContourFile(killed) as file:
        done = sum(stop - first for first, stop in file.done)
    assert 0 < done < 450_000
    told = run("info", killed)
    assert "still being written, or was interrupted" in " ".join(told.stderr.split())
    assert run("check", killed).exit_code == FAILED
    refused(MISUSED, "not finished", "play", killed)
    command = rendering(killed, "--resume", "--workers", "1")
    result = subprocess.run(command, check=True, capture_output=True, timeout=300, text=True)
    assert json.loads(result.stdout)["poses_rendered"] == 450_000 - done
    assert_same_data(killed, whole)
    assert check_file(killed) == []


def assert_same_data(one, two):
    """Everything but timing, dates and versions."""
    with ContourFile(one) as a, ContourFile(two) as b:
        assert a.recipe == b.recipe
        for first in range(0, a.pose_count, 20_000):
            stop = min(first + 20_000, a.pose_count)
            for left, right in (
                (a.contours(first, stop), b.contours(first, stop)),
                (a.metrics(first, stop), b.metrics(first, stop)),
            ):
                assert left.keys() == right.keys()
                for name in left:
                    np.testing.assert_array_equal(left[name], right[name], err_msg=name)
