"""Contours of a few poses, again and again, on the CPU: the same kernels, everything around them done once.

For one pose of the tube the kernels take 5 us, but launching them, taking memory for them and asking how much is needed
take 0.6 ms. Here launches are recorded once, memory stays, and what kernels leave behind is read where it lies.
"""

from typing import Any, NamedTuple, cast

import numpy as np
import warp as wp

from ..contours import Contours
from ..offsets import BLOCK
from .clip import _clip_loops, room_for_events
from .draw import _draw_contours
from .float32_walk import room_for_scans
from .join import LANE_WORDS, _join_pieces, _join_single_pieces, room_to_join
from .lanes import claiming_lanes, threads_for
from .pieces import SLOTS, ContourPieces, CutPlanes, with_slots
from .scan import WALK_BLOCKS, _scan_sections, _walk_doubtful_loops, _walk_loops
from .tree import _tree_search_pieces

CPU = "cpu"
FEW = 32  # patches of all poses that get the largest capacities
EVENTS_MANY, POINTS_MANY = 24, 48  # of a patch
PIECE_BYTES, EVENT_BYTES, POINT_BYTES = 120, 8, 13
# Counters of patches: those to walk, those claimed, those for float64, of several pieces to join, without room.
CROSSED, CLAIMED, DOUBTFUL, LISTED, EXCESS = range(5)

Launches = list[tuple[wp.Launch, int | None]]  # each with the counter that must not be 0 for it to do anything


class RoomSize(NamedTuple):
    """Capacities of a `Room`."""

    pieces: int = 32
    """Of a patch."""
    events: int = 128
    """Of a patch; a room has never fewer than pieces, since `_clip_loops` calls too many events too many pieces."""
    points: int = 4096
    """Of all poses."""

    @classmethod
    def for_sections(cls, query_count: int) -> "RoomSize":
        """Capacities for so many patches of all poses: most of one alone, since memory is allocated for each."""
        return cls() if query_count <= FEW else cls(SLOTS, EVENTS_MANY, POINTS_MANY * query_count)

    def doubled_for(self, needed: "RoomSize") -> "RoomSize":
        """Twice what is needed, of what there is not enough."""
        return RoomSize(*(own if own >= need else 2 * need for own, need in zip(self, needed, strict=True)))


def room_bytes(size: RoomSize, query_count: int) -> int:
    """Size of the memory of a `Room` with so many patches of all poses, about [byte]."""
    return query_count * (PIECE_BYTES * size.pieces + EVENT_BYTES * size.events) + POINT_BYTES * size.points


