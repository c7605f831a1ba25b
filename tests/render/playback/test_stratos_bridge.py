"""Focal points from a contour file to `palpate-ultraleap`: what the fake array behind the library's stub was handed.

The bridge is compiled against a stub of the vendor's library, whose fake array records each device sample, 40,000 a
second. Nothing here is hardware.
"""

import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from devices.ultraleap_bridge import RATE, Bridge, shared_program

from palpate.render import (
    SamplingStrategy,
    load_rig,
    play_file,
    prepare_frames,
    render,
    static_pose,
)

pytestmark = pytest.mark.exhaustive
PLAYER = """
import sys
from palpate.render import SamplingStrategy, load_rig, play_file
play_file(sys.argv[1], array=load_rig("stratos", serial=f"127.0.0.1:{sys.argv[2]}"), duration=30.0)
"""


@pytest.fixture(scope="session")
def program(tmp_path_factory):
    return shared_program(tmp_path_factory)


@pytest.fixture(scope="session")
def contours(tmp_path_factory):
    """The rim of a cube that a palm cuts askew to the array's axes, so that no coordinate stands for another."""
    batch = render("cube", "palm", static_pose([0.01, 0.02, 0.21], quaternion=[0.1, 0.05, 0.02, 0.99355]), "cc")
    return batch.save(tmp_path_factory.mktemp("contours") / "cube.h5")


def rig_at(bridge):
    return load_rig("stratos", serial=f"127.0.0.1:{bridge.port}")


def recorded(path, points=1, start=1):
    """x, y, z, intensity of each point of each device sample, shape [device sample, point, 4]."""
    rows = np.fromfile(f"{path}.{start}", np.dtype([("time", "<f8"), ("points", "<f4", (points, 4))]))
    return rows["points"]


def sounding(rows):
    """Rows from the first that sounds to the last one: all before and after are silent."""
    on = np.flatnonzero(rows[:, :, 3].any(axis=1))
    return rows[on[0] : on[-1] + 1]


def sampled(path, tmp_path, sampling, duration, points):
    """What the export writes, by the layout of docs/formats/focal-points.md: sampled without drive, player and link."""
    from palpate.render.exports.file_export import export_file

    out = tmp_path / "points.bin"
    export_file(path, out, to="focal-points", sampling=sampling, duration=duration)
    return np.fromfile(out, "<f4", offset=32).reshape(-1, points, 4)


def distinct(rows):
    """Rows without those that repeat the one before."""
    return rows[np.append(True, (rows[1:] != rows[:-1]).reshape(len(rows) - 1, -1).any(axis=1))]


def held(sample_count, rate):
    """The sample of each device sample: k is held until sample k + 1 is due."""
    ends = np.ceil(np.arange(1, sample_count + 1) * RATE / rate - 0.5).astype(int)
    return np.repeat(np.arange(sample_count), np.diff(ends, prepend=0))


@pytest.mark.parametrize(("rate", "points"), [(40e3, 1), (10e3, 1), (40e3 / 3, 1), (10e3, 4)])
@pytest.mark.parametrize("is_prepared", [False, True])
def test_each_focal_point_is_handed_over_in_order_none_twice_none_lost(
    program, contours, tmp_path, rate, points, is_prepared
):
    sampling = SamplingStrategy(update_rate=rate, foci=points)
    options = {"sampling": sampling, "duration": 0.5}
    path = contours
    if is_prepared:
        path, options = tmp_path / "frames.h5", {}
        prepare_frames(contours, path, array="stratos", sampling=sampling, duration=0.5)
    with Bridge(program, record=tmp_path / "seen", rates=",".join([str(RATE)] * points)) as bridge:
        playback = play_file(path, array=rig_at(bridge), **options)
        bridge.end()
    sent, seen = sampled(contours, tmp_path, sampling, 0.5, points), sounding(recorded(tmp_path / "seen", points))
    assert playback.frames == len(sent) == round(0.5 * rate)
    assert bridge.counts()[:4] == (len(sent) + 1, len(sent) + 1, 0, 0)  # and the off frame behind them
    wanted = sent[held(len(sent), rate)]
    if bridge.counts()[4]:  # this machine was late: the library held a sample for longer, which no test is about
        seen, wanted = distinct(seen), distinct(wanted)
    np.testing.assert_array_equal(seen[:, :, :3], wanted[:, :, :3])
    # of several points, the drive rounds ratios of intensities to 2^-16
    np.testing.assert_allclose(seen[:, :, 3], wanted[:, :, 3], rtol=0, atol=0 if points == 1 else 2**-16)
    assert playback.played.off_confirmed is None
    assert "does not say" in playback.played.off_doubt


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_the_array_is_handed_silence_when_its_player_is_killed_or_hangs(program, contours, tmp_path, number):
    with Bridge(program, record=tmp_path / "seen") as bridge:
        player = subprocess.Popen([sys.executable, "-c", PLAYER, contours, str(bridge.port)])
        try:
            while not (tmp_path / "seen.1").exists() or not recorded(tmp_path / "seen")[:, 0, 3].any():
                assert player.poll() is None
                time.sleep(0.05)
            player.send_signal(number)
            end = time.monotonic() + 20
            while (recorded(tmp_path / "seen")[-40:, 0, 3] > 0).any() and time.monotonic() < end:
                time.sleep(0.05)
        finally:
            player.kill()
            player.wait()
        bridge.end()
    rows = recorded(tmp_path / "seen")[:, 0]
    sent = sampled(contours, tmp_path, None, 30.0, 1)[:, 0]
    seen = sounding(recorded(tmp_path / "seen"))[:, 0]
    np.testing.assert_array_equal(distinct(seen), distinct(sent)[: len(distinct(seen))])  # in order, until the end
    assert not rows[-40:, 3].any()
    assert "client went" in bridge.output or "sent away" in bridge.output
