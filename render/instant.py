"""One pose to focal points, again and again, on the CPU: contours and focal points of a hand that moves now.

The kernels are those of `render`, and so are the bits; what is saved is everything around them. For one pose of the
tube the kernels take 5 us, but launching them, taking memory for them and asking how much is needed take 0.6 ms.
Here launches are recorded once, memory stays, and what kernels leave behind is read where it lies.
"""

import math
from typing import Any, NamedTuple, cast

import numpy as np
import warp as wp

from ..datasets.errors import MotionError
from ..datasets.motion import PALM_DOWN
from ..kernels.close import _join_pieces, _join_single_pieces, room_to_join
from ..kernels.draw import Lines, _draw_contours
from ..kernels.events import _clip_loops, room_for_events
from ..kernels.find import method_for
from ..kernels.piece import Pieces, with_slots
from ..kernels.seek import _seek_pieces
from ..kernels.trace import _walk_first_loops, _walk_other_loops
from .batch import check_poses
from .contours import ContourBatch
from .errors import PoseError, StrategyError
from .hands import Palm
from .objects import MeshObject
from .sampling import FocalPoints, Path, Sampler, SamplingStrategy, joined, paths_of
from .strategy import IntersectionStrategy, intersect

CPU = "cpu"  # a GPU takes 1.2 ms for its launches alone
POSE_INTERVAL = 1 / 90  # [s]; a headset's hand tracking
INTERVAL_RANGE = (1e-4, 5.0)  # [s]
FAR = 1e30  # [m]; float32 ends beyond
DRAWN_MOST = 10.0  # [s] in one go: 400,000 samples at 40 kHz
DRAWN_AT_ONCE = 16 * 1024  # samples, as `sample_contours` does
NORM_SURE = 5e-8  # a quaternion's norm this near to 1 is left alone by `check_poses`, however it rounds
SEVERAL, LISTED, EXCESS = range(3)  # counters: patches with more loops, with more pieces to join, without room

Launches = list[tuple[wp.Launch, int | None]]  # each with the counter that must not be 0 for it to do anything


class RoomSize(NamedTuple):
    """How much of everything a room has."""

    pieces: int = 32
    """Of a patch."""
    events: int = 128
    """Of a patch; a room has never fewer than pieces, since `_clip_loops` calls too many events too many pieces."""
    points: int = 4096

    def doubled_for(self, needed: "RoomSize") -> "RoomSize":
        """Twice what is needed, of what there is not enough."""
        return RoomSize(*(own if own >= need else 2 * need for own, need in zip(self, needed, strict=True)))


class Room:
    """Memory for the contours of one pose, and the launches that fill it."""

    def __init__(
        self, surface: Any, patch: wp.array, strategy: IntersectionStrategy, method: str, size: RoomSize
    ) -> None:
        self.size = size._replace(events=max(size.events, size.pieces))
        self._surface, self._patch, self._row_count = surface, patch, patch.shape[0]
        self._stages = [int("outside" in strategy.prune), int("close" in strategy.transform)]
        self._pose, self._pose_rows = shared(1, wp.transform)
        self._counters, self._count = shared(3, wp.int32)
        self._rest, _ = shared(self._row_count, wp.int32)
        self._polylines, self._points = Offsets(self._row_count), Offsets(self._row_count)
        self._pieces = self._room_for_pieces()
        self._events = room_for_events(self._row_count, self.size.events, wp.get_device(CPU))
        self._events.count.zero_()  # seeking leaves them so
        self._lines, self._contours = self._room_for_lines()
        self._find = self._tracing() if method == "trace" else self._seeking()
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
            self._contours.kind[:count] = 0
            self._draw.launch()
        return None

    def contours(self) -> ContourBatch:
        """What it was filled with, where it lies."""
        line_count, point_count, all_of = self._polylines.total, self._points.total, self._contours
        return ContourBatch(
            points=all_of.points[:point_count],
            kind=all_of.kind[:point_count],
            polyline_start=all_of.polyline_start[: line_count + 1],
            polyline_patch=all_of.polyline_patch[:line_count],
            polyline_closed=all_of.polyline_closed[:line_count],
            pose_start=all_of.pose_start,
        )

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
        pieces = Pieces()
        pieces.section, _ = shared(0, wp.int32)
        pieces.start = wp.array(np.arange(self._row_count) * room, dtype=wp.int64, device=CPU)
        pieces.room = wp.full(self._row_count, room, dtype=wp.int32, device=CPU)
        pieces.stride = 1
        with_slots(pieces, self._row_count, self._row_count * room, CPU)
        pieces.excess = self._counters[EXCESS:]
        return pieces

    def _room_for_lines(self) -> tuple[Any, ContourBatch]:
        """Where contours are drawn, for the kernel and for NumPy."""
        line_most = self._row_count * (self.size.pieces + 1)  # one a piece, and the patch's boundary
        lines, host = Lines(), {}
        for field, size, dtype in (
            ("points", self.size.points, wp.vec3),
            ("kind", self.size.points, wp.uint8),
            ("polyline_start", line_most + 1, wp.int64),  # starts with a 0, which nothing writes over but a 0
            ("polyline_patch", line_most, wp.int32),
            ("polyline_closed", line_most, wp.uint8),
        ):
            array, host[field] = shared(size, dtype)
            setattr(lines, field, array)
        return lines, ContourBatch(**host, pose_start=self._polylines.host[:: self._row_count])

    def _tracing(self) -> Launches:
        section = [self._surface, self._pose, self._patch, self._stages[0], self._pieces.section]
        rest = [self._rest, self._counters[SEVERAL:]]
        return [
            (self._recorded(_walk_first_loops, section, [self._events, *rest]), None),
            (self._recorded(_walk_other_loops, [*section, *rest], [self._events]), SEVERAL),
            (self._recorded(_clip_loops, [*section[:3], self._events], [self._pieces]), None),
        ]

    def _seeking(self) -> Launches:
        inputs = [self._surface, self._pose, self._patch, *self._stages]
        return [(self._recorded(_seek_pieces, inputs, [self._pieces]), None)]

    def _joining_and_drawing(self) -> tuple[Launches, wp.Launch]:
        ends, entries = room_to_join(self._pieces, CPU)
        entries.polylines, entries.points = self._polylines.count, self._points.count
        rest = [self._rest, self._counters[LISTED:]]
        single = [self._pieces, self._stages[1]]
        several = [self._surface, self._pieces, self._pose, self._patch, self._stages[1], *rest]
        drawn = [self._surface, self._pose, self._patch, self._pieces, entries, *self._stages]
        return [
            (self._recorded(_join_single_pieces, single, [entries, *rest]), None),
            (self._recorded(_join_pieces, several, [ends, entries]), LISTED),
        ], self._recorded(_draw_contours, [*drawn, self._polylines.start, self._points.start], [self._lines])

    def _recorded(self, kernel: Any, inputs: list, outputs: list) -> wp.Launch:
        launch = wp.launch(kernel, self._row_count, inputs=inputs, outputs=outputs, device=CPU, record_cmd=True)
        return cast(wp.Launch, launch)


