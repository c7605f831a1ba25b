"""A live run from its source to the emulated array, with its processes."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from palpate.device.errors import DeviceError, SafetyLimitError
from palpate.device.playing.limits import Limits
from palpate.render import Connection, Live, LiveRecording, PlaneHand, SamplingStrategy, render
from palpate.render.errors import RenderError, StrategyError
from palpate.render.live import handle
from palpate.render.live.handle import sampling_at

REFUSED = {
    "source": ({"source": "no-such-source"}, "no-such-source"),
    "intensity": ({"intensity": 2}, r"intensity must lie in 0\.\.1, not 2"),
    "recording that is there": ({"record": "there.h5"}, "exists already; overwrite=True replaces it"),
    "side": ({"side": "middle", "source": "udp"}, "side must be one of"),
    "two connections": ({"connection": Connection(), "emulate": True}, "emulate is a field of connection"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_bad_input_is_refused_before_anything_is_started(case, monkeypatch, tmp_path):
    def start(*_, **__):
        raise AssertionError("an array is opened")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(handle, "HeldArrays", start)
    Path("there.h5").write_bytes(b"")
    fields, sentence = REFUSED[case]
    with pytest.raises(Exception, match=sentence) as refused:
        Live(**({"solid": "cube"} | fields))
    assert type(refused.value).__module__.startswith("palpate.")


def test_a_sampling_by_name_takes_the_rate_of_the_run():
    assert sampling_at("stm", 5000.0).update_rate == 5000.0
    assert sampling_at(SamplingStrategy(update_rate=20e3), 5000.0).update_rate == 20e3


def children():
    """Processes that this one has started and that run."""
    found = []
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            try:
                fields = (folder / "stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue
            if int(fields[1]) == os.getpid() and fields[0] != "Z":
                found.append(int(folder.name))
    return set(found)


@pytest.fixture
def nothing_left():
    """No process, no thread and no descriptor is left behind."""
    before = children(), threading.active_count(), len(os.listdir("/proc/self/fd"))
    yield
    end = time.monotonic() + 2
    while time.monotonic() < end and (children() - before[0] or threading.active_count() > before[1]):
        time.sleep(0.01)
    assert children() <= before[0]
    assert threading.active_count() <= before[1]
    assert len(os.listdir("/proc/self/fd")) <= before[2] + 1  # of a log of HDF5's or Warp's, opened once


@pytest.mark.exhaustive
def test_a_run_is_felt_recorded_and_given_again_bit_for_bit(tmp_path, nothing_left):
    path = tmp_path / "run.h5"
    with Live("tube", record=path, realtime=False) as live:
        live.wait(1.0)
        repr(live)
    assert live.files == [path]
    assert live.outcome["off_confirmed"] is True
    assert live.statistics().poses > 50
    with LiveRecording(path) as recording:
        comparison = recording.compare()
        assert (comparison.differing, comparison.samples > 8000) == (0, True)
    live.close()  # twice is once


@pytest.mark.exhaustive
def test_everything_changes_while_it_runs_and_another_rate_is_refused(tmp_path, nothing_left):
    told = []
    with Live("tube", record=tmp_path / "run.h5", realtime=False, told=told.append) as live:
        live.wait(0.3)
        live.change(solid="cube")
        live.set_intensity(0.5)
        live.wait(0.2)
        with pytest.raises(StrategyError, match=r"update_rate must be 10000 Hz.*not 20000 Hz"):
            live.change(sampling=SamplingStrategy(update_rate=20e3))
        live.change(strategy="oc", sampling="stm")
        before = live.statistics().poses
        live.wait(0.3)
        assert live.statistics().poses > before + 5
        assert "cube" in live.described()
    assert [path.name for path in live.files] == ["run.h5", "run-2.h5", "run-3.h5"]
    for path in live.files:
        with LiveRecording(path) as recording:
            assert recording.compare().differing == 0
    assert not [sentence for sentence in told if "fail" in sentence]


@pytest.mark.exhaustive
@pytest.mark.parametrize("hand", ["palm", "planes", "skin"])
def test_a_moment_has_the_contours_of_its_pose_bit_for_bit(hand, nothing_left):
    with Live("tube", hand=hand, source="exploration", realtime=False) as live:
        live.wait(0.3)
        first, found = live.moment(), []
        while len(found) < 8:
            live.wait(0.04)
            found.append(live.moment())
        scene = live.scene()
    assert live.moment() is None
    assert first.number < found[0].number < found[-1].number
    assert first.time < found[-1].time < 1.5
    for moment in found:
        own = scene.hand
        if moment.patch_pose is not None:
            own = PlaneHand(own.patches, own.joints, moment.patch_pose[None])
        again = render("tube", own, moment.hand_pose[None], "cc").arrays()
        for name, value in moment.contours.arrays().items():
            np.testing.assert_array_equal(value, again[name])
        assert moment.scene is scene
        assert moment.latency.p50 < 0.1
    assert any(moment.state == "tracking" for moment in found)


@pytest.mark.exhaustive
@pytest.mark.parametrize("who", ["renderer", "writer"])
def test_a_process_that_is_killed_ends_the_run_with_an_error(who, nothing_left):
    sentence = {"renderer": "process that draws ended", "writer": "may be emitting, switch it off"}[who]
    live = Live("tube", realtime=False)

    def run():
        with live:
            live.wait(0.2)
            victim = live._run._renderer if who == "renderer" else live._held.writer
            assert live.moment() is not None
            os.kill(victim.process_id, signal.SIGKILL)
            live.wait(3.0)

    with pytest.raises(RenderError if who == "renderer" else DeviceError, match=sentence):
        run()
    assert not live.is_running
    assert live.moment() is None
    if who == "renderer":
        assert live.outcome["off_confirmed"] is True


@pytest.mark.exhaustive
def test_a_source_that_ends_is_told_and_the_array_falls_silent(tmp_path, nothing_left):
    told = []
    with Live("tube", realtime=False, told=told.append) as live:
        live.wait(0.2)
        os.kill(live._run._source.process_id, signal.SIGKILL)
        live.wait(0.6)
        assert live.is_running
        assert live.moment().state == "no hand"
    assert [sentence for sentence in told if "source" in sentence and "ended" in sentence]
    assert live.outcome["off_confirmed"] is True


@pytest.mark.exhaustive
def test_a_limit_ends_a_run_as_it_ends_a_playback(nothing_left):
    live = Live("tube", realtime=False, limits=Limits(on_time_max=0.4))
    sentence = r"stopped at a limit: it was about to emit for more than 0\.4 s without a pause of 1 s \(on_time_max\)"
    with pytest.raises(SafetyLimitError, match=sentence), live:
        live.wait(5.0)
    assert live.outcome["off_confirmed"] is True


@pytest.mark.exhaustive
def test_ctrl_c_in_the_middle_of_a_change_leaves_nothing_behind(nothing_left):
    live = Live("tube", realtime=False)
    timer = threading.Timer(0.5, lambda: signal.raise_signal(signal.SIGINT))
    with pytest.raises(KeyboardInterrupt), live:
        live.change(solid=timer.start() or "cube")
    assert live.outcome["off_confirmed"] is True


PARENT = """
import sys, time
from palpate.render import Live
with Live("tube", realtime=False) as live:
    live.wait(0.2)
    own = [live._held.writer.process_id, live._run._renderer.process_id, live._run._source.process_id]
    print(*own, flush=True)
    time.sleep(60)
"""


@pytest.mark.exhaustive
def test_if_the_parent_is_killed_all_its_processes_end():
    parent = subprocess.Popen([sys.executable, "-c", PARENT], stdout=subprocess.PIPE, text=True)
    started = [int(part) for part in parent.stdout.readline().split()]
    assert len(started) == 3
    parent.kill()
    parent.wait()
    parent.stdout.close()
    end = time.monotonic() + 3
    while time.monotonic() < end and any(runs(process) for process in started):
        time.sleep(0.02)
    assert [process for process in started if runs(process)] == []


def runs(process):
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False
