"""Slow fields and solvers in float64, by complex matrices: one frame at a time, nothing shared with the kernels."""

import numpy as np
from scipy.special import j1


def wave_matrix(points, position, normal, *, wavelength, radius):
    """Pressure of each transducer at each point at drive 1, complex, [..., point, transducer]; exp(+j w t)."""
    between = points[..., :, None, :] - position
    distance = np.linalg.norm(between, axis=-1)
    cosine = (between * normal).sum(axis=-1) / distance
    x = 2 * np.pi * radius / wavelength * np.sqrt(np.maximum(1 - cosine**2, 0))
    directivity = np.where(x < 1e-6, 1.0, 2 * j1(x) / np.where(x < 1e-6, 1.0, x))
    return directivity / distance * np.exp(-2j * np.pi * distance / wavelength)


def pressure_of(waves, delay, amplitude=1.0):
    """Complex pressure at each point, [..., point], of drives exp(-2 pi j delay), delay [turns], [..., transducer]."""
    return np.einsum("...mn,...n->...m", waves, amplitude * np.exp(-2j * np.pi * delay))


def unit(z):
    return z / np.abs(z)


def solve_frame(waves, target, *, gs_pat, wgs):
    """Delays [turns] of one frame, [transducer]: naive, then GS-PAT, then WGS, as many iterations as asked for."""
    back = waves.conj().T / (np.abs(waves) ** 2).sum(axis=1)
    p = target.astype(complex)
    if gs_pat:
        for _ in range(gs_pat):
            y = waves @ back @ p
            p = target * unit(y)
        p = target**2 * y / np.abs(y) ** 2 / (np.abs(waves) ** 2).sum(axis=1)
    weight, power = np.abs(p), 0.5 if np.count_nonzero(target) == 2 else 1.0
    for _ in range(wgs):
        reached = waves @ unit(waves.conj().T @ p)
        weight = weight * (target / np.abs(reached)) ** power
        weight /= weight.max()
        p = weight * unit(reached)
    return -np.angle(waves.conj().T @ p) / (2 * np.pi) % 1.0


def lock_gauge(delay):
    """Delays turned frame by frame so that each is in phase with the one before, [frame, transducer]."""
    out = delay.astype(float).copy()
    for f in range(1, len(out)):
        along = np.exp(-2j * np.pi * out[f]) @ np.exp(2j * np.pi * out[f - 1])
        out[f] = (out[f] + np.angle(along) / (2 * np.pi)) % 1.0
    return out


def limit_slew(target, step, start):
    """Delays [turns] that move at most `step` a frame towards the target, the short way; first from `start`."""
    out, now = [], start.astype(float).copy()
    for wanted in target:
        way = (wanted - now + 0.5) % 1.0 - 0.5
        now = (now + np.clip(way, -step, step)) % 1.0
        out.append(now)
    return np.array(out)


def amplitude_error(waves, delay, target):
    """RMS over the points of |p| / (s T) - 1 with the scale s that fits best in the mean, [frame]."""
    reached = np.abs(pressure_of(waves, delay)) / target
    return np.sqrt(((reached / reached.mean(axis=-1, keepdims=True) - 1) ** 2).mean(axis=-1))
