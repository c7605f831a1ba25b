"""Every intersection strategy side by side: a list of them, and a picture on the same object and palm."""

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...datasets.known_names import unknown_name
from ...datasets.storage.schema import KIND_NAMES
from ..contour_batch import ContourBatch
from ..errors import StrategyError
from ..hands.hand import Palm, PatchFrames
from ..hands.mesh_hand import MeshHand
from ..intersection.batch_rendering import collect
from ..intersection.job import ContourJob
from ..intersection.scene import Scene
from ..objects.mesh.solid_mesh import MeshObject
from ..sampling.sampler import laid_jumps
from ..sampling.strategy import SamplingStrategy
from ..stages.registry import ROLES, find_stage, first_line, known_stages
from ..strategies.intersection_strategy import PRESETS, IntersectionStrategy
from .contour_lines import WIDTH, draw_contours, varies
from .picture_style import COLOURS, INK, picture_bytes, require_picture, style, write_picture
from .rendering_labels import short_text

COLUMNS = 5
WRAPPED = 40  # characters of a line of text over a panel
NAME_MOST = 22  # characters of a title
STRATEGIES_MOST = 12
GREY, DPI = "#444444", 120
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


class Panel(NamedTuple):
    """One strategy of a picture."""

    title: str
    text: str
    strategy: IntersectionStrategy


def draw_gallery(
    picture: Path, *, names: Sequence[str] | None = None, device: str = "cpu", overwrite: bool = False
) -> None:
    """Draw every preset on the same object and palm into a PNG, SVG or PDF; `names`: only these.

    Raises StrategyError for another kind of picture, one that is there unless `overwrite`, or an unknown name;
    ContourFileError where it cannot be written.
    """
    require_picture(picture, overwrite=overwrite)
    lines = dict(strategy_rows())
    for name in names or ():
        if name not in lines:
            raise StrategyError(unknown_name("strategy", name, lines))
    panels = [Panel(name, lines[name], PRESETS[name]()) for name in names or lines]
    _write(gallery_figure(panels, device=device), picture)


def draw_strategies(
    picture: Path, strategies: Mapping[str, IntersectionStrategy], *, device: str = "cpu", overwrite: bool = False
) -> None:
    """Draw strategies by name on the gallery's object and palm, each after the raw intersection that it begins with.

    Raises StrategyError for no strategy, more than STRATEGIES_MOST, another kind of picture, and one that is there
    unless `overwrite`; ContourFileError where it cannot be written.
    """
    require_picture(picture, overwrite=overwrite)
    _write(strategies_figure(strategies, device=device), picture)


def strategies_figure(strategies: Mapping[str, IntersectionStrategy], *, device: str = "cpu") -> Any:
    """The picture that `draw_strategies` writes, as a matplotlib figure."""
    if not 1 <= len(strategies) <= STRATEGIES_MOST:
        raise StrategyError(f"a picture shows 1 to {STRATEGIES_MOST} strategies, not {len(strategies)}")
    return gallery_figure(_with_raw(strategies), device=device)


def _with_raw(strategies: Mapping[str, IntersectionStrategy]) -> list[Panel]:
    """Strategies, each after its raw intersection unless a panel before shows that."""
    panels: list[Panel] = []
    for name, strategy in strategies.items():
        raw = IntersectionStrategy(raw=strategy.raw_stage, step=strategy.step, modules=strategy.modules)
        title = short_text(name, NAME_MOST)
        if all(panel.strategy != raw for panel in panels):
            line = find_stage("raw", raw.raw_stage.name).line
            panels.append(Panel(title if strategy == raw else f"raw: {raw.raw_stage.name}", line, raw))
        if strategy != raw:
            panels.append(Panel(title, _stages_text(strategy), strategy))
    return panels


def _stages_text(strategy: IntersectionStrategy) -> str:
    """The stages after the raw intersection, in words."""
    parts = []
    for role in ("prune", "transform"):
        for stage in strategy.stages()[role]:
            options = find_stage(role, stage.name).options
            values = [
                f", {key} {f'{value:.3g}' if isinstance(value, float) else value} {options[key].unit}"
                for key, value in stage.options.items()
            ]
            parts.append(stage.name + "".join(value.rstrip() for value in values))
    return textwrap.shorten(short_text(" + ".join(parts), 400), 2 * WRAPPED, placeholder=" …")


def _contours(solid: MeshObject, hand: Palm | MeshHand, strategy: IntersectionStrategy, device: str) -> ContourBatch:
    return collect(ContourJob.of(Scene.of(solid, hand, strategy), POSE, device=device))[0]