class Offsets:
    """Counts of sections, which kernels write, and their offsets, which they read."""

    def __init__(self, section_count: int) -> None:
        self.count, count = shared(section_count + 1, wp.int64)
        self.start, self.host = shared(section_count + 1, wp.int64)
        self._scanned = count[:-1], self.host[1:]

    def scan(self) -> None:
        """Counts to offsets."""
        np.cumsum(self._scanned[0], out=self._scanned[1])

    @property
    def total(self) -> int:
        """All of them."""
        return self.host.item(-1)


def shared(size: int, dtype: Any) -> tuple[wp.array, np.ndarray]:
    """An array of zeros, for kernels and for NumPy."""
    array = wp.zeros(size, dtype=dtype, device=CPU)
    return array, array.numpy()


class PoseContours:
    """Contours of one pose at a time: those of `render`, bit for bit.

    thing, hand, strategy: as in `render`. method: how contours are looked for, see `find_pieces`.
    Memory is taken when made, and anew, twice as much, when a pose needs more. Not for two threads at once.
    Raises MeshError where the strategy needs a closed surface and the object has none, ValueError for a method that
    does not exist or not for this object.
    """

    def __init__(
        self,
        thing: MeshObject,
        hand: Palm,
        strategy: IntersectionStrategy,
        *,
        method: str | None = None,
        size: RoomSize | None = None,
    ) -> None:
        middle = np.array([*thing.bounds.mean(axis=0), *PALM_DOWN], np.float32)
        pose = wp.array(middle[None], dtype=wp.transform, device=CPU)
        intersect(thing, hand, pose, strategy, method=method)  # refuses what cannot be done
        surface, patch = thing.on(CPU), hand.on(CPU)
        self._made_of = surface, patch, strategy, method or method_for(surface, wp.get_device(CPU))
        self._room = Room(*self._made_of, size or RoomSize())
        self.grown = 0
        """How often memory was taken anew."""
        self.at(middle)
        self._room.warm()

    def at(self, pose: np.ndarray) -> ContourBatch:
        """Contours of a pose, on the host, in memory that the next call writes over: copy what shall last.

        pose: x y z [m] and unit quaternion xyzw, float32, shape [7], as `check_poses` leaves it.
        """
        while (needed := self._room.fill(pose)) is not None:
            self._room = Room(*self._made_of, self._room.size.doubled_for(needed))
            self.grown += 1
        return self._room.contours()


