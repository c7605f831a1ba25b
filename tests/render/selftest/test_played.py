"""What the steps of the first hour play, from the bytes that emulated boards played: decoded by `wire_decoders`, which
was written from the documents, and put into a field by `board_field`, in float64. No answer is looked at here.
"""

import json
import math
import subprocess
import sys

import numpy as np
import pytest
from acceptance_script import answers_of, emitting, shorten, spend_hour, steps_of, tone
from board_field import CARRIER, FOCUS, SPEED_OF_SOUND, brightest_point
from wire_decoders import DECODERS, GRID

from palpate.device.playing.player import Player
from palpate.device.registry import array_model
from palpate.render import SamplingStrategy
from palpate.render.selftest.frames import FeltStimulus
from palpate.render.selftest.stimuli import stimulus

MOST = 12_000  # frames of a stimulus: 1.2 s at 10 kHz, more than a turn
QUARTER = 42.0  # [mm]: mean of 5.25, 15.75, ... 78.75
RATES = {"emulator": 10_000.0, "pat16": 10_000.0, "sonicsurface": 230_769 / 10 / 258}
NEAR_LEFT, NEAR_RIGHT, FAR_LEFT = (-1, -1), (1, -1), (-1, 1)


@pytest.fixture(scope="module")
def hours(tmp_path_factory):
    """An hour with each array, its first MOST frames of each stimulus, as they are asked for."""
    kept = {}

    def of(array, capsys):
        if array not in kept:
            with pytest.MonkeyPatch.context() as patch:
                stops = []
                stop = Player.stop
                patch.setattr(Player, "stop", lambda self: (stops.append(self._link.clock.now_ns()), stop(self)))
                shorten(patch, MOST)
                path = tmp_path_factory.mktemp(array) / "report.json"
                done = spend_hour(capsys, patch, path, answers_of(array), array=array, record=400_000)
                assert done.code == 0
                kept[array] = dict(zip(steps_of(array), done.played, strict=True)), stops, done
        return kept[array]

    return of


@pytest.fixture(params=["emulator", "pat16", "sonicsurface"])
def played(request, hours, capsys):
    """Name of an array, and what it played in each step: frames and when they began [ns]."""
    return request.param, hours(request.param, capsys)[0]


def decoded(array, frame):
    """What a frame does, place by place; a sonicsurface's board keeps the 256 values between start and swap."""
    wire = bytes(frame)
    return DECODERS[array](b"\xfe" + wire + b"\xfd" if array == "sonicsurface" else wire)


def amplitudes(array, frames):
    """Pressure amplitude of each frame: its loudest transducer's."""
    if array == "pat16":
        return np.sin(np.pi * frames[:, 256:].max(axis=1).astype(np.float64) / 128)
    if array == "sonicsurface":
        return (frames < 32).any(axis=1).astype(np.float64)
    return frames[:, 1::2].max(axis=1) / 255


def loud(array, frames):
    """Numbers of frames that emit more than half."""
    return np.flatnonzero(amplitudes(array, frames) > 0.5)


def loudest(array, frames):
    """The decoded frame that emits most of the first 200."""
    return decoded(array, frames[int(amplitudes(array, frames[:200]).argmax())])


def peak(drive, *, mirrored=False, window=None):
    """Where most arrives in phase [m]; mirrored: of a board whose y runs the other way round."""
    place = np.array([[x, -y if mirrored else y, 0.0] for x, y in drive]) * 1e-3
    delay, level = np.array(list(drive.values())).T
    if window is None:
        return brightest_point(place, delay, level)
    flight = np.linalg.norm(window[:, None] - place, axis=2) * CARRIER / SPEED_OF_SOUND
    return window[np.abs(np.exp(-2j * np.pi * (delay + flight)) @ level).argmax()]


def plane(height, half=0.06, step=2e-3):
    """Points [m] at a height."""
    across = np.arange(-half, half + step / 2, step)
    x, y = np.meshgrid(across, across, indexing="ij")
    return np.stack([x.ravel(), y.ravel(), np.full(x.size, height)], axis=1)


def test_a_stimulus_has_its_corner_its_turn_and_its_tone():
    model = array_model("pat16")
    corner = FeltStimulus(1.0, corner=NEAR_LEFT)
    assert (model.position[corner.emitting(model), :2] < 0).all()
    assert corner.emitting(model).sum() == 64
    assert corner.position(model, np.zeros(1))[0] * 1e3 == pytest.approx([-QUARTER, -QUARTER, 80.0], abs=1e-3)
    turn = FeltStimulus(1.0, centre=(0.0, 0.0, 0.2), radius=0.02)
    quarters = turn.position(model, np.array([0.0, 0.25, 0.5]))[:, :2]
    assert quarters == pytest.approx(np.array([[0.02, 0.0], [0.0, 0.02], [-0.02, 0.0]]), abs=1e-6)  # anticlockwise
    frame = np.arange(2000)
    level = FeltStimulus(0.2, modulation=440.0).level(model, frame)
    assert tone(level, frame * 100_000) == pytest.approx(440, abs=5)  # frames at 10 kHz


