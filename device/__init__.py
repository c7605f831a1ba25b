"""Arrays of transducers and how to play frames to them. Never imports Warp.

```python
model = array_model("emulator")
with open_link(model) as link:
    report = Player(link).play([encode_frames(delay, amplitude, array=model)], update_rate=10e3)
```
"""

from importlib import import_module
from typing import TYPE_CHECKING

from .array import ArrayModel, FocalZone, UsbIdentity
from .array_kind import ArrayKind, EmulationRequest, LinkRequest
from .boards.built_in import register_built_in
from .boards.discovery import ArrayInfo, find_arrays, find_serial_arrays, open_link, udev_rule
from .boards.emulator.link import UsbLink
from .boards.emulator.usb_side import EmulatorBackend
from .clock import Clock, MonotonicClock, VirtualClock
from .codec import encode_frames, off_frame
from .emulation.faults import Fault, FaultKind
from .emulation.peripheral import Descriptors, Peripheral
from .emulation.usb_bus import EmulatedBus
from .errors import (
    ArrayKindError,
    CalibrationError,
    DeviceBusyError,
    DeviceError,
    DeviceLostError,
    DeviceNotFoundError,
    DevicePermissionError,
    DeviceStallError,
    DeviceTimeoutError,
    FrameError,
    LimitsError,
    LinkError,
    NoBackendError,
    PlayInterrupted,
    SafetyLimitError,
    UnknownArrayError,
    UpdateRateError,
    WatchdogError,
)
from .flat_array import flat_array, flat_grid
from .link import BoardStatus, Link
from .playing.limits import Limits
from .playing.player import Player
from .registry import array_model, array_names, register_array, remove_array
from .report import Lateness, LiveStatistics, PlayReport, QueueDepth, Underrun
from .transports.bulk import open_bulk
from .transports.stream import StreamLink
from .wire_layout import Layout

__all__ = [
    "ArrayInfo",
    "ArrayKind",
    "ArrayKindError",
    "ArrayModel",
    "BoardStatus",
    "CalibrationError",
    "Clock",
    "Descriptors",
    "DeviceBusyError",
    "DeviceError",
    "DeviceLostError",
    "DeviceNotFoundError",
    "DevicePermissionError",
    "DeviceStallError",
    "DeviceTimeoutError",
    "EmulatedBus",
    "EmulationRequest",
    "EmulatorBackend",
    "Fault",
    "FaultKind",
    "FocalZone",
    "FrameError",
    "Lateness",
    "Layout",
    "Limits",
    "LimitsError",
    "Link",
    "LinkError",
    "LinkRequest",
    "LiveStatistics",
    "MonotonicClock",
    "NoBackendError",
    "Peripheral",
    "PlayInterrupted",
    "PlayReport",
    "Player",
    "QueueDepth",
    "SafetyLimitError",
    "StreamLink",
    "Underrun",
    "UnknownArrayError",
    "UpdateRateError",
    "UsbIdentity",
    "UsbLink",
    "VirtualClock",
    "WatchdogError",
    "array_model",
    "array_names",
    "encode_frames",
    "find_arrays",
    "find_serial_arrays",
    "flat_array",
    "flat_grid",
    "off_frame",
    "open_bulk",
    "open_link",
    "register_array",
    "remove_array",
    "udev_rule",
]

register_built_in()  # here, so that they are known whatever is imported of this package

if TYPE_CHECKING:
    __version__: str
else:  # hidden from type checkers, which would take every name for one that it gives

    def __getattr__(name: str) -> str:
        """`__version__`, read when it is asked for: finding it takes longer than some imports do (PEP 562)."""
        if name != "__version__":
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return import_module("importlib.metadata").version("palpate")
