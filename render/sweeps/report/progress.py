"""How far a sweep is, on standard error: a bar on a terminal, else a line from time to time, as logs of CI have it."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from ...terminal.bars import progress_bar
from ...terminal.foreign_text import errors, print_message
from ..run.sweep_run import SweepProgress, clock_time

LINE_SECONDS = 30.0
"""Least time between two lines; a sweep that takes less prints none."""

Watch = Callable[[SweepProgress], None]


@contextmanager
def sweep_bar(*, as_json: bool) -> Iterator[Watch]:
    """A function to call with the progress of a sweep, which shows recipes, poses a second and the time to go.

    as_json: whether a program reads the results; then a terminal has no bar. Lines are printed nevertheless, because
    standard output stays free of them and a log that is silent for long looks like a sweep that hangs.
    """
    if not errors.is_terminal:
        yield _print_lines()
        return
    with progress_bar("recipes", quiet=as_json) as show:
        yield lambda progress: show(_pace(progress), progress.recipes, progress.recipe_count)


def _print_lines() -> Watch:
    last = time.monotonic()

    def show(progress: SweepProgress) -> None:
        nonlocal last
        if (now := time.monotonic()) >= last + LINE_SECONDS:
            last = now
            print_message(f"{progress.recipes:,} of {progress.recipe_count:,} recipes, {_pace(progress)}", "progress")

    return show


def _pace(progress: SweepProgress) -> str:
    left = "" if progress.seconds_left is None else f", {clock_time(progress.seconds_left)} to go"
    return f"{progress.rate:,.0f} poses/s{left}"
