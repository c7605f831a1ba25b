"""The array `emulator`, as a value."""

from __future__ import annotations

from ...array import ArrayModel
from ...array_kind import ArrayKind, EmulationRequest, LinkRequest
from ...transports.bulk import usb_backend
from .geometry import emulator_model
from .layout import LAYOUT
from .link import UsbLink
from .usb_side import EmulatorBackend


def _open_link(model: ArrayModel, request: LinkRequest) -> UsbLink:
    return UsbLink.open(
        model,
        serial=request.serial,
        backend=usb_backend(request.backend),
        clock=request.clock,
        transport=request.transport,
    )


def _emulate(request: EmulationRequest) -> EmulatorBackend:
    return EmulatorBackend(request.serials or ("EMU0001",), clock=request.clock, record=request.record)


KIND = ArrayKind(name="emulator", build=emulator_model, layout=LAYOUT, open_link=_open_link, emulate=_emulate)
