"""Simulated people of signal-detection theory: what they feel is noisy, and the stronger of two feelings wins.

Noise is drawn, and nothing here has the formula of a psychometric function: an analysis that recovers what is planted
shares no code with what planted it. Nothing of palpate is imported.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

INTERVALS = {"first": 0, "second": 1, "third": 2, "fourth": 3, "1": 0, "2": 1, "3": 2, "4": 3}
"""Labels of keys that mean an interval."""
OPAQUE = 1.0
OTHER_RATIO = (1.5, 0.2)
"""Mean of r, and standard deviation of log(r - 1), of objects that a table lacks."""
BLOCK_SIZE = 256  # random numbers that are drawn at once
FELT_DIFFERENCE = 1.0  # of two feelings, from which on people describe one


@dataclass(frozen=True, kw_only=True)
class Observer:
    """A person with known parameters, each of which is planted."""

    seed: int
    strengths: Mapping[str, float]
    """Of each stimulus, by its name: how strongly it is felt before noise, whose standard deviation is 1."""
    sensitivity: float = 1.0
    """Factor on all strengths."""
    sign: int = 1
    """1: what is felt more strongly is called denser; -1: less dense; 0: no difference is felt, whatever is seen."""
    opacity_effect: float = 0.0
    """Share of a strength that an opaque object adds for everyone, and a transparent one takes away, halves each."""
    interval_bias: float = 0.0
    """Added to the feeling of the first interval."""
    habit: str = ""
    """Key that is pressed in every choice between intervals, whatever was felt; empty: none."""
    lapse: float = 0.02
    """Share of choices that are random keys."""
    criterion: float = 1.0
    """Of a single interval: a feeling above it is a "yes"."""
    exponent: float = 0.7
    """Of numbers that are given to strengths."""
    number_noise: float = 0.15
    """Standard deviation of the logarithm of such numbers."""
    rating_noise: float = 0.7
    """Standard deviation of ratings, in points."""
    reaction_median: float = 1.2
    """[s]"""
    reaction_spread: float = 0.35
    """Standard deviation of the logarithm of reaction times."""
    age: int = 27

    @property
    def planted(self) -> dict[str, Any]:
        """All parameters by their names."""
        return asdict(self)

    def __repr__(self) -> str:
        """One line."""
        return f"Observer(seed {self.seed}, sign {self.sign}, sensitivity {self.sensitivity:.2f}, habit {self.habit!r})"


class Mind:
    """An observer while they take part: what they have felt since the trial began, and in the block.

    The same calls in the same order draw the same noise, whoever makes them.
    """

    def __init__(self, observer: Observer, seed: int = 0) -> None:
        self.observer = observer
        self._normal = _draws(lambda rng: rng.standard_normal(BLOCK_SIZE), seed, observer.seed, 0)
        self._uniform = _draws(lambda rng: rng.random(BLOCK_SIZE), seed, observer.seed, 1)
        self._reading = _draws(lambda rng: rng.standard_normal(BLOCK_SIZE), seed, observer.seed, 2)
        self._felt: list[tuple[str, float]] = []  # stimulus and noise
        self._evidence: list[float] = []  # differences of feelings since the block began
        self._opacity = OPAQUE
        self._anchor: float | None = None  # number that the first stimulus is called
        self._has_answered = self._has_rated = False

    def begin_trial(self) -> None:
        """Forget what was felt: the next interval is the first one."""
        self._felt.clear()

    def see(self, opacity: float, text: str) -> None:
        """Look at the screen of an interval; `text` may name the number of the first stimulus."""
        self._opacity = opacity
        if text.startswith("The first one is called "):
            self._anchor = float(text.removeprefix("The first one is called ").rstrip("."))

    def feel(self, stimulus: str) -> None:
        """An interval is played."""
        if self._has_answered:
            self._felt.clear()
            self._has_answered = False
        if self._has_rated:
            self._evidence.clear()
            self._has_rated = False
        self._felt.append((stimulus, self._normal()))

    def choose(self, keys: Sequence[tuple[str, str]]) -> int:
        """Number of the key to press, of pairs of a key and its label."""
        own, felt = self.observer, self._felt
        labels = [label.casefold() for _, label in keys]
        self._has_answered = True
        if "i agree" in labels:
            return labels.index("i agree")
        means = [INTERVALS.get(label) for label in labels]
        if felt and None not in means:
            values = [self._value(*one) for one in felt]
            values[0] += own.interval_bias
            self._evidence.append(abs(values[0] - values[-1]))
            chosen = means.index(values.index(max(values)))
        elif felt and sorted(labels) == ["no", "yes"]:
            value = self._value(*felt[-1])
            self._evidence.append(abs(value - own.criterion))
            chosen = labels.index("yes" if value > own.criterion else "no")
        else:  # about themselves
            return int(self._uniform() * len(keys))
        if self._uniform() < own.lapse:
            chosen = int(self._uniform() * len(keys))
        habits = [number for number, (key, _) in enumerate(keys) if key == own.habit]
        return habits[0] if habits else chosen

    def rate(self, text: str, points: int) -> int:
        """A point of a scale, from 1: of confidence or difficulty by the evidence in the block, else of a feeling."""
        self._has_answered = True
        sure = 1 - math.exp(-sum(self._evidence) / len(self._evidence) / 2) if self._evidence else 0.5
        if "confident" in text or "sure" in text:
            level, self._has_rated = sure, True
        elif "difficult" in text:
            level, self._has_rated = 1 - sure, True
        else:
            level = 0.5 + (self._value(*self._felt[-1]) / 6 if self._felt else 0.0)
        point = round(1 + (points - 1) * level + self.observer.rating_noise * self._normal())
        return min(max(point, 1), points)

    def number(self, text: str, low: float | None, high: float | None) -> float:
        """A number, of three digits at most: an age, or a power of a strength, in units of the first stimulus' number.

        low, high: bounds of what is taken.
        """
        own = self.observer
        self._has_answered = True
        if not self._felt:
            value = own.age if "old are you" in text or "age?" in text else low or 0.0
        else:
            strengths = [own.sensitivity * max(own.strengths[name], 1e-6) for name, _ in self._felt]
            unit = 1.0 if self._anchor is None else strengths[0]
            value = (10.0 if self._anchor is None else self._anchor) * (strengths[-1] / unit) ** own.exponent
            value = float(f"{value * math.exp(own.number_noise * self._normal()):.3g}")
        return min(max(value, -math.inf if low is None else low), math.inf if high is None else high)

    def write(self, text: str) -> str:
        """A sentence: which of two intervals was felt how, or what all of them were like."""
        self._has_answered = True
        if len(self._felt) < 2:
            return {
                1: "The ones with more in them felt filled.",
                -1: "The ones with less in them felt filled.",
                0: "I could hardly feel any difference.",
            }[self.observer.sign]
        first, second = (self._value(*one) for one in (self._felt[0], self._felt[-1]))
        if abs(second - first) < FELT_DIFFERENCE:
            return "No, both were the same to me."
        which = "second" if second > first else "first"
        if "coherence" in text:
            return f"Yes, the {which} one fitted better to what I saw."
        return f"Yes, the {which} one was denser and more filled, the other one like an empty outline."

    def seconds(self) -> float:
        """Time to an answer [s]."""
        return self._time(self._normal())

    def reading_seconds(self) -> float:
        """Time to the key below a text [s]; its noise is drawn apart from that of answers."""
        return self._time(self._reading())

    def _time(self, noise: float) -> float:
        return self.observer.reaction_median * math.exp(self.observer.reaction_spread * noise)

    def _value(self, stimulus: str, noise: float) -> float:
        own = self.observer
        if own.sign == 0:
            return noise
        seen = 0.5 if self._opacity >= OPAQUE else -0.5
        return own.sensitivity * own.strengths[stimulus] * (own.sign + own.opacity_effect * seen) + noise


def _draws(draw: Callable[[np.random.Generator], np.ndarray], *seed: int) -> Callable[[], float]:
    """One random number after the other, drawn many at once, which is faster."""
    rng = np.random.default_rng(seed)
    ready: list[float] = []

    def one() -> float:
        if not ready:
            ready.extend(draw(rng).tolist()[::-1])
        return ready.pop()

    return one


class DrawnRatios:
    """Ratios r of one participant's intervals: by object and opacity, with log-normal scatter of r - 1.

    table: mean of r, and standard deviation of log(r - 1), by object and opacity.
    """

    def __init__(self, table: Mapping[tuple[str, float], tuple[float, float]], observer: Observer, seed: int) -> None:
        self._table = table
        self._normal = _draws(lambda rng: rng.standard_normal(BLOCK_SIZE), seed, observer.seed, 3)

    def of(self, solid: str, opacity: float) -> float:
        """The next interval's."""
        mean, scatter = self._table.get((solid, opacity), OTHER_RATIO)
        return 1 + (mean - 1) * math.exp(scatter * self._normal() - scatter**2 / 2)


