"""Audible noise: silence, a still focus, known modulations, and what must not matter."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import refused, run
from scipy.io import wavfile

from palpate.device import array_model
from palpate.render import (
    MeshObject,
    NoiseListener,
    NoiseModel,
    NoiseSignal,
    NoiseSpectrum,
    Palm,
    PlacedArray,
    PlayedFrames,
    Resonance,
    StrategyError,
    exploration,
    level_differences,
    predict_noise,
    render,
    static_pose,
    write_wave_files,
)
from palpate.render.acoustics.spectrum import a_weight
from palpate.render.acoustics.transducers import TransducerSet

RATE = 40_000.0
LIGHT = NoiseModel(sources=20)
"""Few sources: seconds less to compute."""
FACE = (0.00525, 0.00525, 0.0)  # a transducer's
X9 = np.ones(9)


def frames_of_level(level: np.ndarray, transducers: int = 256) -> PlayedFrames:
    return PlayedFrames(np.zeros((len(level), transducers), np.uint8), level.astype(np.float32), RATE)


def moving_focus(radius: float, seconds: float = 0.12, jump: bool = False) -> PlayedFrames:
    """A circle, or a line that restarts, 20 cm up at 7 m/s; delays by the closed form."""
    count = round(seconds * RATE)
    way = 7.0 * np.arange(count) / RATE
    if jump:
        place = np.column_stack([(way % (4 * radius)) - 2 * radius, np.zeros(count), np.full(count, 0.2)])
    else:
        turn = way / radius
        place = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), np.full(count, 0.2)])
    position = array_model("emulator").position.astype(float)
    distance = np.linalg.norm(place[:, None] - position, axis=2)
    return PlayedFrames(
        np.rint(-distance / (343 / RATE) * 256).astype(int).astype(np.uint8), np.ones(count, np.float32), RATE
    )


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("noise")
    cube = MeshObject.load("cube")
    motion = exploration(cube, duration=1.5, seed=3)
    return {name: render(cube, Palm(), motion, name).save(folder / f"{name}.h5") for name in ("oc", "cc")}


@pytest.mark.parametrize("kind", ["beam", "transducers"])
def test_silence_and_a_still_focus_make_no_sound(kind):
    listener = NoiseListener("emulator", NoiseModel(kind=kind, sources=50))
    assert not listener.listen(frames_of_level(np.zeros(8000))).samples.any()
    still = listener.listen(frames_of_level(np.ones(8000))).samples
    assert np.ptp(still[1000:]) < 1e-5 * still.max()


def test_a_known_modulation_is_heard_as_its_square_through_the_pole():
    """1 + m sin through a low-pass H, squared: 2 m |H(f)| at f, m^2 |H(f)|^2 / 2 at 2 f."""
    m, f, count = 0.4, 430.6640625, 80_000  # ten bins of 44100 / 1024 Hz
    level = (1 + m * np.sin(2 * np.pi * f * np.arange(count) / RATE)) / (1 + m)
    model = NoiseModel(kind="transducers", resonance=Resonance(pole=700.0), microphone=(0, 0, 30))
    spectrum = NoiseSpectrum.of_samples(
        NoiseListener("emulator", model).listen(frames_of_level(level)).samples[4000:], RATE
    )
    gain = 1 / math.hypot(1, f / 700.0)
    expected = 20 * math.log10(2 * m * gain / (m**2 * gain**2 / 2))
    assert spectrum.band(f - 90, f + 90) - spectrum.band(2 * f - 90, 2 * f + 90) == pytest.approx(expected, abs=0.15)


def test_many_sources_are_the_same_as_each_by_itself(device):
    """More sources than transducers are added up as combinations of transducers: the same sum of squares."""
    frames, model = moving_focus(0.03), NoiseModel(sources=300)
    combined = NoiseListener("emulator", model, device=device).listen(frames).samples
    transducers = TransducerSet("emulator")
    place = model.places(transducers)
    position = transducers.position
    pole = math.exp(-2 * math.pi * 1000 / RATE)
    state, power = np.zeros(256, complex), []
    waves = transducers.waves(place)
    weight = 1 / np.linalg.norm(place - [position[:, 0].max() + 5.25e-3 + 0.15, 0, 0.07], axis=1) / 300
    for row in frames.delay[:400]:
        drive = np.exp(-2j * np.pi * row / 256)
        state = drive + pole * (state - drive)
        power.append(weight @ np.abs(waves @ state) ** 2)
    assert combined[:400] == pytest.approx(np.array(power), rel=1e-4)


def test_a_weights_are_those_of_the_standard():
    """IEC 61672-1, table of A weightings [dB] at nominal frequencies, which are 1000 * 10^(n / 10) Hz."""
    for step, decibel in {-10: -19.1, -3: -3.2, 0: 0.0, 4: 1.3, 10: -2.5}.items():
        assert 10 * math.log10(a_weight(np.array(1000 * 10 ** (step / 10)))) == pytest.approx(decibel, abs=0.06)


def test_the_spectrum_holds_all_power_and_its_bins_are_the_papers():
    rng = np.random.default_rng(5)
    spectrum = NoiseSpectrum.of_samples(rng.normal(size=150_000), 44_100.0)
    assert spectrum.frequency[1] == pytest.approx(44_100 / 1024)
    assert spectrum.band(0, 23_000) == pytest.approx(0.0, abs=0.06)  # variance 1
    twice = NoiseSpectrum.of_samples(2 * rng.normal(size=150_000), 44_100.0)
    assert level_differences(twice, spectrum)["rms"] == pytest.approx(20 * math.log10(2), abs=0.1)
    assert spectrum.with_floor(0.0).level.min() > 0


@pytest.mark.exhaustive
@pytest.mark.parametrize("kind", ["beam", "transducers"])
def test_open_contours_are_louder_where_ears_are_sensitive(kind, files):
    """The founding paper's order (4.3.2): 300 Hz to 10 kHz louder, RMS about the same; with any source of noise."""
    model = NoiseModel(kind=kind)
    oc, cc = (NoiseSpectrum.of(predict_noise(files[name], model=model)) for name in ("oc", "cc"))
    found = level_differences(oc, cc)
    assert found["db_300_10k"] > 1
    assert found["dba"] > 1
    assert abs(found["rms"]) < found["db_300_10k"]


