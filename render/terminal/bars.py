"""Progress of the command line on standard error, where that is a terminal."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator
from typing import IO, TYPE_CHECKING, cast

from .foreign_text import errors, print_message, shows_progress, visible

if TYPE_CHECKING:
    from rich.console import Console

    from ...device.report import LiveStatistics

SILENT_SECONDS = 1.0
"""Time before a bar appears [s]: shorter work needs none."""


def screen() -> Console:
    """Standard error for Rich, which is imported only where something is drawn."""
    from rich.console import Console

    return Console(file=cast("IO[str]", errors), highlight=False, soft_wrap=True)


@contextlib.contextmanager
def progress_bar(title: str, *, quiet: bool) -> Iterator[Callable[..., None]]:
    """A bar on standard error, once the work has taken SILENT_SECONDS.

    Yields a function to call with the stage's name, where there are several, the amount done, and the amount in all. A
    timer starts the bar, because a stage that is one call of NumPy reports nothing before its end.
    """
    if quiet or not shows_progress():
        yield lambda *given: None
        return
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    progress = Progress(*columns, console=screen(), transient=True)
    task = progress.add_task(visible(title), total=None)

    def show(*given: object) -> None:
        *stage, done, total = given
        text = visible(": ".join(map(str, (title, *stage))))
        progress.update(task, description=text, completed=cast("int", done), total=cast("int", total) if done else None)

    timer = threading.Timer(SILENT_SECONDS, progress.start)
    timer.daemon = True
    timer.start()
    try:
        yield show
    finally:
        timer.cancel()
        timer.join()
        progress.stop()


@contextlib.contextmanager
def playback_line(
    title: str, *, quiet: bool, elapsed: Callable[[], float] | None = None
) -> Iterator[Callable[[LiveStatistics, int], None]]:
    """A title when playing begins, then a bar with live statistics, on standard error.

    elapsed: the time that the first frame took [s], asked for when playing begins and added to the title.
    Yields a function to call with the statistics and the number of all frames. quiet, or no terminal: title only.
    """
    begun = False
    with progress_bar("frames", quiet=quiet) as show:

        def show_statistics(live: LiveStatistics, total: int) -> None:
            nonlocal begun
            if not begun:
                first = "" if elapsed is None else f", first frame after {elapsed():.1f} s"
                print_message(f"{title}{first}; Ctrl-C stops it", "progress")
                begun = True
            late = f"{live.underruns} underruns, {live.lateness * 1e3:.1f} ms behind"
            show(f"{live.queue_bytes >> 10} KiB under way, {late}", live.frames, total)

        yield show_statistics
