"""What goes wrong with files, motions and shapes; each message is one sentence fit to be shown as it is."""


class DatasetError(Exception):
    """Base of every error that `palpate.datasets` raises for a user's mistake or a machine's failure."""


class ContourFileError(DatasetError):
    """A contour file cannot be read, written or resumed; the message names the file and why."""


class Hdf5Error(DatasetError, ValueError):
    """An HDF5 file holds what palpate's never do; the message names the path inside the file, the value and the bound.

    Whoever reads the file puts its name before the message.
    """


class MotionError(DatasetError, ValueError):
    """A hand motion is malformed; the message names the row and the value."""


class ShapeError(DatasetError, ValueError):
    """A built-in shape is asked for that does not exist, or with impossible sizes."""


class RecordingError(DatasetError, ValueError):
    """A recording of a hand cannot be read or used; the message names the file, the frame and the joint."""


class SweepStoreError(DatasetError):
    """A store of a sweep, or a table of one, cannot be read or written; the message names the file and why."""


class NotStoreError(SweepStoreError):
    """What is named as a sweep's store is something else."""


class RecordingWarning(UserWarning):
    """A recording of a hand looks wrong, but can be used."""
