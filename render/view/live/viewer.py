"""Shows contour files on a viser server: one thread draws; what the visitor does waits in a queue for it."""

import queue
import threading
from collections.abc import Callable, Sequence
from time import perf_counter

import numpy as np

from ....datasets.errors import DatasetError
from ....device.errors import DeviceError
from ...errors import RenderError
from ...playback.placed_arrays import PlacedArray
from ...runtime.warp_start import start_warp
from ...terminal.foreign_text import visible
from ..file_scene import FileScene, Moment
from ..focal_path import FocalPath, focal_path
from ..series import longest_pose, overview_of, steps_in, window_around
from .controls import Actions, Controls
from .guarded_server import GuardedServer
from .numbers import facts_html, failure_html, moment_html
from .plots import OverviewPlot, WindowPlots
from .predictions import Predictions
from .scene_nodes import SceneNodes
from .shared_clock import SharedClock

FRAME = 1 / 30  # [s] between frames while it plays
REST = 0.2  # [s] after the last change, before slower things are computed for what is shown
REFRESH = 1.0  # [s] between looks at a file that is still being written
WINDOW = 2.0  # [s] of plots before and after the shown moment
GAP = 0.06  # [m] between two files' scenes
FIELD_OF_VIEW = np.radians(12.0)  # as by a long lens
SIGHT = np.array([0.2, -0.85, 0.45])  # from the scenes to the eye


