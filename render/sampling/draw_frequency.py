"""Draw frequency of poses: how often per second their contours are drawn while the pose lasts.

It is the update rate over the whole number of samples that one cycle has, as the sampler draws it: pauses and
returns included. Everything that shows a draw frequency takes it from here; sweeps compute the same on the device.
"""

from collections.abc import Iterator

import numpy as np

from ...datasets.contour_file.reader import ContourFile
from ..contour_batch import ContourBatch
from .sampler import laid_cycles
from .strategy import DEFAULT, SEAM, SamplingStrategy

POSES_AT_ONCE = 512  # whose contours are read from a file


def pose_frequencies(batch: ContourBatch, strategy: SamplingStrategy = DEFAULT) -> np.ndarray:
    """Draw frequency of each pose of a batch on the host [Hz], shape [pose]; NaN without contours, 0 if still."""
    if not needs_cycles(strategy):
        return frequencies_by_time(batch.length(), pauses_of(batch), strategy)
    cycles = laid_cycles(batch, strategy)
    return np.where(cycles["count"] > 0, strategy.update_rate / np.maximum(cycles["samples"], 1), np.nan)


def file_frequencies(file: ContourFile, rows: np.ndarray, strategy: SamplingStrategy = DEFAULT) -> np.ndarray:
    """Draw frequency of some poses of a file [Hz], shape [row]; NaN for those without contours or not done yet.

    rows: numbers of poses, increasing. Contours are read only where lengths do not decide.
    """
    out = np.full(len(rows), np.nan)
    done = np.zeros(len(rows), bool)
    for first, stop in file.done:
        done |= (rows >= first) & (rows < stop)
    if needs_cycles(strategy):
        for at, batch in _batches_of(file, rows, done):
            out[at] = pose_frequencies(batch, strategy)
        return out
    length = np.concatenate([np.zeros(0), *(file.metrics(a, b)["length"] for a, b in _runs_of(rows[done]))])
    out[done] = frequencies_by_time(length, file_pauses(file, rows[done]), strategy)
    return out


def file_pauses(file: ContourFile, rows: np.ndarray) -> np.ndarray:
    """Duration of pauses in a cycle, of some done poses of a file [s], shape [row]; reads no contours without any."""
    out = np.zeros(len(rows))
    if "dwell" in file.optional:
        for at, batch in _batches_of(file, rows, np.ones(len(rows), bool)):
            out[at] = pauses_of(batch)
    return out


def pauses_of(batch: ContourBatch) -> np.ndarray:
    """Duration of the pauses that each pose's contours have in a cycle [s], shape [pose]: at a closed one's seam once.

    Polylines without length are not drawn, so they do not pause.
    """
    if batch.dwell is None:
        return np.zeros(len(batch.pose_start) - 1)
    dwell, start = batch.dwell.astype(np.float64), batch.polyline_start
    line = np.repeat(np.arange(len(start) - 1), np.diff(start))
    step = np.linalg.norm(np.diff(batch.points.astype(np.float64), axis=0), axis=1)
    length = np.bincount(line[1:], np.where(line[1:] == line[:-1], step, 0.0), len(start) - 1)
    dwell[start[:-1][(batch.polyline_closed > 0) & (np.diff(start) > 0)]] = 0.0
    paused = np.where(length > 0, np.bincount(line, dwell, len(start) - 1), 0.0)
    pose = np.repeat(np.arange(len(batch.pose_start) - 1), np.diff(batch.pose_start))
    return np.bincount(pose, paused, len(batch.pose_start) - 1)


def needs_cycles(strategy: SamplingStrategy) -> bool:
    """Whether the samples of a cycle follow from more than lengths and the contours' own pauses."""
    return not strategy.plain and strategy.pace.kind in ("speed", "capped")


def frequencies_by_time(
    length: np.ndarray, pause: np.ndarray | float = 0.0, strategy: SamplingStrategy = DEFAULT
) -> np.ndarray:
    """Draw frequency of contours by their lengths [m] and pauses in a cycle [s]: [Hz], NaN where there are none.

    strategy: one that needs no cycles.
    """
    length = np.asarray(length, np.float64)
    seconds = length / strategy.speed + pause
    samples = np.clip(np.ceil(seconds * strategy.update_rate - SEAM), *strategy.samples_bounds)
    moves = 0.0 if strategy.pace.kind == "still" else strategy.update_rate
    return np.where(length > 0, moves / samples, np.nan)


def _runs_of(rows: np.ndarray) -> Iterator[tuple[int, int]]:
    """Ranges of consecutive numbers, at most POSES_AT_ONCE each."""
    for run in np.split(rows, np.flatnonzero(np.diff(rows) != 1) + 1):
        for k in range(0, len(run), POSES_AT_ONCE):
            part = run[k : k + POSES_AT_ONCE]
            yield int(part[0]), int(part[-1]) + 1


def _batches_of(file: ContourFile, rows: np.ndarray, done: np.ndarray) -> Iterator[tuple[np.ndarray, ContourBatch]]:
    """Contours of the done ones among some poses: which rows, and a batch of these."""
    where = np.flatnonzero(done)
    begin = 0
    for first, stop in _runs_of(rows[done]):
        yield where[begin : begin + stop - first], ContourBatch.from_arrays(file.contours(first, stop))
        begin += stop - first
