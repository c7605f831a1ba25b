"""Power before a study: how often its own analysis would find an effect, by simulated measures of a plan's cells.

The model is as simple as what people can guess: the mean of the measure, and how much participants differ, on a logit
scale for probabilities, in points on scales. It says nothing of lapses, orders and tired people; simulated observers,
who are made otherwise, judge it in docs/measured/simulated-study.md.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from statistics import NormalDist
from typing import Any

import numpy as np

from ...errors import StrategyError
from ..plan.block_designs import trial_counts
from ..plan.study_plan import StudyPlan
from .answer_measures import Measure, choice_measures, level_label, scale_measures
from .answer_reading import StudyTable
from .hypothesis_tests import SIGNIFICANT, bound_proportion, compare_with_centre_by_ranks
from .measure_tests import compare_pairs

PARTICIPANTS = (*range(6, 61), *range(65, 201, 5))
"""Numbers of participants among which the least one that has the power is searched."""
WANTED = 0.8
"""Power that studies commonly aim at."""
SPREAD = 1.0
"""Between participants, where nobody says: of a logit, which makes probabilities differ by about 0.2, or points."""
NOISE = 1.0  # [point] of one answer on a scale
PEOPLE = 1000  # of a normal distribution, whose mean probability is that of all people
LOGIT_MOST = 40.0  # a probability of 4e-18, for each unit of the spread
DEVIATIONS_MOST = 8.0  # from a scale's end to a centre that is as good as at it
HALVINGS = 50


@dataclass(frozen=True, kw_only=True)
class PowerQuestion:
    """What effect there is, and what is asked of the analysis."""

    measure: Measure
    """Of the plan, without participants."""
    trials: tuple[int, ...]
    """Answers in each cell."""
    planned: int
    """Participants of the plan."""
    mean: float
    """Of the measure over participants: probability, or points; of those who don't answer the other way."""
    mean_other: float | None = None
    """At the last level of `factor`; None: `mean` is compared with chance."""
    factor: str | None = None
    spread: float = 0.0
    """Standard deviation between participants: of a probability's logit, or of points."""
    opposite: float = 0.0
    """Share of participants who answer the other way: with probability 1 - p."""
    noise: float = NOISE
    """Standard deviation of one answer on a scale [point]."""
    tables: int = 1000
    """Simulated studies for each number of participants."""
    seed: int = 1

    @property
    def is_choice(self) -> bool:
        """Whether the measure is a proportion."""
        return self.measure.chance is not None

    @cached_property
    def centres(self) -> tuple[float, ...]:
        """Around which participants lie, so that the means are `mean` and `mean_other`: logits, or points.

        They differ from the means, as logits are bent into probabilities, and points are rounded and end at the ends
        of the scale.
        """
        means = [own for own in (self.mean, self.mean_other) if own is not None]
        if self.is_choice:
            if not self.spread:
                with np.errstate(divide="ignore"):  # a mean of 0 or 1 is a logit without end
                    return tuple(float(np.log(own) - np.log1p(-own)) for own in means)
            people = self.spread * np.array([NormalDist().inv_cdf((k + 0.5) / PEOPLE) for k in range(PEOPLE)])
            reach = LOGIT_MOST + LOGIT_MOST * self.spread
            return tuple(_inverse(lambda x: float(_proportion(x + people).mean()), own, -reach, reach) for own in means)
        deviation = math.hypot(self.spread, self.noise)
        if not deviation:
            return tuple(means)
        low, high = self.measure.low or 1.0, self.measure.high or 1.0
        bounds, of = np.arange(low, high) + 0.5, NormalDist(0.0, deviation)
        reach = DEVIATIONS_MOST * deviation
        return tuple(
            _inverse(lambda x: low + sum(of.cdf(x - own) for own in bounds), own, low - reach, high + reach)
            for own in means
        )

    @property
    def sought(self) -> str:
        """What the analysis is to find."""
        if self.factor is None:
            return f"{self.measure.name} differs from chance"
        first, last = (level_label(self.factor, self.measure.factors[self.factor][place]) for place in (0, -1))
        return f"{self.measure.name} differs between {first} and {last}"

    @property
    def assumed(self) -> dict[str, str]:
        """What the power rests on, in words for people."""
        mean = f"{self.mean:g}"
        if self.factor is not None and self.mean_other is not None:
            mean += f", and {self.mean_other:g} at {level_label(self.factor, self.measure.factors[self.factor][-1])}"
        spread = f"{self.spread:g} point between participants, {self.noise:g} of one answer (standard deviations)"
        if self.is_choice:
            people = self.centres[0] + self.spread * np.array(
                [NormalDist().inv_cdf((k + 0.5) / 100) for k in range(100)]
            )
            spread = (
                f"{self.spread:g} of the logit: participants' probabilities deviate by {_proportion(people).std():.2f}"
            )
        low, high = min(self.trials), max(self.trials)
        is_family = self.factor is not None and len(self.measure.factors[self.factor]) > 2  # of more than one pair
        return {
            "mean": mean,
            "spread": spread,
            **({"opposite": f"{self.opposite:g} of participants answer the other way"} if self.is_choice else {}),
            "answers": f"{low if low == high else f'{low} to {high}'} in each of {len(self.trials)} cells",
            "test": "Wilcoxon, two-sided, 0.05" + ", Holm-corrected" * is_family,
            "simulated": f"{self.tables} studies for each number of participants, seed {self.seed}",
        }


