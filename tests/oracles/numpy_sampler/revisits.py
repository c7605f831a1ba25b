"""Revisit rate: how often a place on the skin is drawn, counted on focal points and hand poses alone.

In each interval one place that a focal point draws is picked. The watch looks up how long ago that place was visited
before. A visit is a run of drawn samples with a focal point near the place. docs/guide/sampling.md has the definition.
"""

import math

import numpy as np

from palpate.render.sampling.metrics import FocalPoints, SamplingCount

REVISIT_RADIUS = 5e-3  # [m] on the skin: half a focal point's width 0.2 m above an array of 0.16 m
REVISIT_LIMIT = 1.0  # [s] without a visit: a place that waits longer waits in vain
PICK_INTERVAL = 20e-3  # [s]; a pick takes some 60 us of a core, and 50 a second are enough for the mean
GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0  # its multiples spread evenly over 0..1, so that picks keep step with no cycle
BLOCK = 1024  # samples that are remembered at once
GROUP_TIME = 1.6e-3  # [s] of the samples in a box: 11 mm of a contour at 7 m/s
LOOK = 64  # boxes that are searched first: 0.1 s
SURELY_NEAR = (1.001 * REVISIT_RADIUS) ** 2  # [m^2]; rounding leaves no box out that has a sample near the place


class Ring:
    """The newest columns of an array that grows; each is stored twice, so that consecutive columns are one slice."""

    def __init__(self, size: int, rows: int, dtype: type = np.float64) -> None:
        """size: columns that are remembered."""
        self._size, self._twice = size, np.zeros((rows, 2 * size), dtype)

    def write(self, first: int, columns: np.ndarray) -> None:
        """Write columns from a number on, shape [row, column]."""
        start, count = first % self._size, columns.shape[1]
        over = max(start + count - self._size, 0)
        self._twice[:, start : start + count] = columns
        self._twice[:, start + self._size : start + self._size + count - over] = columns[:, : count - over]
        self._twice[:, :over] = columns[:, count - over :]

    def columns(self, first: int, stop: int) -> np.ndarray:
        """Columns first..stop, shape [row, column]."""
        start = first % self._size
        return self._twice[:, start : start + stop - first]


