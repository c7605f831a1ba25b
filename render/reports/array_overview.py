"""A small scene of the whole setting: the array of transducers, the object above it, and the way of the palm."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...datasets.rigid import rotate
from ...device.array import ArrayModel
from .picture_style import FAINT, INK
from .scene_drawing import SceneSource, blank, draw_object, set_limits
from .scene_view import SceneView, flat

FACE, RIM, DISC = "#eef1f5", "#5b6470", "#a3afbd"
FAR = 0.8  # [m] from the array's middle to the object's; farther arrays are left out
WAY_MOST = 2000  # poses of the palm's way that are drawn
CIRCLE = np.linspace(0, 2 * np.pi, 13)[:-1]
FOOT = 0.12  # of the height, below, for the scale bar
GAP = 0.46  # radius of a drawn transducer as a share of the distance to the nearest one


def is_near(model: ArrayModel, source: SceneSource) -> bool:
    """Whether an array and the object fit into one picture."""
    middle = source.triangles(0).reshape(-1, 3)
    middle = 0.5 * (middle.min(axis=0) + middle.max(axis=0))
    return float(np.linalg.norm(model.position.mean(axis=0) - middle)) <= FAR


def draw_overview(
    axes: Any,
    source: SceneSource,
    poses: np.ndarray,
    view: SceneView,
    models: Sequence[ArrayModel],
) -> None:
    """Draw arrays, the object at the first pose shown, the palm's way, and where it is at the poses shown."""
    box, font = axes.get_window_extent(), axes.xaxis.label.get_size()
    aspect = box.width / box.height
    blank(axes)
    basis = SceneView(view.elevation, view.azimuth).basis()
    places = [flat(source.triangles(int(poses[0])).reshape(-1, 3), basis)]
    for model in models:
        places.append(_draw_array(axes, model, basis))
    draw_object(axes, source.triangles(int(poses[0])), basis)
    step = max(1, len(source.pose) // WAY_MOST)
    way = flat(source.pose[::step, :3], basis)
    if len(source.pose) > 1:
        axes.plot(way[:, 0], way[:, 1], color=FAINT, lw=0.5, alpha=0.7, zorder=2)
    marks = flat(source.pose[poses, :3], basis)
    axes.plot(marks[:, 0], marks[:, 1], "o", ms=1.4 * font, mfc="white", mec=INK, mew=0.7, zorder=4)
    for k, mark in enumerate(marks):
        axes.annotate(letter(k), mark, ha="center", va="center_baseline", zorder=5)
    places += [way, marks]
    low, high = (getattr(np.concatenate(places), end)(axis=0) for end in ("min", "max"))
    low = low - FOOT * (high - low) * [0.0, 1.0]
    half = 0.52 * (high - low) + 6
    set_limits(axes, 0.5 * (low + high), np.array([max(half[0], half[1] * aspect), max(half[1], half[0] / aspect)]))


def _draw_array(axes: Any, model: ArrayModel, basis: np.ndarray) -> np.ndarray:
    """Add an array: its face and its transducers as discs; returns places [mm] that it takes."""
    from matplotlib.collections import PolyCollection

    position = model.position.astype(np.float64)
    nearest = np.linalg.norm(position[1:] - position[0], axis=1).min() if len(position) > 1 else 0.01
    across, along = rotate(np.asarray(model.pose, np.float64)[3:], np.eye(3)[:2])
    ring = GAP * nearest * (np.cos(CIRCLE)[:, None] * across + np.sin(CIRCLE)[:, None] * along)
    discs = flat(position[:, None] + ring, basis)
    local = (position - position.mean(axis=0)) @ np.stack([across, along]).T
    half = np.abs(local).max(axis=0) + 0.5 * nearest
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    face = flat(position.mean(axis=0) + corners @ np.stack([across, along]), basis)
    look = {"linewidths": 0.5, "edgecolors": [RIM]}
    axes.add_collection(PolyCollection([face], facecolors=[FACE], zorder=0.1, **look), autolim=False)
    axes.add_collection(
        PolyCollection(list(discs), facecolors=[DISC], zorder=0.2, linewidths=0),
        autolim=False,
    )
    return face


def letter(k: int) -> str:
    """The name of a moment: a, b, c ..."""
    return chr(ord("a") + k)
