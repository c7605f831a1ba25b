"""One pose to focal points, again and again, on the CPU: contours and focal points of a hand that moves now.

The kernels are those of `render`, and so are the bits; what is saved is everything around them (`PreparedContours`).
"""

import math

import numpy as np

from ...datasets.errors import MotionError
from ..contour_batch import ContourBatch
from ..errors import PoseError, StrategyError
from ..hands.hand import Hand
from ..intersection.named_inputs import motion_of
from ..intersection.prepared_contours import PreparedContours
from ..objects.solid import Solid
from ..sampling.metrics import FocalPoints
from ..sampling.presets import sampling_of
from ..sampling.sampler import Sampler, age_at, joined
from ..sampling.strategy import SamplingStrategy
from ..strategies.intersection_strategy import IntersectionStrategy

POSE_INTERVAL = 1 / 90  # [s]; a headset's hand tracking
INTERVAL_RANGE = (1e-4, 5.0)  # [s]
FAR = 1e30  # [m]; float32 ends beyond
DRAWN_MOST = 10.0  # [s] in one go: 400,000 samples at 40 kHz
NORM_SURE = 5e-8  # a quaternion's norm this near to 1 is left alone by `motion_of`, however it rounds


class Instant:
    """Focal points of a hand that moves now: a pose comes, the focal points until the next one go.

    Sample k is shown at k / update rate after the first pose, as in `sample_contours`: the same poses give the same
    focal points, bit for bit, if each is drawn until the time of the next. No sample is left out or comes twice,
    whenever poses come: what was not drawn before a pose is drawn from the one before it.

    solid, hand, strategy: as in `render`. sampling: how contours are drawn, by default at constant speed.
    interval: expected between poses [s]; a pose is held for twice that if `sampling.hold` is shorter.
    Not for two threads at once. Raises MeshError where the strategy needs a closed surface and the object has none,
    StrategyError for an interval out of its range.

    >>> from palpate.render import Instant, static_pose
    >>> instant = Instant("cube", "palm", "cc")
    >>> pose = static_pose([0, 0, 0.2]).pose[0]
    >>> len(instant.draw(pose, time=0.0, until=0.01).position)  # 10 ms at 10 kHz
    100
    >>> len(instant.draw(pose, time=0.01, until=0.03).position)  # the next 20 ms
    200
    """

    def __init__(
        self,
        solid: Solid | str,
        hand: Hand | str,
        strategy: IntersectionStrategy | str,
        sampling: SamplingStrategy | str | None = None,
        *,
        interval: float = POSE_INTERVAL,
    ) -> None:
        low, high = INTERVAL_RANGE
        if not low <= interval <= high:  # a NaN compares false
            raise StrategyError(f"interval must lie in {low:g}..{high:g} s, not {interval}")
        sampling = sampling_of(sampling or SamplingStrategy())
        self.interval = interval
        self._intersection = PreparedContours(solid, hand, strategy)
        self._rate = sampling.update_rate
        self.hold = max(sampling.hold, 2.0 * interval)
        """Age at which a pose starts to fade [s]."""
        self._restart(sampling)

    def reset(self) -> None:
        """Forget all poses: the next one is the first."""
        self._restart(self.sampler.strategy)

    def _restart(self, sampling: SamplingStrategy) -> None:
        self.sampler = Sampler(sampling, revisits=False)
        """Its `count` has what was drawn, revisits left out."""
        self.contours: ContourBatch | None = None
        """Of the last pose, on the host, in memory that the next pose writes over: copy what shall last."""
        self._began = 0.0  # when the first pose came [s]
        self._came = 0.0  # when the last one did, from there on [s]
        self._pose = np.zeros(7)
        self._drawn = 0  # samples so far

    def __repr__(self) -> str:
        return f"Instant({self.sampler!r})"

    @property
    def grown(self) -> int:
        """How often memory was taken anew, because a pose needed more."""
        return self._intersection.grown

    def draw(
        self, pose: np.ndarray, time: float, *, until: float | None = None, patch_pose: np.ndarray | None = None
    ) -> FocalPoints:
        """Take a pose; returns the focal points from the last one drawn to `until`.

        pose: x y z [m] and quaternion xyzw, hand frame -> array frame, shape [7]. time: when the hand was there [s],
        on any clock, after the pose before. until: when the next pose is expected [s], by default time + interval.
        patch_pose: of an articulated hand, poses of its patches in the hand's frame, shape [patch, 7], NaN for one that
        is not there.
        Raises PoseError or MotionError for a pose that `render` refuses, a time that is not after the last pose's,
        an `until` before it, or more than DRAWN_MOST in one go; then nothing has changed.
        """
        row, hand = checked_pose(pose), self._intersection.hand_at(patch_pose)
        until = time + self.interval if until is None else until
        first = self.contours is None
        began = time if first else self._began
        if not (first or time - began > self._came):
            raise MotionError(f"time {time!r} s is not after {began + self._came!r} s of the pose before")
        if until < time:
            raise MotionError(f"until {until!r} s is before {time!r} s of its pose")
        before, stop = self._samples_until(time, began), self._samples_until(until, began)
        late = [self._samples(before)] if before > self._drawn and not first else []
        self.contours = contours = self._intersection.at_checked(row, hand)
        self._began, self._came, self._pose = began, time - began, row.astype(np.float64)
        count, age = max(stop - self._drawn, 0), age_at(self._drawn, self._came, self._rate)
        if (struct := self._intersection.struct) is None:
            focus = self.sampler.draw(contours, self._pose, count, age=age, hold=self.hold)
        else:
            focus = self.sampler.draw_struct(
                struct, contours.polyline_count, self._pose, count, age=age, hold=self.hold
            )
        self._drawn += count
        return joined([*late, focus])

    def go_on(self, until: float) -> FocalPoints:
        """More focal points of the last pose, because none has come: it is held, then fades.

        until: [s], on the clock of the poses. Raises MotionError before the first pose, and for more than DRAWN_MOST
        in one go.
        """
        if self.contours is None:
            raise MotionError("there is no pose yet to go on with")
        return self._samples(self._samples_until(until, self._began))

    def _samples_until(self, time: float, began: float) -> int:
        """Samples shown before a time [s]: see `sample_bounds`."""
        if not math.isfinite(time):
            raise MotionError(f"time {time!r} s is not finite")
        count = math.ceil((time - began) * self._rate - 1e-6)
        if count - self._drawn > DRAWN_MOST * self._rate:
            last = began + self._drawn / self._rate
            raise MotionError(
                f"time {time:.6g} s is more than {DRAWN_MOST:g} s after {last:.6g} s of the last focal point: after a "
                "gap so long, begin with another Instant"
            )
        return count

    def _samples(self, stop: int) -> FocalPoints:
        """Samples of the last pose up to sample `stop`."""
        count, age = max(stop - self._drawn, 0), age_at(self._drawn, self._came, self._rate)
        focus = self.sampler.draw_on(self._pose, count, age=age, hold=self.hold)
        self._drawn += count
        return focus


def checked_pose(pose: np.ndarray) -> np.ndarray:
    """A pose as `motion_of` gives and refuses it, float32, shape [7]."""
    try:
        row = np.asarray(pose, np.float64)
    except (TypeError, ValueError):
        raise PoseError("a pose must be seven numbers (x y z, qx qy qz qw)") from None
    if row.shape != (7,):
        raise PoseError(f"a pose must be seven numbers (x y z, qx qy qz qw), not of shape {row.shape}")
    x, y, z, a, b, c, w = row.tolist()
    if abs(x) + abs(y) + abs(z) < FAR and abs(math.sqrt(a * a + b * b + c * c + w * w) - 1.0) < NORM_SURE:
        return row.astype(np.float32)
    return motion_of(row[None]).pose[0]