def test_waves_share_one_gain(tmp_path):
    tone = np.sin(2 * np.pi * 1000 * np.arange(20_000) / RATE)
    heard = {tmp_path / f"{gain}.wav": NoiseSignal(gain * tone, RATE) for gain in (1, 2)}
    write_wave_files(heard)
    peak = {}
    for path, signal in heard.items():
        rate, samples = wavfile.read(path)
        assert (rate, samples.dtype) == (44_100, np.int16)
        assert len(samples) == pytest.approx(signal.duration * 44_100, abs=2)
        peak[path] = np.abs(samples.astype(int)).max()
    assert list(peak.values()) == pytest.approx([0.45 * 32767, 0.9 * 32767], abs=20)
    with pytest.raises(StrategyError, match="exists"):
        write_wave_files(heard)
    with pytest.raises(StrategyError, match=r"must end in \.wav"):
        write_wave_files({tmp_path / "a.mp3": next(iter(heard.values()))})
    with pytest.raises(StrategyError, match="nothing to hear"):
        write_wave_files({tmp_path / "b.wav": NoiseListener("emulator", LIGHT).listen(frames_of_level(np.zeros(8000)))})
    assert not (tmp_path / "b.wav").exists()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: NoiseModel(kind="skin"), "kind"),
        (lambda: NoiseModel(sources=0), "sources must lie in 1..100000, not 0"),
        (lambda: NoiseModel(box=((0, 0, 0), (1, 1, -1))), "first one below the second"),
        (lambda: NoiseModel(microphone=(0, math.nan, 0)), "microphone must be three numbers"),
        (lambda: Resonance(pole=0), "pole must lie in 10..40000 Hz, not 0"),
        (lambda: NoiseListener("emulator", NoiseModel(kind="transducers", microphone=FACE)), "from a source"),
        (lambda: NoiseListener("emulator", LIGHT).listen(frames_of_level(np.ones(100))), "0.0025 s are too"),
        (lambda: NoiseListener("autd3", LIGHT).listen(frames_of_level(np.ones(8000))), "the arrays have 249"),
        (lambda: NoiseListener([]), "arrays must be at least one"),
        (lambda: NoiseModel(seed=-1), "seed must"),
        (lambda: NoiseModel(box=5), "box must be two corners"),
        (lambda: NoiseListener(replace(array_model("emulator"), position=np.zeros((0, 3)))), "has no transducers"),
        (lambda: NoiseModel(microphone=(0.1, 0.2)), "microphone must be three numbers"),
        (lambda: NoiseModel(microphone=(1e5, 0, 0)), "up to 30"),
        (lambda: NoiseListener("emulator", replace(LIGHT, box=((-0.01, -0.01, -1e-3), (0.01,) * 3))), "no room"),
        (lambda: NoiseListener("emulator", LIGHT).listen(frames_of_level(np.full(8000, np.nan))), "one finite level"),
        (lambda: NoiseListener("pat16", LIGHT).listen(replace(frames_of_level(np.ones(99)), level=X9)), "9 levels"),
    ],
)  # fmt: skip
def test_bad_input_is_named(call, message):
    with pytest.raises(StrategyError, match=message):
        call()