PAPER_STRENGTHS = {
    "cube-cc": 1.6, "tube-cc": 0.6, "dog-cc": 0.8, "cube-oc": 0.0, "tube-oc": 0.0, "dog-oc": 0.0,
}  # fmt: skip
"""Of the stimuli of the paper's study."""
PAPER_RATIOS = {
    (solid, opacity): value
    for solid, value in {"cube": (2.2, 0.2), "tube": (1.4, 0.2), "dog": (1.6, 0.2)}.items()
    for opacity in (1.0, 0.7)
}


def paper_observers(
    count: int = 18, *, opposite: int | None = None, indifferent: int | None = None, seed: int = 1, **fields: Any
) -> list[Observer]:
    """People as the paper found them: most call closed contours denser, some open ones, some feel no difference.

    opposite, indifferent: how many of the latter two, by default a sixth each. Sensitivities scatter by 20 %. fields:
    of all observers, instead of the usual ones.
    """
    rng = np.random.default_rng([seed, count])
    opposite = count // 6 if opposite is None else opposite
    indifferent = count // 6 if indifferent is None else indifferent
    signs = rng.permutation([-1] * opposite + [0] * indifferent + [1] * (count - opposite - indifferent))
    usual = Observer(**{"seed": 0, "strengths": PAPER_STRENGTHS, "opacity_effect": 0.8, **fields})
    return [
        replace(
            usual,
            seed=1000 * seed + number,
            sign=int(sign),
            sensitivity=usual.sensitivity * float(np.exp(rng.normal(0.0, 0.2))),
            age=int(rng.integers(20, 38)),
        )
        for number, sign in enumerate(signs)
    ]


def null_observers(count: int = 18, *, seed: int = 1, **fields: Any) -> list[Observer]:
    """People to whom all stimuli feel the same, at every opacity."""
    return paper_observers(count, opposite=0, indifferent=count, seed=seed, **fields)
