"""What can go wrong with an array; every message is a sentence that can be shown as it is.

```
DeviceError
├── UnknownArrayError      (ValueError)       no array model of that name
├── ArrayKindError         (ValueError)       a kind of array that cannot be registered
├── CalibrationError       (ValueError)       a board file that is wrong, or none where one is needed
├── UpdateRateError        (ValueError)       a rate that the board lacks, or can't keep up
├── FrameError             (ValueError)       drives or blocks that no frame can be made of
├── LimitsError            (ValueError)       limits of a playback that are none
├── SafetyLimitError                          a playback was ended by its limits; `report` of it
├── WatchdogError                             no watchdog can be kept for that array
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

import errno
import signal
from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from .report import PlayReport


class DeviceError(Exception):
    """Base of everything that this package raises."""


class UnknownArrayError(DeviceError, ValueError):
    """No array model has that name."""


class ArrayKindError(DeviceError, ValueError):
    """A kind of array has a name that is taken, or a field of a wrong type, or builds another array's model."""


class CalibrationError(DeviceError, ValueError):
    """A board file that cannot be read or makes no sense, or none where one is needed."""


class UpdateRateError(DeviceError, ValueError):
    """The update rate is not one that the array has, or it cannot keep it up for that many frames."""


class FrameError(DeviceError, ValueError):
    """Drives of a wrong shape or range, or bytes that are no whole number of frames."""


class LimitsError(DeviceError, ValueError):
    """A limit of a playback is no time, or no duty."""


class SafetyLimitError(DeviceError):
    """A playback went beyond its limits; the array was switched off before this was raised."""

    report: PlayReport | None = None
    """What was played until then."""


class WatchdogError(DeviceError):
    """No watchdog can be kept: another process could not reach that array."""


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


def link_error(who: str, code: int | None, error: object = None) -> LinkError:
    """The error for what the bus said.

    Args:
        who: name and serial number of the array, for the message.
        code: errno; an unknown one, or None, makes a plain `LinkError`.
        error: the bus's own words, for that case.
    """
    kind, advice = _MEANING.get(code or 0, (LinkError, f"failed: {error or code}"))
    return kind(f"array {who} {advice}")


# errno: (error, what to do about it)
_MEANING: Final[Mapping[int, tuple[type[LinkError], str]]] = {
    errno.EACCES: (DevicePermissionError, "may not be opened by this user: add a udev rule for it, or use its group"),
    errno.EPERM: (DevicePermissionError, "may not be opened by this user: add a udev rule for it, or use its group"),
    errno.EBUSY: (DeviceBusyError, "is in use: stop the other player, or choose another serial number"),
    errno.ENODEV: (DeviceLostError, "is gone: it was unplugged or lost its power"),
    errno.ENOENT: (DeviceLostError, "is gone: it was unplugged, lost its power or was reconfigured"),
    errno.EPIPE: (DeviceStallError, "refused (stall): its firmware may not be the one this array model is for"),
    errno.ETIMEDOUT: (DeviceTimeoutError, "did not answer in time: check its cable, or switch it off and on"),
    errno.ENOMEM: (LinkError, "got no memory for a transfer: raise usbfs_memory_mb of the kernel module usbcore"),
}
