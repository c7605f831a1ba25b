"""Audible noise of OC and CC over explorers of the cube: models of noise beside each other, and what makes it quieter.

    python benchmarks/noise_study.py FOLDER --explorers 10 --seconds 30      # renders into FOLDER what is not there
    python benchmarks/noise_study.py FOLDER --device cuda:0                  # and listens

Prints two JSON objects. For each model: the differences OC - CC [dB] (mean and standard deviation over explorers), and
the RMS distance of OC's spectrum from the founding paper's Fig. 4B over 300 to 4,000 Hz, both at the same mean level.
For each remedy: the levels of OC and CC less those of plain CC.
"""

import argparse
import json
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from os import sched_getaffinity
from pathlib import Path

import numpy as np
import warp as wp

from palpate.render import (
    Driver,
    DriveStrategy,
    MeshObject,
    NoiseListener,
    NoiseModel,
    NoiseSpectrum,
    Palm,
    PlayedFrames,
    Resonance,
    Sampler,
    SamplingStrategy,
    level_differences,
    load_contours,
    load_rig,
    load_sampling,
    load_strategy,
    record,
    sample_contours,
)
from palpate.render.acoustics.prediction import frames_of
from palpate.render.reproduction.paper_numbers import paper_spectra

UPDATE_RATE = 40_000.0  # [Hz] the paper's device's
SHAPE_BAND = (300.0, 4000.0)  # [Hz]
MODELS = {
    "beam": NoiseModel(),
    **{f"beam, {count:,} sources": NoiseModel(sources=count) for count in (100, 300, 1000, 10_000, 50_000)},
    **{f"beam, other places {seed}": NoiseModel(seed=seed) for seed in (1, 2, 3)},
    "beam, 1,000 sources, later if farther": NoiseModel(sources=1000, is_late=True),
    "beam, box of 30 x 30 x 48 cm": NoiseModel(box=((-0.15, -0.15, 0.02), (0.15, 0.15, 0.5))),
    "beam, slab of 4 cm at the hand": NoiseModel(box=((-0.085, -0.085, 0.18), (0.085, 0.085, 0.22))),
    **{f"beam, pole {pole} Hz": NoiseModel(resonance=Resonance(pole=pole)) for pole in (300, 500, 700, 1400, 2000)},
    "beam, pole 847 Hz, detuned by -211 Hz": NoiseModel(resonance=Resonance(847.0, -211.0)),
    "beam, microphone 15 cm from the middle": NoiseModel(microphone=(0.15, 0.0, 0.07)),
    "transducers": NoiseModel(kind="transducers"),
    "transducers, pole 847 Hz, detuned by -211 Hz": NoiseModel(kind="transducers", resonance=Resonance(847.0, -211.0)),
}
STM = replace(load_sampling("stm"), update_rate=UPDATE_RATE)
DIP = 1e-3  # [s] half of a dip of the amplitude at a jump
Remedy = tuple[str, SamplingStrategy, DriveStrategy]
"""Suffix of the file, or what else is done; how contours become focal points, and these drives."""
REMEDIES: dict[str, Remedy] = {
    "plain": ("", STM, DriveStrategy()),
    "restart at every pose": ("restart", STM, DriveStrategy()),
    "amplitude dips for 2 ms at jumps": ("dip", STM, DriveStrategy()),
    "pendulum": ("", replace(STM, gap=replace(STM.gap, kind="pendulum")), DriveStrategy()),
    "return at 14 m/s": ("", replace(STM, gap=replace(STM.gap, kind="return", speed=14.0)), DriveStrategy()),
    "return at 30 m/s": ("", replace(STM, gap=replace(STM.gap, kind="return", speed=30.0)), DriveStrategy()),
    "return at 60 m/s": ("", replace(STM, gap=replace(STM.gap, kind="return", speed=60.0)), DriveStrategy()),
    "slew 4/256": ("", STM, DriveStrategy(slew=4 / 256)),
    "slew 8/256": ("", STM, DriveStrategy(slew=8 / 256)),
    "pendulum and slew 4/256": ("", replace(STM, gap=replace(STM.gap, kind="pendulum")), DriveStrategy(slew=4 / 256)),
    "no fade": ("", replace(STM, fade=0.0), DriveStrategy()),
    "poses interpolated to 1 mm": ("dense", STM, DriveStrategy()),
    "10 kHz update rate": ("", replace(STM, update_rate=10_000.0), DriveStrategy()),
}


