"""Which serial port an array is at: by its adapter's serial number, by its path, or because there is only one."""

from __future__ import annotations

import errno
import os
from pathlib import Path

from ..array import ArrayModel
from ..errors import DeviceNotFoundError, DevicePermissionError, link_error
from ..registry import array_model, array_names
from .serial_line import PortInfo, SerialPort, SerialPorts


def likely_ports(ports: SerialPorts) -> list[PortInfo]:
    """The ports that an array may be at: those of USB adapters, but for the chips of arrays that are on USB."""
    identities = [array_model(name).usb for name in array_names()]
    chips = [(usb.vendor, usb.product) for usb in identities if usb is not None]  # such as a pat16's FT232H
    return [info for info in ports.listed() if info.usb_ids is not None and info.usb_ids not in chips]


def choose_port(model: ArrayModel, wanted: str | None, ports: SerialPorts) -> PortInfo:
    """The port of an array.

    Args:
        model: which kind.
        wanted: serial number of the adapter, or path of the port; None takes the only one that there is.
        ports: what has the ports.

    Raises:
        DeviceNotFoundError: there is none, or there are several and none was named.
    """
    found = likely_ports(ports)
    there = ", ".join(map(_named, found))
    if wanted is None:
        chosen = found
    else:
        listed = ports.listed()
        chosen = [info for info in listed if info.path == wanted] or [info for info in listed if info.serial == wanted]
        if not chosen and os.sep in wanted:  # such as a pseudo-terminal, which is in no list
            return PortInfo(wanted, None, "serial port", None)
    if len(chosen) == 1:
        return chosen[0]
    if chosen:
        raise DeviceNotFoundError(
            f"array {model.name} may be at any of {len(chosen)} serial adapters: {', '.join(map(_named, chosen))}. Say "
            "which by its serial number or its port (serial=NAME)"
        )
    who = model.name if wanted is None else f"{model.name} {wanted}"
    otherwise = (
        f"found instead: {there}" if found else "no serial adapter is plugged in; a port can be named (serial=PORT)"
    )
    raise DeviceNotFoundError(f"array {who} was not found: {otherwise}")


def open_port(model: ArrayModel, info: PortInfo, ports: SerialPorts, *, baud: int) -> SerialPort:
    """Open the port of an array; every failure is a `LinkError`, with what to do about it."""
    who = f"{model.name} at {info.path}"
    try:
        return ports.open(info.path, baud=baud)
    except OSError as error:
        if error.errno in (errno.EACCES, errno.EPERM):
            raise DevicePermissionError(f"array {who} {no_permission(info.path)}") from error
        if error.errno == errno.ENOENT:
            there = ", ".join(map(_named, likely_ports(ports))) or "none"
            raise DeviceNotFoundError(f"array {who} was not found: there is no such port; found: {there}") from error
        raise link_error(who, errno.EBUSY if error.errno == errno.EAGAIN else error.errno, error) from error


def no_permission(path: str) -> str:
    """What keeps this user from opening a port, and what to do about it."""
    return f"may not be opened by this user: join the group that owns it ({_group(path)}), then log in again"


def _named(info: PortInfo) -> str:
    return f"{info.serial} at {info.path}" if info.serial else info.path


def _group(path: str) -> str:
    try:
        return Path(path).group()
    except (OSError, KeyError, NotImplementedError):
        return "dialout on most systems"
