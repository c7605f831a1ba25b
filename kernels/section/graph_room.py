"""Contours of as many poses each time on a GPU: all launches recorded as one graph, memory reused.

Launching the kernels from Python, taking memory and asking how much is needed take 1.6 to 2.1 ms; a graph is one launch
and one answer. Numbers of points are not known while it is recorded, so memory has a fixed size, and a batch that needs
more is not drawn: its size is returned.
"""

from typing import Any

import numpy as np
import warp as wp

from ..offsets import BLOCK
from ..patch import EXACT
from .joining import Entries
from .recorded_launches import CPU, EXCESS, Launches, Room, RoomSize, first_of

wp.set_module_options(EXACT)

FITS, POLYLINES, POINTS = range(3)  # answers of a graph


@wp.kernel
def _sum_up(
    excess: wp.array[wp.int32],  # queries without room, shape [1]
    point_most: wp.int64,
    polyline_start: wp.array[wp.int64],  # offsets of sections, shape [section + 1]
    point_start: wp.array[wp.int64],
    answer: wp.array[wp.int64],  # whether all fits, polylines, points
):
    """Answer whether contours fit the room, and how much they are."""
    last = point_start.shape[0] - 1
    fits = wp.int64(0)
    if excess[0] == 0 and point_start[last] <= point_most:
        fits = wp.int64(1)
    answer[0] = fits
    answer[1] = polyline_start[last]
    answer[2] = point_start[last]


@wp.kernel
def _withhold_sections(
    # In:
    answer: wp.array[wp.int64],
    patch_count: int,
    # Out:
    entries: Entries,
    polyline_start: wp.array[wp.int64],
    point_start: wp.array[wp.int64],
    pose_start: wp.array[wp.int64],  # offsets of poses into polylines, shape [pose + 1]
):
    """Leave nothing to be drawn where there is no room; offsets of poses."""
    section = wp.tid()
    if answer[0] == wp.int64(0):
        polyline_start[section] = wp.int64(0)
        point_start[section] = wp.int64(0)
        if section < entries.count.shape[0]:
            entries.count[section] = 0
    elif section % patch_count == 0:
        pose_start[section // patch_count] = polyline_start[section]


class GraphRoom(Room):
    """A `Room` on a CUDA device; on the CPU the same launches one by one, for tests."""

    def __init__(self, surface: Any, patch: wp.array, **options: Any) -> None:
        self.device = str(patch.device)
        super().__init__(surface, patch, **options)

    def _prepare(self) -> None:
        self._pose_start = wp.zeros(self._pose_count + 1, dtype=wp.int64, device=self.device)
        self._answer = wp.zeros(3, dtype=wp.int64, device=self.device)
        is_cuda = wp.get_device(self.device).is_cuda
        self._answered = wp.zeros(3, dtype=wp.int64, device=CPU, pinned=is_cuda)
        self._answers = self._answered.numpy()
        self._run()  # loads modules, which no graph may
        self._graph = self._recorded() if is_cuda else None

    def _recorded(self) -> wp.Graph:
        wp.synchronize_device(self.device)
        with wp.ScopedCapture(self.device) as capture:
            self._run()
        return capture.graph

    def fill(self, pose: np.ndarray | wp.array) -> RoomSize | None:
        """Draw the contours of poses, wp.transform, shape [pose], on the device, or as of `Room`."""
        source = pose if isinstance(pose, wp.array) else wp.array(pose, dtype=wp.transform, device=self.device)
        wp.copy(self._pose, source, count=self._pose_count)
        if self._graph is None:
            self._run()
        else:
            wp.capture_launch(self._graph)
            wp.synchronize_stream(wp.get_stream(self.device))
        if self._answers.item(FITS):
            return None
        if self._counters.numpy()[EXCESS]:
            return self._size_needed()
        return self.size._replace(points=self._answers.item(POINTS))

    def contours(self) -> dict[str, Any]:
        """The contours of the last poses, without copying: arrays of a contour batch by name."""
        line_count, point_count, lines = self._answers.item(POLYLINES), self._answers.item(POINTS), self._lines
        return {
            "points": first_of(lines.points, point_count),
            "kind": first_of(lines.kind, point_count),
            "polyline_start": first_of(lines.polyline_start, line_count + 1),
            "polyline_patch": first_of(lines.polyline_patch, line_count),
            "polyline_closed": first_of(lines.polyline_closed, line_count),
            "pose_start": self._pose_start,
        }

    device_contours = contours

    def warm(self) -> None:
        """Nothing: everything was launched before it was recorded."""

    def _run(self) -> None:
        """Everything that is done for a batch."""
        self._counters.zero_()
        self._launch(self._find)
        self._launch(self._join)
        starts = []
        for offsets in (self._polylines, self._points):
            wp.utils.array_scan(offsets.count, offsets.start, inclusive=False)
            starts.append(offsets.start)
        inputs = [self._counters[EXCESS:], self.size.points, *starts]
        wp.launch(_sum_up, 1, inputs=inputs, outputs=[self._answer], device=self.device, block_dim=BLOCK)
        outputs = [self._entries, *starts, self._pose_start]
        inputs = [self._answer, self._patch.shape[0]]
        wp.launch(
            _withhold_sections,
            self.query_count + 1,
            inputs=inputs,
            outputs=outputs,
            device=self.device,
            block_dim=BLOCK,
        )
        self._lines.kind.zero_()
        self._draw.launch()
        wp.copy(self._answered, self._answer)

    def _launch(self, launches: Launches) -> None:
        for launch, _ in launches:
            launch.launch()
