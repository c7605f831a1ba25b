"""Old names of public attributes and keywords, which still work, and keywords that people try, which are explained."""

from collections.abc import Callable
from functools import wraps
from typing import Any, ParamSpec, TypeVar

from .user_warnings import warn_user

P = ParamSpec("P")
R = TypeVar("R")


class OldAttribute:
    """Old name of an attribute of a class; reading it warns (DeprecationWarning) and gives the new attribute."""

    def __init__(self, new: str) -> None:
        self._new = new

    def __set_name__(self, owner: type, name: str) -> None:
        """Keep the old name, for the warning."""
        self._old = name

    def __get__(self, instance: object, owner: type | None = None) -> Any:
        """The attribute under its new name."""
        if instance is None:
            return self
        _warn(self._old, self._new)
        return getattr(instance, self._new)


def accept_old_keywords(**new_names: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorator: a function also takes these old keywords, with a DeprecationWarning.

    new_names: old name=new name. Raises TypeError where an argument is given under both names.
    """

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        @wraps(function)
        def call(*args: P.args, **kwargs: P.kwargs) -> R:
            for old, new in new_names.items():
                if old in kwargs:
                    if new in kwargs:
                        raise TypeError(f"{function.__qualname__}() got both {new!r} and its old name {old!r}")
                    _warn(old, new)
                    kwargs[new] = kwargs.pop(old)
            return function(*args, **kwargs)

        return call

    return decorate


def explain_keywords(**ways: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorator: TypeErrors on keywords that people try name the way out; ways: sentence by keyword."""

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        @wraps(function)
        def call(*args: P.args, **kwargs: P.kwargs) -> R:
            for name in kwargs.keys() & ways.keys():
                raise TypeError(f"{function.__name__}() has no {name!r}: {ways[name]}")
            return function(*args, **kwargs)

        return call

    return decorate


def _warn(old: str, new: str) -> None:
    """Warn (DeprecationWarning) of an old name where the user reads or passes it."""
    warn_user(f"{old!r} is now called {new!r}", DeprecationWarning)
