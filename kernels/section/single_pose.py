"""Contours of one pose, again and again, on the CPU: the same kernels, everything around them done once.

For one pose of the tube the kernels take 5 us, but launching them, taking memory for them and asking how much is needed
take 0.6 ms. Here launches are recorded once, memory stays, and what kernels leave behind is read where it lies.
"""

from typing import Any, NamedTuple, cast

import numpy as np
import warp as wp

from .clip_events import _clip_loops, room_for_events
from .contour_writing import _draw_contours
from .joining import _join_pieces, _join_single_pieces, room_to_join
from .pieces import ContourPieces, with_slots
from .row_walker import LineArrays
from .scan_search import _walk_first_loops, _walk_other_loops
from .tree_search import _tree_search_pieces

CPU = "cpu"  # a GPU takes 1.2 ms for its launches alone
SEVERAL, LISTED, EXCESS = range(3)  # counters: patches with more loops, with more pieces to join, without room

Launches = list[tuple[wp.Launch, int | None]]  # each with the counter that must not be 0 for it to do anything


class RoomSize(NamedTuple):
    """Capacities of a `Room`."""

    pieces: int = 32
    """Of a patch."""
    events: int = 128
    """Of a patch; a room has never fewer than pieces, since `_clip_loops` calls too many events too many pieces."""
    points: int = 4096

    def doubled_for(self, needed: "RoomSize") -> "RoomSize":
        """Twice what is needed, of what there is not enough."""
        return RoomSize(*(own if own >= need else 2 * need for own, need in zip(self, needed, strict=True)))


