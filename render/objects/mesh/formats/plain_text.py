"""Text of mesh files: line ends of every system as LF, and numbers read all or refused with the line that is wrong."""

import re
import warnings
from collections.abc import Sequence

import numpy as np

from ....errors import MeshError

_MARK = b"\xef\xbb\xbf"  # UTF-8's byte order mark
_SHOWN = 80


def plain_text(content: bytes) -> bytes:
    """Text without a byte order mark, each line ended by LF; raises MeshError for what is no text."""
    if b"\0" in content:
        raise MeshError("is no text: it holds NUL bytes")
    return content.removeprefix(_MARK).replace(b"\r\n", b"\n").replace(b"\r", b"\n")


def shown(line: bytes) -> str:
    """The begin of a line for a message."""
    return repr(" ".join(line.decode("utf-8", "replace").split())[:_SHOWN])


def numbers_of(lines: Sequence[bytes], kind: type = np.float64) -> np.ndarray:
    """All numbers of lines, one after the other, shape [number]; `kind` is float64 or int64.

    Raises MeshError, which shows the first line with anything else.
    """
    try:
        return _parsed(b" ".join(lines), kind)
    except (ValueError, DeprecationWarning):  # the latter by NumPy before 2.3, which then leaves out the rest
        for line in lines:
            try:
                _parsed(line, kind)
            except (ValueError, DeprecationWarning):
                raise wrong_line(line, "whole numbers" if kind is np.int64 else "numbers") from None
        raise


def wrong_line(line: bytes, wanted: str) -> MeshError:
    """The error for a line that does not hold what is wanted; names decimal commas where it has such."""
    if re.search(rb"\d,\d", line):
        wanted += " with decimal points, not commas"
    return MeshError(f"the line {shown(line)} must hold {wanted}")


def _parsed(text: bytes, kind: type) -> np.ndarray:
    if not text or text.isspace():  # NumPy reads a number of nothing but blanks
        return np.empty(0, kind)
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)
        return np.fromstring(text, kind, sep=" ")