def test_the_circle_that_is_felt_has_2_cm_and_is_drawn_at_the_samplers_speed():
    place = stimulus("circle", 0.2, 0.1, SamplingStrategy()).position.astype(np.float64)
    assert np.hypot(place[:, 0], place[:, 1]) == pytest.approx(np.full(len(place), 0.02), abs=1e-6)
    assert np.linalg.norm(np.diff(place, axis=0), axis=1) == pytest.approx(np.full(len(place) - 1, 7e-4), rel=1e-3)
    assert np.cross(place[0], place[1])[2] > 0


@pytest.mark.exhaustive
@pytest.mark.parametrize(("step", "side"), [("corner", NEAR_LEFT), ("corner-x", NEAR_RIGHT), ("corner-y", FAR_LEFT)])
def test_a_corner_is_one_quarter_and_focuses_above_its_middle(step, side, played):
    array, frames = played[0], played[1][step][0]
    quarter = {(x, y) for x in GRID for y in GRID if (np.sign(x), np.sign(y)) == side}
    assert len(quarter) == 64
    seen = set()
    for number in loud(array, frames)[:60:10]:
        seen |= emitting(decoded(array, frames[number]))
    assert seen == quarter
    at = peak(loudest(array, frames), window=plane(0.08))
    assert at[:2] == pytest.approx(np.array(side) * QUARTER * 1e-3, abs=2.5e-3)


@pytest.mark.exhaustive
@pytest.mark.parametrize("step", ["focus", "replug"])
def test_the_focus_is_at_30_minus_20_200(step, played):
    drive = loudest(played[0], played[1][step][0])
    assert len(emitting(drive)) == 256
    assert peak(drive)[:2] == pytest.approx(FOCUS[:2], abs=1e-3)
    assert peak(drive)[2] == pytest.approx(FOCUS[2], abs=5e-3)  # along its axis a focus is 40 mm long


@pytest.mark.exhaustive
def test_the_turn_is_anticlockwise_once_a_second_2_cm_about_the_middle(played):
    array, (frames, time_ns) = played[0], played[1]["turn"]
    assert turning(array, frames, time_ns) == pytest.approx(1.0, abs=0.1)


def turning(array, frames, time_ns, *, mirrored=False):
    """Turns a second, anticlockwise positive, from where the field of a few frames peaks."""
    moments = loud_moments(array, frames, time_ns)
    angle, when = [], []
    for number, drive in moments:
        x, y, _ = peak(drive, mirrored=mirrored, window=plane(0.2, half=0.03, step=5e-4))
        assert math.hypot(x, y) == pytest.approx(0.02, abs=1.5e-3)
        angle.append(math.atan2(y, x))
        when.append(time_ns[number] * 1e-9)
    turned = np.unwrap(angle)
    return (turned[-1] - turned[0]) / (2 * math.pi) / (when[-1] - when[0])


def loud_moments(array, frames, time_ns):
    """Five frames that emit, at least 1/20 s apart, with their numbers."""
    chosen = []
    for number in loud(array, frames):
        if not chosen or time_ns[number] >= time_ns[chosen[-1]] + 50_000_000:
            chosen.append(number)
    return [(number, decoded(array, frames[number])) for number in chosen[:5]]


@pytest.mark.exhaustive
@pytest.mark.parametrize("array", ["emulator", "pat16", "sonicsurface"])
def test_the_array_is_off_after_each_step_and_within_a_tenth_of_a_second_of_a_stop(array, hours, capsys):
    steps, (stop_ns,), _ = hours(array, capsys)
    for name, (frames, _) in steps.items():
        if name == "silent":
            assert not amplitudes(array, frames).any()
        elif name != "unplug":
            assert amplitudes(array, frames)[-1] == 0, name
    frames, time_ns = steps["stopping"]
    off_ns = time_ns[np.flatnonzero(amplitudes(array, frames))[-1] + 1]
    assert -200_000_000 < off_ns - stop_ns <= 100_000_000  # it was stopped while it played, or hardly later


@pytest.mark.exhaustive
def test_a_new_process_prints_json_and_nothing_else():
    words = [sys.executable, "-m", "palpate.render.cli", "selftest", "--emulate", "--clock", "virtual", "--json"]
    done = subprocess.run([*words, "--duration", "0.1"], check=True, capture_output=True, text=True)
    assert json.loads(done.stdout)["point_frames"] == 1000
