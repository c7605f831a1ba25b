"""The one place that calls libusb itself: bulk transfers, on the handle that pyusb opened.

pyusb has no transfers that go on while Python does something else. Of what it keeps to itself, this uses
`Device._ctx.handle.handle`, `Device._ctx.backend` and the backend's `lib` and `ctx`; if a version of pyusb lacks one,
`BulkQueue` refuses, and `hidden_name` says which. The struct and the codes are libusb's own, whose ABI is stable.
"""

from __future__ import annotations

import ctypes
import errno
import threading
from array import array
from collections import deque
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

from ..errors import LinkError
from .pyusb import UsbDevice

COMPLETED: Final = 0
CANCELLED: Final = 3
STATUS_ERRNO: Final[Mapping[int, int]] = {
    1: errno.EIO, 2: errno.ETIMEDOUT, CANCELLED: errno.ECANCELED, 4: errno.EPIPE, 5: errno.ENODEV, 6: errno.EOVERFLOW,
}  # fmt: skip
"""libusb_transfer_status -> errno."""

_NOT_FOUND = -5
_INTERRUPTED = -10
_CODE_ERRNO: Final[Mapping[int, int]] = {
    -1: errno.EIO, -2: errno.EINVAL, -3: errno.EACCES, -4: errno.ENODEV, _NOT_FOUND: errno.ENOENT, -6: errno.EBUSY,
    -7: errno.ETIMEDOUT, -8: errno.EOVERFLOW, -9: errno.EPIPE, _INTERRUPTED: errno.EINTR, -11: errno.ENOMEM,
    -12: errno.ENOSYS,
}  # fmt: skip
_TYPE_BULK = 2


class Completion(NamedTuple):
    """What became of a transfer."""

    slot: int
    status: int
    """libusb_transfer_status."""
    taken: int
    """Bytes that the device took."""


class _Transfer(ctypes.Structure):
    """`struct libusb_transfer`, without its isochronous packets."""


_Callback = ctypes.CFUNCTYPE(None, ctypes.POINTER(_Transfer))
_Transfer._fields_ = [
    ("dev_handle", ctypes.c_void_p),
    ("flags", ctypes.c_uint8),
    ("endpoint", ctypes.c_ubyte),
    ("type", ctypes.c_ubyte),
    ("timeout", ctypes.c_uint),
    ("status", ctypes.c_int),
    ("length", ctypes.c_int),
    ("actual_length", ctypes.c_int),
    ("callback", _Callback),
    ("user_data", ctypes.c_void_p),
    ("buffer", ctypes.c_void_p),
    ("num_iso_packets", ctypes.c_int),
]


class _Timeval(ctypes.Structure):
    _fields_ = [("tv_sec", ctypes.c_long), ("tv_usec", ctypes.c_long)]


def is_libusb(device: UsbDevice) -> bool:
    """Whether the backend of an opened device is libusb's."""
    return type(getattr(getattr(device, "_ctx", None), "backend", None)).__module__ == "usb.backend.libusb1"


def hidden_name(device: UsbDevice) -> str | None:
    """Reason for which transfers to an opened device cannot be queued; None: they can."""
    context: Any = getattr(device, "_ctx", None)
    backend: Any = getattr(context, "backend", None)
    if not is_libusb(device):
        return f"the backend is {type(backend).__module__}"
    handle: Any = getattr(getattr(context, "handle", None), "handle", None)
    if not handle:
        return "the device is not open, or this version of pyusb keeps its handle elsewhere"
    lib: Any = getattr(backend, "lib", None)
    if not isinstance(lib, ctypes.CDLL) or not hasattr(backend, "ctx"):
        return "this version of pyusb keeps libusb elsewhere"
    names = ("alloc", "free", "submit", "cancel")
    missing = [name for name in names if not hasattr(lib, f"libusb_{name}_transfer")]
    if missing or not hasattr(lib, "libusb_handle_events_timeout_completed"):
        return "this libusb is too old"
    return None