class Viewer:
    """The page of one file, or of two side by side.

    scenes: open files, which stay the caller's. labels: what they are called; titles: more words on each. arrays:
    shown under each file's scene; pressure and noise are predicted for them.
    """

    def __init__(
        self,
        server: GuardedServer,
        scenes: Sequence[FileScene],
        labels: Sequence[str],
        arrays: Sequence[PlacedArray],
        titles: Sequence[str] = (),
    ) -> None:
        self._server, self._scenes, self._labels, self._titles = server, list(scenes), list(labels), titles
        self._tasks: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._sought: int | None = None
        self.clock = SharedClock(scenes)
        self._by_time = all(scene.has_time for scene in scenes)
        self._nodes = self._place_scenes(arrays)
        self._facts = server.gui.add_html(facts_html(scenes, labels, titles))
        self._numbers = server.gui.add_html("")
        self._controls = Controls(server, scenes[0].pose_count, self._actions())
        with self._controls.plots:
            overviews = [overview_of(scene) for scene in scenes]
            self._plots = WindowPlots(server, labels, by_time=self._by_time)
            self._overview = OverviewPlot(server, overviews, labels, by_time=self._by_time)
        self.clock.seek(longest_pose(scenes[0], overviews[0]))  # a hand that touches nothing shows little
        self._message = server.gui.add_html("")
        self._predictions = Predictions(server, scenes, arrays, self._controls, self._offsets)
        self._moments: list[Moment] = []
        self._paths: list[FocalPath | None] = []
        self._shown: list[int] = []
        self._is_settled = False
        self._changed = self._looked = perf_counter()
        self.frames_drawn = 0

    def _place_scenes(self, arrays: Sequence[PlacedArray]) -> list[SceneNodes]:
        boxes = [scene.bounds() for scene in self._scenes]
        step = max(float(np.ptp(box[:, 0])) for box in boxes) + 0.2 + GAP  # a hand is 0.2 m long
        middle = (len(boxes) - 1) / 2
        self._offsets = [np.array([step * (k - middle), 0.0, 0.0]) for k in range(len(boxes))]
        nodes = []
        for k, (scene, label) in enumerate(zip(self._scenes, self._labels, strict=True)):
            nodes.append(SceneNodes(self._server, scene, f"/file{k}", self._offsets[k]))
            nodes[k].add_arrays([placed.model for placed in arrays])
            if len(self._scenes) > 1:
                above = (0.0, 0.0, float(boxes[k][1, 2]) + 0.05)
                self._server.scene.add_label(f"/file{k}/label", visible(label), position=above)
        look = np.mean([box.mean(axis=0) + off for box, off in zip(boxes, self._offsets, strict=True)], axis=0)
        self._look_at(look, step * (0.9 if len(boxes) == 1 else 1.35))
        return nodes

    def _look_at(self, middle: np.ndarray, width: float) -> None:
        """Show a width [m] around a middle from far away: nearly from the same side for scenes that stand side by side.

        The scenes are left of the page's middle, since the panel covers its right.
        """
        away = width / (2.0 * np.tan(FIELD_OF_VIEW / 2.0))
        camera, aside = self._server.initial_camera, np.array([0.14 * width, 0.0, 0.0])
        camera.fov = FIELD_OF_VIEW
        sight = SIGHT if len(self._scenes) == 1 else SIGHT * [0.0, 1.0, 1.0]  # equally far from both
        camera.position = middle + aside + away * sight / np.linalg.norm(sight)
        camera.look_at = middle + aside

    def _actions(self) -> Actions:
        put = self._tasks.put
        return Actions(
            seek=self._ask_for,
            step=lambda count: put(lambda: self._go_to(self.clock.poses()[0] + count)),
            toggle=lambda: put(self._toggle),
            set_speed=lambda speed: put(lambda: setattr(self.clock, "speed", speed)),
            set_layer=lambda name, shown: put(lambda: [each.set_visible(name, shown) for each in self._nodes]),
            set_pressure=lambda where: put(lambda: self._set_pressure(where)),
            predict_noise=lambda: put(self._predict_noise),
        )

    def _ask_for(self, pose: int) -> None:
        """Note where the slider stands; of several notes that wait, the last one counts."""
        self._sought = pose
        self._tasks.put(self._seek)

    def _seek(self) -> None:
        pose, self._sought = self._sought, None
        if pose is not None:
            self._go_to(pose)

    def _go_to(self, pose: int) -> None:
        self.clock.seek(pose)
        self._draw()

    def _toggle(self) -> None:
        self.clock.is_playing = not self.clock.is_playing
        self._draw()

    def _set_pressure(self, where: str) -> None:
        self._predictions.where = where
        self._is_settled = False

    def _predict_noise(self) -> None:
        poses = self.clock.poses()
        windows = [window_around(scene, pose, WINDOW) for scene, pose in zip(self._scenes, poses, strict=True)]
        self._predictions.predict_noise(windows, self._labels)

    def run(self, *stops: threading.Event) -> None:
        """Draw until one of `stops` is set; what goes wrong with a file is shown on the page."""
        start_warp()
        self._draw()
        before = perf_counter()
        while not any(stop.is_set() for stop in stops):
            try:
                task = self._tasks.get(timeout=FRAME if self.clock.is_playing else REST / 2)
            except queue.Empty:
                task = self._idle
            now = perf_counter()
            self.clock.advance(now - before)
            before = now
            self._try(task)

    def _try(self, task: Callable[[], None]) -> None:
        try:
            task()
        except (RenderError, DatasetError, DeviceError) as error:
            self._message.content = failure_html(str(error))
            self.clock.is_playing = False

    def _idle(self) -> None:
        if self.clock.is_playing:
            self._draw()
            return
        now = perf_counter()
        if now - self._looked > REFRESH and not all(scene.is_sealed for scene in self._scenes):
            self._looked = now
            self._refresh()
        if not self._is_settled and now - self._changed > REST:
            self._settle()

    def _refresh(self) -> None:
        """Look whether more poses of unfinished files are done, or whether a file is whole by now."""
        before = [(scene.done_count, scene.is_sealed) for scene in self._scenes]
        for scene in self._scenes:
            scene.refresh()
        if [(scene.done_count, scene.is_sealed) for scene in self._scenes] != before:
            self._facts.content = facts_html(self._scenes, self._labels, self._titles)
            self._overview.replace([overview_of(scene) for scene in self._scenes])
            self._shown = []
            self._draw()

    def _draw(self) -> None:
        """Show what the timeline asks for: all of it together, and at once."""
        poses = self.clock.poses()
        is_new = poses != self._shown
        if is_new:
            self._moments = [scene.moment(pose) for scene, pose in zip(self._scenes, poses, strict=True)]
            self._paths = [focal_path(scene, pose) for scene, pose in zip(self._scenes, poses, strict=True)]
        with self._server.atomic():
            for k, (nodes, path) in enumerate(zip(self._nodes, self._paths, strict=True)):
                if is_new:
                    nodes.show(self._moments[k])
                    nodes.show_jumps(self._moments[k].contours, path)
                last = 0 if path is None else len(path.position) - 1
                nodes.show_focus(path, min(int(self.clock.share_of(k) * (last + 1)), last))
            self._numbers.content = moment_html(self._moments, self._scenes, self._labels)
            self._controls.show(poses[0], is_playing=self.clock.is_playing)
            self._message.content = ""
            if is_new:
                self._predictions.hide()
        self._server.flush()
        self._shown, self._is_settled, self._changed = poses, False, perf_counter()
        self.frames_drawn += 1

    def _settle(self) -> None:
        """Compute what takes longer, once the time rests: plots around it, and pressure."""
        self._is_settled = True
        poses = self.clock.poses()
        windows = [window_around(scene, pose, WINDOW) for scene, pose in zip(self._scenes, poses, strict=True)]
        steps = [steps_in(self._scenes[0], windows[0])]
        now = self.clock.now if self._by_time else float(poses[0])
        with self._server.atomic():
            self._plots.show(windows, steps, now)
            self._overview.mark(now)
        self._predictions.show_pressure(self._moments)
