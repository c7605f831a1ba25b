"""Copies on devices that objects and hands keep: made when needed, and left out of pickles and of `copy`."""

from collections.abc import Callable, Mapping
from threading import RLock
from typing import Any, ClassVar


class KeepsDeviceCopies:
    """A class whose `_on`, `_fields` and the like are caches by device, under its `_lock`."""

    made_anew: ClassVar[Mapping[str, Callable[[], Any]]] = {"_lock": RLock, "_on": dict, "_fields": dict}
    """What begins empty in each object and in each copy of it."""

    _lock: Any

    def begin_copies(self) -> None:
        """Have no copies on devices."""
        for name, make in self.made_anew.items():
            setattr(self, name, make())

    def __getstate__(self) -> dict[str, Any]:
        """All but the copies on devices and what locks them."""
        return {name: value for name, value in vars(self).items() if name not in self.made_anew}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """The same object without copies on devices."""
        vars(self).update(state)
        self.begin_copies()
