"""Progress of a sweep off a terminal: few lines on standard error, each of which can be read alone."""

from contextlib import contextmanager
from io import StringIO

import pytest
from rich.console import Console

from palpate.render.sweeps.report import progress
from palpate.render.sweeps.report.progress import sweep_bar
from palpate.render.sweeps.run.sweep_run import SweepProgress


@pytest.fixture
def lines(monkeypatch):
    """Seconds -> lines printed by then, by a sweep that reports its progress each second."""
    printed, now = [], [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(progress, "print_message", lambda text, kind: printed.append(text))

    def run(seconds, *, as_json=False):
        with sweep_bar(as_json=as_json) as watch:
            for second in range(seconds):
                now[0] += 1.0
                watch(SweepProgress(second, 1200, 10**6, 12345.6, 90.0 if second else None))
        return printed

    return run


@pytest.mark.parametrize("as_json", [False, True])
def test_a_long_sweep_prints_a_line_at_most_every_thirty_seconds(lines, as_json):
    assert lines(29, as_json=as_json) == []
    assert len(lines(65, as_json=as_json)) == 2
    assert lines(0)[0] == "29 of 1,200 recipes, 12,346 poses/s, 1 min 30 s to go"


def test_a_terminal_has_a_bar_instead_unless_a_program_reads_the_results(lines, monkeypatch):
    bars = []

    @contextmanager
    def progress_bar(title, *, quiet):
        yield lambda *given: None if quiet else bars.append(given)

    monkeypatch.setattr(progress, "errors", Console(file=StringIO(), force_terminal=True))
    monkeypatch.setattr(progress, "progress_bar", progress_bar)
    assert lines(30, as_json=True) == bars == []
    assert lines(2) == []
    assert bars == [("12,346 poses/s", 0, 1200), ("12,346 poses/s, 1 min 30 s to go", 1, 1200)]
