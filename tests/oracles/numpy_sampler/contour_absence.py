"""Absence: the longest time for which a contour that is there is not drawn, from one passage to the next."""

import numpy as np

from palpate.render.sampling.metrics import SamplingCount

from .route import Route


class AbsenceWatch:
    """Counts samples since each polyline of the pose was last drawn, over all poses that have it.

    A polyline that appears is waited for from then on, one that disappears until then. Nothing is waited for in a
    silence. What the focal point passes at intensity 0 counts as drawn: nothing else is to be drawn there.
    """

    def __init__(self, count: SamplingCount, update_rate: float) -> None:
        self._count, self._period = count, 1.0 / update_rate
        self._clock = 0  # samples so far
        self._drawn = np.zeros(0, np.int64)  # sample in which each polyline was last drawn, or before which it appeared
        self._lost = True

    def enter(self, route: Route) -> None:
        """The next samples are of a pose with these polylines."""
        drawn = np.full(len(route.pieces), self._clock - 1)
        if not self._lost:
            known = route.earlier >= 0
            drawn[known] = self._drawn[route.earlier[known]]
        self._drawn, self._lost = drawn, False

    def watch(self, sample_count: int, piece: np.ndarray | None) -> None:
        """The next samples; piece: the polyline that each focal point is on, -1 for none, shape [sample, focus].

        None as the piece: there is one polyline, and every sample is on it.
        """
        start, self._clock = self._clock, self._clock + sample_count
        if piece is None:
            self._keep(start - int(self._drawn[0]))
            self._drawn[0] = self._clock - 1
            return
        order = np.argsort(piece, axis=None, kind="stable")
        line, sample = piece.ravel()[order], start + order // piece.shape[1]
        line, sample = line[line >= 0], sample[line >= 0]
        before = np.empty_like(sample)
        before[1:] = sample[:-1]
        first = np.flatnonzero(np.diff(line, prepend=-1))
        before[first] = self._drawn[line[first]]
        self._drawn[line] = sample  # of several that are the same the last one stays
        self._keep(int((sample - before).max(initial=1)))
        self._keep(int((self._clock - self._drawn).max(initial=1)))

    def _keep(self, samples: int) -> None:
        """Count from one sample on a polyline to the next, if that is the longest time."""
        self._count.absence_max = max(self._count.absence_max, (samples - 1) * self._period)

    def lose(self, sample_count: int) -> None:
        """The next samples are silent."""
        self._clock += sample_count
        self._lost = True
