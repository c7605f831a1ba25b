"""What can go wrong with an array; every message is a sentence that can be shown as it is.

```
DeviceError
├── UnknownArrayError      (ValueError)       no array model of that name
├── UpdateRateError        (ValueError)       not a whole division of the carrier
├── FrameError             (ValueError)       drives or blocks that no frame can be made of
├── NoBackendError                            libusb is not installed
└── LinkError              (OSError)          the device or the bus; `report` if it ended a playback
    ├── DeviceNotFoundError
    ├── DeviceBusyError
    ├── DevicePermissionError (PermissionError)
    ├── DeviceLostError                       unplugged, or its power failed
    ├── DeviceTimeoutError (TimeoutError)
    └── DeviceStallError                      the device refused a request or halted its endpoint
PlayInterrupted            (KeyboardInterrupt) a signal ended a playback; outside the tree, like its parent
```
"""

from __future__ import annotations

import signal
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .report import PlayReport


class DeviceError(Exception):
    """Base of everything that this package raises."""


class UnknownArrayError(DeviceError, ValueError):
    """No array model has that name."""


class UpdateRateError(DeviceError, ValueError):
    """The update rate is not carrier / n for a divider n that the array has."""


class FrameError(DeviceError, ValueError):
    """Drives of a wrong shape or range, or bytes that are no whole number of frames."""


class NoBackendError(DeviceError):
    """No libusb on this machine, so no array can be looked for."""


class LinkError(DeviceError, OSError):
    """The device or the bus failed."""

    report: PlayReport | None = None
    """What was played up to the failure, where it ended a playback."""


class DeviceNotFoundError(LinkError):
    """No such array is plugged in."""


class DeviceBusyError(LinkError):
    """Another process, or another player of this one, holds the array."""


class DevicePermissionError(LinkError, PermissionError):
    """The array is plugged in, but this user may not open it."""


class DeviceLostError(LinkError):
    """The array was unplugged, or lost its power."""


class DeviceTimeoutError(LinkError, TimeoutError):
    """The array did not answer in time."""


class DeviceStallError(LinkError):
    """The array refused a request, or halted its endpoint."""


class PlayInterrupted(KeyboardInterrupt):
    """A signal ended a playback; the array was switched off before this was raised.

    It derives from `KeyboardInterrupt` so that a script which does not expect it ends, as the signal asked it to.
    """

    def __init__(self, signum: int, report: PlayReport) -> None:
        super().__init__(f"playback was stopped by {signal.Signals(signum).name}")
        self.signum = signum
        """Number of the signal; a command line exits with 128 + signum."""
        self.report = report
        """What was played until then."""
