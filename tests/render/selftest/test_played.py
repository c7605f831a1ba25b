"""What the steps of the first hour play, from the bytes that emulated boards played: decoded by `wire_decoders`, which
was written from the documents, and put into a field by `board_field`, in float64. No answer is looked at here.

So is what the page says a faulty board would make a person answer: the fault is made in the decoded frames.
"""

import math
from itertools import pairwise

import numpy as np
import pytest
from acceptance_script import answers_of, emitting, shorten, spend_hour, steps_of, tone
from board_field import CARRIER, FOCUS, SPEED_OF_SOUND, brightest_point
from wire_decoders import DECODERS, GRID

from palpate.device.playing.player import Player

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


def stretches(level, time_ns):
    """What was played in one go: parts of a series between silences of more than half a second [(level, time)]."""
    on = np.flatnonzero(level)
    edges = [0, *(np.flatnonzero(np.diff(time_ns[on]) > 500_000_000) + 1), len(on)]
    parts = [on[first:stop] for first, stop in pairwise(edges)]
    return [(level[part[0] : part[-1] + 1], time_ns[part[0] : part[-1] + 1]) for part in parts]


@pytest.mark.exhaustive
@pytest.mark.parametrize("array", ["emulator", "pat16"])
@pytest.mark.parametrize("step", ["ending", "pitch", "minute"])
def test_tones_are_a_by_the_boards_own_clock(array, step, hours, capsys):
    frames, time_ns = hours(array, capsys)[0][step]
    ((level, when),) = stretches(amplitudes(array, frames), time_ns)
    assert np.median(np.diff(when)) == 100_000  # 10 kHz
    assert tone(level, when) == pytest.approx(440, abs=1)


@pytest.mark.exhaustive
def test_the_fast_tone_is_the_same_at_13_kHz(hours, capsys):
    frames, time_ns = hours("pat16", capsys)[0]["fast"]
    ((level, when),) = stretches(amplitudes("pat16", frames), time_ns)
    assert np.median(np.diff(when)) == 75_000
    assert tone(level, when) == pytest.approx(440, abs=1.5)


@pytest.mark.exhaustive
@pytest.mark.parametrize("array", ["emulator", "pat16"])
def test_both_tones_of_the_divider_have_one_pitch(array, hours, capsys):
    """444.4 Hz is 18 cents from 440 Hz, a fifth of a semitone."""
    frames, time_ns = hours(array, capsys)[0]["divider"]
    first, second = stretches(amplitudes(array, frames), time_ns)
    assert tone(*first) == pytest.approx(440, abs=1)
    assert np.median(np.diff(second[1])) == 45 * 25_000
    assert tone(*second) == pytest.approx(40_000 / 45 / 2, abs=1)


def test_a_board_that_does_not_take_the_divider_plays_the_second_tone_much_higher(hours, capsys):
    frames, time_ns = hours("pat16", capsys)[0]["divider"]
    level, when = stretches(amplitudes("pat16", frames), time_ns)[1]
    at_the_old_rate = when[0] + np.arange(len(level)) * 100_000
    assert tone(level, at_the_old_rate) == pytest.approx(5000, abs=5)  # answer `higher`


def test_a_board_that_loses_every_second_frame_plays_the_first_tone_only(hours, capsys):
    """What the published gateware made of frames that straddle two of its blocks."""
    frames, time_ns = hours("pat16", capsys)[0]["divider"]
    first, second = stretches(amplitudes("pat16", frames), time_ns)
    assert tone(first[0][::2], first[1][::2]) == pytest.approx(440, abs=1)
    for lost in (0, 1):
        assert tone(second[0][lost::2], second[1][lost::2]) == 0.0  # answer `first-only`


@pytest.mark.exhaustive
def test_a_mirrored_board_gives_the_wrong_answers_that_the_page_names(hours, capsys):
    """Its y runs the other way; a person turns it so that the first corner is near on the left: by a quarter turn."""
    steps = hours("pat16", capsys)[0]
    at = {}
    for step in ("corner", "corner-x", "corner-y"):
        x, y, _ = peak(loudest("pat16", steps[step][0]), mirrored=True, window=plane(0.08))
        at[step] = x, y
    assert np.sign(at["corner"]).tolist() == [-1, 1]

    def as_it_stands(x, y):
        return -y, x  # anticlockwise: far left comes to near left

    assert np.sign(as_it_stands(*at["corner"])).tolist() == list(NEAR_LEFT)
    assert np.sign(as_it_stands(*at["corner-x"])).tolist() == list(FAR_LEFT)  # answer `far-left`
    assert np.sign(as_it_stands(*at["corner-y"])).tolist() == list(NEAR_RIGHT)  # answer `near-right`
    focus = peak(loudest("pat16", steps["focus"][0]), mirrored=True, window=plane(0.2))
    assert as_it_stands(*focus[:2]) == pytest.approx((-0.02, 0.03), abs=2.5e-3)  # answer `left-far`
    assert turning("pat16", *steps["turn"], mirrored=True) == pytest.approx(-1.0, abs=0.1)  # answer `clockwise`


def test_offsets_of_half_a_turn_make_a_focus_weak(hours, capsys, rng):
    """A board whose transducers are soldered either way round, played to without its board file."""
    drive = loudest("pat16", hours("pat16", capsys)[0]["focus"][0])
    turned = {place: (delay + 0.5 * rng.integers(2), level) for place, (delay, level) in drive.items()}
    assert pressure(turned) < 0.3 * pressure(drive)  # answer `weak`


def pressure(drive):
    """At the focal point, of all transducers alike."""
    place = np.array([[x, y, 0.0] for x, y in drive]) * 1e-3
    delay, level = np.array(list(drive.values())).T
    flight = np.linalg.norm(place - FOCUS, axis=1) * CARRIER / SPEED_OF_SOUND
    return abs(np.sum(level * np.exp(-2j * np.pi * (delay + flight))))


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


@pytest.mark.exhaustive(after=1)
def test_an_unplugged_board_was_playing_until_then(played):
    array, steps = played
    frames, time_ns = steps["unplug"]
    assert len(loud(array, frames[-40:]))
    assert np.diff(time_ns)[-1] <= 1e9 / RATES[array] * 2
