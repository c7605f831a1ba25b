"""The array `autd3`, as a value."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...array import ArrayModel
from ...array_kind import ArrayKind, LinkRequest
from .geometry import autd3_model
from .layout import LAYOUT

if TYPE_CHECKING:
    from .link import Autd3Link


def _open_link(model: ArrayModel, request: LinkRequest) -> Autd3Link:
    from .link import open_autd3  # an optional package stands behind it

    return open_autd3(model, address=request.serial, emulated=request.emulated)


KIND = ArrayKind(
    name="autd3",
    aliases=("autd",),
    build=autd3_model,
    layout=LAYOUT,
    open_link=_open_link,
    emulates_itself=True,
    not_live="an autd3 gathers frames in banks of 0.1 s before it plays them, so it cannot follow a hand that moves "
    "now, nor begin a stimulus at once: record to a file, and play that",
    not_listed="an autd3 cannot be listed: serial=INTERFACE names the network interface that it hangs on",
)
