"""Two stimuli that a hand should feel, for `palpate selftest`."""

import numpy as np

from ..device.ensemble import play_together
from . import console
from .drive import Driver
from .errors import StrategyError
from .frames import FrameSource
from .playback import Connection
from .rig import load_rig
from .sampling import FocalPoints, SamplingStrategy
from .source import PointSource

MODULATION = 200.0  # [Hz], where Pacinian corpuscles are most sensitive
RADIUS = 0.02  # [m]; 7 m/s around it is 56 turns a second
TOLD = ("frames", "underruns", "board_underruns", "off_sent", "off_confirmed")


def stimulus(name: str, height: float, seconds: float, sampling: SamplingStrategy) -> FocalPoints:
    """Focal points of "point" (a still focus, amplitude modulated) or "circle" (STM at constant speed)."""
    count = max(round(seconds * sampling.update_rate), 1)
    time = np.arange(count) / sampling.update_rate
    position = np.tile(np.array([0.0, 0.0, height]), (count, 1))
    intensity = np.ones(count)
    if name == "point":
        intensity = 0.5 - 0.5 * np.cos(2 * np.pi * MODULATION * time)
    else:
        angle = sampling.speed / RADIUS * time
        position += RADIUS * np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)
    return FocalPoints(position.astype(np.float32), intensity.astype(np.float32))


def run_selftest(options: dict, *, as_json: bool) -> None:
    """Play both stimuli and report."""
    arrays = load_rig(options["array"], serial=options["serial"], calibration=options["calibration"])
    models = [placed.model for placed in arrays]
    zone, height, seconds = models[0].focal_zone, options["height"], options["seconds"]
    if not zone.z_min <= height <= zone.z_max:
        raise StrategyError(f"height must lie in {zone.z_min}..{zone.z_max} m for array {models[0].name}, not {height}")
    if not 0 < seconds <= 600:
        raise StrategyError(f"seconds must lie between 0 and 600, not {seconds}")
    connection = Connection(
        emulate=options["emulate"],
        clock=options["clock"],
        watchdog=options["watchdog"],
        uncalibrated=options["uncalibrated"],
    )
    sampling = SamplingStrategy(update_rate=models[0].update_rate(models[0].divider_default))
    results = {}
    with connection.all_of(arrays) as links:
        for name in ("point", "circle"):
            if not as_json:
                console.errors.print(f"{name}: hold a palm {height:g} m above the array for {seconds:g} s")
            frames = FrameSource(PointSource(stimulus(name, height, seconds, sampling)), Driver(models))
            results[name] = play_together(links, frames, update_rate=sampling.update_rate)[0].as_dict()
    values = {
        "array": models[0].name,
        "serial": results["point"]["serial"],
        "height": height,
        **{f"{name}_{key}": results[name][key] for name in results for key in TOLD},
    }
    console.say(values, as_json=as_json, title="selftest: was it felt, first a point, then a circle?")
