"""A picture of what was rendered: contours on the object, the palm, length and draw frequency over time."""

from pathlib import Path

import numpy as np

from ..datasets.errors import ContourFileError
from ..datasets.reader import ContourFile
from .contours import HAND, ContourBatch
from .hands import hand_from
from .sampling import SamplingStrategy

COLOURS = {"object": "#c1121f", "hand": "#1d6fa5", "mesh": "#8d99ae", "palm": "#f4a261"}
POSES_SHOWN = 3


def shown_poses(length: np.ndarray, count: int = POSES_SHOWN) -> np.ndarray:
    """Poses to show: the one of longest contour in each of `count` equal stretches that has any."""
    stretches = np.array_split(np.arange(len(length)), min(count, len(length)))
    best = [part[np.argmax(length[part])] for part in stretches if len(part)]
    return np.array([i for i in best if length[i] > 0], int)


def draw_figure(paths: dict[str, Path], picture: Path, *, sampling: SamplingStrategy | None = None) -> None:
    """Draw one picture of renderings of the same object and motion, by label, into a PNG, SVG or PDF.

    The contours shown are those of the last file. Raises ContourFileError where a file cannot be read, or the picture
    not be written.
    """
    import matplotlib as mpl  # 0.7 s that only pictures cost
    from matplotlib.figure import Figure

    sampling = sampling or SamplingStrategy()
    with mpl.rc_context({"font.size": 8, "axes.spines.top": False, "axes.spines.right": False}):
        figure = Figure(figsize=(9.6, 5.0), layout="constrained")
        grid = figure.add_gridspec(2, 2 * POSES_SHOWN, height_ratios=[1.7, 1])
        scenes = [figure.add_subplot(grid[0, 2 * k : 2 * k + 2], projection="3d") for k in range(POSES_SHOWN)]
        length_axes = figure.add_subplot(grid[1, :POSES_SHOWN])
        frequency_axes = figure.add_subplot(grid[1, POSES_SHOWN:], sharex=length_axes)
        time = None
        for k, (label, path) in enumerate(paths.items()):
            with ContourFile(path) as file:
                length = _lengths(file)
                time = file.motion().get("time")
                across = np.arange(len(length)) if time is None else time
                if k == len(paths) - 1:
                    _draw_scenes(scenes, file, length, across, "pose {:.0f}" if time is None else "{:.2f} s")
            length_axes.plot(across, 1e3 * length, lw=0.9, label=label)
            frequency_axes.plot(across, sampling.draw_frequency(length), lw=0.9, label=label)
        for axes, name in ((length_axes, "length [mm]"), (frequency_axes, "draw frequency [Hz]")):
            axes.set_title(name, fontsize=8, loc="left")
            axes.set_xlabel("pose" if time is None else "time [s]")
        length_axes.legend(loc="upper right", frameon=False, ncols=len(paths), borderaxespad=0)
        frequency_axes.set_yscale("log")
        try:
            figure.savefig(picture, dpi=120)
        except (OSError, ValueError) as error:
            raise ContourFileError(f"{picture}: the picture cannot be written ({error})") from error


def _lengths(file: ContourFile) -> np.ndarray:
    """Length of each pose's contours [m]; NaN where a pose is not done yet."""
    length = np.full(file.pose_count, np.nan)
    for first, stop in file.done:
        length[first:stop] = file.metrics(first, stop)["length"]
    return length


def _draw_scenes(scenes: list, file: ContourFile, length: np.ndarray, across: np.ndarray, title: str) -> None:
    from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

    thing, hand, pose = file.object(), hand_from(file.hand), file.motion()["pose"]
    triangles = 1e3 * thing["vertices"][thing["faces"]]
    poses = shown_poses(np.nan_to_num(length))
    corners = 1e3 * hand.corners(pose[poses]) if len(poses) else np.zeros((0, 4, 3))
    extent = np.concatenate([triangles.reshape(-1, 3), corners.reshape(-1, 3)])
    middle, reach = (extent.min(axis=0) + extent.max(axis=0)) / 2, 0.4 * np.ptp(extent, axis=0).max()
    for axes in scenes[len(poses) :]:
        axes.set_visible(False)
    for axes, i, palm in zip(scenes, poses, corners, strict=False):
        batch = ContourBatch.from_arrays(file.contours(int(i), int(i) + 1))
        segment = np.flatnonzero(np.isin(np.arange(batch.point_count - 1), batch.polyline_start[1:] - 1, invert=True))
        ends = 1e3 * np.stack([batch.points[segment], batch.points[segment + 1]], axis=1)
        colours = np.where(batch.kind[segment] == HAND, COLOURS["hand"], COLOURS["object"])
        axes.computed_zorder = False  # contours over the palm over the object: depth sorting would hide them in turn
        axes.add_collection3d(Poly3DCollection(triangles, facecolors=COLOURS["mesh"], alpha=0.1, shade=True, zorder=1))
        axes.add_collection3d(
            Poly3DCollection([palm], facecolor=COLOURS["palm"], edgecolor="none", alpha=0.4, zorder=2)
        )
        axes.add_collection3d(Line3DCollection(list(ends), colors=list(colours), lw=2.2, capstyle="round", zorder=3))
        for name, m in zip("xyz", middle, strict=True):
            getattr(axes, f"set_{name}lim")(m - reach, m + reach)
        axes.set_box_aspect((1, 1, 1))
        axes.view_init(elev=22, azim=-60)
        axes.set_axis_off()
        axes.set_title(title.format(across[i]), fontsize=8, y=0.97)
    if (np.nan_to_num(length) > 0).any():
        scenes[0].plot([], [], [], color=COLOURS["object"], lw=2.2, label="object's contour")
        scenes[0].plot([], [], [], color=COLOURS["hand"], lw=2.2, label="palm's boundary inside it")
        scenes[0].legend(loc="lower left", frameon=False, fontsize=7, bbox_to_anchor=(-0.1, -0.12))
