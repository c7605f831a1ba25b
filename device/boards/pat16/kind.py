"""The array `pat16`, as a value."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ...array import ArrayModel
from ...array_kind import ArrayKind, EmulationRequest, LinkRequest
from ...transports.bulk import usb_backend
from .board_file import read_pat
from .geometry import pat16_model
from .layout import LAYOUT
from .link import PatLink

if TYPE_CHECKING:
    from .usb_side import PatBackend


def _open_link(model: ArrayModel, request: LinkRequest) -> PatLink:
    return PatLink.open(
        model,
        serial=request.serial,
        backend=usb_backend(request.backend),
        clock=request.clock,
        transport=request.transport,
        uncalibrated=request.uncalibrated,
    )


def _calibration_serial(path: Path) -> str:
    return read_pat(path).serial


def _emulate(request: EmulationRequest) -> PatBackend:
    from .usb_side import PatBackend  # who plays to a real board needs no model of one

    return PatBackend(request.serials or ("PATEMU01",), clock=request.clock, record=request.record)


KIND = ArrayKind(
    name="pat16",
    aliases=("openmpd", "asierinho", "pat"),  # its makers' project, their driver, and what papers call such boards
    build=pat16_model,
    layout=LAYOUT,
    open_link=_open_link,
    calibration_serial=_calibration_serial,
    emulate=_emulate,
)
