"""Arrays and focal points for tests of drives; NumPy alone."""

import numpy as np

WAVELENGTH = 343.0 / 40e3  # [m]
RADIUS = 4.5e-3  # [m] of a piston
ARRAYS_OF_PHASES = ("emulator", "pat16", "sonicsurface", "autd3")
"""Names of the built-in arrays whose frames hold delays and levels of transducers; the others take focal points."""
SOLVERS = {"naive": (0, 0), "gs-pat": (20, 0), "wgs": (0, 20), "gs-pat+wgs": (10, 6)}


def flat_array():
    """Positions [m] and normals of 16 x 16 transducers, 10.5 mm apart, facing +z."""
    axis = (np.arange(16) - 7.5) * 10.5e-3
    y, x = np.meshgrid(axis, axis, indexing="ij")
    position = np.stack([x.ravel(), y.ravel(), np.zeros(256)], axis=1)
    return position.astype(np.float32), np.tile(np.float32([0, 0, 1]), (256, 1))


def tilted_array():
    """249 of them, leaning by 0.4 rad and moved: no multiple of 16 or 32."""
    position, normal = (a[:249] for a in flat_array())
    cosine, sine = np.cos(0.4), np.sin(0.4)
    turn = np.array([[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]])
    return (position @ turn.T + [-0.05, 0.02, 0.01]).astype(np.float32), (normal @ turn.T).astype(np.float32)


def random_foci(rng, frame_count, size):
    """Focal points [m] of frames, two wavelengths apart at least, [frame, size, 3]."""
    out = np.empty((frame_count, size, 3))
    for frame in out:
        apart = 0.0
        while apart < 2 * WAVELENGTH:
            frame[:, :2] = rng.uniform(-0.05, 0.05, (size, 2))
            frame[:, 2] = rng.uniform(0.15, 0.25, size)
            between = np.linalg.norm(frame[:, None] - frame, axis=-1)
            apart = (between + np.eye(size)).min()
    return out.astype(np.float32)


def turned(difference):
    """Differences of delays [turns], the short way, without sign."""
    return np.abs((difference + 0.5) % 1.0 - 0.5)
