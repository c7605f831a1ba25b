"""A picture of what was rendered: contours on the object, the palm, length and draw frequency over time."""

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...datasets.contour_file.reader import ContourFile
from ...datasets.errors import ContourFileError
from ...datasets.rigid import rotate
from ...datasets.storage.durable import write_file
from ...datasets.storage.schema import KIND_NAMES
from ..contour_batch import ContourBatch
from ..errors import StrategyError
from ..hands.hand import Hand, hand_from
from ..hands.mesh_hand import MeshHand
from ..sampling.contour_sampling import SamplingStrategy
from ..terminal.foreign_text import visible
from ..validation import require_path, value_text

COLOURS = {"object": "#c1121f", "hand": "#1d6fa5", "made": "#2a9d8f", "mesh": "#8d99ae", "palm": "#f4a261"}
LINES = ("#2b2d42", "#2a9d8f", "#9b5de5", "#bc6c25")  # of lengths and frequencies: not those of the contours
POSES_SHOWN = 3
SUFFIXES = (".png", ".svg", ".pdf")
FREQUENCY_SHOWN = 1000.0  # [Hz]; contours of a few millimetres would stretch the axis a hundredfold
ELEVATION, AZIMUTH = 22.0, -60.0  # [degree] of the eye


def shown_poses(length: np.ndarray, normal: np.ndarray, count: int = POSES_SHOWN) -> np.ndarray:
    """Poses to show: in each of `count` equal stretches the one of longest contour, as far as it faces the eye.

    length: [m], shape [pose]; normal: of the palm, shape [pose, 3]. The first pose if none has a contour.
    """
    azimuth, elevation = np.radians([AZIMUTH, ELEVATION])
    eye = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    seen = length * np.abs(normal @ eye)
    best = [part[np.argmax(seen[part])] for part in np.array_split(np.arange(len(seen)), min(count, len(seen)))]
    return np.array([i for i in best if seen[i] > 0] or [0])


def require_picture(picture: Path, *, overwrite: bool, also: tuple[str, ...] = ()) -> None:
    """Raise StrategyError for a name that is none of a picture, a file that is there unless `overwrite`, and no folder.

    also: other suffixes that may be written.
    """
    if picture.suffix.lower() not in (*SUFFIXES, *also):
        raise StrategyError(f"{picture}: must end in one of {', '.join((*SUFFIXES, *also))}")
    if picture.exists() and not overwrite:
        raise StrategyError(f"{picture}: exists; overwrite=True replaces it")
    if not picture.parent.is_dir():
        raise StrategyError(f"{picture}: cannot be written, as there is no folder {picture.parent}")


def save_picture(figure: Any, picture: Path, *, dpi: int) -> None:
    """Write a matplotlib figure whole or not at all; raises OSError."""
    content = io.BytesIO()
    figure.savefig(content, dpi=dpi, format=picture.suffix.lower().removeprefix("."))
    write_file(picture, content.getbuffer())


def draw_figure(
    paths: dict[str, str | Path],
    picture: str | Path,
    *,
    sampling: SamplingStrategy | None = None,
    overwrite: bool = False,
) -> None:
    """Draw one picture of renderings of the same object and motion, by label, into a PNG, SVG or PDF.

    The contours shown are those of the last file. Raises StrategyError for another kind of picture, for one that is
    there unless `overwrite`, and for files of different objects or motions; ContourFileError where a file cannot be
    read, or the picture not be written.

    >>> from pathlib import Path
    >>> from palpate.render import draw_figure, render, static_pose
    >>> path = render("cube", "palm", static_pose([0, 0, 0.2]), "cc").save("cube.h5", overwrite=True)
    >>> draw_figure({"closed": path}, "cube.png", overwrite=True)
    >>> [picture.name for picture in Path().glob("*.png")]
    ['cube.png']
    """
    import matplotlib as mpl  # 0.7 s that only pictures cost
    from matplotlib.figure import Figure

    if not isinstance(paths, Mapping):  # pyright: ignore[reportUnnecessaryIsInstance]  # scripts give one path
        raise StrategyError(f"files must be given by label, as in {{'closed': 'tube.h5'}}, not {value_text(paths)}")
    picture, files = require_path(picture, "the picture"), {label: Path(path) for label, path in paths.items()}
    require_picture(picture, overwrite=overwrite)
    _refuse_unlike(list(files.values()))
    sampling = sampling or SamplingStrategy()
    with mpl.rc_context({"font.size": 8, "axes.spines.top": False, "axes.spines.right": False}):
        figure = Figure(figsize=(9.6, 5.2), layout="constrained")
        parts = figure.add_gridspec(2, 1, height_ratios=[1.7, 1])
        top, bottom = figure.add_subfigure(parts[0]), figure.add_subfigure(parts[1])
        length_axes, frequency_axes = bottom.subplots(1, 2, sharex=True)
        time = None
        for k, (label, path) in enumerate(files.items()):
            with ContourFile(path) as file:
                length = _lengths(file)
                time = file.motion().get("time")
                across = np.arange(len(length)) if time is None else time
                if k == len(paths) - 1:
                    _draw_scenes(top, file, length, across, "pose {:.0f}" if time is None else "{:.2f} s")
            style = {
                "lw": 0.9,
                "label": visible(label),
                "color": LINES[k % len(LINES)],
                "marker": "." if len(length) < 3 else "",
            }
            length_axes.plot(across, 1e3 * length, **style)
            frequency_axes.plot(across, sampling.draw_frequency(length), **style)
        frequency_axes.set_yscale("log")
        low, high = frequency_axes.get_ylim()
        frequency_axes.set_ylim(min(low, 10.0), min(max(high, 100.0), FREQUENCY_SHOWN))
        length_axes.set_title("length [mm]", fontsize=8, loc="left")
        frequency_axes.set_title(f"draw frequency at {sampling.speed:g} m/s [Hz]", fontsize=8, loc="left")
        for axes in (length_axes, frequency_axes):
            axes.set_xlabel("pose" if time is None else "time [s]")
        handles, labels = length_axes.get_legend_handles_labels()
        legend = bottom.legend(handles, labels, loc="outside upper right", frameon=False, ncols=len(paths))
        for text in legend.get_texts():
            text.set_parse_math(False)  # names of files are no formulas; the ticks of the logarithmic axis are
        try:
            save_picture(figure, picture, dpi=120)
        except OSError as error:
            raise ContourFileError(f"{picture}: the picture cannot be written ({error.strerror or error})") from error


