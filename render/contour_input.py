"""Functions that take contour files take rendered batches, too: a batch becomes a file while the function runs."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack
from functools import wraps
from inspect import signature
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, Protocol, TypeVar, runtime_checkable

P = ParamSpec("P")
Result = TypeVar("Result")


@runtime_checkable
class SavedContours(Protocol):
    """Contours that can be a contour file for a while, as a RenderedBatch can."""

    def as_file(self) -> AbstractContextManager[Path]:
        """The path of a contour file that holds them; it need not exist afterwards."""
        ...


ContourInput = str | Path | SavedContours
"""A contour file's path, or a rendered batch."""
ContourInputs = Mapping[str, ContourInput] | Sequence[ContourInput]
"""Several of them: by label, or in a list."""


def takes_batches(
    function: Callable[Concatenate[Any, P], Result],
) -> Callable[Concatenate[ContourInput | ContourInputs, P], Result]:
    """Have a function whose first argument is a contour file's path, or several of them, take batches there."""
    first = next(iter(signature(function).parameters))

    @wraps(function)
    def call(*arguments: Any, **options: Any) -> Result:
        with ExitStack() as stack:
            if first in options:
                options[first] = _path_of(options[first], stack)
            return function(*(_path_of(one, stack) for one in arguments[:1]), *arguments[1:], **options)

    return call


def _path_of(value: Any, stack: ExitStack) -> Any:
    """A path for a batch, also within a list or by label; any other value as it is."""
    if isinstance(value, SavedContours):
        return stack.enter_context(value.as_file())
    if isinstance(value, Mapping):
        return {label: _path_of(one, stack) for label, one in value.items()}
    if isinstance(value, list | tuple):
        return [_path_of(one, stack) for one in value]
    return value
