"""The proof: a contour file of the tube, played through the real libusb to the pat16 board model, draws its contour."""

# Everything behind the wire is this file's own: which pin is which transducer, what it adds, the field in float64.

from __future__ import annotations

import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from umockdev_session import Plug, run, write_pat_file

from palpate.datasets.contour_file.reader import ContourFile
from palpate.datasets.motions.hand_motion import HandMotion
from palpate.render import MeshObject, Palm, closed_contour, exploration
from palpate.render.intersection.file_recording import record
from palpate.render.playback.focal_points import ContourSource
from palpate.render.sampling.sampler import Sampler, sample_bounds
from palpate.render.sampling.strategy import SamplingStrategy

pytestmark = [pytest.mark.exhaustive, pytest.mark.usefixtures("umockdev")]

PALPATE = str(Path(sys.executable).with_name("palpate"))
SERIAL = "FT4TKZL8"
RATE = 10e3
WAVENUMBER = 2 * np.pi * 40e3 / 343.0
BEGIN, END = 2.0, 3.3  # [s] of the exploration: the hand comes to the tube, and moves on it


def segments_of(file: ContourFile, pose: int) -> tuple[np.ndarray, np.ndarray]:
    """Starts and steps of a pose's contours [m]."""
    contours = file.contours(pose, pose + 1)
    points, bounds = contours["points"].astype(float), contours["polyline_start"]
    parts = [points[first:stop] for first, stop in pairwise(bounds)]
    starts = np.vstack([part[:-1] for part in parts] or [np.zeros((0, 3))])
    return starts, np.vstack([np.diff(part, axis=0) for part in parts] or [np.zeros((0, 3))])


