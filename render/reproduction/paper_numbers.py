"""What the founding paper reports: the numbers that palpate's are put beside, with the section that has each."""

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
