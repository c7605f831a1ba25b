"""Progress of the command line on standard error, where that is a terminal."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from ..runtime.loading_progress import Watch, unwatched
from .foreign_text import errors, print_message, shows_progress, visible

if TYPE_CHECKING:
    from ...device.report import LiveStatistics

DESCRIPTION = TextColumn("{task.description}", markup=False)

LOADING_SILENT = 1.0  # [s] before a progress bar for loading appears


@contextlib.contextmanager
def progress_bar(title: str, *, quiet: bool) -> Iterator[Callable[[int, int], None]]:
    """Progress bar on standard error; yields a function to call with the count done and the total."""
    if quiet or not shows_progress():
        yield lambda done, total: None
        return
    columns = (DESCRIPTION, BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=errors, transient=True) as progress:
        task = progress.add_task(visible(title), total=None)
        yield lambda done, total: progress.update(task, completed=done, total=total)


@contextlib.contextmanager
def loading_bar(title: str, *, quiet: bool) -> Iterator[Watch]:
    """Progress bar with the stage's name on standard error, once loading has taken LOADING_SILENT.

    A timer starts it, because a stage that is one call of NumPy reports nothing before its end.
    """
    if quiet or not shows_progress():
        yield unwatched
        return
    columns = (DESCRIPTION, BarColumn(), TimeElapsedColumn())
    progress = Progress(*columns, console=errors, transient=True)
    task = progress.add_task(visible(title), total=None)
    timer = threading.Timer(LOADING_SILENT, progress.start)
    timer.daemon = True
    timer.start()
    try:
        yield lambda stage, done, total: progress.update(
            task, description=visible(f"{title}: {stage}"), completed=done, total=total if done else None
        )
    finally:
        timer.cancel()
        timer.join()
        progress.stop()


@contextlib.contextmanager
def playback_line(
    title: str, *, quiet: bool, elapsed: Callable[[], float] | None = None
) -> Iterator[Callable[[LiveStatistics, int], None]]:
    """A title when playing begins, then live statistics, on standard error.

    elapsed: the time that the first frame took [s], asked for when playing begins and added to the title.
    Yields a function to call with the statistics and the number of all frames. quiet, or no terminal: title only.
    """
    begun = False

    def begin() -> None:
        nonlocal begun
        if not begun:
            first = "" if elapsed is None else f", first frame after {elapsed():.1f} s"
            print_message(f"{title}{first}; Ctrl-C stops it", "progress")
            begun = True

    if quiet or not shows_progress():
        yield lambda live, total: begin()
        return
    statistics = TextColumn("{task.fields[statistics]}", markup=False)
    with Progress(BarColumn(), MofNCompleteColumn(), statistics, console=errors, transient=True) as progress:
        task = progress.add_task("frames", total=None, statistics="")

        def show(live: LiveStatistics, total: int) -> None:
            begin()
            text = (
                f"{live.queue_bytes >> 10} KiB under way, {live.underruns} underruns, "
                f"{live.lateness * 1e3:.1f} ms behind"
            )
            progress.update(task, completed=live.frames, total=total, statistics=text)

        yield show
