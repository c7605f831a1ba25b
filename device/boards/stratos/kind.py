"""Ultraleap's STRATOS Explore ("USX"): 16 x 16 transducers at 10.3 mm.

The grid is that of Ultraleap's own simulator HandyBeam (2019, Apache-2.0, `tx_array_library.py`). Not published, and so
not known here: the transducers' pressure, their order and wiring, and the geometry of a STRATOS Inspire.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from ...array import POINT_BYTES, ArrayModel
from ...array_kind import ArrayKind, EmulationRequest, LinkRequest
from ...flat_arrays import flat_array, flat_grid
from ...wire_layout import FocusLayout

if TYPE_CHECKING:
    from .link import BridgeLink
    from .model import EmulatedBridge


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


def _open_link(model: ArrayModel, request: LinkRequest) -> BridgeLink:
    from .link import open_bridge  # who plays to another array needs no link to this one

    return open_bridge(model, request)


def _emulate(request: EmulationRequest) -> EmulatedBridge:
    from .model import EmulatedBridge

    return EmulatedBridge(request.serials or ("USX:EMULATED",), clock=request.clock, record=request.record)


KIND = ArrayKind(
    name="stratos",
    aliases=("stratos-explore", "ultraleap", "ultrahaptics", "usx"),
    build=stratos_model,
    layout=FocusLayout(),
    open_link=_open_link,
    emulate=_emulate,
    supposed="of a stratos the grid of transducers is published, but neither their pressure nor how its library finds "
    "phases: supposed are transducers as other arrays have them, exact phases for one focal point, and palpate's "
    "solver for several",
    watches_itself="palpate-ultraleap silences it when the connection ends, or nothing is heard for 0.5 s",
    not_listed="a real stratos cannot be listed: serial=HOST:PORT names the place at which its "
    "palpate-ultraleap listens",
)
