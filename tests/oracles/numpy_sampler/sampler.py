"""Sampler: draws one pose after another and keeps where the focal points are.

A new pose does not restart the drawing: it goes on, one sample further, from the point of the new contours nearest to
where the focal point is, in the same direction (restarting makes closed contours as loud as open ones). Along contours
that stay, every cycle has the same whole number of samples, so the seam is a step like any other.
"""

import math
from fractions import Fraction
from functools import lru_cache

import numpy as np

from palpate.datasets.rigid import rotate
from palpate.render.sampling.metrics import FocalPoints, SamplingCount
from palpate.render.sampling.presets import sampling_of
from palpate.render.sampling.strategy import Order, SamplingStrategy

from .continuity import Place, entered, place_on
from .contour_absence import AbsenceWatch
from .cycle import Cycle, lay_cycle
from .fading import TICKS, fade_ticks, ticks_of
from .path import Path
from .revisits import RevisitWatch
from .route import Route

REST = (0.0, 0.0, 0.2)  # [m] where a focal point of intensity 0 is before there was any
LENGTH_UNIT = 2.0**-32  # [m], 0.2 nm: sums of whole ones are exact in any order, up to 2,000 km
CYCLE_LIMIT = 16_384  # samples, 1.6 s at 10 kHz: longer cycles are made as they are played


@lru_cache(maxsize=8)
def shown_order(order: Order, points: int) -> np.ndarray:
    """Place within the cycle, 0..points - 1, of each point in the order in which they are shown."""
    if order.kind == "random":
        return np.random.default_rng(order.seed).permutation(points)
    return (order.step if order.kind == "step" else 1) * np.arange(points) % points


class Cursor:
    """A place on a cycle: samples since the curve parameter at which it was entered."""

    def __init__(self, cycle: Cycle, parameter: float, index: int, strategy: SamplingStrategy) -> None:
        self.cycle, self._strategy = cycle, strategy
        self._anchor, self._index = parameter, index  # the next sample
        points = strategy.pace.points
        self._table = None if points is None else shown_order(strategy.order, points)

    @property
    def last(self) -> float:
        """Parameter of the sample drawn last, before points are held or reordered."""
        return float(self._parameters(np.array(self._index - 1)))

    @property
    def one_sample(self) -> float:
        """Curve parameter from a sample to the next."""
        return 0.0 if self._strategy.pace.kind == "still" else self.cycle.one_sample

    def _parameters(self, index: np.ndarray) -> np.ndarray:
        """Parameters of samples, within 0..period."""
        parameter = self._anchor + self.one_sample * (index % self.cycle.repeat_count)
        if self.cycle.turns > 1:
            return parameter % self.cycle.period
        return np.where(parameter < self.cycle.period, parameter, parameter - self.cycle.period)

    def take(self, count: int) -> tuple[np.ndarray, np.ndarray | None, np.ndarray | None]:
        """The next samples: points [m], shape [sample, focus, 3], intensities, shape [sample, focus] or None, and the
        polylines' numbers in the route, shape [sample, focus], -1 between two, None on the only one.
        """
        cycle, foci = self.cycle, self._strategy.foci
        parameter = self._parameters(np.arange(self._index, self._index + count))[:, None]
        self._index += count
        if foci > 1:
            parameter = (parameter + cycle.period * np.arange(foci) / foci) % cycle.period
        if self._table is not None:
            share = len(self._table) / cycle.period
            turn = np.floor(parameter * share + 1e-9).astype(np.int64) % len(self._table)
            parameter = self._table[turn] / share
        intensity = None if cycle.intensity is None else np.interp(parameter, cycle.parameter, cycle.intensity)
        return cycle.at(parameter), intensity, cycle.pieces_at(parameter)


