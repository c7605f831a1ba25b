"""Arrays of transducers and how to play frames to them. Never imports Warp.

```python
model = array_model("emulator")
with UsbLink.open(model) as link:
    report = Player(link).play([encode_frames(delay, amplitude)], update_rate=10e3)
```
"""

from .array import ArrayModel, FocalZone, UsbIdentity, array_model, array_names
from .clock import Clock, MonotonicClock, VirtualClock
from .codec import encode_frames, off_frame
from .emulator import EmulatorBackend, Fault, FaultKind
from .errors import (
    DeviceBusyError,
    DeviceError,
    DeviceLostError,
    DeviceNotFoundError,
    DevicePermissionError,
    DeviceStallError,
    DeviceTimeoutError,
    FrameError,
    LinkError,
    NoBackendError,
    PlayInterrupted,
    UnknownArrayError,
    UpdateRateError,
)
from .link import BoardStatus, Link
from .player import Player
from .report import PlayReport, Underrun
from .usb import ArrayInfo, UsbLink, find_arrays

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
    "Link",
    "LinkError",
    "MonotonicClock",
    "NoBackendError",
    "PlayInterrupted",
    "PlayReport",
    "Player",
    "Underrun",
    "UnknownArrayError",
    "UpdateRateError",
    "UsbIdentity",
    "UsbLink",
    "VirtualClock",
    "array_model",
    "array_names",
    "encode_frames",
    "find_arrays",
    "off_frame",
]
