"""Contours as lines in a picture: colour and dashes by kind, paler where they are weaker, pauses as dots."""

from typing import Any

import numpy as np

from ...datasets.storage.schema import KIND_NAMES
from ..contour_batch import HAND, ContourBatch
from ..stages.curves import divide_batch
from .picture_style import COLOURS, HAND_DASHES, INK, paler

FINE = 1e-3  # [m] of the pieces by which varying intensity is shown
WIDTH = 2.2  # [pt]
HALO = 1.0  # [pt] of white beside lines, which sets them off from what is below
LEVELS = 20  # of intensity that are shown: neighbours of one level are one line


def draw_contours(axes: Any, batch: ContourBatch, place: Any, *, width: float = WIDTH) -> list[Any]:
    """Add the contours of a batch of one pose to axes, whose limits are set; returns the artists.

    place: function of points [m], shape [point, 3], that gives them in the picture, shape [point, 2]. width: [pt].
    """
    from matplotlib.collections import LineCollection

    lines, kind, strength = intensity_runs(batch)
    shown = [place(line) for line in lines]
    colours = [paler(COLOURS[KIND_NAMES[k]], s) for k, s in zip(kind, strength, strict=True)]
    # Dashes go on from line to line, as one contour is many lines where its intensity varies. Units: widths of a line.
    unit = axes.get_window_extent().width / axes.figure.dpi * 72 / abs(np.subtract(*axes.get_xlim())) / width
    length = [unit * np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in shown]
    offset = np.concatenate([[0.0], np.where(kind == HAND, length, 0.0).cumsum()]) % sum(HAND_DASHES)
    dashes = [(float(at), HAND_DASHES) if k == HAND else "-" for at, k in zip(offset, kind, strict=False)]
    ends = {"capstyle": "round", "joinstyle": "round"}
    artists: list[Any] = [
        LineCollection(shown, colors=[("white", 0.7)], linewidths=width + HALO, zorder=2.9, **ends),
        LineCollection(shown, colors=colours, linewidths=width, linestyles=dashes, zorder=3.0, **ends),
    ]
    for artist in artists:
        axes.add_collection(artist, autolim=False)
    if batch.dwell is not None and (batch.dwell > 0).any():
        at = place(batch.points[batch.dwell > 0])
        look = {"ms": 4.5, "color": INK, "mec": "white", "mew": 0.6, "zorder": 3.2}
        artists += axes.plot(at[:, 0], at[:, 1], "o", **look)
    return artists


def varies(batch: ContourBatch) -> bool:
    """Whether any part of the contours is weaker than full intensity."""
    return batch.intensity is not None and batch.point_count > 0 and float(batch.intensity.min()) < 1.0


def intensity_runs(batch: ContourBatch) -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
    """Lines [m] of one kind and one intensity each, their kinds, and their intensities; finely cut where it varies."""
    fine = divide_batch(batch, FINE) if varies(batch) else batch
    count = fine.point_count
    last = np.zeros(count, bool)
    last[fine.polyline_start[1:] - 1] = True
    segment = np.flatnonzero(~last)
    points = np.ones(count) if fine.intensity is None else np.asarray(fine.intensity, np.float64)
    strength = 0.5 * (points[segment] + points[np.minimum(segment + 1, count - 1)])
    strength = np.round(strength * LEVELS) / LEVELS
    kind = fine.kind[segment]
    goes_on = (np.diff(segment) == 1) & (np.diff(kind) == 0) & (np.diff(strength) == 0)
    first = np.concatenate([[True], ~goes_on])[: len(segment)]
    start = np.flatnonzero(first)
    stop = np.append(start[1:], len(segment))
    lines = [fine.points[segment[a] : segment[b - 1] + 2] for a, b in zip(start, stop, strict=True)]
    return lines, kind[start], strength[start]
