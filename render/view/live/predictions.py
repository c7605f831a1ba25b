"""Predictions on the page: where a pose presses, as colours on the hand or in a plane; how loud the motion is."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ....datasets.rigid import quaternion_of
from ...acoustics.field_metrics import sampling_for
from ...acoustics.noise import NoiseModel
from ...acoustics.prediction import predict_noise
from ...acoustics.spectrum import levels_over_time
from ...errors import StrategyError
from ...playback.placed_arrays import PlacedArray
from ..file_scene import FileScene, Moment
from ..pressure_print import PressurePrint, PressurePrinter
from ..series import PoseWindow, window_rows
from .controls import Controls
from .guarded_server import GuardedServer
from .numbers import STYLE, safe
from .plots import level_plot

SOURCES = 300
"""Virtual sources of noise: fewer than `palpate noise` takes, which needs seven times as long."""
LIFT = 5e-4  # [m] of a print off the palm, towards the array


class Predictions:
    """Prints of pressure and levels of noise for the shown files, played by `arrays`."""

    def __init__(
        self,
        server: GuardedServer,
        scenes: Sequence[FileScene],
        arrays: Sequence[PlacedArray],
        controls: Controls,
        offsets: Sequence[np.ndarray],
    ) -> None:
        self.where = "off"
        """Where pressure is shown: of `pressure_print.PLACES`."""
        self._server, self._scenes, self._arrays = server, scenes, tuple(arrays)
        self._controls, self._offsets = controls, offsets
        self._printer: PressurePrinter | None = None
        self._nodes: list[Any] = []
        self._plot: Any = None

    def hide(self) -> None:
        """Take prints away, which were of another pose."""
        for node in self._nodes:
            node.remove()
        self._nodes = []
        self._controls.scale.content = ""

    def show_pressure(self, moments: Sequence[Moment]) -> None:
        """Show prints of the poses where they are asked for, all in the same colours."""
        self.hide()
        if self.where == "off":
            return
        if self._printer is None:
            self._printer = PressurePrinter(self._arrays, sampling_for(None, self._arrays))
        prints = [self._printer.compute(moment, self.where) for moment in moments]
        peak = max(each.peak for each in prints)
        with self._server.atomic():
            for k, (each, moment) in enumerate(zip(prints, moments, strict=True)):
                self._show_print(f"/file{k}/pressure", each, moment, peak, self._scenes[k])
        unit = "Pa, mean over one draw cycle; right to some 50 %"
        self._controls.scale.content = f'<div style="{STYLE}">dark: 0, bright: <b>{peak:.2f}</b> {unit}</div>'

    def _show_print(self, root: str, printed: PressurePrint, moment: Moment, peak: float, scene: FileScene) -> None:
        scale = max(peak, 1e-12)
        if printed.on_vertices is not None:
            import trimesh

            colours = (255 * colours_of(printed.on_vertices / scale)).astype(np.uint8)
            mesh = trimesh.Trimesh(moment.hand.vertices, scene.looks.faces, vertex_colors=colours, process=False)
            self._nodes.append(self._server.scene.add_mesh_trimesh(f"{root}/skin", mesh))
        for number, (plane, radiation) in enumerate(zip(printed.planes, printed.on_planes, strict=True)):
            image = (255 * colours_of(radiation / scale)).astype(np.uint8)
            normal = np.cross(plane.u, plane.v)
            axes = np.stack([plane.u, -plane.v, -normal], axis=1)  # an image's rows go down
            self._nodes.append(
                self._server.scene.add_image(
                    f"{root}/{number}",
                    image,
                    *plane.extent,
                    format="png",
                    wxyz=quaternion_of(axes)[[3, 0, 1, 2]],
                    position=plane.origin - LIFT * normal,
                    cast_shadow=False,
                    receive_shadow=False,
                )
            )

    def predict_noise(self, windows: Sequence[PoseWindow], labels: Sequence[str]) -> None:
        """Say how loud the motion in windows is: A-weighted levels, of which only differences mean anything."""
        rows = [window_rows(scene, window) for scene, window in zip(self._scenes, windows, strict=True)]
        if any(row is None for row in rows):
            raise StrategyError("noise needs poses with times, all of them rendered, around the shown moment")
        self._controls.noise.content = f'<div style="{STYLE}">predicting ...</div>'
        self._server.flush()
        model = NoiseModel(sources=SOURCES)
        signals = [predict_noise(row, array=self._arrays, model=model) for row in rows if row is not None]
        levels = [signal.spectrum().a_weighted for signal in signals]
        begin, end = windows[0].time[[0, -1]]
        lines = [
            f"{safe(label)}: <b>{level - levels[0]:+.1f} dB(A)</b>" for label, level in zip(labels, levels, strict=True)
        ]
        text = "<br>".join(lines) if len(lines) > 1 else f"{safe(labels[0])}: <b>{levels[0]:.1f} dB(A)</b>"
        told = "against the first file" if len(lines) > 1 else "in units of its own: compare two files"
        self._controls.noise.content = f'<div style="{STYLE}">{text}<br>{begin:.2f} to {end:.2f} s, {told}</div>'
        self._show_levels(windows, [levels_over_time(signal) for signal in signals], labels)

    def _show_levels(
        self, windows: Sequence[PoseWindow], levels: Sequence[tuple[np.ndarray, np.ndarray]], labels: Sequence[str]
    ) -> None:
        """Plot the levels over time, until noise is predicted again."""
        if self._plot is not None:
            self._plot.remove()
        lines = [(window.time[0] + time, (level,)) for window, (time, level) in zip(windows, levels, strict=True)]
        with self._controls.predict:
            self._plot = level_plot(self._server, lines, labels)


def colours_of(share: np.ndarray) -> np.ndarray:
    """Colours of shares 0..1 of the largest pressure, RGBA 0..1; as in `palpate field`'s pictures."""
    from matplotlib import colormaps

    return np.asarray(colormaps["inferno"](np.clip(share, 0.0, 1.0)))
