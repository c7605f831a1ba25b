"""Pressure of drives at points: against the vendor's emulator of an AUTD3, limits of rounding and rate, refusals."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from field_oracles import wave_matrix

from palpate.device import array_model
from palpate.device.array import ArrayModel
from palpate.device.codec import encode_frames
from palpate.kernels.acoustics.resonance import DeviceFrames, emit_frames
from palpate.render import Driver, FocalPoints, PlayedFrames, Resonance, StrategyError, drive_focus, pressure_at
from palpate.render.acoustics.pressure import complex_drives, follow_drives, require_places
from palpate.render.acoustics.transducers import TransducerSet

FOCUS = np.array([0.03, -0.02, 0.2])


def focused(point=FOCUS, array="emulator"):
    return drive_focus(FocalPoints(np.float32([point]), np.ones(1, np.float32)), array)


def places(count=200, seed=1):
    return np.random.default_rng(seed).uniform([-0.08, -0.08, 0.05], [0.08, 0.08, 0.3], (count, 3))


def test_pressures_are_those_of_the_oracle_for_one_frame_and_for_many(device):
    model, points = array_model("emulator"), places()
    rng = np.random.default_rng(3)
    drives = (rng.normal(size=(5, 256)) + 1j * rng.normal(size=(5, 256))).astype(np.complex64)
    waves = wave_matrix(points, model.position.astype(float), model.normal, wavelength=343 / 40e3, radius=4.5e-3)
    wanted = 3.4 * drives @ waves.T
    got = pressure_at(points, drives, device=device)
    assert got.dtype == np.complex64
    assert np.abs(got - wanted).max() < 1e-4 * np.abs(wanted).max()
    single = pressure_at(points.reshape(10, 20, 3), drives[2], device=device)
    assert single.shape == (10, 20)
    assert np.abs(single.ravel() - wanted[2]).max() < 1e-4 * np.abs(wanted).max()


def test_several_arrays_add_up_and_one_gives_its_part():
    below = array_model("emulator")
    above = below.placed([0, 0, 0.4, 1, 0, 0, 0])
    focus = FocalPoints(np.float32([FOCUS]), np.ones(1, np.float32))
    drives = Driver([below, above]).drive(focus)
    both = pressure_at(places(), drives, [below, above])
    parts = Driver([below, above]).split(drives)
    apart = [pressure_at(places(), part, array) for part, array in zip(parts, (below, above), strict=True)]
    assert np.abs(both - sum(apart)).max() < 1e-5 * np.abs(both).max()
    rounded = pressure_at(places(), drives, [below, above], quantised=True)
    assert np.abs(rounded - both).max() < 5e-3 * np.abs(pressure_at(FOCUS[None], drives, [below, above])[0, 0])


def test_played_frames_and_rounded_drives_are_the_same():
    drives = focused()
    frames = PlayedFrames(np.uint8([np.floor(drives.delay[0] * 256 + 0.5) % 256]), np.ones(1, np.float32), 10e3)
    wanted = pressure_at(places(), drives, quantised=True)
    assert np.abs(pressure_at(places(), frames) - wanted).max() < 1e-5 * np.abs(wanted).max()


@pytest.mark.parametrize(("bits", "gain", "array"), [(8, 0.99998, "emulator"), (5, 0.99839, "sonicsurface")])
def test_rounded_phases_cost_what_the_literature_says(bits, gain, array):
    """sinc(2^-b), coherent gain of phases in 2^b steps: 8 bits change nothing, 5 cost 0.2 %."""
    foci = places(30)
    gains = []
    for point in foci[np.abs(foci[:, 2] - 0.15) < 0.1]:
        drives = focused(point, array)
        exact, rounded = (pressure_at(point, drives, array, quantised=q)[0] for q in (False, True))
        gains.append(abs(rounded) / abs(exact))
    assert np.sinc(2.0**-bits) == pytest.approx(gain, abs=1e-5)
    assert np.mean(gains) == pytest.approx(gain, abs=2e-4 if bits == 5 else 1e-5)


def test_resonant_transducers_follow_as_the_kernel_of_noise_has_it():
    rng = np.random.default_rng(5)
    frames = PlayedFrames(rng.integers(0, 256, (300, 256), dtype=np.uint8), np.ones(300, np.float32), 10e3)
    resonance, transducers = Resonance(), TransducerSet("emulator")
    followed = follow_drives(complex_drives(frames, transducers), resonance, carrier=40e3, update_rate=10e3)
    out = wp.zeros((512, 1200), dtype=wp.float32, device="cpu")
    on_device = DeviceFrames(wp.array(frames.delay, device="cpu"), wp.array(frames.level, device="cpu"))
    emit_frames(on_device, rate=0.25, pole=resonance.per_period(40e3), begin=0, end=1200, origin=0, out=out)
    signal = out.numpy()[:, 3::4]  # the last period of each frame
    assert np.abs(followed.T - (signal[:256] + 1j * signal[256:])).max() < 1e-5


def moving(speed, rate, duration=0.03):
    """Pressure at a focal point on a circle of 30 mm 20 cm up, over that of one at rest, mean after 5 ms."""
    turn = speed / 0.03 * np.arange(round(duration * rate)) / rate
    position = np.stack([0.03 * np.cos(turn), 0.03 * np.sin(turn), np.full(len(turn), 0.2)], axis=1)
    drives = drive_focus(FocalPoints(position.astype(np.float32), np.ones(len(turn), np.float32)), "emulator")
    transducers = TransducerSet("emulator")
    ideal = complex_drives(drives, transducers)
    slow = follow_drives(ideal, Resonance(pole=847.0), carrier=40e3, update_rate=rate)
    waves = transducers.waves(position)
    ratio = np.abs((waves * slow).sum(axis=1)) / np.abs((waves * ideal).sum(axis=1))
    return ratio[round(0.005 * rate) :].mean()


@pytest.mark.parametrize(("speed", "factor"), [(7, 0.969), (10, 0.940), (14, 0.89), (20, 0.82)])
def test_a_faster_focus_is_weaker_as_found_with_another_program(speed, factor):
    assert moving(speed, 40e3) == pytest.approx(factor, abs=0.025)


def test_the_vendors_emulator_of_an_autd3_has_the_same_pressures():
    """RMS field of autd3-emulator 0.12.0: monopoles of 275.574 Pa at 0.2 m over 4 pi, all in float32."""
    pytest.importorskip("autd3", reason="the vendor's package autd3 is not installed")
    pytest.importorskip("autd3_emulator", reason="the vendor's package autd3-emulator is not installed")
    recorder = pytest.importorskip("autd3_recorder")
    client = pytest.importorskip("palpate.device.boards.autd3.vendor_client")
    from array import array

    from palpate.device.boards.autd3.link import Autd3Link

    model = array_model("autd3")
    drives = focused(array="autd3")
    channel = recorder.RecordingChannel()
    try:
        link = Autd3Link(model, client.Controller(channel, who="autd3"))
        link.start(4)
        frames = encode_frames(np.tile(drives.delay, (200, 1)), np.ones(200), array=model)
        link.write(array("B", frames.tobytes()))
        link.drain()
        points, rms = channel.field(25_000_000, FOCUS)  # it plays from 15 to 35 ms
    finally:
        channel.dispose()
    got = pressure_at(
        points, drives, "autd3", quantised=True, piston_radius=0.0, pressure_at_1m=275.574246625 * 0.2 / (4 * np.pi)
    )
    wanted = np.sqrt(2) * rms
    error = np.abs(np.abs(got[0]) - wanted)
    assert wanted.max() > 3000
    assert error.max() < 1e-4 * wanted.max()


@pytest.mark.parametrize(
    ("point", "message"),
    [
        ([0.00525, 0.00525, 0.004], r"0\.004 m from a transducer's face, must be 0\.005 m at least"),
        ([0.0, 0.0, 0.0], "from a transducer's face"),
        ([0.0, np.nan, 0.2], r"point 0 is \[0\.0, nan, 0\.2\]: it must be finite"),
        ([0.0, 0.2], r"shape \[\.\.\., 3\]"),
    ],
)
def test_points_that_have_no_pressure_are_refused(point, message):
    with pytest.raises(StrategyError, match=message):
        pressure_at(np.array(point), focused())
    require_places(np.array([[0, 0, 0.0051], [0.1, 0, 0.0]]), TransducerSet("emulator"))  # these have one


def test_drives_that_do_not_fit_are_refused():
    model = array_model("emulator")
    empty = ArrayModel(**{**vars(model), "position": model.position[:0], "normal": model.normal[:0]})
    with pytest.raises(StrategyError, match="has no transducers"):
        pressure_at(FOCUS, focused(), empty)
    with pytest.raises(StrategyError, match=r"shape \(1, 249\), but the arrays take \[frame, 256\]"):
        pressure_at(FOCUS, np.ones(249, np.complex64))
    bad = np.ones((2, 256), np.complex64)
    bad[1, 3] = np.nan
    with pytest.raises(StrategyError, match=r"transducer 3 in frame 1 is .*: not finite"):
        pressure_at(FOCUS, bad)
    with pytest.raises(StrategyError, match="cannot be quantised"):
        pressure_at(FOCUS, np.ones(256, np.complex64), quantised=True)
    with pytest.raises(StrategyError, match=r"update_rate in 0\.\.40000 Hz, not None"):
        pressure_at(FOCUS, focused(), resonance=Resonance())


def test_transducers_of_gain_0_emit_nothing():
    """Half of an array pressed on a focal point: half the pressure, as its waves are in phase there."""
    half = replace(array_model("emulator"), gain=(np.arange(256) % 2).astype(np.float32))
    focus = np.float32([[0, 0, 0.2]])
    drives = drive_focus(FocalPoints(focus, np.ones(1, np.float32)), "emulator")
    found = [np.abs(pressure_at(focus, drives, array)).item() for array in (half, "emulator")]
    assert found[0] == pytest.approx(found[1] / 2, rel=1e-3)
