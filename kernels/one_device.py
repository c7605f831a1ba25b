"""Arguments of host functions whose Warp arrays must be on one device."""

import inspect
from collections.abc import Callable
from functools import wraps
from typing import Any, ParamSpec, TypeVar

import warp as wp

DEPTH_MOST = 3  # of structs, tuples and lists within each other

P = ParamSpec("P")
R = TypeVar("R")


class MixedDevicesError(ValueError):
    """Arrays that are used together are on different devices."""


def require_one_device(**arguments: Any) -> None:
    """Raise MixedDevicesError, with both arguments and devices, unless all Warp arrays are on one device.

    An argument is an array, or a Warp struct, a batch of contours, a tuple or a list that holds arrays; others are
    passed over, and so are arrays without elements. Warp checks nothing by default, and a kernel that reads the memory
    of another device ends the process.

    >>> import warp as wp
    >>> from palpate.kernels.one_device import require_one_device
    >>> require_one_device(points=wp.zeros(3, device="cpu"), keep=wp.zeros(3, device="cpu"), share=0.5)
    """
    found: list[tuple[str, wp.array]] = []
    for name, argument in arguments.items():
        _gather_arrays(name, argument, DEPTH_MOST, found)
    for name, array in found[1:]:
        if array.device is not found[0][1].device:
            where = f"{found[0][0]} is on {found[0][1].device}, {name} is on {array.device}"
            raise MixedDevicesError(
                f"arrays must be on one device, but {where}: wp.clone({name}, device=...) copies it"
            )


def _gather_arrays(name: str, value: Any, depth: int, found: list[tuple[str, wp.array]]) -> None:
    """Append the arrays with elements in a value, and their names."""
    if isinstance(value, wp.array):
        if value.size:
            found.append((name, value))
    elif value is None or not depth or isinstance(value, (str, int, float)):
        return
    elif isinstance(value, tuple | list):
        fields = getattr(value, "_fields", None)
        for k, own in enumerate(value):
            _gather_arrays(f"{name}.{fields[k]}" if fields else f"{name}[{k}]", own, depth - 1, found)
    elif hasattr(value, "_ctype"):  # a Warp struct
        for field, own in vars(value).items():
            if own is not None and field[0] != "_":
                _gather_arrays(f"{name}.{field}", own, depth - 1, found)
    elif hasattr(value, "by_name"):  # a batch of contours
        for field, own in value.by_name().items():
            _gather_arrays(f"{name}.{field}", own, depth - 1, found)


def on_one_device(function: Callable[P, R]) -> Callable[P, R]:
    """Decorator: `require_one_device` for the arguments of a host function; 2 to 10 us a call."""
    names = tuple(inspect.signature(function).parameters)

    @wraps(function)
    def checked(*args: P.args, **kwargs: P.kwargs) -> R:
        require_one_device(**dict(zip(names, args, strict=False)), **kwargs)
        return function(*args, **kwargs)

    return checked
