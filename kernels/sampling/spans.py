"""Spans of motions: contours and poses in, focal points and counts out, on any device, in memory that is used again.

A room has the memory, the recorded launches and the motions' states. One motion, pose after pose, is sampled in it
without taking memory again; a thousand whole motions are sampled in it at once.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp

from ..offsets import BLOCK
from .cycles import PosePieces, _collect_pieces, _lay_cycles, _list_poses
from .entry import _enter_poses
from .focus import PiecePassages, PoseEnds, _draw_samples, _find_ends
from .layout import (
    CycleNodes,
    DrawnCycles,
    DrawnPiece,
    DrawnSection,
    MotionState,
    PoseCycle,
    PoseEntry,
    PoseSchedule,
    RouteRows,
    SamplerState,
    StepCount,
)
from .pieces import STARTS_MOST
from .route import ROOM, SUMS
from .sums import _sum_counts

REST = (0.0, 0.0, 0.2)  # [m] where focal points of intensity 0 are before there were any
RUNS_MOST = 16_384  # that are laid at once: the room of a run's searches takes 15 KB
SPARE = 2  # times what is needed is allocated, but for the first time
SCHEDULE = {"first": wp.int64, "number": wp.int64, "time": wp.float64, "hold": wp.float64}  # what is not int32


def has_pauses(plan: Any, contours: Any) -> bool:
    """Whether a focal point may pause somewhere."""
    return contours.dwell is not None or plan.dwell_time > 0 or plan.dwell_ratio > 0


class SpanRoom:
    """Memory for spans of motions, and the motions' states.

    motion_count: the states begin at rest. foci: focal points a sample. shown: place in a cycle of its points in the
    order in which they are shown. goes_on: whether further spans follow; else their pieces are not stored.
    """

    def __init__(self, motion_count: int, foci: int, shown: np.ndarray, device: str, *, goes_on: bool = True) -> None:
        self.device, self.goes_on, self._foci = device, goes_on, foci
        self._on_cpu = wp.get_device(device).is_cpu
        self._arrays: dict[str, wp.array] = {}
        self._launches: dict[str, wp.Launch] = {}
        self._recorded: tuple[Any, Any] = (None, None)  # plan and contours of the launches
        self._counts = 0, 0  # poses and motions of the last span
        self.grown = 0
        """Number of allocations so far."""
        self.state = SamplerState()
        states = np.zeros(motion_count, MotionState.numpy_dtype())
        states["place"]["silent"], states["place"]["rested"], states["lost"] = 1, -1.0, 1
        self.state.motion = wp.array(states, dtype=MotionState, device=device)
        rest = np.broadcast_to(np.array(REST), (motion_count, foci, 3))
        self.state.shown, self.state.last = (wp.array(rest, dtype=wp.vec3d, device=device) for _ in range(2))
        self.state.room = 0
        self._keep_pieces(0)
        self._schedule = PoseSchedule()
        self._schedule.shown = wp.array(shown, dtype=wp.int32, device=device)
        self._views: dict[str, np.ndarray] = {}

    @property
    def motion_count(self) -> int:
        """Number of motions."""
        return self.state.motion.shape[0]

    def draw(
        self,
        plan: Any,
        contours: Any,
        schedule: Mapping[str, np.ndarray],
        pose: np.ndarray | wp.array,
        *,
        line_most: int = 0,
    ) -> tuple[wp.array, wp.array]:
        """Draw the next span of each motion; returns positions [m] and intensities, shape [sample, focus].

        plan: SamplingPlan. contours: Contours of all poses of the span, one motion after the other; each polyline must
        have points. schedule: arrays of a PoseSchedule by name, times in ticks. pose: hand frame -> array frame, shape
        [pose, 7], or transformd [pose] on the device. line_most: polylines of a pose at most.
        The arrays have room for more samples than are drawn, and the next span overwrites them.
        """
        pose_count = len(schedule["count"])
        self._begin(plan, contours, schedule, int(schedule["count"].sum()), line_most if self.goes_on else 0, pose)
        self._counts = pose_count, self.motion_count
        if pose_count > 0:
            self._lay(plan, contours, pose_count)
        self._launch("enter", self.motion_count)
        if pose_count > 0:
            self._launch("ends", pose_count)
            self._launch("draw", pose_count)
        self._launch("sum", self.motion_count)
        return self._arrays["position"], self._arrays["intensity"]

    def draw_pose(
        self, plan: Any, contours: Any, pose: np.ndarray, *, line_most: int, **values: float
    ) -> tuple[wp.array, wp.array]:
        """Draw the next samples of one pose of the only motion, as `draw` does.

        pose: shape [7]. values: `first`, `number`, `count`, `time`, `hold` and `goes_on` of the schedule.
        """
        views = self._views
        if not self._is_ready_for(plan, contours, line_most, int(values["count"])):
            span = {name: np.array([value]) for name, value in values.items()}
            span |= {"motion_start": np.array([0, 1]), "motion": np.array([0]), "row": np.array([0])}
            return self.draw(plan, contours, span, pose.reshape(1, 7), line_most=line_most)
        for name, value in values.items():
            views[f"schedule_{name}"][0] = value
        views["pose"][0] = pose
        launches = self._launches
        launches["collect"].launch()
        launches["list"].launch()
        launches["single"].launch()
        if views["runs"].item(0):
            launches["runs"].launch()
        launches["enter"].launch()
        launches["ends"].launch()
        launches["draw"].launch()
        launches["sum"].launch()
        return self._arrays["position"], self._arrays["intensity"]

    def _is_ready_for(self, plan: Any, contours: Any, line_most: int, sample_count: int) -> bool:
        """Whether all launches are recorded for one pose of these contours, and memory suffices, on the CPU."""
        if not (
            self._on_cpu
            and self._counts == (1, 1)
            and self._recorded[0] is plan
            and line_most <= self.state.room
            and sample_count <= self._arrays["position"].shape[0]
        ):
            return False
        before = self._recorded[1]
        if before is contours:
            return True
        grown = self.grown
        self._fit(plan, contours, 1, sample_count)
        columns = [(own.intensity is None, own.dwell is None) for own in (before, contours)]
        if self.grown != grown or columns[0] != columns[1]:
            return False
        for name in ("collect", "single", "runs", "enter", "sum"):  # the others take no contours
            self._launches[name].set_param_at_index(0, contours)
        self._recorded = plan, contours
        return True

    def lay(self, plan: Any, contours: Any, schedule: Mapping[str, np.ndarray]) -> None:
        """Lay the cycles of a span's poses and draw nothing; schedule: at least its motions and counts."""
        pose_count = len(schedule["count"])
        self._begin(plan, contours, schedule, 0, 0, np.zeros((0, 7)))
        if pose_count > 0:
            self._lay(plan, contours, pose_count)

    def _begin(
        self,
        plan: Any,
        contours: Any,
        schedule: Mapping[str, np.ndarray],
        sample_count: int,
        line_most: int,
        pose: np.ndarray | wp.array,
    ) -> None:
        """Have memory, schedule and launches for a span."""
        grown = self.grown
        self._keep_pieces(line_most)
        self._fit(plan, contours, len(schedule["count"]), sample_count)
        self._set_schedule(schedule, pose)
        if self.grown != grown or self._recorded[0] is not plan or self._recorded[1] is not contours:
            self._record(plan, contours)

    def _lay(self, plan: Any, contours: Any, pose_count: int) -> None:
        """Lay the cycles of all poses: first those of one piece, all at once, then the runs."""
        self._launch("collect", pose_count)
        self._launch("list", pose_count)
        self._launch("single", pose_count)
        runs = int(self._views["runs"][0] if self._on_cpu else self._arrays["runs"].numpy()[0])
        grown = self.grown
        self._fit_runs(min(runs, RUNS_MOST))
        if self.grown != grown:
            self._record(plan, contours)
        for first in range(0, runs, RUNS_MOST):
            self._launches["runs"].set_param_by_name("first", first)
            self._launch("runs", min(runs - first, RUNS_MOST))

    @property
    def cycles(self) -> wp.array:
        """Cycles of the poses of the last span, PoseCycle, in an array that has room for more."""
        return self._arrays["cycles"]

    @property
    def nodes(self) -> tuple[wp.array, wp.array]:
        """Curve parameter of each node of those cycles, and its point [m], in arrays that have room for more."""
        return self._arrays["parameter"], self._arrays["point"]

    @property
    def schedule(self) -> Any:
        """The schedule of the last span, PoseSchedule, in arrays that have room for more."""
        return self._schedule

    @property
    def pose(self) -> wp.array:
        """The poses of the last span, transformd, in an array that has room for more."""
        return self._arrays["pose"]

    def _launch(self, name: str, count: int) -> None:
        launch = self._launches[name]
        launch.set_dim(count)
        launch.launch()

    def _array(self, name: str, count: int, dtype: Any, width: int | None = None) -> wp.array:
        """An array with room for so many rows."""
        own = self._arrays.get(name)
        if own is None or own.shape[0] < count:
            count = count if own is None else SPARE * count
            shape = count if width is None else (count, width)
            own = self._arrays[name] = wp.empty(shape, dtype=dtype, device=self.device)
            self._views.pop(name, None)
            self.grown += 1
        return own

    def _keep_pieces(self, room: int) -> None:
        """Keep room for so many pieces in each motion's state."""
        state = self.state
        if state.piece is not None and room <= state.room:
            return
        room = max(room, SPARE * state.room)
        rows = state.motion.shape[0]
        for name, dtype in (("piece", DrawnPiece), ("seen", wp.int64)):
            own = wp.empty(rows * room, dtype=dtype, device=self.device)
            for motion in range(rows if state.room else 0):
                wp.copy(own, getattr(state, name), motion * room, motion * state.room, state.room)
            setattr(state, name, own)
        state.room = room
        self.grown += 1

    def _fit(self, plan: Any, contours: Any, pose_count: int, sample_count: int) -> None:
        """Have memory for a span."""
        points, lines = contours.points.shape[0], contours.polyline_closed.shape[0]
        drawn_count = lines + self.motion_count * self.state.room
        node_count = plan.passes * (points + 2 * lines) + pose_count * max(plan.sections, 1)
        paused = node_count if has_pauses(plan, contours) else 0
        for name, count, dtype in (
            ("given", lines, DrawnPiece),
            ("drawn", drawn_count, DrawnPiece),
            ("candidate", lines, DrawnPiece),
            ("span", lines, wp.float64),
            ("slowdown", lines if plan.sections > 0 else 0, wp.float64),
            ("first", lines, wp.int32),
            ("last", lines, wp.int32),
            ("waits", lines, wp.int64),
            ("parameter", node_count, wp.float64),
            ("point", node_count, wp.vec3d),
            ("piece", node_count, wp.int32),
            ("level", node_count if contours.intensity is not None else 0, wp.float64),
            ("pause", paused, wp.float64),
            ("corner", paused, wp.uint8),
            ("section", pose_count * plan.sections, DrawnSection),
            ("piece_count", pose_count, wp.int32),
            ("piece_length", pose_count, wp.float64),
            ("cycles", pose_count, PoseCycle),
            ("begin", pose_count, wp.int32),
            ("single", pose_count, wp.int32),
            ("runs", 1, wp.int32),
            ("entries", pose_count, PoseEntry),
            ("counts", pose_count, StepCount),
            ("pose", pose_count, wp.transformd),
        ):
            self._array(name, count, dtype)
        for name, count, dtype in (
            ("end_shown", pose_count, wp.vec3d),
            ("end_last", pose_count, wp.vec3d),
            ("position", sample_count, wp.vec3),
            ("intensity", sample_count, wp.float32),
        ):
            self._array(name, count, dtype, self._foci)
        if "room" not in self._arrays:
            self._fit_runs(1 if self._on_cpu else 0)

    def _fit_runs(self, runs: int) -> None:
        """Have memory for the searches of so many runs."""
        self._array("room", runs * ROOM, wp.int32)
        self._array("sums", runs * SUMS, wp.float64)
        self._array("start", runs, wp.vec3d, STARTS_MOST)

    def _set_schedule(self, schedule: Mapping[str, np.ndarray], pose: np.ndarray | wp.array) -> None:
        """Write the schedule and poses of a span."""
        for name, values in schedule.items():
            array = self._array(f"schedule_{name}", len(values), SCHEDULE.get(name, wp.int32))
            setattr(self._schedule, name, array)
            self._write(f"schedule_{name}", values)
        if self._on_cpu and "runs" not in self._views:
            self._views["runs"] = self._arrays["runs"].numpy()
        if isinstance(pose, wp.array):
            wp.copy(self._arrays["pose"], pose, count=pose.shape[0])
        else:
            self._write("pose", pose)

    def _write(self, name: str, values: np.ndarray) -> None:
        array = self._arrays[name]
        if self._on_cpu:
            view = self._views.get(name)
            if view is None:
                view = self._views[name] = array.numpy()
            view[: len(values)] = values
        elif len(values):
            scalar = np.float64 if array.dtype == wp.transformd else wp.dtype_to_numpy(array.dtype)
            host = np.ascontiguousarray(values, scalar)  # so that Warp copies it as it is
            wp.copy(array, wp.array(host, dtype=array.dtype, device="cpu", copy=False), count=len(values))

    def _record(self, plan: Any, contours: Any) -> None:
        """Record the launches of a plan on these contours."""
        own, state, schedule = self._arrays, self.state, self._schedule
        rows, nodes, pieces, passages, drawn = RouteRows(), CycleNodes(), PosePieces(), PiecePassages(), DrawnCycles()
        rows.given, rows.drawn, rows.candidate, rows.span = (own[n] for n in ("given", "drawn", "candidate", "span"))
        rows.room, rows.sums, rows.start = own["room"], own["sums"], own["start"]
        nodes.parameter, nodes.point, nodes.piece, nodes.section = (
            own[n] for n in ("parameter", "point", "piece", "section")
        )
        nothing = wp.empty(0, dtype=wp.float64, device=self.device)
        nodes.intensity = own["level"] if contours.intensity is not None else nothing
        nodes.pause = own["pause"] if has_pauses(plan, contours) else nothing
        nodes.corner = own["corner"] if has_pauses(plan, contours) else wp.empty(0, dtype=wp.uint8, device=self.device)
        nodes.slowdown = own["slowdown"]
        pieces.count, pieces.length = own["piece_count"], own["piece_length"]
        ends = PoseEnds()
        ends.shown, ends.last = own["end_shown"], own["end_last"]
        passages.first, passages.last = own["first"], own["last"]
        drawn.nodes, drawn.cycles, drawn.entries = nodes, own["cycles"], own["entries"]
        drawn.pose, drawn.routes = own["pose"], own["drawn"]
        laid = [rows, nodes, own["cycles"]]
        given = [contours, plan, schedule, pieces, state, own["single"], own["begin"]]
        for name, kernel, inputs, outputs in (
            ("collect", _collect_pieces, [contours, schedule, state], [rows, pieces, own["runs"]]),
            ("list", _list_poses, [schedule, pieces, state], [own["cycles"], own["single"], own["begin"], own["runs"]]),
            ("single", _lay_cycles, [*given, -1], laid),
            ("runs", _lay_cycles, [*given, 0], laid),
            ("enter", _enter_poses, [contours, plan, schedule, nodes, own["cycles"]], [state, own["entries"]]),
            ("ends", _find_ends, [plan, schedule, drawn], [ends, passages]),
            (
                "draw",
                _draw_samples,
                [plan, schedule, drawn, ends, state],
                [passages, own["position"], own["intensity"], own["counts"]],
            ),
            (
                "sum",
                _sum_counts,
                [contours, plan, schedule, drawn, ends, own["counts"], passages],
                [own["waits"], state],
            ),
        ):
            options = {"device": self.device, "block_dim": BLOCK, "record_cmd": True}
            self._launches[name] = wp.launch(kernel, 1, inputs=inputs, outputs=outputs, **options)
        self._recorded = plan, contours