@dataclass(frozen=True, kw_only=True)
class FoundPower:
    """The power with one number of participants."""

    participants: int
    power: float
    low: float
    high: float
    """95 % interval of the power, as a finite number of studies was simulated."""


def power_question(plan: StudyPlan, options: dict[str, Any]) -> PowerQuestion:
    """The question that options ask about a plan; raises StrategyError for one that has no answer."""
    empty = StudyTable(plan=plan, codes=(), answers=())
    known = {own.name: own for own in (*choice_measures(empty), *scale_measures(empty))}
    if not known:
        raise StrategyError("--power needs a plan with blocks of the design 2ifc, or with questions of the kind scale")
    name = options["measure"] or next(iter(known))
    if name not in known:
        raise StrategyError(f"--measure must be one of {', '.join(known)}, not {name!r}")
    measure = known[name]
    low, high = (0.0, 1.0) if measure.chance is not None else (measure.low or 1.0, measure.high or 1.0)
    mean, other, factor = options["mean"], options["mean_other"], options["factor"]
    if mean is None:
        raise StrategyError(f"--power needs --mean, the {measure.title} that you expect, {low:g} to {high:g}")
    for key, value in (("mean", mean), ("mean-other", other)):
        if value is not None and not low <= value <= high:
            raise StrategyError(f"--{key} must be {low:g} to {high:g}, not {value:g}")
    if mean == (measure.chance if other is None else other):
        raise StrategyError(f"--mean must differ from {mean:g}, with which it is compared: else there is no effect")
    if other is not None and factor is None:
        factor = next(iter(measure.factors), None)
    if factor is not None and factor not in measure.factors:
        raise StrategyError(f"--factor must be one of {', '.join(measure.factors) or 'none'}, not {factor!r}")
    if factor is not None and other is None:
        raise StrategyError(f"--factor {factor} needs --mean-other: the {measure.title} at its last level")
    if other is not None and factor is None:
        raise StrategyError(f"--mean-other needs a factor with two levels, and {name} has none in this plan")
    if factor is None and measure.chance is None:
        raise StrategyError(f"{name} has no chance level: --mean-other and --factor say what differs")
    for key, most in (("spread", 10.0), ("opposite", 1.0), ("noise", 10.0)):
        if options[key] is not None and not 0.0 <= options[key] <= most:
            raise StrategyError(f"--{key} must be 0 to {most:g}, not {options[key]:g}")
    if options["opposite"] and measure.chance is None:
        raise StrategyError(f"--opposite is of proportions, and {name} is a scale")
    if (options["opposite"] or 0.0) >= 0.5:
        raise StrategyError(
            f"--opposite must be below 0.5, not {options['opposite']:g}: else no effect is left in the direction sought"
        )
    if options["noise"] is not None and measure.chance is not None:
        raise StrategyError(f"--noise is of scales, and {name} is a proportion")
    if options["seed"] < 0:
        raise StrategyError(f"--seed must be 0 or more, not {options['seed']}")
    if not 100 <= options["tables"] <= 100_000:
        raise StrategyError(f"--tables must be 100 to 100000, not {options['tables']}")
    given = {key: options[key] for key in ("spread", "opposite", "noise") if options[key] is not None}
    given.setdefault("spread", SPREAD)
    return PowerQuestion(
        measure=measure, trials=_trials(plan, measure), planned=len(plan.codes), mean=mean, mean_other=other,
        factor=factor, tables=options["tables"], seed=options["seed"], **given,
    )  # fmt: skip


