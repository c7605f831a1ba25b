"""The array `pat16`, as a value."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ...array import ArrayModel
from ...array_kind import ArrayKind, EmulationRequest, LinkRequest
from ...transports.bulk import usb_backend
from .geometry import pat16_model
from .layout import LAYOUT

if TYPE_CHECKING:
    from .link import PatLink
    from .usb_side import PatBackend


def _open_link(model: ArrayModel, request: LinkRequest) -> PatLink:
    from .link import PatLink  # who plays to another array needs no link to this one

    return PatLink.open(
        model,
        serial=request.serial,
        backend=usb_backend(request.backend),
        clock=request.clock,
        transport=request.transport,
        uncalibrated=request.uncalibrated,
    )


def _calibration_serial(path: Path) -> str:
    from .board_file import read_pat

    return read_pat(path).serial


def _emulate(request: EmulationRequest) -> PatBackend:
    from .usb_side import PatBackend

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
