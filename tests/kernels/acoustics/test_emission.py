"""Kernels of noise against float64 oracles that step through time, one number after the other."""

import math
from itertools import pairwise

import numpy as np
import pytest
import warp as wp

from palpate.kernels.acoustics.propagation import (
    COLUMNS,
    DEPTH,
    ROWS,
    propagate_signals,
    split_lags,
    sum_late_power,
    wave_rows,
)
from palpate.kernels.acoustics.resonance import CHUNK, DeviceFrames, emit_frames

CARRIER = 40_000.0
POLES = {"at once": 0j, "1 kHz": np.exp(-2 * np.pi * 1000 / CARRIER), "detuned": np.exp((-5322 - 1326j) / CARRIER)}


def respond(delay: np.ndarray, level: np.ndarray, period_count: int, rate: float, pole: complex) -> np.ndarray:
    """One-pole low-pass of each transducer's drive, from rest; complex128, shape [transducer, period]."""
    state = np.zeros(delay.shape[1], complex)
    out = np.empty((delay.shape[1], period_count), complex)
    for t in range(period_count):
        frame = math.floor(t * rate + 1e-6)
        drive = level[frame] * np.exp(-2j * np.pi * delay[frame] / 256)
        state = drive + pole * (state - drive)
        out[:, t] = state
    return out


def emitted(device, frames, *, rate, pole, spans):
    """The same by the kernel, in spans of periods that follow each other."""
    delay, level = frames
    parts = []
    given = DeviceFrames(wp.array(delay, device=device), wp.array(level, device=device))
    for begin, end in spans:
        out = wp.empty((2 * delay.shape[1], end - begin), dtype=wp.float32, device=device)
        emit_frames(given, rate=rate, pole=complex(pole), begin=begin, end=end, origin=begin, out=out)
        parts.append(out.numpy())
    signal = np.concatenate(parts, axis=1)
    return signal[: delay.shape[1]] + 1j * signal[delay.shape[1] :]


@pytest.mark.parametrize("rate", [1.0, 0.25, 88.7 / CARRIER * 40])
@pytest.mark.parametrize("name", POLES)
def test_emitted_amplitudes_are_those_of_a_low_pass(name, rate, device, rng):
    period_count, transducer_count = 3 * int(CHUNK) + 17, 35  # two whole groups of lanes and a part
    frame_count = math.ceil(period_count * rate) + 1
    frames = rng.integers(0, 256, (frame_count, transducer_count), np.uint8), rng.random(frame_count, np.float32)
    exact = respond(*frames, period_count, rate, POLES[name])
    found = emitted(device, frames, rate=rate, pole=POLES[name], spans=[(0, period_count)])
    assert np.abs(found - exact).max() < 1e-6


def test_spans_change_no_bit(device, rng):
    period_count = 2 * int(CHUNK) + 300
    frames = rng.integers(0, 256, (period_count, 16), np.uint8), rng.random(period_count, np.float32)
    pole = POLES["1 kHz"]
    whole = emitted(device, frames, rate=1.0, pole=pole, spans=[(0, period_count)])
    cut = [0, 100, int(CHUNK), int(CHUNK) + 1, period_count]
    assert np.array_equal(emitted(device, frames, rate=1.0, pole=pole, spans=list(pairwise(cut))), whole)


def test_power_arrives_late_and_linear_between_periods(device, rng):
    source_count, columns, skip = 37, 700, 40
    signal = rng.normal(size=(2 * source_count, columns)).astype(np.float32)
    lag, weight = rng.uniform(0, skip - 2, source_count), rng.uniform(0, 1, source_count)
    lag[:2] = 0, 5
    whole, share = split_lags(lag, weight)
    out = wp.empty(columns - skip, dtype=wp.float32, device=device)
    sum_late_power(
        wp.array(signal, device=device),
        wp.array(whole, device=device),
        wp.array(share, dtype=wp.vec2, device=device),
        skip=skip,
        out=out,
    )
    power = signal[:source_count].astype(float) ** 2 + signal[source_count:].astype(float) ** 2
    time = np.arange(columns)
    exact = sum(weight[n] * np.interp(time[skip:] - lag[n], time, power[n]) for n in range(source_count))
    assert out.numpy() == pytest.approx(exact, rel=1e-5)


def test_signals_propagate_by_the_complex_matrix(device, rng):
    places, transducers, columns = ROWS, DEPTH, COLUMNS
    waves = rng.normal(size=(places, transducers)) + 1j * rng.normal(size=(places, transducers))
    signal = rng.normal(size=(transducers, columns)) + 1j * rng.normal(size=(transducers, columns))
    out = wp.empty((2 * places, columns), dtype=wp.float32, device=device)
    given = wp.array(np.concatenate([signal.real, signal.imag]).astype(np.float32), device=device)
    propagate_signals(wp.array(wave_rows(waves), device=device), given, out=out)
    found = out.numpy()
    assert np.abs(found[:places] + 1j * found[places:] - waves @ signal).max() < 1e-4