class Instant:
    """Focal points of a hand that moves now: a pose comes, the focal points until the next one go.

    Sample k is shown at k / update rate after the first pose, as in `sample_contours`: the same poses give the same
    focal points, to the bit, if each is drawn until the time of the next. No sample is left out or comes twice,
    whenever poses come: what was not drawn before a pose is drawn from the one before it.

    thing, hand, strategy: as in `render`. sampling: how contours are drawn, by default at constant speed.
    interval: expected between poses [s]; a pose is held for twice that if `sampling.hold` is shorter.
    Not for two threads at once. Raises MeshError where the strategy needs a closed surface and the object has none,
    StrategyError for an interval out of its range.
    """

    def __init__(
        self,
        thing: MeshObject,
        hand: Palm,
        strategy: IntersectionStrategy,
        sampling: SamplingStrategy | None = None,
        *,
        interval: float = POSE_INTERVAL,
    ) -> None:
        low, high = INTERVAL_RANGE
        if not low <= interval <= high:  # a NaN compares false
            raise StrategyError(f"interval must lie in {low:g}..{high:g} s, not {interval}")
        sampling = sampling or SamplingStrategy()
        self.interval = interval
        self.sampler = Sampler(sampling)
        """Its `count` tells what has been drawn."""
        self.contours: ContourBatch | None = None
        """Of the last pose, on the host, in memory that the next pose writes over: copy what shall last."""
        self._intersection = PoseContours(thing, hand, strategy)
        self._rate = sampling.update_rate
        self._hold = max(sampling.hold, 2.0 * interval)
        self._began = 0.0  # when the first pose came [s]
        self._came = 0.0  # when the last one did, from there on [s]
        self._pose = np.zeros(7)
        self._path: Path | None = None
        self._drawn = 0  # samples so far

    @property
    def grown(self) -> int:
        """How often memory was taken anew, because a pose needed more."""
        return self._intersection.grown

    def draw(self, pose: np.ndarray, time: float, *, until: float | None = None) -> FocalPoints:
        """Take a pose; returns the focal points from the last one drawn to `until`.

        pose: x y z [m] and quaternion xyzw, hand frame -> array frame, shape [7]. time: when the hand was there [s],
        on any clock, after the pose before. until: when the next pose is expected [s], by default time + interval.
        Raises PoseError or MotionError for a pose that `render` refuses, a time that is not after the last pose's,
        an `until` before it, or more than DRAWN_MOST in one go; then nothing has changed.
        """
        row = checked_pose(pose)
        until = time + self.interval if until is None else until
        first = self.contours is None
        began = time if first else self._began
        if not (first or time - began > self._came):
            raise MotionError(f"time {time!r} s is not after {began + self._came!r} s of the pose before")
        if until < time:
            raise MotionError(f"until {until!r} s is before {time!r} s of its pose")
        before, stop = self._samples_until(time, began), self._samples_until(until, began)
        late = self._samples(before) if before > self._drawn and not first else []
        self.contours = self._intersection.at(row)
        self._began, self._came, self._pose = began, time - began, row.astype(np.float64)
        self._path = next(paths_of(self.contours))
        return joined([*late, *self._samples(stop)])

    def go_on(self, until: float) -> FocalPoints:
        """More focal points of the last pose, because none has come: it is held, then fades.

        until: [s], on the clock of the poses. Raises MotionError before the first pose, and for more than DRAWN_MOST
        in one go.
        """
        if self.contours is None:
            raise MotionError("there is no pose yet to go on with")
        return joined(self._samples(self._samples_until(until, self._began)))

    def _samples_until(self, time: float, began: float) -> int:
        """Samples shown before a time [s]: see `sample_bounds`."""
        if not math.isfinite(time):
            raise MotionError(f"time {time!r} s is not finite")
        count = math.ceil((time - began) * self._rate - 1e-6)
        if count - self._drawn > DRAWN_MOST * self._rate:
            last = began + self._drawn / self._rate
            raise MotionError(f"time {time!r} s is more than {DRAWN_MOST:g} s after {last!r} s of the last focal point")
        return count

    def _samples(self, stop: int) -> list[FocalPoints]:
        """Samples of the last pose up to sample `stop`, in blocks; one at least."""
        blocks = []
        while self._drawn < stop or not blocks:
            count = min(max(stop - self._drawn, 0), DRAWN_AT_ONCE)
            age = self._drawn / self._rate - self._came
            blocks.append(self.sampler.draw(self._path, self._pose, count, age=age, hold=self._hold))
            self._drawn += count
        return blocks


def checked_pose(pose: np.ndarray) -> np.ndarray:
    """A pose as `check_poses` gives and refuses it, float32, shape [7]."""
    try:
        row = np.asarray(pose, np.float64)
    except (TypeError, ValueError):
        raise PoseError("a pose must be seven numbers (x y z, qx qy qz qw)") from None
    if row.shape != (7,):
        raise PoseError(f"a pose must be seven numbers (x y z, qx qy qz qw), not of shape {row.shape}")
    x, y, z, a, b, c, w = row.tolist()
    if abs(x) + abs(y) + abs(z) < FAR and abs(math.sqrt(a * a + b * b + c * c + w * w) - 1.0) < NORM_SURE:
        return row.astype(np.float32)
    return check_poses(row[None])[0]