def distance_to(starts: np.ndarray, steps: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Of each point from the nearest segment [m]."""
    between = points[:, None] - starts
    square = np.maximum((steps**2).sum(axis=1), 1e-30)
    t = np.clip((between * steps).sum(axis=2) / square, 0, 1)
    return np.linalg.norm(between - t[..., None] * steps, axis=2).min(axis=1)


def pins_emit(frames: np.ndarray, own_delay: np.ndarray) -> np.ndarray:
    """Complex amplitude at each pin, [frame, pin], exp(+j w t): the fundamental of its pulse, and what the part adds.

    The pulse begins at the phase byte and lasts the duty, in 1/128 of a period: what comes out is its middle, less the
    quarter of a period that a full pulse's middle lies behind its edge.
    """
    begin, duty = (frames[:, :256] & 0x7F) / 128, (frames[:, 256:] & 0x7F) / 128
    delay = begin + duty / 2 - 0.25 + own_delay
    return np.sin(np.pi * duty) * np.exp(-2j * np.pi * delay)


def power(points: np.ndarray, place: np.ndarray, emitted: np.ndarray) -> np.ndarray:
    """|p|^2 of monopoles, [frame, point], at points [frame, point, 3]."""
    square = (points**2).sum(axis=2)[..., None] + (place**2).sum(axis=1) - 2 * points @ place.T
    distance = np.sqrt(square)
    cosine, sine = np.cos(WAVENUMBER * distance) / distance, np.sin(WAVENUMBER * distance) / distance
    real, imaginary = emitted.real[..., None], emitted.imag[..., None]
    pressure = (cosine @ real + sine @ imaginary) + 1j * (cosine @ imaginary - sine @ real)
    return np.abs(pressure[..., 0]) ** 2


def peaks_near(focus: np.ndarray, place: np.ndarray, emitted: np.ndarray) -> np.ndarray:
    """Where the pressure is highest across the beam, within 4 mm of each point [m].

    On a grid of 2 mm, then by the parabola through the highest value and its neighbours along each axis; a highest
    value on the edge of the grid is left there, 4 mm away.
    """
    beam = focus / np.linalg.norm(focus, axis=1, keepdims=True)
    u = np.cross(beam, [0.0, 1.0, 0.0])
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    axes = np.stack([u, np.cross(beam, u)], axis=1)
    line = np.linspace(-4e-3, 4e-3, 5)
    offset = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1)
    level = power(focus[:, None] + offset.reshape(-1, 2) @ axes, place, emitted).reshape(-1, 5, 5)
    row, column = np.divmod(level.reshape(-1, 25).argmax(axis=1), 5)
    frame = np.arange(len(focus))
    peak = np.zeros((len(focus), 2))
    for axis, best in enumerate((row, column)):
        inside = np.clip(best, 1, 3)
        below, here, above = (
            level[frame, inside + step, column] if axis == 0 else level[frame, row, inside + step]
            for step in (-1, 0, 1)
        )
        bend = below - 2 * here + above
        peak[:, axis] = line[best] + np.where(best == inside, (below - above) / (2 * bend) * (line[1] - line[0]), 0.0)
    return focus + np.einsum("fa,fax->fx", peak, axes)


@pytest.fixture(scope="module")
def played(umockdev: None, tmp_path_factory: pytest.TempPathFactory):
    """The file, what the board played, and the board's wiring."""
    folder = tmp_path_factory.mktemp("proof")
    tube = MeshObject.load("tube")
    whole = exploration(tube.bounds, duration=6.0, rate=30.0, seed=1, model="around")
    kept = (whole.time >= BEGIN) & (whole.time < END)
    motion = HandMotion(whole.time[kept] - whole.time[kept][0], whole.pose[kept])
    record(folder / "tube.h5", tube, Palm(), motion, closed_contour(), devices=["cpu"])
    wiring = write_pat_file(folder / "board.pat", serial=SERIAL)
    command = [PALPATE, "play", str(folder / "tube.h5"), "--array", "pat16", "--calibration", str(folder / "board.pat")]
    plug = Plug("pat16", SERIAL, driver="ftdi_sio")
    return folder / "tube.h5", run([*command, "--json"], folder, plugs=(plug,)), wiring


def test_the_focus_traces_the_contour_within_a_millimetre_at_every_frame(played) -> None:
    path, outcome, (place, own_delay, _) = played
    assert outcome.returncode == 0, outcome.err
    with ContourFile(path) as file:
        source = ContourSource(file, Sampler(SamplingStrategy(update_rate=RATE)))
        asked = [(block.position.astype(float), block.intensity) for block in source]
        focus, intensity = (np.concatenate(part) for part in zip(*asked, strict=True))
        contours = [segments_of(file, pose) for pose in range(file.pose_count)]
        bounds = sample_bounds(file.motion()["time"].astype(float), source.duration, RATE)
    frames = outcome.played()
    on = np.flatnonzero((frames[:, 256:] & 0x7F).any(axis=1))
    wanted = np.flatnonzero(intensity > 0)
    assert len(on) == len(wanted) > 0.9 * (END - BEGIN) * RATE
    assert (np.diff(on) == np.diff(wanted)).all()
    pose = np.searchsorted(bounds, wanted, side="right") - 1
    for first in range(0, len(on), 500):
        rows = slice(first, first + 500)
        emitted = pins_emit(frames[on[rows]], own_delay)
        peak = peaks_near(focus[wanted[rows]], place, emitted)
        for number in np.unique(pose[rows]):
            here = pose[rows] == number
            assert distance_to(*contours[number], peak[here]).max() <= 1e-3


def test_the_board_was_let_go_silent_and_its_driver_bound_again(played) -> None:
    _, outcome, _ = played
    board = outcome.devices[0]
    told = outcome.told
    assert (board["emitting"], board["claimed"]) == (False, False)
    assert board["bindings"] == ["-ftdi_sio", "+ftdi_sio"]
    assert (told["array"], told["transport"], told["stopped_by"]) == ("pat16", "queued", "end")
    assert (told["off_sent"], told["off_confirmed"], told["board_underruns"]) == (True, None, None)
    assert (told["frames"], told["refused"]) == (round((END - BEGIN) * RATE), 0)
