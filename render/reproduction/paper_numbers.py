"""What the founding paper reports: its numbers, with the section that has each, and rows that put palpate's beside."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..reports.report_pages import ReportTable

ROW_HEAD = ("result", "paper", "palpate", "why they differ")


class ReportRow(NamedTuple):
    """One result of the paper beside palpate's."""

    what: str
    paper: str
    ours: str
    why: str
    """Why the two differ, or may."""


def compared(rows: Sequence[ReportRow]) -> ReportTable:
    """The table of these rows, without a title: it stands right below the section's text."""
    return ReportTable("", ROW_HEAD, tuple(rows), "compare")


SOURCE = (
    "Mulot, Howard, Emery, Pacchierotti, Marchal: Designing 3D Object Rendering Techniques for Ultrasound Mid-Air "
    "Haptics using Intersection Strategies, SAP 2024, doi 10.1145/3675231.3675235"
)

EXPLORER_COUNT = 18
"""Participants of the user study (6.1.4)."""
BLOCK_COUNT = 2
"""Blocks of each participant and object: an opaque and a transparent picture of it (6.1.2)."""
REPETITION_COUNT = 10
"""Explorations with CC in a block: five of each order of OC and CC (6.1.2)."""
EXPLORATION_SECONDS = 7.0
"""Of each exploration [s] (6.1.2)."""
SPEED = 7.0
"""Of the focal point [m/s] (4.2)."""

RATIOS = {"cube": 2.54, "tube": 1.48, "dog": 1.36}
"""Means of r by object: the white diamonds of figure 6C, read off the vectors of the PDF."""
ALPHA = 0.001
"""Every pair of objects differs in r at this level, by Wilcoxon tests with Holm's correction (6.2)."""

RAW_SECONDS, PRUNE_SECONDS = 1e-3, 0.2e-3
"""Of raw intersection and pruning [s], per 100 faces of the mesh: C# on an i7-12700H (4.3.1)."""
CLOSE_SECONDS = 0.1e-3
"""Of closing contours [s], at most, in all (4.3.1)."""

OBJECTS = ("tube", "dog", "cube", "sphere", "rock")
"""Of figure 5B, in its order."""

RECORDING_SECONDS = 30.0
"""Of each of ten recordings of noise [s] (4.3.2)."""
NOISE_RMS, NOISE_PEAK = 0.54, -1.9
"""OC louder than CC by this [dB], neither different from 0 (4.3.2)."""
NOISE_BANDS = {"db_300_10k": 5.9, "db_40_300": 0.0, "dba": 5.6}
"""OC louder than CC by this [dB], from sums over all bins of figures 4A and 4B, read off the vectors of the PDF."""


BIN = 44100.0 / 1024.0
"""Width of a bin of figure 4 [Hz]: the corners of its curves are as far apart as the bins of a Fourier transform of
1,024 samples at 44.1 kHz."""

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
"""Figures 4A (CC) and 4B (OC): audible spectra while a cube is explored. The curves in the authors' PDF are vectors;
these are 30 of their 510 bins, about evenly spaced on a logarithmic axis, each as it stands in the PDF, rounded to
0.1 dB. Levels are relative: the paper gives no reference."""


def paper_spectra() -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Frequencies [Hz], levels of CC and levels of OC [dB], each float64, shape [point]."""
    points = np.array(POINTS, np.float64)
    return points[:, 0] * BIN, points[:, 1], points[:, 2]