@pytest.mark.exhaustive
def test_the_command_compares_with_the_first_file_and_writes_what_is_asked(files, tmp_path):
    picture = tmp_path / "noise.png"
    arguments = ("noise", files["cc"], files["oc"], "--sources", "100", "--wav", "-o", picture)
    result = json.loads(run(*arguments, "--json").stdout)
    first, second = result["files"]
    assert first["difference"]["dba"] == 0
    assert second["difference"]["dba"] == pytest.approx(second["dba"] - first["dba"])
    assert second["difference"]["db_300_10k"] > 1
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert [Path(path).exists() for path in result["wav"]] == [True, True]
    refused(2, "exists", *arguments)
    refused(2, "source must be", "noise", files["cc"], "--source", "wall")
    refused(2, "does not exist", "noise", tmp_path / "no.h5")
    refused(2, "named twice", "noise", files["cc"], files["cc"])
    still = render("cube", "palm", static_pose([0, 0, 0.2]), "cc").save(tmp_path / "static.h5")
    refused(2, "holds one static pose", "noise", still)


def test_the_prediction_moves_with_the_array_and_forgets_how_it_began():
    frames, model = moving_focus(0.02, jump=True), LIGHT
    still = frames_of_level(np.ones(8000))
    here = NoiseListener("emulator", model).listen(frames).spectrum()
    turned = array_model("emulator").placed([0.3, -0.2, 1.0, 1, 0, 0, 0])
    there = NoiseListener(turned, model).listen(frames).spectrum()
    assert level_differences(there, here) == pytest.approx(dict.fromkeys(here.levels(), 0.0), abs=1e-3)
    assert NoiseListener("emulator", model).listen(still).spectrum().peak < 1e-3 * here.peak


def test_dead_transducers_are_silent_and_arrays_of_other_steps_are_refused(files):
    alive = np.arange(256) < 128
    half = replace(array_model("emulator"), gain=alive.astype(np.float32))
    frames = frames_of_level(np.ones(4800))
    heard = [
        NoiseListener(one, NoiseModel(kind="transducers")).listen(frames).samples[-1] for one in (half, "emulator")
    ]
    assert 0.3 * heard[1] < heard[0] < 0.7 * heard[1]
    rig = [PlacedArray(array_model(name)) for name in ("emulator", "pat16")]
    with pytest.raises(StrategyError, match="other steps of amplitude"):
        predict_noise(files["cc"], array=rig, duration=0.2)