def find_power(question: PowerQuestion) -> list[FoundPower]:
    """The power of the plan's number of participants, and of those numbers by which the least with WANTED was found.

    Power rises with participants, so that halving the list finds it: the last number that was tried has the power,
    unless not even the largest has.
    """
    numbers = sorted({*PARTICIPANTS, question.planned})
    found = {question.planned: power_of(question, question.planned)}
    low, high = 0, len(numbers) - 1
    while low < high:
        middle = (low + high) // 2
        count = numbers[middle]
        if count not in found:
            found[count] = power_of(question, count)
        low, high = (low, middle) if found[count].power >= WANTED else (middle + 1, high)
    if numbers[low] not in found:
        found[numbers[low]] = power_of(question, numbers[low])
    return [found[count] for count in sorted(found)]


def power_of(question: PowerQuestion, participants: int) -> FoundPower:
    """How often the analysis finds the effect in simulated studies with so many participants."""
    rng = np.random.default_rng([question.seed, participants])
    hits = sum(_finds(question, simulate_measure(question, participants, rng)) for _ in range(question.tables))
    low, high = bound_proportion(hits, question.tables)
    return FoundPower(participants=participants, power=hits / question.tables, low=low, high=high)


def simulate_measure(question: PowerQuestion, participants: int, rng: np.random.Generator) -> Measure:
    """The measure of one simulated study."""
    measure, trials = question.measure, np.array(question.trials)
    centres = np.full(len(measure.cells), question.centres[0])
    if question.factor is not None and question.mean_other is not None:
        last = measure.factors[question.factor][-1]
        centres[measure.numbers_at(question.factor, last)] = question.centres[1]
    person = rng.normal(0.0, question.spread, (participants, 1)) if question.spread else np.zeros((participants, 1))
    codes = tuple(map(str, range(participants)))
    if not question.is_choice:
        points = np.zeros((participants, len(centres)))
        for number, count in enumerate(trials):
            answers = centres[number] + person + rng.normal(0.0, question.noise, (participants, count))
            points[:, number] = np.clip(np.round(answers), measure.low, measure.high).mean(axis=1)
        return replace(measure, codes=codes, values=points)
    signs = np.where(rng.random((participants, 1)) < question.opposite, -1.0, 1.0)
    successes = rng.binomial(trials, _proportion(signs * (centres + person)))
    counts = np.broadcast_to(trials, successes.shape)
    return replace(measure, codes=codes, values=successes / counts, successes=successes, counts=counts)


def _proportion(logits: np.ndarray) -> np.ndarray:
    return 1.0 / (1.0 + np.exp(-logits))


def _inverse(function: Callable[[float], float], wanted: float, low: float, high: float) -> float:
    """Where a rising function has a value, by halving."""
    for _ in range(HALVINGS):
        middle = (low + high) / 2.0
        low, high = (middle, high) if function(middle) < wanted else (low, middle)
    return (low + high) / 2.0


def _finds(question: PowerQuestion, measure: Measure) -> bool:
    """Whether the analysis finds the effect: in the right direction, corrected as the analysis does."""
    if question.factor is None:
        test = compare_with_centre_by_ranks(measure.by_participant(), measure.chance or 0.0, measure.name)
        p, is_above = test.p_final, question.mean >= (measure.chance or 0.0)
    else:
        of_first = len(measure.factors[question.factor]) - 1  # pairs with the first level, the last one's at the end
        test = compare_pairs(measure, question.factor)[of_first - 1]
        p, is_above = test.p_final, question.mean >= (question.mean_other or 0.0)
    return p is not None and p < SIGNIFICANT and ((test.effect_size or 0.0) > 0) == is_above


def _trials(plan: StudyPlan, measure: Measure) -> tuple[int, ...]:
    """Answers of one participant in each cell."""
    blocks = {own.name: own for own in plan.blocks}
    found = []
    for cell in measure.cells:
        block = blocks[cell.name.partition(": ")[0]]
        is_after = any(measure.name in (own.name, f"{own.name}_{own.point_count}") for own in block.questions_after)
        found.append(1 if is_after else trial_counts(block).least // len(block.sets))
    return tuple(found)
