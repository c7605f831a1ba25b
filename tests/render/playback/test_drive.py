"""Phases of a single focus: values worked by hand, an independent field; the loop from contour to pressure."""

import numpy as np
import pytest
from board_outputs import emulator_drives, emulator_slots
from scipy.special import j1

from palpate.device import EmulatorBackend
from palpate.device.clock import VirtualClock
from palpate.device.codec import encode_frames
from palpate.device.registry import array_model
from palpate.render import ContourBatch, MeshObject, Palm, closed_contour, exploration, open_contour, render
from palpate.render.errors import RenderError
from palpate.render.intersection.file_recording import record
from palpate.render.playback.drive import drive_focus
from palpate.render.playback.file_playback import Connection, play_file
from palpate.render.sampling.metrics import FocalPoints
from palpate.render.sampling.strategy import SamplingStrategy

WAVENUMBER = 2 * np.pi * 40e3 / 343.0
RADIUS = 0.0045  # [m] of a transducer


def focus_at(*points, intensity=1.0):
    position = np.array(points, np.float32)
    return FocalPoints(position, np.full(len(position), intensity, np.float32))


def pressure(point, transducer, delay, amplitude):
    """Complex pressure of pistons facing +z, time factor exp(+j w t); [frame, ...] fields at points [frame, ..., 3]."""
    between = point[..., None, :] - transducer
    distance = np.linalg.norm(between, axis=-1)
    x = WAVENUMBER * RADIUS * np.linalg.norm(between[..., :2], axis=-1) / distance
    directivity = np.where(x < 1e-6, 1.0, 2 * j1(x) / np.where(x < 1e-6, 1.0, x))
    source = amplitude * np.exp(-2j * np.pi * delay)
    shape = (len(point),) + (1,) * (point.ndim - 2) + (transducer.shape[0],)
    waves = source.reshape(shape) * directivity / distance
    return (waves * np.exp(-1j * WAVENUMBER * distance)).sum(axis=-1), np.abs(waves).sum(axis=-1)


def across_beam(focus):
    """Two directions across the line from the array's centre to each focal point, shape [frame, 2, 3]."""
    beam = focus / np.linalg.norm(focus, axis=1, keepdims=True)
    u = np.cross(beam, [0.0, 1.0, 0.0])
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    return np.stack([u, np.cross(beam, u)], axis=1)


def peak_near(focus, delay, amplitude):
    """Where the pressure peaks across the beam within 5 mm of each point, and its share of the greatest possible."""
    transducer, axes = emulator_slots(), across_beam(focus)
    place, reach = focus.copy(), 4e-3
    for _ in range(3):
        offset = reach * np.stack(np.meshgrid(*[np.linspace(-1, 1, 5)] * 2), axis=-1).reshape(-1, 2)
        points = place[:, None] + np.einsum("ga,fax->fgx", offset, axes)
        field, bound = pressure(points, transducer, delay, amplitude)
        best = np.abs(field).argmax(axis=1)
        rows = np.arange(len(focus))
        place, share = points[rows, best], np.abs(field)[rows, best] / bound[rows, best]
        reach /= 2.5
    return place, share


def distance_to(segments, points):
    """Distance of each point from the nearest of its own list of segments (start, end)."""
    out = []
    for (start, end), point in zip(segments, points, strict=True):
        step = end - start
        t = np.clip(np.einsum("ij,ij->i", point - start, step) / np.einsum("ij,ij->i", step, step), 0, 1)
        out.append(np.linalg.norm(start + t[:, None] * step - point, axis=1).min())
    return np.array(out)


def test_delays_at_an_asymmetric_point_are_those_worked_by_hand():
    array = array_model("emulator")
    delay = drive_focus(focus_at((0.03, -0.02, 0.2)), array).delay[0]
    # r = sqrt(dx^2 + dy^2 + 0.2^2), delay = frac(-r / 8.575 mm), with 30 digits
    worked = {
        (-0.07875, -0.07875): 0.581574,
        (0.07875, -0.07875): 0.034980,
        (0.02625, -0.01575): 0.667021,
        (0.07875, 0.07875): 0.374246,
    }
    for place, turns in worked.items():
        index = int(np.argmin(np.linalg.norm(array.position[:, :2] - place, axis=1)))
        assert delay[index] == pytest.approx(turns, abs=1e-4)


@pytest.mark.parametrize("point", [(0.03, -0.02, 0.2), (-0.06, 0.05, 0.14), (0.0, 0.0, 0.265), (0.065, 0.065, 0.25)])
def test_decoded_bytes_focus_at_the_asked_point(point):
    drives = drive_focus(focus_at(point), array_model("emulator"))
    delay, level = emulator_drives(encode_frames(drives.delay, drives.amplitude))
    peak, share = peak_near(np.array([point]), delay, level)
    assert np.linalg.norm(peak - point) < 1e-3
    assert share > 0.995
    mirrored, _ = pressure(np.array([[point]]), emulator_slots(), 1 - delay, level)  # what a sign error would give
    right, _ = pressure(np.array([[point]]), emulator_slots(), delay, level)
    assert abs(mirrored[0, 0]) < 0.2 * abs(right[0, 0])


