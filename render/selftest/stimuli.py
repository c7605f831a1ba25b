"""Stimuli that a hand should feel, for `palpate selftest`."""

from contextlib import nullcontext

import numpy as np

from ...device.playing.ensemble import play_together
from ...device.playing.signals import ending_on_signals
from ..errors import StrategyError
from ..playback.drive import Driver
from ..playback.file_playback import CLOCKS, Connection
from ..playback.focal_points import PointSource
from ..playback.frames import MadeFrames
from ..playback.placed_arrays import load_rig
from ..runtime.warp_start import start_warp
from ..sampling.metrics import FocalPoints
from ..sampling.strategy import SamplingStrategy
from ..terminal import console
from ..terminal.foreign_text import print_message
from ..validation import choose, unit_hint
from .report import SelftestReport

MODULATION = 200.0  # [Hz], where Pacinian corpuscles are most sensitive
RADIUS = 0.02  # [m]; 7 m/s around it is 56 turns a second
SLOW = 2 * np.pi * RADIUS  # [m/s] once around in a second: a hand feels which way
FAST_ENOUGH = 1000.0  # [Hz] of update rate, for a circle at 7 m/s
SECONDS_MOST = 60.0  # within the limits of on-time
STIMULI = {
    "point": "a point, modulated",
    "circle": "a circle",
    "turn": "a point that goes around once a second, anticlockwise as you look down on the array",
}
SHOWN = ("frames", "underruns", "board_underruns", "off_sent", "off_confirmed")


def stimulus(name: str, height: float, seconds: float, sampling: SamplingStrategy) -> FocalPoints:
    """Focal points of a still focus, a circle (STM), or a slow turn from +x to +y; the first and last modulated.

    On slow links the modulation is a quarter of the update rate, and the circle as slow as the turn.
    """
    rate = sampling.update_rate
    count = max(round(seconds * rate), 1)
    time = np.arange(count) / rate
    position = np.tile(np.array([0.0, 0.0, height]), (count, 1))
    intensity = np.ones(count)
    if name != "circle":
        intensity = 0.5 - 0.5 * np.cos(2 * np.pi * min(MODULATION, rate / 4) * time)
    if name != "point":
        speed = sampling.speed if name == "circle" and rate >= FAST_ENOUGH else SLOW
        angle = speed / RADIUS * time
        position += RADIUS * np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)
    return FocalPoints(position.astype(np.float32), intensity.astype(np.float32))


def run_selftest(options: dict, *, as_json: bool) -> None:
    """Play them all, and report; with a report file each stimulus is asked about.

    The arrays are switched off on every way out: after each stimulus, by a signal, and by a failure.
    """
    path = options["report"]
    if path is None and options["overwrite"]:
        raise StrategyError("--overwrite means nothing without --report FILE")
    start_warp()
    arrays = load_rig(
        options["array"], serial=options["serial"], calibration=options["calibration"], baud=options["baud"]
    )
    models = [placed.model for placed in arrays]
    height, seconds = options["height"], options["duration"]
    zone = models[0].focal_zone
    if not zone.z_min <= height <= zone.z_max:
        hint = unit_hint(height, zone.z_min, zone.z_max, "m")
        span = f"{zone.z_min}..{zone.z_max} m for array {models[0].name}"
        raise StrategyError(f"height must lie in {span}, not {height}{hint}")
    if not 0 < seconds <= SECONDS_MOST:
        raise StrategyError(f"duration must lie between 0 and {SECONDS_MOST:g}, not {seconds}")
    connection = Connection(
        emulate=options["emulate"],
        clock=choose("clock", options["clock"], tuple(CLOCKS)),
        watchdog=options["watchdog"],
        uncalibrated=options["uncalibrated"],
    )
    report = None
    if path is not None:
        report = SelftestReport(path, overwrite=options["overwrite"], calibration=options["calibration"])
    sampling = SamplingStrategy(update_rate=models[0].update_rate(models[0].divider_default))
    results = {}
    with report.kept() if report else nullcontext(), ending_on_signals(), connection.all_of(arrays) as links:
        if report:
            report.describe(arrays, links, emulated=connection.emulate)
        for name, expected in STIMULI.items():
            if not as_json:
                print_message(f"{expected}: hold a palm {height:g} m above the array for {seconds:g} s")
            points = stimulus(name, height, seconds, sampling)
            frames = MadeFrames(PointSource(points, update_rate=sampling.update_rate), Driver(models))
            results[name] = play_together(links, frames, update_rate=sampling.update_rate)
            if report:
                report.add(name, expected, results[name])
    values = {
        "array": models[0].name,
        "serial": results["point"][0].serial,
        "height": height,
        **{f"{name}_{key}": getattr(reports[0], key) for name, reports in results.items() for key in SHOWN},
    }
    if len(arrays) > 1:
        values["arrays"] = [
            {"stimulus": name, **{key: getattr(report, key) for key in ("array", "serial", *SHOWN)}}
            for name, reports in results.items()
            for report in reports
        ]
    console.show_values(values, as_json=as_json, title="selftest: was it felt, a point, a circle, a slow turn?")
