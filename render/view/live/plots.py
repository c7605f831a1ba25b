"""Plots beside the timeline: length of the whole file, and length, frequency and tilt around the shown moment."""

from collections.abc import Sequence

import numpy as np
import viser
from viser import uplot

from ...reports.picture_style import LINES
from ..series import Overview, PoseWindow, Steps

NOW, JUMP, HOP = "#111111", "#d628a0", "#f77f00"
HEIGHT = 130  # [pixel]
HOP_HEIGHT = 0.07  # of a plot of lengths
POINTS, DOTS = 8, 3  # [pixel] of markers, and of what lines are made of
MILLIMETRES = 1e3
FREQUENCY_SHOWN = 500.0  # [Hz]; contours of a few millimetres would stretch the axis a hundredfold


class OverviewPlot:
    """Longest contours of each stretch of the whole files, and where the shown moment is."""

    def __init__(
        self, server: viser.ViserServer, overviews: Sequence[Overview], labels: Sequence[str], *, by_time: bool
    ) -> None:
        self._now: float | None = None
        self._by_time = by_time
        self._time, self._lines = self._lines_in(overviews)
        series = [uplot.Series(label=_unit(by_time)), *_lines_of(labels), _marker("now", NOW)]
        axes = (uplot.Axis(label="time [s]" if by_time else "pose"), uplot.Axis(label="length [mm]"))
        self._plot = server.gui.add_uplot(
            (self._time, *self._lines, np.full(len(self._time), np.nan)),
            series=tuple(series),
            title="whole file",
            scales={"x": uplot.Scale(time=False)},
            axes=axes,
            height=HEIGHT,
            legend=uplot.Legend(show=False),
        )

    def replace(self, overviews: Sequence[Overview]) -> None:
        """Show other lines of the same files, of which more poses are done."""
        self._time, self._lines = self._lines_in(overviews)
        self.mark(self._time[0] if self._now is None else self._now)

    def _lines_in(self, overviews: Sequence[Overview]) -> tuple[np.ndarray, list[np.ndarray]]:
        return on_one_axis([(each.places(by_time=self._by_time), (MILLIMETRES * each.longest,)) for each in overviews])

    def mark(self, now: float) -> None:
        """Mark a time [s], or a pose's number."""
        self._now = now
        bin_number = max(0, int(np.searchsorted(self._time, now, side="right")) - 1)
        marker = np.full(len(self._time), np.nan)
        value = self._lines[0][bin_number]
        marker[bin_number] = 0.0 if np.isnan(value) else value
        _fill(self._plot, self._time, [*self._lines, marker])


class WindowPlots:
    """Length (with jumps and hops), draw frequency and tilt of every pose around the shown moment."""

    def __init__(self, server: viser.ViserServer, labels: Sequence[str], *, by_time: bool) -> None:
        self._by_time = by_time
        empty = (np.zeros(1), *(np.full(1, np.nan),) * (len(labels) + 1))
        marks = (_marker("now", NOW),)
        steps = (_marker("jump", JUMP, DOTS), _marker("hop", HOP, DOTS))
        self._length = _plot(
            server, "length [mm]", (*_lines_of(labels), *marks, *steps), (*empty, empty[1], empty[1]), by_time=by_time
        )
        self._frequency = _plot(server, "draw frequency [Hz]", (*_lines_of(labels), *marks), empty, by_time=by_time)
        self._tilt = _plot(server, "tilt to the array [degree]", (*_lines_of(labels), *marks), empty, by_time=by_time)

    def show(self, windows: Sequence[PoseWindow], steps: Sequence[Steps], now: float) -> None:
        """Show windows of the files around a time [s], or a pose's number; and the steps of the first file."""
        columns = [
            (
                each.places(by_time=self._by_time),
                (MILLIMETRES * each.length, each.draw_frequency, np.degrees(each.tilt)),
            )
            for each in windows
        ]
        time, lines = on_one_axis(columns)
        length, frequency, tilt = (lines[k::3] for k in range(3))
        now_at = max(0, int(np.searchsorted(time, now, side="right")) - 1)
        top = float(np.nanmax(length[0], initial=0.0))
        marked = [
            _marks(windows[0].time, times, height * top)  # below the line, which they would hide
            for times, height in ((steps[0].jump, 0.0), (steps[0].hop, HOP_HEIGHT))
        ]
        _fill(self._length, time, [*length, _at(time, now_at, length[0]), *marked])
        _fill(self._frequency, time, [*frequency, _at(time, now_at, frequency[0])], FREQUENCY_SHOWN)
        _fill(self._tilt, time, [*tilt, _at(time, now_at, tilt[0])])


