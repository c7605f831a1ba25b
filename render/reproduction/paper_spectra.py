"""Figure 4 of the founding paper as 30 points: audible spectra while a cube is explored with CC and with OC.

Source: the curves of figures 4A (CC) and 4B (OC) in the authors' PDF are vectors; their corners lie 44100 / 1024 Hz
apart, as those of a Fourier transform of 1,024 samples at 44.1 kHz do. 30 of the 510 bins, about evenly spaced on a
logarithmic axis, each as it stands in the PDF, rounded to 0.1 dB. Levels are relative: the paper gives no reference.
"""

import numpy as np
from numpy.typing import NDArray

BIN = 44100.0 / 1024.0
"""Width of a bin [Hz]."""

POINTS: tuple[tuple[int, float, float], ...] = (
    # bin, CC [dB], OC [dB]
    (1, -31.1, -32.0),
    (2, -29.7, -29.5),
    (3, -30.6, -30.6),
    (4, -32.8, -32.4),
    (5, -35.7, -35.6),
    (6, -38.4, -37.6),
    (7, -41.0, -39.6),
    (8, -43.5, -41.0),
    (9, -46.2, -42.4),
    (11, -52.0, -44.8),
    (13, -56.3, -45.9),
    (15, -57.8, -46.9),
    (17, -58.5, -47.7),
    (19, -60.0, -47.9),
    (22, -61.9, -47.7),
    (25, -60.0, -48.7),
    (29, -63.0, -50.7),
    (34, -65.8, -52.3),
    (39, -64.5, -52.4),
    (45, -66.2, -53.1),
    (52, -69.0, -53.9),
    (60, -66.2, -55.3),
    (70, -67.8, -58.8),
    (81, -67.4, -60.0),
    (93, -70.6, -63.9),
    (110, -69.5, -66.5),
    (139, -72.6, -70.5),
    (174, -71.3, -70.8),
    (203, -73.2, -72.5),
    (232, -73.1, -72.8),
)


def paper_spectra() -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Frequencies [Hz], levels of CC and levels of OC [dB], each float64, shape [point]."""
    points = np.array(POINTS, np.float64)
    return points[:, 0] * BIN, points[:, 1], points[:, 2]