class Room:
    """Memory for the contours of as many poses each time, and the launches that fill it.

    planes: on the CPU, with room for the poses. scans: whether the scan search finds pieces, else the tree search does.
    size: how much memory there is.
    """

    def __init__(self, planes: CutPlanes, size: RoomSize, *, scans: bool) -> None:
        self.size = size._replace(events=max(size.events, size.pieces))
        self._planes, self.query_count = planes, planes.section_count
        self._counters = wp.zeros(5, dtype=wp.int32, device=CPU)
        self._rest = wp.zeros(self.query_count, dtype=wp.int32, device=CPU)
        self._polylines, self._points = (Offsets(self.query_count) for _ in range(2))
        self._pieces = self._room_for_pieces()
        count = wp.zeros(self.query_count, dtype=wp.int32, device=CPU)  # of events; tree searches leave it so
        self._events = room_for_events(count, self.size.events)
        self._lines = self._room_for_lines()
        self._find = self._scan_search() if scans else self._tree_search()
        self._join, self._draw = self._joining_and_drawing()
        # Arrays stay where they lie, so NumPy looks at them once.
        fields = ("points", "kind", "polyline_start", "polyline_patch", "polyline_closed")
        self._host = {field: getattr(self._lines, field).numpy() for field in fields}
        self._section_start = self._polylines.host[:: planes.patch.shape[0]]
        self._pose_start = self._lines.pose_start.numpy()
        self._pose_view, self._count = planes.pose.numpy(), self._counters.numpy()

    @property
    def struct(self) -> Any:
        """The contours of the last poses as kernels take them, `Contours`, in arrays that have room for more."""
        return self._lines

    def fill(self, pose: np.ndarray) -> RoomSize | None:
        """Draw the contours of poses; returns None, or the size that they need if there is no room.

        pose: of the hand, shape [pose, 7], or of each patch where the room is made for that, [pose, patch, 7].
        """
        self._pose_view[:] = pose if pose.ndim == 3 else pose.reshape(-1, 1, 7)
        self._count.fill(0)
        self._launch(self._find)
        if self._count.item(EXCESS):
            return self._size_needed()
        self._launch(self._join)
        self._polylines.scan()
        self._points.scan()
        count = self._points.total
        if count > self.size.points:
            return self.size._replace(points=count)
        if count:
            self._host["kind"][:count] = 0
            self._draw.launch()
        self._pose_start[:] = self._section_start
        return None

    def _size_needed(self) -> RoomSize:
        pieces, events = int(self._pieces.count.numpy().max()), int(self._events.count.numpy().max())
        return self.size._replace(pieces=pieces, events=events)

    def contours(self) -> dict[str, np.ndarray]:
        """The contours of the last poses, without copying: arrays of a contour batch by name."""
        line_count, point_count, host = self._polylines.total, self._points.total, self._host
        return {
            "points": host["points"][:point_count],
            "kind": host["kind"][:point_count],
            "polyline_start": host["polyline_start"][: line_count + 1],
            "polyline_patch": host["polyline_patch"][:line_count],
            "polyline_closed": host["polyline_closed"][:line_count],
            "pose_start": self._pose_start,
        }

    def device_contours(self) -> dict[str, wp.array]:
        """The same as arrays on the device."""
        line_count, point_count, lines = self._polylines.total, self._points.total, self._lines
        counts = {"points": point_count, "kind": point_count, "polyline_start": line_count + 1}
        # An array of no rows cannot be a part of another one.
        columns = {
            field: column[:count]
            if (count := counts.get(field, line_count))
            else wp.empty(0, dtype=column.dtype, device=CPU)
            for field, column in ((field, getattr(lines, field)) for field in self._host)
        }
        return {**columns, "pose_start": lines.pose_start}

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
        room, queries = self.size.pieces, self.query_count
        pieces = ContourPieces()
        pieces.section = wp.empty(0, dtype=wp.int32, device=CPU)
        pieces.start = wp.array(np.arange(queries) * room, dtype=wp.int64, device=CPU)
        pieces.room = wp.full(queries, room, dtype=wp.int32, device=CPU)
        pieces.stride = 1  # slots of a query lie beside each other
        with_slots(pieces, queries, queries * room, CPU)
        pieces.excess = self._counters[EXCESS:]
        return pieces

    def _room_for_lines(self) -> Any:
        """Allocate the output arrays of contours."""
        line_most = self.query_count * (self.size.pieces + 1)  # one a piece, and the patch's boundary
        lines = Contours()
        for field, size, dtype in (
            ("points", self.size.points, wp.vec3),
            ("kind", self.size.points, wp.uint8),
            ("polyline_start", line_most + 1, wp.int64),  # starts with a 0, which nothing writes over but a 0
            ("polyline_patch", line_most, wp.int32),
            ("polyline_closed", line_most, wp.uint8),
        ):
            setattr(lines, field, wp.zeros(size, dtype=dtype, device=CPU))
        lines.pose_start = wp.zeros(self._planes.pose.shape[0] + 1, dtype=wp.int64, device=CPU)
        return lines

    def _scan_search(self) -> Launches:
        section = [*self._planes.inputs, self._pieces.section]
        device, surface = wp.get_device(CPU), self._planes.surface
        scans = room_for_scans(surface, self.query_count, self._counters[CROSSED:], device)
        doubtful, events = [self._rest, self._counters[DOUBTFUL:]], self._events
        lanes = claiming_lanes(device, self.query_count, WALK_BLOCKS)
        return [
            (self._record(_scan_sections, section, [scans, events.count, *doubtful]), None),
            (self._record(_walk_loops, [*section, scans], [events, *doubtful], lanes), CROSSED),
            (self._record(_walk_doubtful_loops, [*section, *doubtful], [events]), DOUBTFUL),
            (self._record(_clip_loops, [surface.rank, events], [self._pieces]), None),
        ]

    def _tree_search(self) -> Launches:
        inputs = [*self._planes.inputs, int(self._planes.closes)]
        return [(self._record(_tree_search_pieces, inputs, [self._pieces]), None)]

    def _joining_and_drawing(self) -> tuple[Launches, wp.Launch]:
        surface, pose, patch, bounded, closes = self._planes
        ends, entries = room_to_join(self._pieces, CPU)
        entries.polylines, entries.points = self._polylines.count, self._points.count
        own = wp.empty(LANE_WORDS, dtype=wp.int64, device=CPU)
        lanes_to_join = threads_for(wp.get_device(CPU), self.query_count)
        rest = [self._rest, self._counters[LISTED:]]
        single = [self._pieces, int(closes)]
        several = [surface, self._pieces, pose, patch, int(closes), *rest]
        drawn = [surface, pose, patch, self._pieces, entries, int(bounded), int(closes)]
        return [
            (self._record(_join_single_pieces, single, [entries, *rest]), None),
            (self._record(_join_pieces, several, [own, ends, entries], lanes_to_join), LISTED),
        ], self._record(_draw_contours, [*drawn, self._polylines.start, self._points.start, None, None], [self._lines])

    def _record(self, kernel: Any, inputs: list, outputs: list, lanes: int | None = None) -> wp.Launch:
        options = {"device": CPU, "block_dim": BLOCK, "record_cmd": True}
        return cast(wp.Launch, wp.launch(kernel, lanes or self.query_count, inputs=inputs, outputs=outputs, **options))


class Offsets:
    """Counts of sections, which kernels write, and their offsets, which they read."""

    def __init__(self, section_count: int) -> None:
        self.count, self.start = (wp.zeros(section_count + 1, dtype=wp.int64, device=CPU) for _ in range(2))
        self.host = self.start.numpy()
        self._scanned = self.count.numpy()[:-1], self.host[1:]

    def scan(self) -> None:
        """Counts to offsets."""
        np.cumsum(self._scanned[0], out=self._scanned[1])

    @property
    def total(self) -> int:
        """All of them."""
        return self.host.item(-1)