class Sampler:
    """Draws one pose after another; keeps where the focal points are and counts what happens.

    Sampler(SamplingStrategy(speed=7.0, update_rate=10000.0, foci=2), 2000 samples drawn)
    """

    def __init__(self, strategy: SamplingStrategy | str) -> None:
        self.strategy = strategy = sampling_of(strategy)
        self.count = SamplingCount()
        self._path: Path | None = None  # of the last sample
        self._before: Path | None = None  # whose contours were entered last
        self._cursor: Cursor | None = None
        self._shown = np.tile(np.array(REST), (strategy.foci, 1))  # the last focal points
        self._place = Place(np.array(REST), None)  # of the first on its cycle: not held or reordered, no small circle
        self._drawn = False  # something has been drawn
        self._silent = True  # the last sample was
        self._revisits = RevisitWatch(self.count, strategy.update_rate)
        self._absences = AbsenceWatch(self.count, strategy.update_rate)
        self._route: Route | None = None  # of the contours that were entered last
        self._last = self._shown  # where they were on their cycle, shape [focus, 3]: see `_place`
        self._entry: tuple[Cycle, float, np.ndarray] | None = None  # the parameter, and where the focal points were [m]
        self._on_cycle = 0  # samples on the current cycle
        self._cycles_before = 0.0  # on cycles before it
        self._ordinary = strategy.step_ordinary  # longest step along them [m]

    def __repr__(self) -> str:
        """One line."""
        return f"Sampler({self.strategy!r}, {self.count.samples} samples drawn)"

    def draw(
        self, path: Path | None, pose: np.ndarray, sample_count: int, *, age: float = 0.0, hold: float = np.inf
    ) -> FocalPoints:
        """The next samples, of one pose.

        path: contours of the pose, None if there are none. pose: x y z [m] and quaternion, shape [7].
        age: how old the pose is at the first of these samples [s], `age_at` of it if they are drawn block by block;
        hold: at what age it starts to fade [s].
        """
        focus = self._next(path, pose, sample_count, age, hold)
        self._revisits.take(focus, pose)
        return focus

    def _next(self, path: Path | None, pose: np.ndarray, sample_count: int, age: float, hold: float) -> FocalPoints:
        """The next samples, counted in all but their revisits."""
        first = self.count.samples
        self.count.samples += sample_count
        gain = self._gain(sample_count, age, hold)
        if path is None or sample_count == 0:
            return self._rest(sample_count)
        position, intensity, is_new = self._run(path, sample_count, gain)
        if self.strategy.lm is not None:
            position += circle_offsets(self.strategy, pose, first, sample_count)[:, None]
        if gain is not None:
            intensity = gain[:, None] if intensity is None else intensity * gain[:, None]
        drawn = None if intensity is None else np.max(intensity, axis=1) > 0
        self._count_jumps(position, drawn, is_new)
        if drawn is not None:
            self.count.silent += int(np.count_nonzero(~drawn))
        self._silent, self._drawn = drawn is not None and not drawn[-1:].any(), True
        self._shown = position[-1].copy()
        return focal_points(self.strategy, position, intensity, first)

    def cycle(self, path: Path, pose: np.ndarray | None = None, *, limit: int = CYCLE_LIMIT) -> FocalPoints | None:
        """One whole period of a pose that stays, overlays included: played again and again it is the pose.

        Starts where a new sampler would; changes nothing. pose: needed for small circles only, shape [7].
        None where no whole number of samples up to `limit` is a period of everything.
        """
        count = period_count(self.strategy, lay_cycle(path, self.strategy).repeat_count, limit)
        if count is None:
            return None
        return Sampler(self.strategy).draw(path, np.array([0, 0, 0, 0, 0, 0, 1.0]) if pose is None else pose, count)

    def _gain(self, sample_count: int, age: float, hold: float) -> np.ndarray | None:
        """Factor that fading leaves of the intensity, None for 1."""
        rate = self.strategy.update_rate
        first = ticks_of(age, rate) - ticks_of(hold, rate)  # by how much the pose is older than `hold`
        if first + TICKS * (sample_count - 1) <= 0:
            return None
        over = first + TICKS * np.arange(sample_count)
        self.count.held += int(np.count_nonzero(over > 0))
        return np.clip(1.0 - over / fade_ticks(self.strategy.fade, rate), 0.0, 1.0)

    def _run(self, path: Path, count: int, gain: np.ndarray | None) -> tuple[np.ndarray, np.ndarray | None, bool]:
        """The next samples on a cycle, and whether the first is also the first on a new pose's contours.

        gain: what fading leaves of them.
        """
        is_new, cursor = path is not self._path, self._cursor
        if is_new or cursor is None:
            self._path = path
            cursor = self._cursor = self._enter(path, self._silent)
        position, intensity, piece = cursor.take(count)
        felt = count if gain is None else int(np.count_nonzero(gain > 0))  # a fade falls
        if felt > 0:
            self._absences.watch(felt, piece if piece is None else piece[:felt])
        if felt < count:
            self._absences.lose(count - felt)
        cycle, last = cursor.cycle, cursor.last
        held = self.strategy.pace.points is not None
        self._last = cycle.at(self._spread(cycle, last)) if held else position[-1].copy()
        self._place = place_on(cycle, last, self._last[0], self.strategy.jump_threshold)
        self.count.drawn += count
        self._on_cycle += count
        if self.strategy.pace.kind != "still":
            self.count.cycles = self._cycles_before + cycle.turns * self._on_cycle / cycle.repeat_count
        return position, intensity, is_new

    def _enter(self, path: Path, silent: bool) -> Cursor:
        """Enter the contours of a new pose, where drawing goes on; `silent`: the sample before is."""
        strategy, cycle = self.strategy, lay_cycle(path, self.strategy, self._route)
        before, self._before = self._before if self._drawn else None, path
        self._cycles_before, self._on_cycle = self.count.cycles, 0
        if cycle.route is not None:
            self._absences.enter(cycle.route)
            self._route = cycle.route
        if strategy.pace.kind in ("frequency", "capped"):  # the contours' length decides how fast it runs
            self._ordinary = cycle.step_ordinary + strategy.circle_step
        index = 0 if silent else 1  # after a silence at the nearest point, else one sample on
        self._entry = None
        if not self._drawn:
            return Cursor(cycle, 0.0, 0, strategy)
        if strategy.continuity == "jump" and before is not None and other_contours(before, path):
            return Cursor(cycle, 0.0, 0, strategy)
        parameter = entered(cycle, self._place, strategy.jump_threshold, self._ordinary)
        self._entry = cycle, parameter, self._last
        return Cursor(cycle, parameter, index, strategy)

    def _rest(self, sample_count: int) -> FocalPoints:
        """Silence where the focal points are."""
        self.count.silent += sample_count
        if sample_count > 0:
            self._silent, self._path = True, None
            self._absences.lose(sample_count)
        position = np.repeat(self._shown[None], sample_count, axis=0)
        return focal_points(self.strategy, position, np.zeros(position.shape[:2]), 0)

    def _count_jumps(self, position: np.ndarray, drawn: np.ndarray | None, is_new: bool) -> None:
        """Count steps that are too long, by cause."""
        step = np.empty_like(position)
        step[0] = position[0] - self._shown
        np.subtract(position[1:], position[:-1], out=step[1:])
        length = np.sqrt(np.einsum("ijk,ijk->ij", step, step))
        if self._silent or drawn is not None:
            now = np.ones(len(length), bool) if drawn is None else drawn
            before = np.append(not self._silent, now[:-1])  # whether the sample before is drawn
            again = now & ~before
            again[0] &= self._drawn  # at the very first sample nothing comes back
            self._add("re-entry", np.where(again[:, None], length, 0.0), self._ordinary)
            length[~(now & before)] = 0.0
        self.count.step_longest = max(self.count.step_longest, float(length.max()))
        self._count_far(length, is_new)

    def _count_far(self, length: np.ndarray, is_new: bool) -> None:
        """Count jumps and hops among steps [m], shape [sample, focus]; is_new: the first leads to a new pose."""
        cause = "order" if self.strategy.pace.points is not None else "polyline"
        if is_new:
            moved = 2 * self._moved() >= length[0]  # else the contours themselves have a step as long there
            self._add("pose", length[0][moved], self._ordinary)
            self._add(cause, length[0][~moved], self._ordinary)
        self._add(cause, length[1:] if is_new else length, self._ordinary)

    def _moved(self) -> np.ndarray:
        """From where each focal point was to where it entered the contours of the pose [m]; infinite if anywhere."""
        if self._entry is None:
            return np.full(self.strategy.foci, np.inf)
        cycle, parameter, points = self._entry
        parameters = self._spread(cycle, parameter)
        before = np.nextafter(np.where(parameters > 0, parameters, cycle.period), 0.0)
        around = cycle.at(np.stack([parameters, before]))  # at a jump, both its sides
        return np.linalg.norm(around - points, axis=2).min(axis=0)

    def _spread(self, cycle: Cycle, parameter: float) -> np.ndarray:
        """Parameters of all focal points, of which the first is at this one."""
        foci = self.strategy.foci
        return (parameter + cycle.period * np.arange(foci) / foci) % cycle.period if foci > 1 else np.array([parameter])

    def _add(self, cause: str, length: np.ndarray, ordinary: float) -> None:
        """Count which of these steps [m] are jumps, and which hops: longer than twice an ordinary one [m]."""
        jump = length[length > self.strategy.jump_threshold]
        hop = length[(length > 2 * ordinary) & (length <= self.strategy.jump_threshold)]
        self.count.jumps[cause] += len(jump)
        self.count.jump_lengths[cause] += float(np.rint(jump / LENGTH_UNIT).sum()) * LENGTH_UNIT
        self.count.hops[cause] += len(hop)
        self.count.hops_longest[cause] = max(self.count.hops_longest[cause], float(hop.max(initial=0.0)))


