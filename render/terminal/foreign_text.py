"""The terminal: whatever a command shows goes through `visible`, since names, files and errors come from others.

A terminal obeys some characters instead of showing them: they set its title or clipboard, clear it, or begin a line
that looks like one of ours.
"""

import contextlib
import os
import sys
from collections.abc import Iterable, Sequence
from typing import Any, Literal

from ..errors import RenderError


class ErrorStream:
    """The standard error that Python has when a line is written; one that is closed or full stops no work."""

    def __getattr__(self, name: str) -> Any:
        return getattr(sys.stderr, name)

    @property
    def is_terminal(self) -> bool:
        """Whether people look at it."""
        return sys.stderr is not None and sys.stderr.isatty()

    def write(self, text: str) -> None:
        """Write, if that is possible."""
        with contextlib.suppress(OSError, AttributeError):
            sys.stderr.write(text)

    def flush(self) -> None:
        """Flush, if that is possible."""
        with contextlib.suppress(OSError, AttributeError):
            sys.stderr.flush()


errors = ErrorStream()


class OutputError(RenderError):
    """Results cannot be written to standard output; without a message if their reader has ended, as `head` does."""


_is_quiet = False


def set_quiet(is_quiet: bool) -> None:
    """Leave out warnings, notes and progress from now on, or show them."""
    global _is_quiet  # one command runs in a process at a time
    _is_quiet = is_quiet


def shows_progress() -> bool:
    """Whether progress is shown: where people look, and want it."""
    return errors.is_terminal and not _is_quiet


STYLES = {"error": "1;31", "warning": "33", "note": "33"}
"""SGR codes of the words that begin messages (ECMA-48): bold red, yellow."""


def visible(text: object) -> str:
    """A text of one line, with escapes for all that is not shown as itself.

    Those are what `str.isprintable` denies: control characters (C0, C1, DEL), line and paragraph separators, characters
    that change the direction of writing or have no width, surrogates of bytes that are no UTF-8.
    """
    text = str(text)
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


def print_message(text: object, kind: Literal["", "error", "warning", "note", "progress"] = "") -> None:
    """Print a line on standard error that begins with its kind; a quiet command leaves out all but errors.

    A line without a kind continues an error, or asks a person to do something.
    """
    if _is_quiet and kind in ("warning", "note", "progress"):
        return
    word = f"{kind}: " if kind in STYLES else ""
    if word and errors.is_terminal and "NO_COLOR" not in os.environ:
        word = f"\x1b[{STYLES[kind]}m{word}\x1b[0m"
    errors.write(f"{word}{visible(text)}\n")
    errors.flush()


def write(text: object) -> None:
    """A line on standard output."""
    write_output(visible(text) + "\n")


def write_output(text: str) -> None:
    """Text on standard output as it is; raises OutputError if that is closed or full."""
    try:
        sys.stdout.write(text)
        sys.stdout.flush()
    except OSError as error:
        discard_output()
        if isinstance(error, BrokenPipeError):
            raise OutputError from error
        raise OutputError(f"results cannot be written to standard output ({error.strerror or error})") from error


def discard_output() -> None:
    """Have standard output lead nowhere: else its last flush, when Python ends, fails again, with a traceback."""
    with contextlib.suppress(OSError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def show_table(
    title: str, rows: Iterable[Sequence[object]], columns: Sequence[str] = (), *, to_errors: bool = False
) -> None:
    """A table on standard output, or standard error; without `columns` it has no head.

    Each row is one line, however long; the cells of all columns but the last are padded to one width.
    """
    lines = [[visible(cell) for cell in row] for row in (*([columns] if columns else []), *rows)]
    count = max(map(len, lines), default=0)
    widths = [max((len(line[k]) for line in lines if k < len(line)), default=0) for k in range(count)]
    texts = ["  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=False)).rstrip() for line in lines]
    text = "".join(f"{line}\n" for line in ([visible(title)] if title else []) + texts)
    (errors.write if to_errors else write_output)(text)