class BulkQueue:
    """Transfers to one bulk OUT endpoint, in numbered slots. Their order is the order of `submit`.

    A transfer has no time limit of its own: one that ended in the middle of a queue would tear the stream.

    Raises `LinkError` if there is a `hidden_name(device)`.
    """

    def __init__(self, device: UsbDevice, endpoint: int, *, slots: int) -> None:
        if hidden := hidden_name(device):
            raise LinkError(f"queued transfers need libusb through pyusb, but {hidden}: use the transport 'sync'")
        context: Any = getattr(device, "_ctx")  # noqa: B009  # pyusb's own name, checked for above
        self.done: deque[Completion] = deque()
        """What has ended, in the order in which it was learnt; the caller takes from it."""
        self._handle = context.handle.handle
        self._usb_context = context.backend.ctx
        self._lib, self._waiting = _bindings_of(context.backend.lib)
        self._callback = _Callback(self._ended)
        self._any_done = ctypes.c_int()
        self._buffers: list[ctypes.c_char | None] = [None] * slots  # while set, the bytes can't move
        self._transfers = [self._lib.libusb_alloc_transfer(0) for _ in range(slots)]
        if not all(self._transfers):
            raise LinkError(f"libusb has no memory for {slots} transfers")
        for slot, pointer in enumerate(self._transfers):
            transfer = pointer.contents
            transfer.dev_handle, transfer.endpoint, transfer.type = self._handle, endpoint, _TYPE_BULK
            transfer.timeout, transfer.callback, transfer.user_data = 0, self._callback, slot

    def submit(self, slot: int, data: array[int]) -> int:
        """Hand the bytes to the kernel, behind those before; errno, 0 if they are under way.

        The bytes are not copied: they must not change, and cannot be resized, until the transfer has ended.
        """
        buffer = ctypes.c_char.from_buffer(data)
        transfer = self._transfers[slot].contents
        transfer.buffer, transfer.length = ctypes.addressof(buffer), len(data)
        self._buffers[slot] = buffer  # before it can end, on whatever thread
        code = self._lib.libusb_submit_transfer(self._transfers[slot])
        if code:
            self._buffers[slot] = None
        return _errno(code)

    def cancel(self, slot: int) -> int:
        """Ask for the end of a transfer, which `done` then tells; errno, 0 also if it has just ended."""
        code = self._lib.libusb_cancel_transfer(self._transfers[slot])
        return 0 if code == _NOT_FOUND else _errno(code)

    def handle_events(self, timeout: float) -> int:
        """Wait until a transfer ends, or for `timeout` [s]; errno, 0 if nothing went wrong."""
        self._any_done.value = 0
        limit = _Timeval(int(timeout), int(timeout % 1 * 1e6))
        wait = (self._waiting if timeout else self._lib).libusb_handle_events_timeout_completed
        code = wait(self._usb_context, ctypes.byref(limit), ctypes.byref(self._any_done))
        return 0 if code == _INTERRUPTED else _errno(code)

    def close(self) -> None:
        """Free the transfers. Those that have not ended are kept for ever: the kernel may still read their bytes."""
        if any(buffer is not None for buffer in self._buffers):
            _lost.append(self)
            return
        for pointer in self._transfers:
            self._lib.libusb_free_transfer(pointer)
        self._transfers = []

    def _ended(self, pointer: Any) -> None:
        """Called by libusb, in whichever thread handles its events: takes note, nothing else."""
        transfer = pointer.contents
        slot: int = transfer.user_data or 0  # ctypes reads the address 0 as None
        self._buffers[slot] = None
        self.done.append(Completion(slot, transfer.status, transfer.actual_length))
        self._any_done.value = 1


_lost: list[BulkQueue] = []
_bindings: dict[int, tuple[Any, Any]] = {}
_bindings_lock = threading.Lock()


def _bindings_of(lib: Any) -> tuple[Any, Any]:
    """The library that pyusb loaded, twice, with prototypes of this module's: pyusb has set its own on its object.

    The first is for calls that return at once. They keep the interpreter's lock: whoever gives it up while another
    thread computes gets it back after 5 ms, and filling the queue must not take that long for each transfer.
    The second is for calls that wait.
    """
    with _bindings_lock:
        if lib._handle not in _bindings:
            prompt, waiting = (kind(lib._name, handle=lib._handle) for kind in (ctypes.PyDLL, ctypes.CDLL))
            _prototype(prompt)
            _prototype(waiting)
            _bindings[lib._handle] = prompt, waiting
        return _bindings[lib._handle]


def _prototype(lib: Any) -> None:
    lib.libusb_alloc_transfer.restype = ctypes.POINTER(_Transfer)
    lib.libusb_alloc_transfer.argtypes = [ctypes.c_int]
    for name in ("libusb_free_transfer", "libusb_submit_transfer", "libusb_cancel_transfer"):
        getattr(lib, name).argtypes = [ctypes.POINTER(_Transfer)]
    lib.libusb_free_transfer.restype = None
    lib.libusb_handle_events_timeout_completed.argtypes = [
        ctypes.c_void_p, ctypes.POINTER(_Timeval), ctypes.POINTER(ctypes.c_int),
    ]  # fmt: skip


def _errno(code: int) -> int:
    return 0 if code >= 0 else _CODE_ERRNO.get(code, errno.EIO)
