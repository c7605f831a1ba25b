"""The array `sonicsurface`, as a value."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...array import ArrayModel
from ...array_kind import ArrayKind, EmulationRequest, LinkRequest
from ...transports.serial_line import SerialPorts
from .geometry import BAUD_PUBLISHED, sonicsurface_model
from .layout import LAYOUT
from .link import SonicLink

if TYPE_CHECKING:
    from .serial_side import SonicPorts


def _open_link(model: ArrayModel, request: LinkRequest) -> SonicLink:
    ports = request.backend if isinstance(request.backend, SerialPorts) else None
    return SonicLink.open(model, serial=request.serial, ports=ports, clock=request.clock)


def _emulate(request: EmulationRequest) -> SonicPorts:
    from .model import BAUD  # who plays to a real board needs no model of one
    from .serial_side import SonicPorts

    # boards with the published firmware do not sample at exactly the rate that hosts send at
    baud = BAUD if request.baud is None or request.baud == BAUD_PUBLISHED else request.baud
    return SonicPorts(request.serials or ("SONEMU01",), clock=request.clock, record=request.record, baud=baud)


KIND = ArrayKind(
    name="sonicsurface",
    aliases=("sonic-surface",),
    build=sonicsurface_model,
    layout=LAYOUT,
    open_link=_open_link,
    takes_baud=True,
    emulate=_emulate,
)
