"""The array `sonicsurface`, as a value."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...array import ArrayModel
from ...array_kind import ArrayKind, EmulationRequest, LinkRequest
from ...transports.serial_line import SerialPorts
from .geometry import BAUD_PUBLISHED, sonicsurface_model
from .layout import LAYOUT

if TYPE_CHECKING:
    from .link import SonicLink
    from .serial_side import SonicPorts


def _open_link(model: ArrayModel, request: LinkRequest) -> SonicLink:
    from .link import SonicLink  # who plays to another array needs no link to this one

    ports = request.backend if isinstance(request.backend, SerialPorts) else None
    return SonicLink.open(model, serial=request.serial, ports=ports, clock=request.clock)


def _emulate(request: EmulationRequest) -> SonicPorts:
    from .model import BAUD
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
