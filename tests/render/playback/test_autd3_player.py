"""A contour file played to an AUTD3: what the vendor's emulator records, and its emulated array at the network."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

from palpate.datasets.contour_file.reader import ContourFile
from palpate.datasets.motions.hand_motion import HandMotion
from palpate.device.boards.autd3.link import Autd3Link, open_autd3
from palpate.device.boards.discovery import open_link
from palpate.device.codec import encode_frames
from palpate.device.errors import DeviceLostError, DeviceNotFoundError, NoBackendError
from palpate.device.playing.player import Player
from palpate.device.registry import array_model
from palpate.render import ContourBatch, MeshObject, Palm, closed_contour, exploration, render
from palpate.render.intersection.file_recording import record
from palpate.render.playback.drive import drive_focus
from palpate.render.sampling.metrics import FocalPoints
from palpate.render.sampling.sampler import Sampler, sample_contours
from palpate.render.sampling.strategy import SamplingStrategy

vendor = pytest.importorskip("autd3", reason="the vendor's package autd3 is not installed")
pytest.importorskip("autd3_emulator", reason="the vendor's package autd3-emulator is not installed")
client = pytest.importorskip("palpate.device.boards.autd3.vendor_client")
recorder = pytest.importorskip("autd3_recorder")

MODEL = array_model("autd3")
DIVIDER = 4
RATE = 40e3 / DIVIDER
WAVELENGTH = 343.0 / 40e3


@pytest.fixture
def channel():
    channel = recorder.RecordingChannel()
    yield channel
    channel.dispose()


def _focal_points(path, duration) -> FocalPoints:
    """Those of the tube's closed contour while a hand explores it."""
    tube = MeshObject.load("tube")
    whole = exploration(tube.bounds, duration=20.0, rate=90.0, seed=5)
    count = round(duration * 90)
    length = render(tube, Palm(), whole, closed_contour()).length()
    first = int(np.argmax(np.convolve(length > 0.05, np.ones(count), mode="valid")))
    motion = HandMotion(whole.time[first : first + count] - whole.time[first], whole.pose[first : first + count])
    record(path, tube, Palm(), motion, closed_contour())
    sampler = Sampler(SamplingStrategy(update_rate=RATE))
    with ContourFile(path) as file:
        batches = [ContourBatch.from_arrays(file.contours(*block)) for block in file.blocks()]
        parts = list(sample_contours(batches, motion.pose, motion.time, duration, sampler))
    return FocalPoints(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def _blocks(frames: np.ndarray, size: int = 400):
    for start in range(0, len(frames), size):
        yield frames[start : start + size]


@pytest.mark.exhaustive
def test_a_contour_file_is_played_with_the_right_phase_in_every_period(tmp_path, channel):
    focus = _focal_points(tmp_path / "tube.h5", 0.25)
    drives = drive_focus(focus, MODEL)
    frames = encode_frames(drives.delay, drives.amplitude, array=MODEL)
    link = Autd3Link(MODEL, client.Controller(channel, who="autd3"))
    report = Player(link).play(_blocks(frames), update_rate=RATE)
    recorded = channel.record()
    emitting = np.flatnonzero(recorder.is_emitting(recorded))
    distance = np.linalg.norm(focus.position[:, None].astype(np.float64) - MODEL.position, axis=2)
    expected = np.repeat(-distance / WAVELENGTH * 256, DIVIDER, axis=0)
    drawn = np.repeat(drives.amplitude > 0, DIVIDER)
    played = recorded[emitting[0] : emitting[0] + len(expected)]
    error = (played[:, :249] - expected + 128) % 256 - 128
    assert np.abs(error[drawn]).max() <= 1
    assert drawn.mean() > 0.9
    assert (recorder.is_emitting(played) == drawn).all()
    assert (report.frames, report.board_underruns, report.off_confirmed) == (len(frames), 0, True)


@pytest.fixture
def link():
    link = open_autd3(MODEL, emulated=True)
    yield link
    link.close()


def _frames(count: int) -> np.ndarray:
    focus = np.tile(np.array([[0.03, -0.02, 0.2]], np.float32), (count, 1))
    drives = drive_focus(FocalPoints(focus, np.linspace(0.3, 0.9, count, dtype=np.float32)), MODEL)
    return encode_frames(drives.delay, drives.amplitude, array=MODEL)


def _endless(frames: np.ndarray):
    while True:
        yield frames


@pytest.mark.exhaustive
def test_a_stop_silences_the_array_although_banks_are_full(link):
    player = Player(link)
    threading.Timer(0.4, player.stop).start()
    report = player.play(_endless(_frames(1000)), update_rate=RATE)
    assert (report.stopped_by, report.off_confirmed) == ("stop", True)
    assert 0 < report.frames < 10_000
    assert link.status().level == 0
    assert Player(link).play(_blocks(_frames(500)), update_rate=RATE).frames == 500


@pytest.mark.exhaustive
def test_an_array_that_reboots_is_lost(link):
    emulator = link._controller._channel.emulator
    threading.Timer(0.3, emulator.reboot, [0]).start()
    with pytest.raises(DeviceLostError, match="autd3 at emulated is gone") as caught:
        Player(link).play(_endless(_frames(1000)), update_rate=RATE)
    report = caught.value.report
    assert report.stopped_by == "device"
    assert not report.off_confirmed


@pytest.mark.exhaustive
@pytest.mark.parametrize(("pause", "ending"), [(client.FAILSAFE + 0.4, "LinkError silent"), (0.0, "played")])
def test_an_array_that_hears_nothing_from_its_host_stops_by_itself(pause, ending):
    """A host that is frozen for a while sends as much as one that was killed, but can be asked afterwards."""
    emulator = vendor.UdpEmulator(1)
    address = _address(emulator)
    host = subprocess.Popen([sys.executable, "-c", _HOST, address], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    with host:
        assert host.stdout.readline() == b"playing\n"
        host.send_signal(signal.SIGSTOP)
        time.sleep(pause)
        host.send_signal(signal.SIGCONT)
        told, _ = host.communicate(b"\n", timeout=30)
    assert told.decode().strip() == ending


_HOST = """
import sys
from array import array
from palpate.device.registry import array_model
from palpate.device.boards.autd3.link import open_autd3
from palpate.device.errors import LinkError
frames = array("B", bytes([128]) * 498 * 1500)
with open_autd3(array_model("autd3"), address=sys.argv[1]) as link:
    link.start(4)
    link.write(frames, abandon=lambda: link.bytes_sent > 0)
    print("playing", flush=True)
    sys.stdin.readline()
    try:
        link.write(frames)
        print("played")
    except LinkError as error:
        print("LinkError", "silent" if link.status().level == 0 else "on")
"""


def _address(emulator: vendor.UdpEmulator) -> str:
    return re.search(r"\[::1\]:\d+", str(emulator.option().iface))[0]


@pytest.mark.exhaustive
def test_an_array_is_opened_by_its_address_and_taken_over_by_the_next_host():
    emulator = vendor.UdpEmulator(1)
    address = _address(emulator)
    with open_link(MODEL, serial=address) as first, open_link(MODEL, serial=address) as second:
        assert (first.serial, second.transport) == (address, "udp")
        second.start(DIVIDER)
        with pytest.raises(DeviceLostError):
            first.start(DIVIDER)
        second.close()
        with pytest.raises(DeviceLostError, match="let go"):
            second.start(DIVIDER)


def test_what_is_not_there_is_named():
    for address in ("no-such-interface", "not:an:address"):
        with pytest.raises(DeviceNotFoundError, match=address):
            open_autd3(MODEL, address=address)


def test_without_the_package_the_command_that_installs_it_is_named(monkeypatch):
    monkeypatch.delitem(sys.modules, "palpate.device.boards.autd3.vendor_client", raising=False)
    monkeypatch.setitem(sys.modules, "autd3", None)
    with pytest.raises(NoBackendError, match=re.escape("pip install -e '.[autd3]'")):
        open_autd3(MODEL)
