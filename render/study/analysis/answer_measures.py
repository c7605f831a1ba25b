"""Measures made of answers: proportions of choices, points of scales, ratios r. Practice counts for nothing."""

from collections import Counter, defaultdict
from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import NamedTuple

import numpy as np

from ..plan.study_plan import Factors, PlannedBlock, Question, StudyPlan
from .answer_reading import AnswerRecord, StudyTable

Level = str | float
"""A value of a factor."""
CellKey = tuple[tuple[str, Level], ...]
"""A cell's levels of all factors but one."""


class Cell(NamedTuple):
    """A cell of the design: a block, or within a block a pair or a stimulus."""

    name: str
    factors: Factors
    """Its values of the keys of the plan's `for`."""


@dataclass(frozen=True, kw_only=True)
class Measure:
    """A number for each participant and cell; what is compared between cells, and with chance."""

    name: str
    """In tables and files: `p_cc`, `confidence`."""
    title: str
    """For people: "proportion of answers for cc", "confidence"."""
    unit: str = ""
    codes: tuple[str, ...]
    cells: tuple[Cell, ...]
    values: np.ndarray = field(repr=False)
    """float64, shape [participant, cell]; nan where there is none."""
    successes: np.ndarray | None = field(default=None, repr=False)
    """int64, shape [participant, cell]: of a proportion, the answers that it counts."""
    counts: np.ndarray | None = field(default=None, repr=False)
    """int64, shape [participant, cell]: of a proportion, all answers."""
    chance: float | None = None
    """Value that answers at random have."""
    low: float | None = None
    high: float | None = None
    """Bounds of the scale, where there are any."""

    @property
    def factors(self) -> dict[str, tuple[Level, ...]]:
        """Levels of each factor, in the plan's order; factors with one level are left out."""
        names = dict.fromkeys(name for cell in self.cells for name in cell.factors)
        levels = {
            name: tuple(dict.fromkeys(own.factors[name] for own in self.cells if name in own.factors)) for name in names
        }
        return {name: own for name, own in levels.items() if len(own) > 1}

    def cells_at(self, factor: str, level: Level) -> dict[CellKey, list[int]]:
        """Numbers of the cells at a level of a factor, by their levels of all other factors.

        Several cells have the same levels where a plan's tables repeat the values of their `for`.
        """
        found: dict[CellKey, list[int]] = {}
        for number, cell in enumerate(self.cells):
            if cell.factors.get(factor) == level:
                others = sorted((name, own) for name, own in cell.factors.items() if name != factor)
                found.setdefault(tuple(others), []).append(number)
        return found

    def numbers_at(self, factor: str, level: Level) -> list[int]:
        """Numbers of all cells at a level of a factor."""
        return sorted(chain.from_iterable(self.cells_at(factor, level).values()))

    def at_level(self, factor: str, level: Level) -> np.ndarray:
        """The mean over all cells at a level, shape [participant]; nan where a cell lacks."""
        return self.values[:, self.numbers_at(factor, level)].mean(axis=1)

    def by_participant(self) -> np.ndarray:
        """The mean over all cells, shape [participant]; nan where a cell lacks."""
        return self.values.mean(axis=1)


def level_text(level: Level) -> str:
    """A level as people read it."""
    return level if isinstance(level, str) else f"{level:g}"


def level_label(factor: str, level: Level) -> str:
    """A level as people read it without its factor beside it: a number alone would say nothing."""
    return level if isinstance(level, str) else f"{factor} {level:g}"


def cell_text(cell: Cell) -> str:
    """A cell as people read it: its levels, or its name where the plan gives it none."""
    return ", ".join(level_text(own) for own in cell.factors.values()) or cell.name


NAME = ""
"""Key under which a stimulus' name stands among its factors, none of which can be called so."""
BlockPair = tuple[PlannedBlock, tuple[str, ...]]
"""A pair of stimuli, with the block that plays it."""
PAIRS_NAMED = 6
"""In the title of a measure of pairs that share nothing."""
Keyed = dict[tuple[str, Hashable], list[float]]
"""Values by participant and key of a cell."""


class ScaleKind(NamedTuple):
    """Scales whose points are compared with each other."""

    name: str
    is_of_trial: bool
    """Whether it is asked after each trial, not after blocks."""
    point_count: int


def choice_measures(table: StudyTable) -> list[Measure]:
    """How often the second stimulus of each pair was chosen, as a proportion: p; of blocks of the design `2ifc`.

    Where one stimulus of each pair has a value of a factor that the other one does not have, such as the strategy cc,
    the measure is how often that one was chosen, in whichever order the plan writes a pair: p_cc. Pairs that have no
    such value in common are a measure for each question that is asked of them, as denser is not larger.
    """
    pairs = [(block, pair) for block in table.plan.blocks if block.design == "2ifc" for pair in block.sets]
    families: dict[str, list[BlockPair]] = defaultdict(list)
    for block, pair in pairs:
        families[block.question.text].append((block, pair))
    if not pairs or _shared_level(table.plan, [pair for _, pair in pairs])[0] is not None:
        families = {"": pairs} if pairs else {}
    measures = [_choice_measure(table, own) for own in families.values()]
    names = [own.name for own in measures]
    return [
        replace(own, name=f"{own.name}_{k}") if names.count(own.name) > 1 else own for k, own in enumerate(measures, 1)
    ]


