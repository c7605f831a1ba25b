"""Ultraleap's STRATOS Explore ("USX"): 16 x 16 transducers at 10.3 mm.

The grid is that of Ultraleap's own simulator HandyBeam (2019, Apache-2.0, `tx_array_library.py`). Not published, and so
not known here: the transducers' pressure, their order and wiring, and the geometry of a STRATOS Inspire.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from ...array import POINT_BYTES, ArrayModel
from ...flat_arrays import flat_array, flat_grid

QUEUE_SAMPLES = 4096
"""Samples that palpate lets wait in the bridge, which has room for more: 0.1 s at 40 kHz, so that a stop is prompt."""


@cache
def stratos_model() -> ArrayModel:
    """The model with frames of one focal point, the same each time."""
    return flat_array(
        "stratos",
        flat_grid(16, 16, 10.3e-3),
        np.arange(256),
        frame_clock_reason="its library takes up to 40,000 focal points a second",
        fifo_frames=QUEUE_SAMPLES,
        frame_bytes=POINT_BYTES,
        takes_points=True,
    )