def gallery_figure(panels: Sequence[Panel], *, device: str = "cpu") -> Any:
    """Strategies side by side on the same object and palm, and what the marks mean, as a matplotlib figure."""
    import matplotlib as mpl  # 0.7 s that only pictures cost
    from matplotlib.figure import Figure

    solid, hand = shown_object(), Palm()
    frames = hand.frames(POSE)
    plain = _contours(solid, hand, IntersectionStrategy(), device)
    section = [in_plane(points, frames) for points in plain.polylines_of(0)]  # [mm], each of shape [point, 2]
    columns = min(COLUMNS, max(len(panels) + 1, 3))
    rows = -(-(len(panels) + 1) // columns)
    with mpl.rc_context(style(**{"font.size": 7, "text.parse_math": False})):
        figure = Figure(figsize=(2.0 * columns, 2.2 * rows))
        figure.set_layout_engine("constrained", rect=(0.0, 0.0, 1.0, 0.985))  # titles reach higher than it thinks
        places = figure.subplots(rows, columns, squeeze=False).ravel()
        for axes in places:
            axes.set_axis_off()
        batches = []
        for axes, panel in zip(places, panels, strict=False):
            _draw_background(axes, section, frames)
            needs_solid = panel.strategy.raw_stage.name == "overlap"  # not for patches
            batch = _contours(solid, shown_block(hand) if needs_solid else hand, panel.strategy, device)
            batches.append(batch)
            _draw_panel(axes, batch, frames)
            if needs_solid:
                note = f"the hand a block {1e3 * DEEP:g} mm deep, from above"
                below = axes.text(0.0, -0.01, note, transform=axes.transAxes, fontsize=6, color=GREY, va="top")
                below.set_in_layout(False)
            lines = textwrap.wrap(panel.text, WRAPPED)[:2]
            lines += [""] * (2 - len(lines))
            axes.set_title(panel.title, fontsize=9, fontweight="bold", loc="left", pad=9 * len(lines) + 3)
            place = {"xy": (0.0, 1.0), "xycoords": "axes fraction", "xytext": (0, 3), "textcoords": "offset points"}
            axes.annotate("\n".join(lines), **place, fontsize=6.5, color=GREY, va="bottom")
        _draw_legend(places[len(panels)], batches)
    return figure


def _write(figure: Any, picture: Path) -> None:
    write_picture(picture_bytes(figure, picture.suffix.lower().removeprefix("."), dpi=DPI), picture)


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


def _draw_panel(axes: Any, batch: ContourBatch, frames: PatchFrames) -> None:
    """Contours by kind and intensity, pauses as dots, jumps dotted."""
    if not batch.point_count:
        axes.text(0, 0, "no contour", ha="center", va="center")
        return
    draw_contours(axes, batch, lambda points: in_plane(points, frames))
    for way in _jumps(batch, frames):
        axes.plot(*way.T, ":", color=INK, lw=0.9, zorder=4)


def _jumps(batch: ContourBatch, frames: PatchFrames) -> list[np.ndarray]:
    """Ways of more than a millimetre that the focal point jumps [mm], each of shape [2, 2]."""
    ways = [in_plane(way, frames) for way in laid_jumps(batch, SamplingStrategy())]
    return [way for way in ways if np.linalg.norm(way[1] - way[0]) > 1.0]


def _draw_legend(axes: Any, batches: Sequence[ContourBatch]) -> None:
    """What the marks mean that are in the panels."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    kinds = {int(k) for batch in batches for k in batch.kind.tolist()}
    frames = Palm().frames(POSE)
    texts = ("the object's edge", "the hand's edge", "made by a transformation")
    handles: list[Any] = [
        Line2D([], [], color=COLOURS[KIND_NAMES[k]], lw=WIDTH, label=texts[k]) for k in range(3) if k in kinds
    ]
    if any(varies(batch) for batch in batches):
        handles.append(Line2D([], [], color="#666666", lw=0.7, alpha=0.6, label="thin and pale: weak"))
    if any(batch.dwell is not None and (batch.dwell > 0).any() for batch in batches):
        handles.append(Line2D([], [], color=INK, marker="o", ls="", ms=4.5, mec="white", label="pause"))
    if any(_jumps(batch, frames) for batch in batches):
        handles.append(Line2D([], [], color=INK, ls=":", lw=0.9, label="jump, not drawn"))
    u, v = 2e3 * frames.half[0]
    handles += [
        Patch(facecolor=COLOURS["palm"], alpha=0.28, label=f"palm, {u:g} x {v:g} mm"),
        Patch(facecolor=COLOURS["mesh"], alpha=0.3, label="section of the object"),
    ]
    axes.legend(handles=handles, loc="center left", frameon=False, fontsize=7.5)