def scale_measures(table: StudyTable) -> list[Measure]:
    """The mean of each scale, over the answers of a cell: asked after blocks, or of each stimulus of a block.

    Blocks whose scales have the same name and number of points are one measure. A name is completed where another
    scale has it as well: by `trial` beside one that is asked after blocks, by the number of points beside others.
    """
    asked: dict[ScaleKind, dict[Hashable, Cell]] = {}
    for block, kind in _scales(table.plan):
        own = asked.setdefault(kind, {})
        if kind.is_of_trial:
            own |= {(block.name, names): _set_cell(table.plan, block, names) for names in block.sets}
        else:
            own[block.name, ()] = Cell(block.name, block_factors(block))
    measures = []
    for kind, cells in asked.items():
        points: Keyed = defaultdict(list)
        for own in counted(table):
            key = own.block, own.stimuli if kind.is_of_trial else ()
            is_own = own.name == kind.name and own.kind == "scale" and (own.trial >= 0) == kind.is_of_trial
            if is_own and key in cells and own.value is not None:
                points[own.code, key].append(float(own.value))
        alike = [own for own in asked if own.name == kind.name]
        parts = [kind.name]
        parts += ["trial"] * (kind.is_of_trial and len({own.is_of_trial for own in alike}) > 1)
        parts += [str(kind.point_count)] * (len({own.point_count for own in alike}) > 1)
        measures.append(
            Measure(
                name="_".join(parts),
                title=" ".join(parts).replace("_", " "),
                codes=table.codes,
                cells=tuple(cells.values()),
                values=_matrix(table.codes, list(cells), points, _mean),
                low=1.0,
                high=float(kind.point_count),
            )
        )
    return measures


def ratio_measures(table: StudyTable) -> list[Measure]:
    """The mean ratio r of closed to open contours of the same poses, by block, where stimuli were live."""
    ratios: Keyed = defaultdict(list)
    for own in table.ratios:
        ratios[own.code, own.block].append(own.r)
    blocks = [own for own in table.plan.blocks if any((code, own.name) in ratios for code in table.codes)]
    if not blocks:
        return []
    return [
        Measure(
            name="r",
            title="ratio r of closed to open contours",
            codes=table.codes,
            cells=tuple(Cell(own.name, block_factors(own)) for own in blocks),
            values=_matrix(table.codes, [own.name for own in blocks], ratios, _mean),
            low=1.0,
        )
    ]


def counted(table: StudyTable) -> Iterator[AnswerRecord]:
    """Answers outside practice."""
    return (own for own in table.answers if not own.is_practice)


def block_factors(block: PlannedBlock) -> dict[str, Level]:
    """The levels of a block: those of its `for`, else its name."""
    return dict(block.factors) or {"block": block.name}


def _choice_measure(table: StudyTable, pairs: list[BlockPair]) -> Measure:
    """The proportion of pairs that are compared with each other."""
    wanted, places = _shared_level(table.plan, [pair for _, pair in pairs])
    pairs = [(block, (pair[1 - place], pair[place])) for (block, pair), place in zip(pairs, places, strict=True)]
    cells = {(block.name, frozenset(pair)): _pair_cell(block, pair) for block, pair in pairs}
    seconds = {(block.name, frozenset(pair)): pair[1] for block, pair in pairs}
    chosen: Keyed = defaultdict(list)
    for own in counted(table):
        key = own.block, frozenset(own.stimuli)
        if key in cells and own.name == "answer" and isinstance(own.value, int):
            chosen[own.code, key].append(float(own.stimuli[own.value] == seconds[key]))
    successes, counts = (_matrix(table.codes, list(cells), chosen, function) for function in (sum, len))
    successes, counts = np.nan_to_num(successes).astype(np.int64), np.nan_to_num(counts).astype(np.int64)
    with np.errstate(invalid="ignore"):
        values = successes / counts
    called = "second" if wanted is None else level_text(wanted)
    named = list(dict.fromkeys(f"{second} over {first}" for _, (first, second) in pairs))
    seconds_text = ", ".join([*named[:PAIRS_NAMED], *(["..."] if len(named) > PAIRS_NAMED else [])])
    return Measure(
        name=f"p_{''.join(own if own.isalnum() else '_' for own in called)}",
        title=f"proportion of answers for {seconds_text if wanted is None else called}",
        codes=table.codes,
        cells=tuple(cells.values()),
        values=values,
        successes=successes,
        counts=counts,
        chance=0.5,
        low=0.0,
        high=1.0,
    )


def _scales(plan: StudyPlan) -> Iterator[tuple[PlannedBlock, ScaleKind]]:
    """Each scale, with its block."""
    for block in plan.blocks:
        asked = block.questions if block.design in ("rating", "exploration") else ()
        for questions, is_of_trial in ((asked, True), (block.questions_after, False)):
            for own in questions:
                if own.kind == "scale":
                    yield block, ScaleKind(own.name, is_of_trial, own.point_count)


