"""The script for an AUTD3, run as it stands: what the vendor's emulated array plays are palpate's own focal points."""

import ast
import runpy
import subprocess
import sys

import numpy as np
import pytest

from palpate.device.registry import array_model
from palpate.render import FocalPoints, drive_focus, exploration, export_file, render
from palpate.render.errors import StrategyError
from palpate.render.exports.autd3_script import AUTD3, CAPACITY, require_rate, write_script
from palpate.render.exports.focal_points import SampledFocus

RATE = 10e3
PERIODS = 4  # of 25 us, that a focal point is shown
LEAD_NS = 15_000_000  # less is refused


def circle(count, height=0.2):
    """A circle of 6 cm whose intensity grows."""
    angle = 2 * np.pi * np.arange(count) / count
    place = np.stack([0.03 * np.cos(angle), 0.03 * np.sin(angle) + 0.01, np.full(count, height)], axis=1)
    return FocalPoints(place.astype(np.float32), np.linspace(0, 1, count, dtype=np.float32))


def written(path, focus, rate=RATE, source="my.h5"):
    refused = write_script(path, path.with_name(source), SampledFocus(focus, rate, 0))
    return refused, path


@pytest.fixture
def vendor():
    autd3 = pytest.importorskip("autd3", reason="autd3 is not installed: nothing that the script could use")
    emulator = pytest.importorskip("autd3_emulator", reason="autd3-emulator is not installed")
    return autd3, emulator


