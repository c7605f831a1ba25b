"""Arrays of transducers and how to play frames to them. Never imports Warp.

```python
model = array_model("emulator")
with open_link(model) as link:
    report = Player(link).play([encode_frames(delay, amplitude, array=model)], update_rate=10e3)
```
"""

from importlib import import_module
from typing import TYPE_CHECKING

from .array import ArrayModel, FocalZone, UsbIdentity, array_model, array_names
from .boards.emulator.link import UsbLink
from .boards.emulator.usb_side import EmulatorBackend, Fault, FaultKind
from .clock import Clock, MonotonicClock, VirtualClock
from .codec import encode_frames, off_frame
from .discovery import ArrayInfo, find_arrays, find_serial_arrays, open_link, udev_rule
from .errors import (
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
from .link import BoardStatus, Link
from .playing.limits import Limits
from .playing.player import Player
from .report import Lateness, LiveStatistics, PlayReport, QueueDepth, Underrun

__all__ = [
    "ArrayInfo",
    "ArrayModel",
    "BoardStatus",
    "Clock",
    "DeviceBusyError",
    "DeviceError",
    "DeviceLostError",
    "DeviceNotFoundError",
    "DevicePermissionError",
    "DeviceStallError",
    "DeviceTimeoutError",
    "EmulatorBackend",
    "Fault",
    "FaultKind",
    "FocalZone",
    "FrameError",
    "Lateness",
    "Limits",
    "LimitsError",
    "Link",
    "LinkError",
    "LiveStatistics",
    "MonotonicClock",
    "NoBackendError",
    "PlayInterrupted",
    "PlayReport",
    "Player",
    "QueueDepth",
    "SafetyLimitError",
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
    "off_frame",
    "open_link",
    "udev_rule",
]

if TYPE_CHECKING:
    __version__: str
else:  # hidden from type checkers, which would take every name for one that it gives

    def __getattr__(name: str) -> str:
        """`__version__`, read when it is asked for: finding it takes longer than some imports do (PEP 562)."""
        if name != "__version__":
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return import_module("importlib.metadata").version("palpate")