def level_plot(
    server: viser.ViserServer, lines: Sequence[tuple[np.ndarray, tuple[np.ndarray]]], labels: Sequence[str]
) -> viser.GuiUplotHandle:
    """Levels of noise over time, one line for each file; lines: times [s], and levels [dB]."""
    time, levels = on_one_axis(lines)
    plot = _plot(server, "noise [dB(A)]", _lines_of(labels), (time, *levels), by_time=True)
    known = np.concatenate(levels)
    known = known[np.isfinite(known)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)
    plot.scales = {"x": uplot.Scale(time=False), "y": uplot.Scale(range=(low - 3.0, high + 3.0))}
    return plot


def on_one_axis(
    columns: Sequence[tuple[np.ndarray, tuple[np.ndarray, ...]]],
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Lines of several files on the first file's times: each value is that of the latest time before."""
    time = columns[0][0]
    lines = list(columns[0][1])
    for own, values in columns[1:]:
        row = np.searchsorted(own, time, side="right") - 1
        inside = (row >= 0) & (time <= own[-1])
        lines += [np.where(inside, value[np.maximum(row, 0)], np.nan) for value in values]
    return time, lines


def _lines_of(labels: Sequence[str]) -> tuple[uplot.Series, ...]:
    """Lines of dots: where there is no value there is none, while uPlot would join what is before to what follows."""
    return tuple(_marker(label, LINES[k % len(LINES)], DOTS) for k, label in enumerate(labels))


def _marker(label: str, colour: str, size: float = POINTS) -> uplot.Series:
    return uplot.Series(
        label=label, stroke=colour, width=0, points={"show": True, "size": size, "fill": colour, "stroke": colour}
    )


def _unit(by_time: bool) -> str:
    """What the axis of plots shows."""
    return "s" if by_time else "pose"


def _plot(
    server: viser.ViserServer,
    title: str,
    series: tuple[uplot.Series, ...],
    data: tuple[np.ndarray, ...],
    *,
    by_time: bool,
) -> viser.GuiUplotHandle:
    return server.gui.add_uplot(
        data,
        series=(uplot.Series(label=_unit(by_time)), *series),
        title=title,
        scales={"x": uplot.Scale(time=False)},
        axes=(uplot.Axis(), uplot.Axis()),
        height=HEIGHT,
        legend=uplot.Legend(show=False),
    )


def _fill(plot: viser.GuiUplotHandle, time: np.ndarray, lines: Sequence[np.ndarray], most: float = np.inf) -> None:
    """Give a plot its lines, and a range from 0 to a little over the largest value: uPlot finds none among NaN."""
    plot.data = (time, *lines)
    values = np.concatenate(list(lines))
    top = min(float(np.nanmax(values, initial=0.0)), most)
    top = 1.05 * top or 1.0
    scales = {"x": uplot.Scale(time=False), "y": uplot.Scale(range=(0.0, top))}
    if plot.scales != scales:
        plot.scales = scales


def _at(time: np.ndarray, row: int, line: np.ndarray) -> np.ndarray:
    marker = np.full(len(time), np.nan)
    marker[row] = 0.0 if np.isnan(line[row]) else line[row]
    return marker


def _marks(time: np.ndarray, times: np.ndarray, height: float) -> np.ndarray:
    """A height at the rows that times fall into, NaN elsewhere."""
    marker = np.full(len(time), np.nan)
    row = np.unique(np.searchsorted(time, times, side="right") - 1)
    marker[row[(row >= 0) & (row < len(time))]] = height
    return marker
