"""Every intersection strategy side by side: a list of them, and a picture on the same object and palm."""

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...datasets.errors import ContourFileError
from ...datasets.known_names import unknown_name
from ..contour_batch import HAND, MADE, ContourBatch
from ..errors import StrategyError
from ..hands.hand import Palm, PatchFrames
from ..hands.mesh_hand import MeshHand
from ..intersection.batch_rendering import render
from ..objects.mesh.solid_mesh import MeshObject
from ..sampling.contour_sampling import SamplingStrategy
from ..sampling.path import Path as ContourPath
from ..sampling.track import lay_track
from ..stages.polyline_arrays import divided
from ..stages.registry import ROLES, first_line, known_stages
from ..strategies.intersection_strategy import PRESETS, IntersectionStrategy
from .contour_figure import COLOURS, require_picture, save_picture

MADE_COLOUR = "#6a4c93"
COLUMNS = 5
WRAPPED = 40  # characters of a line of text over a panel
FINE = 1e-3  # [m] of the pieces that intensity is shown by
POSE = np.array([[0.0, 0.0, 0.2, np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]], np.float32)  # palm down, 20 cm high
ANGLE = [(-60, -30), (32, -30), (32, 0), (0, 0), (0, 52), (-60, 52)]  # [mm]; two legs, wider than the palm
HOLE, PEG = (12.0, (-22.0, 17.0)), (11.0, (24.0, 25.0))  # [mm] radius and middle
HEIGHT = 60.0  # [mm]
DEEP = 0.01  # [m] of the block that stands for a hand with an inside


def strategy_rows() -> list[tuple[str, str]]:
    """Every preset by name, with what it draws in one line."""
    from ..strategies.presets import PRESET_LINES

    return [(name, PRESET_LINES.get(name) or first_line(make)) for name, make in PRESETS.items()]


def stage_rows() -> list[tuple[str, str, str, str]]:
    """Every registered stage: role, name, what it does in one line, and its options with their defaults."""
    return [
        (role, name, entry.line, ", ".join(f"{key}={_default(option)}" for key, option in entry.options.items()))
        for role in ROLES
        for name, entry in known_stages(role).items()
    ]


def _default(option: Any) -> str:
    if option.default is None:
        return f"{option.widths:g} focal widths"
    text = f"{option.default:g}" if isinstance(option.default, float) else str(option.default)
    return f"{text} {option.unit}".rstrip()


def shown_object() -> MeshObject:
    """What the gallery is drawn on: an angle with a hole and a peg beside it, so corners, arcs and two regions."""
    from manifold3d import CrossSection, FillRule

    discs = [CrossSection.circle(radius, 48).translate(middle) for radius, middle in (HOLE, PEG)]
    flat = CrossSection([ANGLE], FillRule.Positive) - discs[0] + discs[1]
    mesh = flat.extrude(HEIGHT).translate((0.0, 0.0, 1e3 * float(POSE[0, 2]) - 0.5 * HEIGHT)).to_mesh()
    return MeshObject(1e-3 * np.asarray(mesh.vert_properties)[:, :3], np.asarray(mesh.tri_verts), name="angle and peg")


def shown_block(hand: Palm) -> MeshHand:
    """A hand with an inside: a block on the palm, DEEP deep, of which only the palm feels."""
    from manifold3d import Manifold

    block = Manifold.cube((hand.width, DEEP, hand.length)).translate((-hand.width / 2, 0.0, -hand.length / 2)).to_mesh()
    vertices, faces = np.asarray(block.vert_properties)[:, :3], np.asarray(block.tri_verts)
    palm = (vertices[faces][:, :, 1] < DEEP / 2).all(axis=1)
    return MeshHand(vertices.astype(np.float32), faces, glabrous=palm, name="block")


