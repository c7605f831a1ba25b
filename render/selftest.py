"""Two stimuli that a hand should feel, for `palpate selftest`."""

from collections.abc import Iterator

import numpy as np

from ..device.array import ArrayModel, array_model
from ..device.codec import encode_frames
from ..device.emulator import EmulatorBackend
from ..device.player import Player
from ..device.usb import UsbLink
from . import console
from .drive import drive_focus
from .errors import StrategyError
from .playback import BLOCK, CLOCKS
from .sampling import FocalPoints, SamplingStrategy

MODULATION = 200.0  # [Hz], where Pacinian corpuscles are most sensitive
RADIUS = 0.02  # [m]; 7 m/s around it is 56 turns a second


def stimulus(name: str, height: float, seconds: float, sampling: SamplingStrategy) -> FocalPoints:
    """Focal points of "point" (a still focus, amplitude modulated) or "circle" (STM at constant speed)."""
    count = round(seconds * sampling.update_rate)
    time = np.arange(count) / sampling.update_rate
    position = np.tile(np.array([0.0, 0.0, height]), (count, 1))
    intensity = np.ones(count)
    if name == "point":
        intensity = 0.5 - 0.5 * np.cos(2 * np.pi * MODULATION * time)
    else:
        angle = sampling.speed / RADIUS * time
        position += RADIUS * np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)
    return FocalPoints(position.astype(np.float32), intensity.astype(np.float32))


def frames_of(focus: FocalPoints, array: ArrayModel) -> Iterator[np.ndarray]:
    """Wire bytes of focal points, block by block."""
    for first in range(0, len(focus.intensity), BLOCK):
        part = FocalPoints(focus.position[first : first + BLOCK], focus.intensity[first : first + BLOCK])
        drives = drive_focus(part, array)
        yield encode_frames(drives.delay, drives.amplitude, array=array.name)


def run_selftest(options: dict, *, as_json: bool) -> None:
    """Play both stimuli and report."""
    model = array_model(options["array"])
    zone, height, seconds = model.focal_zone, options["height"], options["seconds"]
    if not zone.z_min <= height <= zone.z_max:
        raise StrategyError(f"height must lie in {zone.z_min}..{zone.z_max} m for array {model.name}, not {height}")
    if not 0 < seconds <= 600:
        raise StrategyError(f"seconds must lie between 0 and 600, not {seconds}")
    if options["clock"] not in CLOCKS:
        raise StrategyError(f"unknown clock {options['clock']!r}; known: {', '.join(CLOCKS)}")
    backend = EmulatorBackend(clock=CLOCKS[options["clock"]]()) if model.embedded else None
    sampling = SamplingStrategy()
    results = {}
    with UsbLink.open(model, serial=options["serial"], backend=backend) as link:
        for name in ("point", "circle"):
            if not as_json:
                console.errors.print(f"{name}: hold a palm {height:g} m above the array for {seconds:g} s")
            focus = stimulus(name, height, seconds, sampling)
            results[name] = Player(link).play(frames_of(focus, model), update_rate=sampling.update_rate).as_dict()
    told = ("frames", "underruns", "board_underruns", "off_confirmed")
    values = {
        "array": model.name,
        "serial": results["point"]["serial"],
        "height": height,
        **{f"{name}_{key}": results[name][key] for name in results for key in told},
    }
    console.say(values, as_json=as_json, title="selftest: was it felt, first a point, then a circle?")
