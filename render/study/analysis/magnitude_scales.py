"""Magnitude estimates: geometric means, and the exponent of the power law of each participant (Stevens 1957)."""

from collections import defaultdict
from dataclasses import dataclass

import numpy as np

from ..plan.study_plan import PlannedBlock
from .answer_measures import block_factors, counted
from .measures import Cell, Measure
from .study_table import StudyTable


@dataclass(frozen=True, kw_only=True)
class MagnitudeScale:
    """The estimates of one block."""

    block: PlannedBlock
    codes: tuple[str, ...]
    x: np.ndarray
    """Values of the stimuli on the plan's scale, float64, rising."""
    means: np.ndarray
    """Geometric mean of each participant's estimates, shape [participant, stimulus]; nan where there is none."""
    exponents: np.ndarray
    """Slope of log estimate over log value, by least squares, shape [participant]; nan where there is no line."""
    left_out: int
    """Estimates that have no logarithm: 0, or below."""
    reason: str = ""
    """Why there is no exponent at all."""


def magnitude_scales(table: StudyTable) -> list[MagnitudeScale]:
    """One for each block of the design `magnitude`."""
    return [_scale(table, block) for block in table.plan.blocks if block.design == "magnitude"]


def exponent_measures(scales: list[MagnitudeScale]) -> list[Measure]:
    """The exponents as a measure, with a cell for each block."""
    if not scales:
        return []
    return [
        Measure(
            name="exponent",
            title="exponent of the power law",
            codes=scales[0].codes,
            cells=tuple(Cell(own.block.name, block_factors(own.block)) for own in scales),
            values=np.stack([own.exponents for own in scales], axis=1),
        )
    ]


def _scale(table: StudyTable, block: PlannedBlock) -> MagnitudeScale:
    values = {own.name: own.value for own in table.plan.stimuli}
    logs: dict[tuple[str, float], list[float]] = defaultdict(list)
    lacking, left_out = set[str](), 0
    for own in counted(table):
        if own.block != block.name or own.name != "answer" or not isinstance(own.value, int | float):
            continue
        value = values[own.stimuli[-1]]  # behind the modulus, if there is one
        if value is None:
            lacking.add(own.stimuli[-1])
        elif own.value <= 0:
            left_out += 1
        else:
            logs[own.code, value].append(float(np.log10(own.value)))
    x = np.array(sorted({value for _, value in logs}), dtype=np.float64)
    means = np.array([[np.mean(logs.get((code, value), [np.nan])) for value in x] for code in table.codes])
    means = means.reshape(len(table.codes), len(x))
    reason = ""
    if lacking:
        reason = f"the plan gives no `value` to {', '.join(sorted(lacking))}"
    elif len(x) < 2:
        reason = f"estimates of {len(x)} value{'s' * (len(x) != 1)}; a line needs 2"
    elif x[0] <= 0:
        reason = f"values must be above 0 for a power law; the least is {x[0]:g}"
    exponents = np.full(len(table.codes), np.nan)
    if not reason:
        for number, own in enumerate(means):
            found = np.isfinite(own)
            if found.sum() > 1:
                exponents[number] = np.polynomial.polynomial.polyfit(np.log10(x[found]), own[found], 1)[1]
    return MagnitudeScale(
        block=block, codes=table.codes, x=x, means=10**means, exponents=exponents, left_out=left_out, reason=reason
    )
