"""A psychometric function fitted to answers: maximum likelihood, and intervals by profile likelihood.

The function is a cumulative Gaussian. The fit writes it as Phi(a + b x), with x scaled to 0..1 so that proportions
rise. In a and b, a flat line (b = 0) and a threshold far outside the data are ordinary points; in mu and sigma they
lie at infinity.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from statistics import NormalDist

import numpy as np

from ...errors import StudyError
from .hypothesis_tests import ALIKE, join_ties

PEAKS_MOST = 4  # of the grid, for one lapse rate, that are climbed
CHI_SQUARE_95 = 3.841458820694124
"""95 % quantile of chi-square with 1 degree of freedom: a value at an interval's end has so much more deviance."""
SAME = 1e-6
"""Log likelihoods that differ by less are those of equally good fits."""
STEEPEST = 20.0
"""Sigmas in the smallest distance between levels: a curve so steep is a step for these data."""
FARTHEST = 10.0
"""Ranges of the levels beside them in which a threshold is looked for."""
JND_SHARE = NormalDist().inv_cdf(0.75)
"""Of sigma: the distance from 50 % to 75 %."""
Z_MOST = 26.0
"""Beyond, the square of the Gaussian's tail is too small for a float64."""
AXES = "mu", "b", "lapse"
CLIMB_MOST = 200
"""Steps of one search for a maximum; 5 to 20 are usual."""
GAIN_LEAST = 1e-14
"""Of log likelihood, that a search goes on for."""
DAMPING_LEAST, DAMPING_MOST = 1e-3, 1e9
"""Share of the information's diagonal that is added to it, where a step without it leads downhill."""
SINGULAR = 1e-12
"""The same share always, so that values of which answers tell only a combination do not divide by zero."""


@dataclass(frozen=True, kw_only=True)
class FittedValue:
    """An estimate between the ends of its 95 % interval; an end is None where the data set no bound."""

    value: float | None = None
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True, kw_only=True)
class PsychometricFit:
    """A cumulative Gaussian through proportions. Where the data do not give a value it is None, and `note` says why."""

    mu: FittedValue = FittedValue()
    """Threshold, or point of subjective equality: where Phi is 0.5; on the scale of x."""
    sigma: FittedValue = FittedValue()
    """Standard deviation of the Gaussian, positive also where proportions fall; 0: as steep as a step."""
    lapse: FittedValue = FittedValue()
    """Lapse rate; its interval ends at 0 and lapse_max where the data allow more."""
    guess: float | None
    """Proportion at the lower end of the curve; None: it equals the lapse rate."""
    is_increasing: bool | None = None
    """Whether proportions rise with x, which the data decide; None: they do neither."""
    deviance: float | None = None
    """Twice the log likelihood that the curve lacks to proportions of its own for each level."""
    freedom: int | None = None
    """Degrees of freedom of the deviance: levels less fitted values (a lapse rate at a bound is not counted)."""
    goodness_p: float | None = None
    """Of the deviance, by chi-square: small where the curve does not describe the data; rough for few answers."""
    converged: bool
    """Whether the likelihood has a maximum, with a threshold and a finite slope."""
    note: str = ""
    """Sentences that say why a value or a bound is missing, with the data; empty where none is."""

    @property
    def jnd(self) -> FittedValue:
        """Just noticeable difference: from 50 % to 75 % of the Gaussian, 0.6745 sigma."""
        ends = {name: None if own is None else JND_SHARE * own for name, own in vars(self.sigma).items()}
        return FittedValue(**ends)

    def predict(self, x: np.ndarray) -> np.ndarray:
        """The curve's proportions at x, in the same shape; nan where there is no curve."""
        from scipy import special  # 0.5 s that only analyses cost

        if self.mu.value is None or self.sigma.value is None or self.lapse.value is None:
            return np.full(np.shape(x), np.nan)
        distance = (np.asarray(x, dtype=float) - self.mu.value) * (1.0 if self.is_increasing else -1.0)
        share = special.ndtr(distance / self.sigma.value) if self.sigma.value else (np.sign(distance) + 1.0) / 2.0
        low = self.lapse.value if self.guess is None else self.guess
        return low + (1.0 - low - self.lapse.value) * share