def render_files(folder: Path, explorers: int, seconds: float) -> None:
    """Contours of the cube for each explorer: OC, CC, and both with poses in between; those that are there stay."""
    from palpate.render import exploration
    from palpate.render.playback.pose_insertion import insert_poses

    folder.mkdir(parents=True, exist_ok=True)
    cube = MeshObject.load("cube")
    for explorer in range(1, explorers + 1):
        motion = exploration(cube, duration=seconds, explorer=explorer, seed=1)
        for suffix in ("", "-dense"):
            for name in ("oc", "cc"):
                path = folder / f"{name}-{explorer}{suffix}.h5"
                if path.exists():
                    continue
                hand = Palm()
                strategy = load_strategy(name)
                dense = insert_poses(cube, hand, motion, strategy, distance=1e-3) if suffix else motion
                record(path, cube, hand, dense, strategy)


def _frames(path: Path, how: str, sampling: SamplingStrategy, drive: DriveStrategy, device: str) -> PlayedFrames:
    """Frames of a contour file; how: restart (the focal point begins anew at each pose), dip, or neither."""
    if how == "restart":
        return _restarted(path, sampling)
    frames = frames_of(path, load_rig("emulator"), sampling=sampling, drive=drive, device=device)
    return _dipped(frames) if how == "dip" else frames


def _restarted(path: Path, sampling: SamplingStrategy) -> PlayedFrames:
    batch = load_contours(path)
    time = np.append(batch.motion.time, batch.motion.duration + np.diff(batch.motion.time).mean())
    ends = np.rint(time * sampling.update_rate).astype(int)
    driver, delay, level = Driver("emulator"), [], []
    for k in range(len(batch)):
        seconds = (ends[k + 1] - ends[k]) / sampling.update_rate
        blocks = sample_contours(
            [batch[k : k + 1]], batch.motion.pose[k : k + 1], np.zeros(1), seconds, Sampler(sampling)
        )
        for focus in blocks:
            rounded = driver.rounded(focus)
            delay.append(rounded.delay.numpy())
            level.append(rounded.amplitude.numpy())
    return PlayedFrames(np.concatenate(delay), np.concatenate(level), sampling.update_rate)


def _dipped(frames: PlayedFrames) -> PlayedFrames:
    """The amplitude goes down to 0 and up again around each step in which phases change by 0.1 turn on average."""
    step = np.abs(np.diff(frames.delay, axis=0).astype(np.int8).astype(np.float32)).mean(axis=1) / 256
    half = round(DIP * frames.update_rate)
    window = 0.5 + 0.5 * np.cos(np.pi * np.arange(-half, half + 1) / half)
    level = frames.level.astype(np.float32).copy()
    for jump in np.flatnonzero(step > 0.1) + 1:
        low, high = max(jump - half, 0), min(jump + half + 1, len(level))
        level[low:high] *= 1 - window[low - jump + half : high - jump + half].astype(np.float32)
    return PlayedFrames(frames.delay, level, frames.update_rate)


def frames_in_parallel(
    jobs: list[tuple[Path, str, SamplingStrategy, DriveStrategy]], device: str
) -> Iterator[PlayedFrames]:
    """Frames of each job in order, made by a process for each core; device: of slew limits."""
    with ProcessPoolExecutor(len(sched_getaffinity(0)), mp_context=get_context("spawn")) as pool:
        pending = [pool.submit(_frames, *job, device) for job in jobs]
        for future in pending:
            yield future.result()


