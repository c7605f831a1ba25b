"""Errors of files, motions and shapes. Each message is one sentence that can be shown to the user unchanged."""

from typing import TypeVar


class DatasetError(Exception):
    """Base of every error that `palpate.datasets` raises for a user's mistake or a machine's failure."""

    names_nothing: bool = False
    """Whether a name, path or size that the user gave stands for nothing: commands report misuse, not a failure."""


Marked = TypeVar("Marked", bound=Exception)


def name_nothing(error: Marked) -> Marked:
    """The same error, marked: a name or path that the user gave stands for nothing."""
    vars(error)["names_nothing"] = True
    return error


class ContourFileError(DatasetError):
    """A contour file cannot be read, written or resumed; the message names the file and why."""


class Hdf5Error(DatasetError, ValueError):
    """An HDF5 file has content that palpate never writes; the message names the path in the file, value and bound.

    The caller that opened the file prepends the file's name.
    """


class MotionError(DatasetError, ValueError):
    """A hand motion is malformed; the message names the row and the value."""


class ShapeError(DatasetError, ValueError):
    """A built-in shape does not exist, or its sizes are impossible."""


class RecordingError(DatasetError, ValueError):
    """A recording of a hand cannot be read or used; the message names the file, the frame and the joint."""


class SweepStoreError(DatasetError):
    """A store of a sweep, or a table of one, cannot be read or written; the message names the file and why."""


class NotStoreError(SweepStoreError):
    """The path given as a sweep's store is not one."""


class RecordingWarning(UserWarning):
    """A recording or motion of a hand has a suspicious value, but can be used."""
