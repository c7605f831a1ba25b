"""Time of audible noise: 30 s of a circle at 40 kHz from 256 transducers, by each kind of source.

    python benchmarks/noise.py [--seconds 30] [--device cuda:0]

On the CPU: processor time of one thread of BLAS (set OPENBLAS_NUM_THREADS=1). On CUDA: wall time, frames on the host
(`listen`), and of the kernels alone with the frames on the device. `convergence` is the level from 300 Hz to 10 kHz of
the circle with more and more sources; each row is a mean over five sets of places, and their spread.
"""

import argparse
import json
import time

import numpy as np
import warp as wp

from palpate.device import array_model
from palpate.kernels.acoustics.resonance import DeviceFrames
from palpate.render import NoiseListener, NoiseModel, NoiseSpectrum, PlayedFrames

RATE = 40_000.0
CASES = {
    "transducers": NoiseModel(kind="transducers"),
    "beam, 300 sources": NoiseModel(sources=300),
    "beam, 300 sources, late": NoiseModel(sources=300, is_late=True),
    "beam, 20,000 sources": NoiseModel(sources=20_000),
}
SOURCES = (100, 300, 1000, 3000, 10_000, 30_000)


def circle(seconds: float, radius: float = 0.04) -> PlayedFrames:
    """A focal point on a circle 20 cm up, at 7 m/s, at 40 kHz."""
    turn = 7.0 / radius * np.arange(round(seconds * RATE)) / RATE
    position = array_model("emulator").position
    delay = np.empty((len(turn), len(position)), np.uint8)
    for first in range(0, len(turn), 1 << 14):
        part = turn[first : first + (1 << 14)]
        place = np.column_stack([radius * np.cos(part), radius * np.sin(part), np.full(len(part), 0.2)])
        distance = np.sqrt(((place[:, None] - position) ** 2).sum(axis=2))
        delay[first : first + len(part)] = np.rint(-distance * (RATE / 343 * 256)).astype(np.int64) & 0xFF
    return PlayedFrames(delay, np.ones(len(turn), np.float32), RATE)


def measure(name: str, frames: PlayedFrames, device: str, repeats: int) -> dict[str, float]:
    """Median seconds of listening to the frames, and of that on frames which are on the device already."""
    listener = NoiseListener("emulator", CASES[name], device=device)
    on_cuda = wp.get_device(device).is_cuda
    clock = time.perf_counter if on_cuda else time.process_time
    listener.listen(PlayedFrames(frames.delay[:8000], frames.level[:8000], RATE))  # compiles
    seconds, resident = [], []
    for _ in range(repeats):
        start = clock()
        listener.listen(frames)
        seconds.append(clock() - start)
        there = DeviceFrames(wp.array(frames.delay, device=device), wp.array(frames.level, device=device))
        wp.synchronize_device(device)
        start = clock()
        listener.hear(there, RATE)
        wp.synchronize_device(device)
        resident.append(clock() - start)
    return {"seconds": float(np.median(seconds)), "resident_seconds": float(np.median(resident))}


def convergence(frames: PlayedFrames, counts: tuple[int, ...], device: str) -> list[dict[str, float]]:
    """Level and spread by the number of sources."""
    rows = []
    for count in counts:
        levels = [
            NoiseSpectrum.of(
                NoiseListener("emulator", NoiseModel(sources=count, seed=seed), device=device).listen(frames)
            ).band(300, 10_000)
            for seed in range(5)
        ]
        rows.append({"sources": count, "level": float(np.mean(levels)), "spread": float(np.std(levels, ddof=1))})
    return rows


def main() -> None:
    """Print one JSON object."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--repeats", type=int, default=3)
    given = parser.parse_args()
    frames = circle(given.seconds)
    figures = {name: measure(name, frames, given.device, given.repeats) for name in CASES}
    levels = convergence(circle(0.5), SOURCES, given.device)
    print(json.dumps({"device": wp.get_device(given.device).name, "times": figures, "convergence": levels}, indent=1))


if __name__ == "__main__":
    main()