def _pair_cell(block: PlannedBlock, pair: tuple[str, ...]) -> Cell:
    if len(block.sets) == 1:
        return Cell(block.name, block_factors(block))
    text = f"{pair[1]} over {pair[0]}"
    return Cell(f"{block.name}: {text}", {**block.factors, "pair": text})


def _set_cell(plan: StudyPlan, block: PlannedBlock, names: tuple[str, ...]) -> Cell:
    """The cell of a stimulus, or of a set, with the block's levels and the stimulus' own."""
    if len(block.sets) == 1:
        return Cell(block.name, block_factors(block))
    text = ", ".join(names)
    own = plan.stimulus(names[0]).factors if len(names) == 1 else {}
    return Cell(f"{block.name}: {text}", {**block.factors, **(own or {"stimulus": text})})


def _shared_level(plan: StudyPlan, pairs: list[tuple[str, ...]]) -> tuple[Level | None, list[int]]:
    """The level that one stimulus of each pair has, and its place in each; no level, and 1, where there is none.

    A stimulus' name is a level as well, the last one that is looked at.
    """
    levels = {own.name: {**own.factors, NAME: own.name} for own in plan.stimuli}
    for factor, level in levels[pairs[0][1]].items():
        having = [[levels[name].get(factor) == level for name in pair] for pair in pairs]
        if all(sum(own) == 1 for own in having):
            return level, [own.index(True) for own in having]
    return None, [1] * len(pairs)


def _matrix(
    codes: tuple[str, ...], keys: list[Hashable], found: Keyed, function: Callable[[list[float]], float]
) -> np.ndarray:
    """Values by participant and cell; nan where there are none."""
    return np.array(
        [[function(found[code, key]) if (code, key) in found else np.nan for key in keys] for code in codes]
    ).reshape(len(codes), len(keys))


def _mean(values: list[float]) -> float:
    return float(np.mean(values))


# ---- Answers that no test is made of: counts of options, numbers as mean and range, and what people wrote


PLAIN_BELOW = 1e6
"""Numbers from which on a power of ten is written."""
AROUND = {"before": "before all blocks", "after": "after all blocks"}


@dataclass(frozen=True, kw_only=True)
class QuestionAnswers:
    """All answers to one question at one place."""

    question: Question
    place: str
    """A block's name, with the stimuli of the trial, or "before all blocks"."""
    answers: tuple[AnswerRecord, ...]

    @property
    def summary(self) -> str:
        """Of choices how often each was given; of numbers mean, deviation and range; of texts how many there are."""
        given = [own.value for own in self.answers if own.value is not None and own.value != ""]
        left = len(self.answers) - len(given)
        empty = f"; {left} left empty" if left else ""
        if self.question.kind == "choice":
            found = Counter(own.label for own in self.answers)
            return ", ".join(f"{option} {found[option]}" for option in self.question.options)
        numbers = np.array([own for own in given if isinstance(own, int | float)], dtype=np.float64)
        if self.question.kind == "text" or not len(numbers):
            return f"{len(given)} answer{'s' * (len(given) != 1)}{empty}"
        with np.errstate(over="ignore"):  # a person may type 1e300
            mean, deviation = float(numbers.mean()), float(numbers.std(ddof=1)) if len(numbers) > 1 else None
        form = ".1f" if np.abs(numbers).max() < PLAIN_BELOW else ".3g"
        spread = "" if deviation is None else f" ± {deviation:{form}}"
        return f"{mean:{form}}{spread} ({numbers.min():g} to {numbers.max():g}), n = {len(numbers)}{empty}"

    @property
    def texts(self) -> tuple[tuple[str, str], ...]:
        """Who wrote what, where something was written."""
        return tuple((own.code, own.value) for own in self.answers if isinstance(own.value, str) and own.value)


def open_answers(table: StudyTable) -> list[QuestionAnswers]:
    """Questions before and after all blocks, after blocks but scales, and of explorations but scales, as asked."""
    found = []
    plan, answers = table.plan, list(counted(table))
    for place, questions in (("before", plan.questions_before), ("after", plan.questions_after)):
        for question in questions:
            own = tuple(one for one in answers if (one.block, one.name) == (place, question.name))
            found.append(QuestionAnswers(question=question, place=AROUND[place], answers=own))
    for block in plan.blocks:
        of_block = [own for own in answers if own.block == block.name]
        asked = block.questions if block.design == "exploration" else ()
        for names in block.sets:
            for question in asked:
                own = tuple(one for one in of_block if (one.name, one.stimuli) == (question.name, names))
                place = f"{block.name}: {', '.join(names)}"
                if question.kind != "scale":
                    found.append(QuestionAnswers(question=question, place=place, answers=own))
        for question in block.questions_after:
            own = tuple(one for one in of_block if (one.name, one.trial) == (question.name, -1))
            if question.kind != "scale":
                found.append(QuestionAnswers(question=question, place=block.name, answers=own))
    return found