def other_contours(a: Path, b: Path) -> bool:
    """Whether two paths differ in their number of polylines, or in which of them are closed."""
    return not np.array_equal(a.closed, b.closed)


def circle_offsets(strategy: SamplingStrategy, pose: np.ndarray, first: int, count: int) -> np.ndarray:
    """From focal points to where small circles move them, for samples first.. [m], shape [sample, 3]."""
    if strategy.lm is None:
        return np.zeros((count, 3))
    angle = 2 * np.pi * turns_of(strategy.lm.frequency, strategy.update_rate, first, count)
    u = rotate(pose[3:], np.array([strategy.lm.radius, 0.0, 0.0]))
    v = rotate(pose[3:], np.array([0.0, 0.0, -strategy.lm.radius]))
    return np.cos(angle)[:, None] * u + np.sin(angle)[:, None] * v


def turns_of(frequency: float, update_rate: float, first: int, count: int) -> np.ndarray:
    """Turns of a wave at samples first.. , their whole part left out, shape [sample]."""
    return np.mod((first + np.arange(count)) * (frequency / update_rate), 1.0)


def wave_of(strategy: SamplingStrategy, first: int, count: int) -> np.ndarray:
    """Factor of amplitude modulation, for samples first.. , shape [sample]."""
    am = strategy.am
    if am is None:
        return np.ones(count)
    turns = turns_of(am.frequency, strategy.update_rate, first, count)
    low = 0.5 + 0.5 * np.cos(2 * np.pi * turns) if am.wave == "sine" else (turns < 0.5).astype(np.float64)
    return 1.0 - am.depth * low


