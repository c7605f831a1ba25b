"""The array `stratos`, as a value."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...array import ArrayModel
from ...array_kind import ArrayKind, EmulationRequest, LinkRequest
from ...focus_layout import FocusLayout
from .geometry import stratos_model

if TYPE_CHECKING:
    from .bridge_side import EmulatedBridge
    from .link import BridgeLink


def _open_link(model: ArrayModel, request: LinkRequest) -> BridgeLink:
    from .link import open_bridge  # who plays to another array needs no link to this one

    return open_bridge(model, request)


def _emulate(request: EmulationRequest) -> EmulatedBridge:
    from .bridge_side import EmulatedBridge

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