def test_speed_of_sound_moves_the_phases_and_is_checked():
    array = array_model("emulator")
    cold, warm = (drive_focus(focus_at((0, 0, 0.2)), array, sound_speed=c).delay for c in (340.0, 346.0))
    assert np.abs(cold - warm).max() > 0.1
    with pytest.raises(RenderError, match=r"300\.\.400 m/s.*34300"):
        drive_focus(focus_at((0, 0, 0.2)), array, sound_speed=34300.0)


def one_delay(point, place, per_metre):
    """The delay of one transducer, each operation rounded to float32."""
    x, y, z = (np.float32(p - t) * np.float32(p - t) for p, t in zip(point, place, strict=True))
    turns = np.sqrt(np.float32(np.float32(x + y) + z)) * np.float32(per_metre)
    return np.float32(np.ceil(turns) - turns)


@pytest.mark.parametrize("name", ["emulator", "autd3", "tilted"])
def test_a_delay_depends_on_its_own_point_and_transducer_only(name, rng):
    pose = [0.01, 0.02, 0.05, 0.0, 0.17364818, 0.0, 0.98480775]
    array = array_model("pat16").placed(pose) if name == "tilted" else array_model(name)
    focus = focus_at(*rng.uniform([-0.04, -0.04, 0.15], [0.04, 0.04, 0.3], (700, 3)))
    whole = drive_focus(focus, array).delay
    for frame, own in zip(rng.integers(0, 700, 100), rng.integers(0, 249, 100), strict=True):
        assert whole[frame, own] == one_delay(focus.position[frame], array.position[own], array.carrier / 343)
    for frames in (1, 2, 3, 513):
        part = drive_focus(focus_at(*focus.position[-frames:]), array).delay
        np.testing.assert_array_equal(part, whole[-frames:])


@pytest.mark.parametrize(
    "point",
    [(0, 0, -0.1), (0, 0, 0), (0.00525, 0.00525, 0.0), (0, 0, 3.0), (1.0, 0, 0.2), (np.nan, 0, 0.2), (0, np.inf, 0.2)],
)
def test_focal_points_outside_the_zone_are_silenced_counted_and_never_nan(point):
    drives = drive_focus(focus_at(point, (0, 0, 0.2)), array_model("emulator"))
    assert drives.refused == 1
    assert drives.amplitude.tolist() == [0.0, 1.0]
    frames = encode_frames(drives.delay, drives.amplitude)
    assert not emulator_drives(frames)[1][0].any()
    assert emulator_drives(frames)[1][1].all()


def test_intensity_that_is_not_a_number_is_silenced_and_counted():
    drives = drive_focus(focus_at((0, 0, 0.2), intensity=np.nan), array_model("emulator"))
    assert drives.refused == 1
    assert drives.amplitude.tolist() == [0.0]


@pytest.mark.exhaustive
@pytest.mark.parametrize(("name", "strategy"), [("cube", closed_contour()), ("tube", open_contour())])
def test_pressure_peaks_on_the_contour_at_every_frame_played(name, strategy, tmp_path):
    thing = MeshObject.load(name)
    whole = exploration(thing.bounds, duration=20.0, rate=90.0, seed=5)
    length = render(thing, Palm(), whole, strategy).length()
    first = int(np.argmax(np.convolve(length > 0.05, np.ones(18), mode="valid")))
    motion = type(whole)(whole.time[first : first + 18], whole.pose[first : first + 18])
    path = tmp_path / "loop.h5"
    record(path, thing, Palm(), motion, strategy)
    bus = EmulatorBackend(clock=VirtualClock(), record=5000)
    rate = 2500.0
    playback = play_file(path, connection=Connection(backend=bus), sampling=SamplingStrategy(update_rate=rate))
    frames = bus.board().played[: playback.played.frames]
    delay, level = emulator_drives(frames)
    assert len(frames) == round(0.2 * rate)
    batch = render(thing, Palm(), motion, strategy)
    pose = np.searchsorted(motion.time, np.arange(len(frames)) / rate + 1e-9, side="right") - 1
    drawn = level.max(axis=1) > 0
    assert (drawn == (batch.length()[pose] > 0)).all()
    assert drawn.mean() > 0.9
    segments = {i: segments_of(batch, i) for i in np.unique(pose[drawn])}
    own = [segments[i] for i in pose[drawn]]
    start = focus_by_coherence(delay[drawn], own)
    peak, share = peak_near(start, delay[drawn], level[drawn])
    assert distance_to(own, peak).max() < 1e-3
    assert share.min() > 0.97


def segments_of(batch: ContourBatch, pose):
    lines = [p.astype(float) for p in batch.polylines_of(pose)]
    return np.concatenate([p[:-1] for p in lines]), np.concatenate([p[1:] for p in lines])


def focus_by_coherence(delay, segments):
    """The point of each frame's contour where the decoded delays arrive most nearly in phase: blind to the sampler."""
    out = []
    for turns, (start, end) in zip(delay, segments, strict=True):
        t = np.linspace(0, 1, 40)[None, :, None]
        points = (start[:, None] + t * (end - start)[:, None]).reshape(-1, 3)
        points = points[:: max(1, len(points) // 400)]
        distance = np.linalg.norm(points[:, None] - emulator_slots(), axis=-1)
        out.append(points[np.abs(np.exp(-1j * (2 * np.pi * turns + WAVENUMBER * distance)).sum(axis=1)).argmax()])
    return np.array(out)
