"""Strategies as the kernels of sampling take them: numbers, and times in ticks.

Ages are whole numbers of ticks. So whether a sample is held, fades or is silent follows from its number and the pose's
time alone, and not from the block of samples that it is drawn in, whose beginning a difference of seconds would round.
"""

import math
from functools import lru_cache
from typing import Any

import numpy as np

from ...kernels.sampling.layout import SamplingPlan
from .strategy import Order, SamplingStrategy

TICKS = float(1 << 20)  # of a sample: one is as short as the rounding of times that `sample_bounds` allows for
FADE_LEAST = 1e-9  # [s]
PACES = ("speed", "frequency", "capped", "still")
WAVES = (None, "sine", "square")


def ticks_of(seconds: Any, update_rate: float) -> Any:
    """A time [s] in ticks, a whole number as float64; infinite for one that is.

    >>> float(ticks_of(0.011, 10_000.0)) / TICKS  # samples; the product of the two is 109.99999999999999
    110.0
    """
    if isinstance(seconds, float):  # of a pose that is now: NumPy takes ten times as long for one number
        return float(round(seconds * update_rate * TICKS)) if math.isfinite(seconds) else seconds
    return np.rint(np.asarray(seconds, np.float64) * update_rate * TICKS)


@lru_cache(maxsize=8)
def shown_order(order: Order, points: int) -> np.ndarray:
    """Place within the cycle, 0..points - 1, of each point in the order in which they are shown."""
    if order.kind == "random":
        return np.random.default_rng(order.seed).permutation(points)
    return (order.step if order.kind == "step" else 1) * np.arange(points) % points


def plan_of(strategy: SamplingStrategy, *, pauses: bool = False) -> Any:
    """A strategy as numbers. pauses: the contours have some of their own."""
    plan, pace, order, gap = SamplingPlan(), strategy.pace, strategy.order, strategy.gap
    dwell, sections = strategy.dwell, strategy.sections
    pauses = sections is None and (pauses or dwell.time > 0 or dwell.share > 0)
    fewest, most = pace.samples_within(strategy.update_rate)
    numbers = {
        "speed": strategy.speed,
        "rate": strategy.update_rate,
        "pace": PACES.index(pace.kind),
        "fixed": round(strategy.update_rate / pace.frequency),
        "fewest": fewest,
        "most": most,
        "lowest": pace.lowest,
        "points": pace.points or 0,
        "points_least": (pace.points or 1) if order.kind in ("step", "random") else 0,
        "foci": strategy.foci,
        "threshold": strategy.jump_threshold,
        "ordinary": strategy.step_ordinary,
        "circle_step": strategy.circle_step,
        "fade": max(float(ticks_of(max(strategy.fade, FADE_LEAST), strategy.update_rate)), 1.0),  # [ticks]
        "restarts": strategy.continuity == "jump",
        "plain": strategy.plain,
        "shortest": order.route == "shortest",
        "margin": order.margin,
        "closes": gap.kind == "close",
        "turns_back": gap.kind == "pendulum",
        "returns": gap.kind == "return",
        "return_speed": gap.speed,
        "pendulum": order.kind == "pendulum",
        "passes": 2 ** [gap.kind == "pendulum", order.kind == "pendulum", pauses].count(True),
        "dwell_time": dwell.time,
        "dwell_ratio": dwell.share / (1.0 - dwell.share),
        "corner_cosine": float(np.cos(dwell.angle)),
        "sections": 0 if sections is None else sections.count,
        "section_speed": 0.0 if sections is None else sections.speed,
        "section_share": dwell.share,
        "frequency": pace.frequency,
        **_overlays_of(strategy),
    }
    for name, value in numbers.items():
        setattr(plan, name, int(value) if isinstance(value, bool) else value)
    return plan


def _overlays_of(strategy: SamplingStrategy) -> dict[str, float]:
    """Modulations as numbers."""
    am, lm, rate = strategy.am, strategy.lm, strategy.update_rate
    out: dict[str, float] = {}
    if lm is not None:
        out |= {"circle_radius": lm.radius, "circle_turns": lm.frequency / rate}
    if am is not None:
        out |= {"wave": WAVES.index(am.wave), "wave_turns": am.frequency / rate, "wave_depth": am.depth}
    return out
