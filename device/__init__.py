"""Arrays of transducers and how to play frames to them. Never imports Warp.

```python
model = array_model("emulator")
with open_link(model) as link:
    report = Player(link).play([encode_frames(delay, amplitude, array=model)], update_rate=10e3)
```
"""

import sys
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    __version__: str

    from .array import ArrayModel, FocalZone, UsbIdentity
    from .array_kind import ArrayKind, EmulationRequest, LinkRequest
    from .boards.discovery import ArrayInfo, find_arrays, find_serial_arrays, open_link, udev_rule
    from .boards.emulator.kind import EmulatorBackend
    from .boards.emulator.link import UsbLink
    from .clock import Clock, MonotonicClock, VirtualClock
    from .codec import encode_frames, off_frame
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
    from .flat_arrays import flat_array, flat_grid
    from .link import BoardStatus, Link
    from .playing.limits import Limits
    from .playing.player import Player
    from .registry import array_model, array_names, emulated_backend, register_array, remove_array
    from .report import Lateness, LiveStatistics, PlayReport, QueueDepth, Underrun
    from .transports.bulk import open_bulk
    from .transports.stream import StreamLink
    from .wire_layout import FocusLayout, Layout, Levels, linear_levels, pulse_levels


_ROOMS = {
    "array": "ArrayModel FocalZone UsbIdentity",
    "array_kind": "ArrayKind EmulationRequest LinkRequest",
    "boards.discovery": "ArrayInfo find_arrays find_serial_arrays open_link udev_rule",
    "boards.emulator.link": "UsbLink",
    "boards.emulator.kind": "EmulatorBackend",
    "clock": "Clock MonotonicClock VirtualClock",
    "codec": "encode_frames off_frame",
    "emulation.peripheral": "Descriptors Peripheral",
    "emulation.usb_bus": "EmulatedBus",
    "errors": "ArrayKindError CalibrationError DeviceBusyError DeviceError DeviceLostError DeviceNotFoundError "
    "DevicePermissionError DeviceStallError DeviceTimeoutError FrameError LimitsError LinkError "
    "NoBackendError PlayInterrupted SafetyLimitError UnknownArrayError UpdateRateError WatchdogError",
    "flat_arrays": "flat_array flat_grid",
    "link": "BoardStatus Link",
    "playing.limits": "Limits",
    "playing.player": "Player",
    "registry": "array_model array_names emulated_backend register_array remove_array",
    "report": "Lateness LiveStatistics PlayReport QueueDepth Underrun",
    "transports.bulk": "open_bulk",
    "transports.stream": "StreamLink",
    "wire_layout": "FocusLayout Layout Levels linear_levels pulse_levels",
}
"""What each module has that scripts use: it is imported when that is asked for, as most programs need few of them."""

_HOMES = {name: room for room, names in _ROOMS.items() for name in names.split()}

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
    "FocalZone",
    "FocusLayout",
    "FrameError",
    "Lateness",
    "Layout",
    "Levels",
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
    "emulated_backend",
    "encode_frames",
    "find_arrays",
    "find_serial_arrays",
    "flat_array",
    "flat_grid",
    "linear_levels",
    "off_frame",
    "open_bulk",
    "open_link",
    "pulse_levels",
    "register_array",
    "remove_array",
    "udev_rule",
]


if not TYPE_CHECKING:  # hidden from type checkers, which would take every name for one that it gives

    def __getattr__(name: str) -> object:
        """What `__all__` names, and `__version__` (PEP 562)."""
        if name == "__version__":
            return import_module("importlib.metadata").version("palpate")
        if name not in _HOMES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}", name=name, obj=sys.modules[__name__])
        found = globals()[name] = getattr(import_module(f".{_HOMES[name]}", __name__), name)
        return found


def __dir__() -> list[str]:
    """The public names, as `dir` and completion show them."""
    return [*__all__, "__version__"]