def shape_error(spectra: list[NoiseSpectrum]) -> float:
    """RMS distance of the mean spectrum from the paper's OC [dB], both at the same mean level."""
    at, _, paper = paper_spectra()
    inside = (at >= SHAPE_BAND[0]) & (at <= SHAPE_BAND[1])
    power = np.mean([spectrum.power for spectrum in spectra], axis=0)
    level = 10 * np.log10(np.maximum(power, 1e-30))
    return float((np.interp(at[inside], spectra[0].frequency, level) - paper[inside]).std())


def weighted(spectrum: NoiseSpectrum, derivative: int) -> NoiseSpectrum:
    """The spectrum of a derivative of the signal, but for a factor."""
    return NoiseSpectrum(spectrum.frequency, spectrum.power * spectrum.frequency ** (2 * derivative), spectrum.peak)


def compared(oc: list[NoiseSpectrum], cc: list[NoiseSpectrum]) -> dict[str, dict[str, float] | float]:
    """Mean and standard deviation of each difference, and the shape of OC."""
    rows = [level_differences(one, other) for one, other in zip(oc, cc, strict=True)]
    row: dict[str, dict[str, float] | float] = {
        name: {"mean": float(np.mean([r[name] for r in rows])), "sd": float(np.std([r[name] for r in rows], ddof=1))}
        for name in rows[0]
    }
    return {**row, "shape": shape_error(oc)}


def study(folder: Path, explorers: int, device: str) -> Iterator[dict[str, object]]:
    """All models on plain frames, then all remedies with the first model."""
    numbers = range(1, explorers + 1)
    heard: dict[tuple[str, str], list[NoiseSpectrum]] = {}
    models = {name: NoiseListener("emulator", model, device=device) for name, model in MODELS.items()}
    plain = [(folder / f"{name}-{k}.h5", "", STM, DriveStrategy()) for name in ("oc", "cc") for k in numbers]
    for (path, *_), frames in zip(plain, frames_in_parallel(plain, device), strict=True):
        for name, listener in models.items():
            heard.setdefault((name, path.name[:2]), []).append(listener.listen(frames).spectrum())
    found = {name: compared(heard[name, "oc"], heard[name, "cc"]) for name in MODELS}
    for derivative in (1, 2):
        oc, cc = ([weighted(one, derivative) for one in heard["beam", strategy]] for strategy in ("oc", "cc"))
        found[f"beam, time derivative {derivative}"] = compared(oc, cc)
    spectra = {name: np.mean([one.power for one in heard["beam", name]], axis=0).tolist() for name in ("oc", "cc")}
    yield {
        "device": wp.get_device(device).name,
        "models": found,
        "spectra": {"frequency": heard["beam", "oc"][0].frequency.tolist(), **spectra},
    }
    yield {"remedies": remedies(folder, numbers, models["beam"], heard["beam", "cc"], device)}


def remedies(
    folder: Path, numbers: range, listener: NoiseListener, reference: list[NoiseSpectrum], device: str
) -> dict[str, dict[str, dict[str, float]]]:
    """Mean levels of OC and CC with each remedy less those of plain CC [dB]."""
    jobs = [
        (name, strategy, k, (folder / f"{strategy}-{k}{'-dense' if how == 'dense' else ''}.h5", how, sampling, drive))
        for name, (how, sampling, drive) in REMEDIES.items()
        for strategy in ("oc", "cc")
        for k in numbers
    ]
    rows: dict[str, dict[str, list[dict[str, float]]]] = {}
    for (name, strategy, k, _), frames in zip(jobs, frames_in_parallel([job[-1] for job in jobs], device), strict=True):
        levels = level_differences(listener.listen(frames).spectrum(), reference[k - 1])
        rows.setdefault(name, {}).setdefault(strategy, []).append(levels)
    return {
        name: {
            strategy: {key: float(np.mean([one[key] for one in levels])) for key in levels[0]}
            for strategy, levels in of.items()
        }
        for name, of in rows.items()
    }


def main() -> None:
    """Render what is not there; listen if a device is given."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--explorers", type=int, default=10)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--device")
    given = parser.parse_args()
    if given.device is None:
        render_files(given.folder, given.explorers, given.seconds)
        return
    for part in study(given.folder, given.explorers, given.device):
        print(json.dumps(part), flush=True)


if __name__ == "__main__":
    main()