def play(path, vendor, periods, *, loop=False, divider=PERIODS):
    """Phases [1/256 turn] and pulse widths [1/512 period] in each period of 25 us from the first focal point on."""
    autd3, emulator = vendor
    script = runpy.run_path(str(path), run_name="script")
    recorder = emulator.Recorder(script["geometry"](), 0)
    recorder.send(script["preparation"]())
    recorder.send(script["stm"](loop))
    before = 0 if loop else -(-LEAD_NS // 25_000 // divider) * divider  # at other times it waits for the next of these
    modes = autd3.value.TransitionMode
    when = modes.Immediate if loop else modes.SysTime(autd3.value.SysTime.from_nanos(before * 25_000))
    recorder.send(autd3.commands.ActivatePatternBank(autd3.value.PatternBank.B1, when))
    recorder.tick(autd3.Duration.from_nanos((before + periods) * 25_000))
    record = recorder.into_record()
    return record.phase().to_numpy().T[before:].astype(int), record.pulse_width().to_numpy().T[before:].astype(int)


def apart(phase, focus):
    """How far phases are from palpate's own [1/256 turn]; the array rounds focal points to 25 um, 3/4 of 1/256 turn."""
    own = np.rint(drive_focus(focus, array_model("autd3")).delay * 256)
    return np.abs((phase - own + 128) % 256 - 128)


@pytest.mark.exhaustive
def test_the_emulated_array_plays_palpates_focal_points_and_ends_silent(tmp_path, vendor):
    focus = circle(500)
    _, path = written(tmp_path / "a.py", focus)
    phase, width = play(path, vendor, PERIODS * 500 + 400)
    phase, width, after = phase[: PERIODS * 500], width[: PERIODS * 500], width[PERIODS * 500 :]
    for k in range(1, PERIODS):
        np.testing.assert_array_equal(phase[::PERIODS], phase[k::PERIODS])  # at 10 kHz
    assert apart(phase[::PERIODS], focus).max() <= 3
    level = np.rint(255 * focus.intensity)
    assert np.abs(width[::PERIODS] - (512 * np.arcsin(level / 255) / np.pi)[:, None]).max() <= 0.51
    assert (after == 0).all()


def test_a_loop_has_no_pause(tmp_path, vendor):
    focus = FocalPoints(circle(50).position, np.ones(50, np.float32))
    _, path = written(tmp_path / "a.py", focus)
    phase, width = play(path, vendor, PERIODS * 150, loop=True)
    assert (width == 256).all()
    first = np.flatnonzero((apart(phase[: PERIODS * 51], FocalPoints(*(part[:1] for part in focus))) <= 3).all(axis=1))[
        0
    ]
    again = phase[first : first + PERIODS * 100].reshape(2, PERIODS * 50, -1)
    np.testing.assert_array_equal(again[0], again[1])


@pytest.mark.parametrize("rate", [40e3, 40e3 / 3, 500.0])
def test_a_focal_point_is_shown_as_long_as_the_rate_says(rate, tmp_path, vendor):
    focus = circle(20)
    divider = round(40e3 / rate)
    _, path = written(tmp_path / "a.py", focus, rate)
    phase, _ = play(path, vendor, divider * 20, divider=divider)
    assert apart(phase[divider // 2 :: divider], focus).max() <= 3
    assert apart(phase[divider - 1 :: divider], focus).max() <= 3


def test_points_that_the_array_cannot_reach_are_silent_and_counted(tmp_path, vendor):
    focus = circle(10)
    focus.position[3] = 0.03, 0.0, 0.02
    focus.position[4] = 0.3, 0.0, 0.2
    refused, path = written(tmp_path / "a.py", focus)
    assert refused == 2
    _, width = play(path, vendor, PERIODS * 10)
    assert (width.reshape(10, -1).max(axis=1) == 0).nonzero()[0].tolist() == [0, 3, 4]  # 0 has intensity 0


@pytest.mark.exhaustive
def test_the_array_takes_as_many_focal_points_as_the_script_may_hold(tmp_path, vendor):
    assert AUTD3.count_most + 1 == CAPACITY
    autd3, emulator = vendor
    angle = np.arange(CAPACITY)
    place = np.stack([0.03 * np.cos(angle), 0.03 * np.sin(angle), np.full(CAPACITY, 0.2)], axis=1).astype(np.float32)
    for count, fits in ((CAPACITY - 1, True), (CAPACITY, False)):
        _, path = written(tmp_path / f"{count}.py", FocalPoints(place[:count], np.ones(count, np.float32)))
        script = runpy.run_path(str(path), run_name="script")
        recorder = emulator.Recorder(script["geometry"](), 0)
        if fits:
            recorder.send(script["stm"]())
        else:
            with pytest.raises(autd3.Autd3Error, match="exceeds capacity 65536"):
                recorder.send(script["stm"]())


def test_its_focal_points_are_the_bits_that_were_sampled(tmp_path, vendor):
    focus = circle(77)
    rows = runpy.run_path(str(written(tmp_path / "a.py", focus)[1]), run_name="script")["focal_points"]()
    np.testing.assert_array_equal(rows[:, :3], focus.position)
    np.testing.assert_array_equal(rows[:, 3], focus.intensity)


@pytest.mark.exhaustive
def test_it_runs_as_a_program_on_the_emulated_array_at_a_network_address(tmp_path, vendor):
    _, path = written(tmp_path / "a.py", circle(2000))
    done = subprocess.run(
        [sys.executable, "-P", str(path), "--emulate"], capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == "plays 2000 focal points, 0.2 s\n"


def test_a_name_that_is_code_is_not_run(tmp_path, vendor):
    source = 'x"""\nraise SystemExit("run")\n"""\'.h5'
    _, path = written(tmp_path / "a.py", circle(5), source=source)
    assert runpy.run_path(str(path), run_name="script")["SOURCE"].endswith(source)
    assert path.read_text().isascii()


def test_rates_and_counts_that_the_array_does_not_take_are_refused(tmp_path):
    assert [require_rate(rate) for rate in (40e3, 10e3, 2.0)] == [1, 4, 20_000]
    for rate, message in ((9999.0, "nearest are 8000 and 10000 Hz"), (80e3, "outside 2..40000 Hz"), (1.0, "outside")):
        with pytest.raises(StrategyError, match=message):
            require_rate(rate)
    with pytest.raises(StrategyError, match=r"1 focal point, but .* plays 2 at least"):
        written(tmp_path / "a.py", circle(1))


@pytest.mark.exhaustive
def test_a_source_named_as_a_place_of_the_script_is_only_named(tmp_path):
    """Names of what the script's text has places for; @DATA@ once broke it."""
    path = render("tube", "palm", exploration("tube", duration=0.2, seed=1), "cc").save(tmp_path / "@DATA@ @COUNT@.h5")
    out = tmp_path / "a.py"
    export_file(path, out, update_rate=8000.0)
    compile(out.read_text(), str(out), "exec")
    (line,) = [line for line in out.read_text().splitlines() if line.startswith("SOURCE")]
    assert ast.literal_eval(line.partition("=")[2].partition("  #")[0].strip()) == str(path)