class Room:
    """Memory for the contours of one pose, and the launches that fill it.

    surface, patch: on the CPU. outside, close: whether contours end at the patch, and are closed along its boundary.
    method: "trace" or "seek", see `find`. size: how much memory there is.
    """

    def __init__(
        self, surface: Any, patch: wp.array, *, outside: bool, close: bool, method: str, size: RoomSize
    ) -> None:
        self.size = size._replace(events=max(size.events, size.pieces))
        self._surface, self._patch, self._row_count = surface, patch, patch.shape[0]
        self._stages = [int(outside), int(close)]
        self._pose, self._pose_rows = shared_zeros((1, 1), wp.transform)
        self._counters, self._count = shared_zeros(3, wp.int32)
        self._rest, _ = shared_zeros(self._row_count, wp.int32)
        self._polylines, self._points = Offsets(self._row_count), Offsets(self._row_count)
        self._pieces = self._room_for_pieces()
        self._events = room_for_events(self._row_count, self.size.events, wp.get_device(CPU))
        self._events.count.zero_()  # seeking leaves them so
        self._lines, self._host = self._room_for_lines()
        self._find = self._scan_search() if method == "trace" else self._tree_search()
        self._join, self._draw = self._joining_and_drawing()

    def fill(self, pose: np.ndarray) -> RoomSize | None:
        """Draw the contours of a pose, shape [7]; returns None, or the size that they need if there is no room."""
        self._pose_rows[0] = pose
        self._count.fill(0)
        self._launch(self._find)
        if self._count.item(EXCESS):
            pieces, events = int(self._pieces.count.numpy().max()), int(self._events.count.numpy().max())
            return self.size._replace(pieces=pieces, events=events)
        self._launch(self._join)
        self._polylines.scan()
        self._points.scan()
        count = self._points.total
        if count > self.size.points:
            return self.size._replace(points=count)
        if count:
            self._host["kind"][:count] = 0
            self._draw.launch()
        return None

    def contours(self) -> dict[str, np.ndarray]:
        """The contours of the last pose, without copying: arrays of a contour batch by name."""
        line_count, point_count, host = self._polylines.total, self._points.total, self._host
        return {
            "points": host["points"][:point_count],
            "kind": host["kind"][:point_count],
            "polyline_start": host["polyline_start"][: line_count + 1],
            "polyline_patch": host["polyline_patch"][:line_count],
            "polyline_closed": host["polyline_closed"][:line_count],
            "pose_start": host["pose_start"],
        }

    def warm(self) -> None:
        """Launch everything once: a kernel's first launch takes longer."""
        self._count.fill(0)
        for launch, _ in (*self._find, *self._join, (self._draw, None)):
            launch.launch()

    def _launch(self, launches: Launches) -> None:
        for launch, counter in launches:
            if counter is None or self._count.item(counter):
                launch.launch()

    def _room_for_pieces(self) -> Any:
        room = self.size.pieces
        pieces = ContourPieces()
        pieces.section, _ = shared_zeros(0, wp.int32)
        pieces.start = wp.array(np.arange(self._row_count) * room, dtype=wp.int64, device=CPU)
        pieces.room = wp.full(self._row_count, room, dtype=wp.int32, device=CPU)
        pieces.stride = 1
        with_slots(pieces, self._row_count, self._row_count * room, CPU)
        pieces.excess = self._counters[EXCESS:]
        return pieces

    def _room_for_lines(self) -> tuple[Any, dict[str, np.ndarray]]:
        """Allocate the output arrays of contours, shared by the kernel and NumPy."""
        line_most = self._row_count * (self.size.pieces + 1)  # one a piece, and the patch's boundary
        lines, host = LineArrays(), {}
        for field, size, dtype in (
            ("points", self.size.points, wp.vec3),
            ("kind", self.size.points, wp.uint8),
            ("polyline_start", line_most + 1, wp.int64),  # starts with a 0, which nothing writes over but a 0
            ("polyline_patch", line_most, wp.int32),
            ("polyline_closed", line_most, wp.uint8),
        ):
            array, host[field] = shared_zeros(size, dtype)
            setattr(lines, field, array)
        return lines, {**host, "pose_start": self._polylines.host[:: self._row_count]}

    def _scan_search(self) -> Launches:
        section = [self._surface, self._pose, self._patch, self._stages[0], self._pieces.section]
        rest = [self._rest, self._counters[SEVERAL:]]
        return [
            (self._record(_walk_first_loops, section, [self._events, *rest]), None),
            (self._record(_walk_other_loops, [*section, *rest], [self._events]), SEVERAL),
            (self._record(_clip_loops, [*section[:3], self._events], [self._pieces]), None),
        ]

    def _tree_search(self) -> Launches:
        inputs = [self._surface, self._pose, self._patch, *self._stages]
        return [(self._record(_tree_search_pieces, inputs, [self._pieces]), None)]

    def _joining_and_drawing(self) -> tuple[Launches, wp.Launch]:
        ends, entries = room_to_join(self._pieces, CPU)
        entries.polylines, entries.points = self._polylines.count, self._points.count
        rest = [self._rest, self._counters[LISTED:]]
        single = [self._pieces, self._stages[1]]
        several = [self._surface, self._pieces, self._pose, self._patch, self._stages[1], *rest]
        drawn = [self._surface, self._pose, self._patch, self._pieces, entries, *self._stages]
        return [
            (self._record(_join_single_pieces, single, [entries, *rest]), None),
            (self._record(_join_pieces, several, [ends, entries]), LISTED),
        ], self._record(_draw_contours, [*drawn, self._polylines.start, self._points.start], [self._lines])

    def _record(self, kernel: Any, inputs: list, outputs: list) -> wp.Launch:
        launch = wp.launch(kernel, self._row_count, inputs=inputs, outputs=outputs, device=CPU, record_cmd=True)
        return cast(wp.Launch, launch)


class Offsets:
    """Counts of sections, which kernels write, and their offsets, which they read."""

    def __init__(self, section_count: int) -> None:
        self.count, count = shared_zeros(section_count + 1, wp.int64)
        self.start, self.host = shared_zeros(section_count + 1, wp.int64)
        self._scanned = count[:-1], self.host[1:]

    def scan(self) -> None:
        """Counts to offsets."""
        np.cumsum(self._scanned[0], out=self._scanned[1])

    @property
    def total(self) -> int:
        """All of them."""
        return self.host.item(-1)


def shared_zeros(size: int | tuple[int, ...], dtype: Any) -> tuple[wp.array, np.ndarray]:
    """An array of zeros, for kernels and for NumPy."""
    array = wp.zeros(size, dtype=dtype, device=CPU)
    return array, array.numpy()