class SkinHistory:
    """Places on the skin at which focal points were drawn, as far back as the visit before may be.

    Drawn samples are numbered from 0 here. Groups of them have boxes: a place is compared only with samples in boxes
    near to it.
    """

    def __init__(self, limit: int, group: int, foci: int) -> None:
        """limit: samples without a visit after which a place waits in vain. group: drawn samples in a box.

        foci: focal points a sample.
        """
        self._limit, self._group, self._foci = limit, group, foci
        boxes = (2 * limit + BLOCK) // group + 2  # a visit lasts one limit at most, and so does the wait before it
        self._remembered = boxes * group
        self._number = Ring(self._remembered, 1, np.int64)  # of each drawn sample among all
        self._skin = Ring(self._remembered, 3 * foci)  # [m], hand frame
        self._low, self._high = Ring(boxes, 3), Ring(boxes, 3)  # [m]
        self._count = 0  # drawn samples so far

    def add(self, sample: np.ndarray, skin: np.ndarray) -> None:
        """Remember drawn samples, at most BLOCK: numbers; focal points in the hand frame [m], [3, focus, sample]."""
        self._number.write(self._count, sample[None])
        self._skin.write(self._count, skin.reshape(-1, len(sample)))
        first = self._count // self._group  # its box may exist already, around the samples before: it is made anew
        self._count += len(sample)
        points = self._skin.columns(first * self._group, self._count).reshape(3, self._foci, -1)
        begins = np.arange(0, points.shape[2], self._group)
        low, high = (points[:, 0], points[:, 0]) if self._foci == 1 else (points.min(axis=1), points.max(axis=1))
        self._low.write(first, np.minimum.reduceat(low, begins, axis=1))
        self._high.write(first, np.maximum.reduceat(high, begins, axis=1))

    def wait_before(self, sample: int, focus: int) -> tuple[bool, int] | None:
        """Whether the place that a focus draws at a sample was visited before, and how many samples it has waited.

        None for a place that does not count: the visit has lasted for longer than the limit, or what was drawn during
        the limit before is not known.
        """
        own = self._first_from(sample)
        place = self._skin.columns(own, own + 1).reshape(3, self._foci)[:, focus]
        found = self._visits(own, place)
        if found is None or sample - found[0][found[2][-1]] > self._limit:
            return None
        moment, square, begins = found
        entered = int(moment[begins[-1]])
        earliest = entered - self._limit
        if len(begins) > 1 and moment[begins[-1] - 1] >= earliest:
            before = slice(begins[-2], begins[-1])
            nearest = np.where(moment[before] >= earliest, square[before], np.inf).argmin()
            now = moment[begins[-1] + square[begins[-1] :].argmin()]
            return True, int(now - moment[begins[-2] + nearest])
        if earliest < 0:
            return None
        first = self._first_from(earliest)
        return False, entered - int(self._number.columns(first, first + 1)[0, 0])

    def _first_from(self, sample: int) -> int:
        """The first drawn sample, of those remembered, that is not before a sample."""
        oldest = max(-(-self._count // self._group) * self._group - self._remembered, 0)  # its whole box is remembered
        return oldest + int(self._number.columns(oldest, self._count)[0].searchsorted(sample))

    def _visits(self, last: int, place: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """The visit to a place that goes on at a drawn sample, and the visit before, if the limit holds it.

        Returns the samples near the place, their square distances [m^2], and where among them visits begin. None, at
        times, where the visit has lasted for longer than the limit.
        """
        stop = last // self._group + 1
        start = max(stop - LOOK, 0)
        while True:
            drawn, square = self._near(start, stop, last, place)
            moment = self._number.columns(start * self._group, last + 1)[0, drawn - start * self._group]
            begins = np.concatenate([[0], (drawn[1:] - drawn[:-1] > 1).nonzero()[0] + 1])
            if len(begins) > 2:  # the last two of three are whole
                return moment, square, begins
            first = self._first_from(int(moment[begins[-1]]) - self._limit) // self._group
            if start <= first:
                return moment, square, begins
            if drawn[begins[-1]] == start * self._group and self._surely_rests(int(moment[-1]), stop, place):
                return None
            start = first

    def _surely_rests(self, sample: int, stop: int, place: np.ndarray) -> bool:
        """Whether boxes alone show that a visit has lasted for longer than the limit, which is many samples.

        sample: the last of the visit. stop: behind its last box.
        """
        first = self._first_from(sample - self._limit) - 1
        if first < 0:
            return False
        low, high = (boxes.columns(first // self._group, stop) for boxes in (self._low, self._high))
        off = np.maximum(place[:, None] - low, high - place[:, None])
        return bool(((off * off).sum(axis=0) < REVISIT_RADIUS**2).all())

    def _near(self, start: int, stop: int, last: int, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Drawn samples in boxes start..stop, up to a last one, near a place: which, and square distances [m^2]."""
        low, high = self._low.columns(start, stop), self._high.columns(start, stop)
        off = np.maximum(low - place[:, None], place[:, None] - high)
        np.maximum(off, 0.0, out=off)
        off *= off
        boxes = (off[0] + off[1] + off[2] < SURELY_NEAR).nonzero()[0]
        drawn = (boxes[:, None] * self._group + np.arange(self._group)).ravel()
        drawn = drawn[: drawn.searchsorted(last - start * self._group, side="right")]
        skin = self._skin.columns(start * self._group, last + 1).take(drawn, axis=1).reshape(3, self._foci, -1)
        off = skin - place[:, None, None]
        off *= off
        square = (off[0] + off[1] + off[2]).min(axis=0)
        near = square < REVISIT_RADIUS**2
        return start * self._group + drawn[near], square[near]


class RevisitWatch:
    """Picks places as focal points come, and counts visits; how samples are cut into blocks changes nothing."""

    def __init__(self, count: SamplingCount, update_rate: float) -> None:
        """count: its `revisits` and `revisit_time` grow. update_rate: of the focal points [Hz]."""
        self._count, self._period = count, 1.0 / update_rate
        self._limit = math.floor(REVISIT_LIMIT * update_rate)
        self._interval = max(1, round(PICK_INTERVAL * update_rate))
        self._group = max(1, round(GROUP_TIME * update_rate))
        self._samples = 0  # so far
        self._pick = 0  # number of the next pick
        self._history: SkinHistory | None = None

    def take(self, focus: FocalPoints, pose: np.ndarray) -> None:
        """The next focal points, at one pose (hand frame -> array frame, shape [7])."""
        for first in range(0, len(focus.intensity), BLOCK):
            intensity = focus.intensity[first : first + BLOCK]
            drawn = intensity.reshape(len(intensity), -1).T > 0
            if drawn.any():
                position = focus.position[first : first + BLOCK].reshape(len(intensity), -1, 3)
                self._look(on_skin(position, np.asarray(pose, np.float64)), drawn)
            self._samples += len(intensity)

    def _look(self, skin: np.ndarray, drawn: np.ndarray) -> None:
        """Remember focal points in the hand frame, shape [3, focus, sample], and count for the picks among them.

        drawn: whether they are, shape [focus, sample].
        """
        foci, count = drawn.shape
        if self._history is None:
            self._history = SkinHistory(self._limit, self._group, foci)
        sample = np.arange(self._samples, self._samples + count)
        if not drawn.all():  # one that is drawn stands in for one that is silent: the nearest stays the nearest
            skin = np.where(drawn, skin, skin[:, drawn.argmax(axis=0), np.arange(count)][:, None])
            some = drawn.any(axis=0)
            skin, sample = skin[..., some], sample[some]
        self._history.add(sample, skin)
        self._pick = max(self._pick, self._samples // self._interval)  # no pick falls into a silence
        while (picked := self._sample_of(self._pick)) < self._samples + count:
            focus = self._pick % foci
            if picked >= self._samples and drawn[focus, picked - self._samples]:
                found = self._history.wait_before(picked, focus)
                if found is not None:
                    self._count.revisits += int(found[0])
                    self._count.revisit_time += found[1] * self._period
            self._pick += 1

    def _sample_of(self, pick: int) -> int:
        """Sample of a pick: one, anywhere, in each interval."""
        return pick * self._interval + math.floor(self._interval * (pick * GOLDEN % 1.0))


def on_skin(position: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Focal points [sample, focus, 3] in the hand frame [m], shape [3, focus, sample]; pose: shape [7]."""
    x, y, z, w = pose[3:].tolist()
    axes = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)],
            [2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)],
            [2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    off = position.transpose(2, 1, 0) - pose[:3, None, None]
    # not as a matrix product, whose rounding depends on how many samples there are
    part = axes[..., None, None] * off
    return part[:, 0] + part[:, 1] + part[:, 2]