def fit_psychometric(
    x: np.ndarray,
    successes: np.ndarray,
    counts: np.ndarray,
    *,
    guess: float = 0.0,
    lapse_max: float = 0.06,
    ties_lapse_to_guess: bool = False,
    with_intervals: bool = True,
) -> PsychometricFit:
    """Fit a cumulative Gaussian to proportions successes / counts at levels x, all of shape [level].

    p = guess + (1 - guess - lapse) Phi((x - mu) / sigma), for yes or no and for m intervals (guess 1 / m); with
    `ties_lapse_to_guess`, for comparisons such as "which was larger", p = lapse + (1 - 2 lapse) Phi. Proportions may
    fall with x as well: Phi is then that of (mu - x) / sigma. lapse lies in 0..lapse_max. Without intervals a fit is
    several times faster.
    """
    most = min(0.5, 1.0 - guess)
    if not 0.0 <= guess < 1.0:
        raise StudyError(f"guess must lie in 0..1, below 1, not {guess}")
    if ties_lapse_to_guess and guess:
        raise StudyError(f"guess must be 0 where the lapse rate stands for it, not {guess}")
    if not 0.0 <= lapse_max < most:
        raise StudyError(f"lapse_max must lie in 0..{most:g}, below {most:g}, not {lapse_max}")
    x, successes, counts = _join_levels(x, successes, counts)
    low_end = None if ties_lapse_to_guess else float(guess)
    data = ", ".join(f"{own:g} of {of:g} at {at:g}" for at, own, of in zip(x, successes, counts, strict=True))

    def without_curve(reason: str) -> PsychometricFit:
        return PsychometricFit(guess=low_end, converged=False, note=f"{reason} ({data})." if data else f"{reason}.")

    if not len(x):
        return without_curve("There are no answers")
    if successes.sum() in (0.0, counts.sum()):
        return without_curve("All answers are of one kind, so there is no threshold")
    if len(x) == 1:
        return without_curve("A curve needs 2 levels, and there is one")
    rising = _Levels.scale(x, successes, counts, guess=low_end, lapse_max=float(lapse_max))
    profile = max(_Profile(rising), _Profile(rising.turn()), key=lambda own: own.best_log)
    if profile.best_log - rising.flat_log() < SAME:
        return without_curve("No curve describes the data better than a flat line")
    if abs(profile.best("mu") - 0.5) > FARTHEST + 0.5:
        reason = f"The best threshold lies more than {FARTHEST:g} times the range of the levels beside them"
        return without_curve(reason)
    return _describe_curve(profile, x, data, with_intervals=with_intervals)


def _describe_curve(profile: "_Profile", x: np.ndarray, data: str, *, with_intervals: bool) -> PsychometricFit:
    """The best curve on the scale of x, with its intervals, its deviance, and what cannot be said."""
    from scipy import stats

    levels = profile.levels
    ends = profile.bound_values() if with_intervals else dict.fromkeys(AXES, (None, None))
    step = profile.find_step()
    lowest, highest = ends["mu"]
    centre = profile.best("mu")
    if step is not None:
        # The best of several equally good curves may be one with a slope, whose interval need not reach to the step.
        centre = step
        lowest = None if lowest is None else min(lowest, step)
        highest = None if highest is None else max(highest, step)
    places = [None if own is None else levels.start + levels.reach * own for own in (centre, lowest, highest)]
    if levels.reach < 0.0:
        places = [places[0], places[2], places[1]]
    mu = FittedValue(value=places[0], low=places[1], high=places[2])
    width = abs(levels.reach)
    flattest, steepest = ends["b"]
    sigma = FittedValue(
        value=width / profile.best("b") if step is None else 0.0,
        low=(width / steepest if steepest else 0.0) if with_intervals else None,
        high=width / flattest if flattest else None,
    )
    lapse = FittedValue(value=profile.best("lapse"))
    if with_intervals:
        low, high = (
            bound if own is None else own for own, bound in zip(ends["lapse"], (0.0, levels.lapse_max), strict=True)
        )
        lapse = FittedValue(value=profile.best("lapse"), low=low, high=high)
    freedom = max(0, len(x) - 2 - (SAME < profile.best("lapse") < levels.lapse_max - SAME))
    deviance = max(0.0, 2.0 * (levels.saturated_log() - profile.best_log))
    reasons = list(_find_reasons(x, mu, sigma, freedom, with_intervals=with_intervals))
    return PsychometricFit(
        mu=mu,
        sigma=sigma,
        lapse=lapse,
        guess=levels.guess,
        is_increasing=levels.reach > 0.0,
        deviance=deviance,
        freedom=freedom,
        goodness_p=float(stats.chi2.sf(deviance, freedom)) if freedom else None,
        converged=step is None,
        note=f"{'. '.join(reasons)} ({data})." if reasons else "",
    )