def draw_gallery(
    picture: Path, *, names: Sequence[str] | None = None, device: str = "cpu", overwrite: bool = False
) -> None:
    """Draw every preset on the same object and palm into a PNG, SVG or PDF; `names`: only these.

    Raises StrategyError for another kind of picture, one that is there unless `overwrite`, or an unknown name;
    ContourFileError where it cannot be written.
    """
    import matplotlib as mpl  # 0.7 s that only pictures cost
    from matplotlib.figure import Figure

    require_picture(picture, overwrite=overwrite)
    lines = dict(strategy_rows())
    for name in names or ():
        if name not in lines:
            raise StrategyError(unknown_name("strategy", name, lines))
    shown = list(names or lines)
    solid, hand = shown_object(), Palm()
    frames = hand.frames(POSE)
    section = _flat(render(solid, hand, POSE, IntersectionStrategy(), device=device), frames)
    rows = -(-(len(shown) + 1) // COLUMNS)
    with mpl.rc_context({"font.size": 7, "text.parse_math": False}):
        figure = Figure(figsize=(10.0, 2.2 * rows))
        figure.set_layout_engine("constrained", rect=(0.0, 0.0, 1.0, 0.985))  # titles reach higher than it thinks
        panels = figure.subplots(rows, COLUMNS, squeeze=False).ravel()
        for axes in panels:
            axes.set_axis_off()
        for axes, name in zip(panels, shown, strict=False):
            _draw_background(axes, section, frames)
            strategy = PRESETS[name]()
            needs_solid = strategy.raw_stage.name == "overlap"  # not for patches
            batch = render(solid, shown_block(hand) if needs_solid else hand, POSE, strategy, device=device)
            _draw_contours(axes, batch, frames)
            if needs_solid:
                note = f"the hand a block {1e3 * DEEP:g} mm deep, from above"
                told_below = axes.text(
                    0.0, -0.01, note, transform=axes.transAxes, fontsize=6, color="#444444", va="top"
                )
                told_below.set_in_layout(False)
            told = textwrap.wrap(lines[name], WRAPPED)
            told += [""] * (2 - len(told))
            axes.set_title(name, fontsize=9, fontweight="bold", loc="left", pad=9 * len(told) + 3)
            place = {"xy": (0.0, 1.0), "xycoords": "axes fraction", "xytext": (0, 3), "textcoords": "offset points"}
            axes.annotate("\n".join(told), **place, fontsize=6.5, color="#444444", va="bottom")
        _draw_legend(panels[len(shown)])
        try:
            save_picture(figure, picture, dpi=110)
        except OSError as error:
            raise ContourFileError(f"{picture}: the picture cannot be written ({error.strerror or error})") from error


def _flat(batch: ContourBatch, frames: PatchFrames) -> list[np.ndarray]:
    """Polylines of the first pose in the first patch's plane [mm], each of shape [point, 2]."""
    return [in_plane(points, frames) for points in batch.polylines_of(0)]


def in_plane(points: np.ndarray, frames: PatchFrames) -> np.ndarray:
    """Points [m], shape [point, 3], in the plane of the first pose's first patch [mm], shape [point, 2]."""
    off = np.asarray(points, np.float64) - frames.origin[0, 0]
    return 1e3 * np.stack([off @ frames.u[0, 0], off @ frames.v[0, 0]], axis=-1)


def _draw_background(axes: Any, section: list[np.ndarray], frames: PatchFrames) -> None:
    """The object's section, and the palm over it."""
    from matplotlib.patches import PathPatch, Rectangle
    from matplotlib.path import Path as Outline

    u, v = 1e3 * frames.half[0]
    skin = Rectangle((-u, -v), 2 * u, 2 * v, facecolor=COLOURS["palm"], alpha=0.28, edgecolor="none", zorder=1)
    rim = Rectangle((-u, -v), 2 * u, 2 * v, fill=False, edgecolor=COLOURS["palm"], lw=0.7, ls=(0, (4, 2)), zorder=2)
    axes.add_patch(skin)
    outline = Outline.make_compound_path(*(Outline(loop, closed=True) for loop in section))
    axes.add_patch(PathPatch(outline, facecolor=COLOURS["mesh"], alpha=0.3, edgecolor="none", zorder=0))
    axes.add_patch(rim)
    extent = np.concatenate([*section, [[-u, -v], [u, v]]])
    (left, low), (right, high) = extent.min(axis=0) - 3, extent.max(axis=0) + 3
    axes.set_xlim(left, right)
    axes.set_ylim(low, high)
    axes.set_aspect("equal")


def _draw_contours(axes: Any, batch: ContourBatch, frames: PatchFrames) -> None:
    """Contours by kind and intensity, pauses as dots, jumps dotted."""
    from matplotlib.collections import LineCollection

    path = ContourPath.of(batch, 0)
    if path is None:
        axes.text(0, 0, "no contour", ha="center", va="center")
        return
    fine = divided(batch, FINE)
    last = fine.polyline_start[1:] - 1
    here = np.setdiff1d(np.arange(fine.point_count), last)
    flat = in_plane(fine.points, frames)
    strength = np.ones(len(flat)) if fine.intensity is None else fine.intensity
    strength = 0.5 * (strength[here] + strength[here + 1])
    colours = [{HAND: COLOURS["hand"], MADE: MADE_COLOUR}.get(k, COLOURS["object"]) for k in fine.kind[here].tolist()]
    ends = np.stack([flat[here], flat[here + 1]], axis=1)
    axes.add_collection(
        LineCollection(
            list(ends), colors=colours, lw=0.4 + 2.0 * strength**1.5, alpha=0.25 + 0.75 * strength, capstyle="round"
        )
    )
    if batch.dwell is not None:
        rests = in_plane(batch.points[batch.dwell > 0], frames)
        axes.plot(rests[:, 0], rests[:, 1], "o", ms=4.5, color="#222222", mec="white", mew=0.6, zorder=5)
    track = lay_track(path, SamplingStrategy())
    jump = np.flatnonzero((np.diff(track.knot) <= 0) & (track.step != 0).any(axis=1))
    ways = [track.points[i : i + 2] for i in jump] + [track.points[[-1, 0]]]
    for way in ways:
        x, y = in_plane(way, frames).T
        if np.hypot(x[1] - x[0], y[1] - y[0]) > 1.0:
            axes.plot(x, y, ":", color="#222222", lw=0.9, zorder=4)


def _draw_legend(axes: Any) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles = [
        Line2D([], [], color=COLOURS["object"], lw=2.2, label="the object's edge"),
        Line2D([], [], color=COLOURS["hand"], lw=2.2, label="the hand's edge"),
        Line2D([], [], color=MADE_COLOUR, lw=2.2, label="made by a transformation"),
        Line2D([], [], color="#666666", lw=0.7, alpha=0.6, label="thin and pale: weak"),
        Line2D([], [], color="#222222", marker="o", ls="", ms=4.5, label="pause"),
        Line2D([], [], color="#222222", ls=":", lw=0.9, label="jump, not drawn"),
        Patch(facecolor=COLOURS["palm"], alpha=0.28, label="palm, 85 x 85 mm"),
        Patch(facecolor=COLOURS["mesh"], alpha=0.3, label="section of the object"),
    ]
    axes.legend(handles=handles, loc="center left", frameon=False, fontsize=7.5)