def focal_points(
    strategy: SamplingStrategy, position: np.ndarray, intensity: np.ndarray | None, first: int
) -> FocalPoints:
    """Focal points of float32, without an axis for foci where there is one; intensities modulated.

    position: [m], shape [sample, focus, 3]. intensity: shape [sample, focus] or [sample, 1]; None means 1.
    """
    shape = position.shape[:2]
    full = np.ones(shape, np.float32) if intensity is None else np.broadcast_to(intensity, shape)
    if strategy.am is not None:
        full = full * wave_of(strategy, first, shape[0])[:, None]
    position, full = position.astype(np.float32), full.astype(np.float32)
    return FocalPoints(position[:, 0], full[:, 0]) if strategy.foci == 1 else FocalPoints(position, full)


def period_count(strategy: SamplingStrategy, cycle_count: int, limit: int) -> int | None:
    """Samples after which everything repeats: cycle and overlays; None if that takes more than `limit`."""
    total = cycle_count
    for overlay in (strategy.am, strategy.lm):
        if overlay is not None:
            turns = Fraction(overlay.frequency) / Fraction(strategy.update_rate)  # a sample
            near = turns.limit_denominator(limit)
            if abs(float(turns - near)) * limit > 1e-6:
                return None
            total = math.lcm(total, near.denominator)
    return total if total <= limit else None