def _refuse_unlike(paths: list[Path]) -> None:
    """Refuse files whose lengths cannot stand in one diagram."""
    recipes = []
    for path in paths:
        with ContourFile(path) as file:
            recipes.append(file.recipe)
    for path, recipe in zip(paths, recipes, strict=True):
        for field in ("object", "representation", "motion", "object motion"):  # some files have only two of them
            if recipe.get(field) != recipes[0].get(field):
                raise StrategyError(f"{path} is of another {field} than {paths[0]}: they do not belong in one picture")


def _lengths(file: ContourFile) -> np.ndarray:
    """Length of each pose's contours [m]; NaN where a pose is not done yet."""
    length = np.full(file.pose_count, np.nan)
    for first, stop in file.done:
        length[first:stop] = file.metrics(first, stop)["length"]
    return length


def _draw_scenes(figure, file: ContourFile, length: np.ndarray, across: np.ndarray, title: str) -> None:
    from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

    solid, hand, pose = file.object(), hand_from(file.hand, file.hand_arrays()), file.motion()["pose"]
    poses = shown_poses(np.nan_to_num(length), rotate(pose[:, 3:], np.array([0.0, 1.0, 0.0])))
    drawn = np.nan_to_num(length)[poses] > 0
    meshes = [1e3 * object_at(solid, int(i)) for i in poses]
    skins = [1e3 * skin_at(hand, pose[i : i + 1], int(i)) for i in poses]
    shown = [*meshes, *(skin for skin, is_drawn in zip(skins, drawn, strict=True) if is_drawn)]
    extent = np.concatenate([polygons.reshape(-1, 3) for polygons in shown])
    middle, reach = (extent.min(axis=0) + extent.max(axis=0)) / 2, 0.5 * np.ptp(extent, axis=0).max()
    for k, (i, triangles, palm) in enumerate(zip(poses, meshes, skins, strict=True)):
        axes = figure.add_subplot(1, len(poses), k + 1, projection="3d")
        axes.computed_zorder = False  # contours over the palm over the object: sorting by depth hides them in turn
        axes.add_collection3d(Poly3DCollection(triangles, facecolors=COLOURS["mesh"], alpha=0.1, shade=True, zorder=1))
        if drawn[k]:
            batch = ContourBatch.from_arrays(file.contours(int(i), int(i) + 1))
            last = batch.polyline_start[1:] - 1
            segment = np.setdiff1d(np.arange(batch.point_count), last)
            ends = 1e3 * np.stack([batch.points[segment], batch.points[segment + 1]], axis=1)
            colours = [COLOURS[KIND_NAMES[kind]] for kind in batch.kind[segment]]
            skin = Poly3DCollection(list(palm), facecolor=COLOURS["palm"], edgecolor="none", alpha=0.4, zorder=2)
            axes.add_collection3d(skin)
            axes.add_collection3d(Line3DCollection(list(ends), colors=colours, lw=2.2, capstyle="round", zorder=3))
        for name, m in zip("xyz", middle, strict=True):
            getattr(axes, f"set_{name}lim")(m - reach, m + reach)
        axes.set_box_aspect((1, 1, 1), zoom=1.35)
        axes.view_init(elev=ELEVATION, azim=AZIMUTH)
        axes.set_axis_off()
        axes.set_title(title.format(across[i]) if drawn[k] else "no contour", fontsize=8)
    if drawn.any():
        from matplotlib.lines import Line2D

        made = any(file.metrics(int(i), int(i) + 1)["length_made"][0] > 0 for i in poses[drawn])
        names = ("object's contour", "hand's boundary inside it", "made of them")[: 3 if made else 2]
        lines = [Line2D([], [], color=COLOURS[kind], lw=2.2) for kind in KIND_NAMES[: len(names)]]
        figure.legend(lines, names, loc="outside lower center", ncols=len(names), frameon=False)


def object_at(solid: dict, pose: int) -> np.ndarray:
    """Triangles of a file's object at a pose [m], shape [face, 3, 3]."""
    vertices = solid["vertices"]
    if "moved" in solid:
        middle = np.stack([vertices.min(axis=0), vertices.max(axis=0)]).astype(np.float64).mean(axis=0)
        place = solid["moved"][pose].astype(np.float64)
        vertices = place[:3] + rotate(place[3:], vertices - middle)
    return vertices[solid["faces"]]


def skin_at(hand: Hand, pose: np.ndarray, row: int) -> np.ndarray:
    """Polygons of the skin at a pose [m], shape [polygon, corner, 3]: patches that are there, or triangles."""
    if isinstance(hand, MeshHand):
        return hand.triangles(pose, row)[0]
    patches = hand.corners(pose, row)[0]
    return patches[np.isfinite(patches).all(axis=(1, 2))]