def _find_reasons(
    x: np.ndarray, mu: FittedValue, sigma: FittedValue, freedom: int, *, with_intervals: bool
) -> Iterator[str]:
    """Why a curve lacks a value or a bound, or where it should not be trusted."""
    if sigma.value == 0.0:
        yield (
            "A step, at a level or between two, describes the answers as well as any curve, so sigma is given as 0 and "
            "the threshold as the place of the step"
        )
    elif sigma.low == 0.0:
        yield "Sigma has no lower bound: a step is not refused either"
    if mu.value is not None and not x[0] <= mu.value <= x[-1]:
        yield f"The threshold {mu.value:g} lies outside the levels, where nothing was asked"
    if with_intervals and sigma.high is None:
        yield "Sigma has no upper bound: a flat line is not refused either"
    missing = [name for name, end in (("lower", mu.low), ("upper", mu.high)) if end is None]
    if with_intervals and missing:
        yield (
            f"The threshold has no {' and no '.join(missing)} bound within {FARTHEST:g} times the range of the levels "
            "beside them"
        )
    if not freedom:
        yield "There is no goodness of fit, since there are no more levels than fitted values"


def _join_levels(x: np.ndarray, successes: np.ndarray, counts: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rising levels that have answers, each once; float64."""
    x, successes, counts = (np.asarray(own, dtype=float) for own in (x, successes, counts))
    if x.ndim != 1 or not x.shape == successes.shape == counts.shape:
        shapes = ", ".join(str(own.shape) for own in (x, successes, counts))
        raise StudyError(f"x, successes and counts must have one value for each level, not shapes {shapes}")
    for at, own, count in zip(x.tolist(), successes.tolist(), counts.tolist(), strict=True):
        if not np.isfinite(at):
            raise StudyError(f"x must be finite, not {at}")
        if not 0.0 <= own <= count or own % 1.0 or count % 1.0 or count == np.inf:
            raise StudyError(f"successes must be whole numbers in 0..count, not {own:g} of {count:g} at x = {at:g}")
    asked = counts > 0.0
    joined = join_ties(x[asked], ALIKE * np.abs(x[asked]).max(initial=0.0))
    levels, places = np.unique(joined, return_inverse=True)
    size = len(levels)
    return levels, np.bincount(places, successes[asked], size), np.bincount(places, counts[asked], size)


@dataclass(frozen=True, kw_only=True)
class _Levels:
    """Answers of levels whose x are scaled to 0..1, and the likelihood of a curve through them."""

    start: float
    reach: float
    """x = start + reach * scaled; reach is negative where proportions fall with x."""
    scaled: np.ndarray
    """float64, shape [level], rising from 0 to 1."""
    successes: np.ndarray
    failures: np.ndarray
    guess: float | None
    lapse_max: float
    steepest: float = field(init=False)
    """Largest b."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "steepest", STEEPEST / float(np.diff(self.scaled).min()))

    @property
    def middles(self) -> np.ndarray:
        """Midway between each two levels."""
        return (self.scaled[1:] + self.scaled[:-1]) / 2.0

    @classmethod
    def scale(
        cls, x: np.ndarray, successes: np.ndarray, counts: np.ndarray, *, guess: float | None, lapse_max: float
    ) -> "_Levels":
        start, reach = float(x[0]), float(x[-1] - x[0])
        return cls(
            start=start,
            reach=reach,
            scaled=(x - start) / reach,
            successes=successes,
            failures=counts - successes,
            guess=guess,
            lapse_max=lapse_max,
        )

    def turn(self) -> "_Levels":
        """The same answers with x from its other end."""
        return _Levels(
            start=self.start + self.reach,
            reach=-self.reach,
            scaled=1.0 - self.scaled[::-1],
            successes=self.successes[::-1],
            failures=self.failures[::-1],
            guess=self.guess,
            lapse_max=self.lapse_max,
        )

    def log(self, points: np.ndarray) -> np.ndarray:
        """Log likelihood, without binomial coefficients, of (a, b, lapse): shape [..., 3] to [...]."""
        return self._sum_logs(*self._shares(points)[1:])

    def score(self, point: np.ndarray) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
        """Log likelihood at one (a, b, lapse), its derivatives, and the expected and the observed information.

        The information, shape [3, 3], is the negative matrix of second derivatives.
        """
        z, p, q = self._shares(point)
        low = point[2] if self.guess is None else self.guess
        width = 1.0 - point[2] - low
        density = np.exp(-z * z / 2.0) / np.sqrt(2.0 * np.pi)
        by_a = width * density
        share = (p - low) / width
        slopes = np.stack([by_a, by_a * self.scaled, 1.0 - 2.0 * share if self.guess is None else -share])
        by_p = self.successes / p - self.failures / q
        expected = np.einsum("il,jl,l->ij", slopes, slopes, (self.successes + self.failures) / (p * q))
        observed = np.einsum("il,jl,l->ij", slopes, slopes, self.successes / p**2 + self.failures / q**2)
        # Second derivatives of p by a, b and lapse; that by lapse twice is 0.
        powers = np.stack([np.ones_like(z), self.scaled, self.scaled**2])
        aa, ab, bb = (powers * (by_p * -z * by_a)).sum(axis=1)
        al, bl = (powers[:2] * (by_p * density)).sum(axis=1) * (-2.0 if self.guess is None else -1.0)
        observed -= np.array([[aa, ab, al], [ab, bb, bl], [al, bl, 0.0]])
        return float(self._sum_logs(p, q)), (slopes * by_p).sum(axis=1), expected, observed

    def flat_log(self) -> float:
        """Log likelihood of the best flat line; where there is a guess rate, it is not below that."""
        p = max(self.successes.sum() / (self.successes + self.failures).sum(), self.guess or 0.0)
        return float(self._sum_logs(np.asarray(p), np.asarray(1.0 - p)))

    def saturated_log(self) -> float:
        """Log likelihood of a proportion of its own for each level."""
        counts = self.successes + self.failures
        return float(self._sum_logs(self.successes / counts, self.failures / counts))

    def _shares(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """z, p and 1 - p of each level; each of the two from its own tail, so that neither rounds to 0."""
        from scipy import special

        a, b, lapse = (points[..., place, np.newaxis] for place in range(3))
        low = lapse if self.guess is None else self.guess
        z = np.clip(a + b * self.scaled, -Z_MOST, Z_MOST)
        width = 1.0 - lapse - low
        return z, low + width * special.ndtr(z), lapse + width * special.ndtr(-z)

    def _sum_logs(self, p: np.ndarray, q: np.ndarray) -> np.ndarray:
        from scipy import special

        return (special.xlogy(self.successes, p) + special.xlogy(self.failures, q)).sum(axis=-1)


class _Profile:
    """The likelihood maximised over all values, or with one of them fixed; it remembers the best point of all."""

    def __init__(self, levels: _Levels) -> None:
        self.levels = levels
        self.best_log = -np.inf
        self._best = np.zeros(3)
        self._last: dict[str, np.ndarray] = {}
        self._axes = {
            # A step at a level is seen only from close by: all starts farther away than some sigma are equally bad.
            "mu": np.unique(np.concatenate([np.linspace(-1.0, 2.0, 31), levels.scaled, levels.middles])),
            "b": np.geomspace(0.3, levels.steepest, 16),
            "lapse": np.unique([0.0, levels.lapse_max / 2.0, levels.lapse_max]),
        }
        from scipy import ndimage

        for lapse in self._axes["lapse"]:
            starts = self._grid(lapse=np.array([lapse]))
            logs = levels.log(starts).reshape(len(self._axes["mu"]), -1)
            # Proportions that rise and fall again have several local maxima, and the grid's best start may lead to a
            # lower one.
            peaks = np.flatnonzero(logs >= ndimage.maximum_filter(logs, size=3, mode="nearest"))
            for start in peaks[np.argsort(-logs.ravel()[peaks], kind="stable")[:PEAKS_MOST]]:
                self._climb(np.zeros(3), np.eye(3), [0, 1, 2], starts[start])

    def best(self, axis: str) -> float:
        """The value of mu, b or lapse at the best point."""
        a, b, lapse = self._best.tolist()
        return {"mu": -a / b if b else np.inf, "b": b, "lapse": lapse}[axis]

    def log_at(self, axis: str, value: float) -> float:
        """The largest log likelihood with a fixed mu, b or lapse."""
        free = [place for place, name in enumerate(AXES) if name != axis]
        offset, directions = np.zeros(3), np.eye(3)[:, free]
        if axis == "mu":
            directions[0, 0] = -value  # a = -b mu follows b
        else:
            offset[AXES.index(axis)] = value
        starts = self._grid(**{axis: np.array([value])})
        if axis in self._last:
            starts = np.concatenate([starts, [offset + directions @ self._last[axis][free]]])
        point, log = self._climb(offset, directions, free, starts[np.argmax(self.levels.log(starts))])
        self._last[axis] = point
        return log

    def bound_values(self) -> dict[str, tuple[float | None, float | None]]:
        """The ends of the intervals of mu, b and lapse; None: the interval reaches to the end of what is looked at."""
        outer = {
            "mu": (-FARTHEST, 1.0 + FARTHEST),
            "b": (0.0, self.levels.steepest),
            "lapse": (0.0, self.levels.lapse_max),
        }
        while True:
            before = self.best_log
            ends = {axis: (self._find_end(axis, own[0]), self._find_end(axis, own[1])) for axis, own in outer.items()}
            if self.best_log <= before + SAME:  # else a profile found a better point than the grid of all values did
                return ends

    def find_step(self) -> float | None:
        """The mu of a step, where a step describes the answers as well as any curve; None: it does not."""
        levels = self.levels
        if self.best_log - self.log_at("b", levels.steepest) >= SAME:
            return None
        a, b, lapse = self._last["b"].tolist()
        # Between two levels all places are equally good, so that the middle stands for them; at a level, the place
        # is where the step passes through the level's proportion.
        found = levels.log(np.array([[-b * own, b, lapse] for own in levels.middles]))
        equal = levels.middles[found > self.best_log - SAME]
        return float(equal.mean()) if len(equal) else -a / b

    def _find_end(self, axis: str, outer: float) -> float | None:
        """The value between the best one and an outer one from which on the data refuse it; None: not even there."""
        from scipy import optimize

        inner, best_log = self.best(axis), self.best_log

        # The root's search begins with values that were computed before, and must find them as they were, though a
        # second climb may come higher.
        @cache
        def excess(share: float) -> float:
            return 2.0 * (best_log - self.log_at(axis, inner + share * (outer - inner))) - CHI_SQUARE_95

        if outer == inner or excess(1.0) <= 0.0:
            return None
        high = 1.0
        while high > SAME and excess(high / 4.0) > 0.0:  # the outer value may be thousands of times farther
            high /= 4.0
        if high <= SAME:
            return inner  # the likelihood falls off as at a cliff
        share = optimize.brentq(excess, high / 4.0, high, xtol=1e-5 * high, rtol=1e-6)
        return inner + float(share) * (outer - inner)  # pyright: ignore[reportArgumentType] - a float without full_output

    def _climb(
        self, offset: np.ndarray, directions: np.ndarray, free: list[int], start: np.ndarray
    ) -> tuple[np.ndarray, float]:
        """The local maximum over offset + directions * free values, which are those of a, b and lapse at `free`."""
        lows = np.array([-np.inf, 0.0, 0.0])[free]
        highs = np.array([np.inf, self.levels.steepest, self.levels.lapse_max])[free]
        values = start[free]
        log, *derivatives = self.levels.score(start)
        damping = 0.0
        for _ in range(CLIMB_MOST):
            uphill = directions.T @ derivatives[0]
            expected, observed = (directions.T @ own @ directions for own in derivatives[1:])
            # A value at its bound stays there as long as the likelihood rises outwards.
            moving = ~(((values <= lows) & (uphill <= 0.0)) | ((values >= highs) & (uphill >= 0.0)))
            moving &= expected.diagonal() > 0.0
            if not moving.any():
                break
            # Newton's steps are the best ones near a maximum. Farther away the observed information may be that of a
            # saddle; the expected one (Fisher scoring) never is, so that small steps by it always lead uphill.
            inner = observed[np.ix_(moving, moving)]
            if np.linalg.eigvalsh(inner)[0] <= SINGULAR * np.trace(inner):
                inner = expected[np.ix_(moving, moving)]
            step = np.zeros(len(free))
            step[moving] = np.linalg.solve(inner + (damping + SINGULAR) * np.diag(inner.diagonal()), uphill[moving])
            trial = np.clip(values + step, lows, highs)
            trial_log, *trial_derivatives = self.levels.score(offset + directions @ trial)
            if trial_log > log:
                gain, log, values, derivatives = trial_log - log, trial_log, trial, trial_derivatives
                damping = damping / 10.0 if damping > DAMPING_LEAST else 0.0
                if gain < GAIN_LEAST:
                    break
            elif float(uphill @ step) < GAIN_LEAST or damping > DAMPING_MOST:
                break
            else:
                damping = max(10.0 * damping, DAMPING_LEAST)
        point = offset + directions @ values
        if log > self.best_log:
            self._best, self.best_log = point, log
        return point, log

    def _grid(self, **fixed: np.ndarray) -> np.ndarray:
        """Points (a, b, lapse) to start from, shape [point, 3]."""
        axes = self._axes | fixed
        mu, b, lapse = (own.ravel() for own in np.meshgrid(*(axes[name] for name in AXES), indexing="ij"))
        return np.stack([-b * mu, b, lapse], axis=1)
