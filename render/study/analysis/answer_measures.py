"""Measures made of answers: proportions of choices, points of scales, ratios r. Practice counts for nothing."""

from collections import defaultdict
from collections.abc import Callable, Hashable, Iterable, Iterator

import numpy as np

from ..plan.study_plan import PlannedBlock, PlannedStimulus, Question, StudyPlan
from .measures import Cell, Level, Measure, level_text
from .study_table import AnswerRecord, StudyTable

Keyed = dict[tuple[str, Hashable], list[float]]
"""Values by participant and key of a cell."""


def choice_measures(table: StudyTable) -> list[Measure]:
    """How often the second stimulus of each pair was chosen, as a proportion: p; of blocks of the design `2ifc`.

    Where all second stimuli share a value of a factor that the first ones do not have, such as the strategy cc, the
    measure is called after it: p_cc.
    """
    plan = table.plan
    pairs = [(block, pair) for block in plan.blocks if block.design == "2ifc" for pair in block.sets]
    if not pairs:
        return []
    wanted = _shared_level(plan, [pair for _, pair in pairs])
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
    return [
        Measure(
            name="p_second" if wanted is None else f"p_{_word(wanted)}",
            title=f"proportion of answers for {'the second of a pair' if wanted is None else level_text(wanted)}",
            codes=table.codes,
            cells=tuple(cells.values()),
            values=values,
            successes=successes,
            counts=counts,
            chance=0.5,
            low=0.0,
            high=1.0,
        )
    ]


def scale_measures(table: StudyTable) -> list[Measure]:
    """The mean of each scale, over the answers of a cell: asked after blocks, or of each stimulus of a block."""
    asked: dict[tuple[str, bool], dict[Hashable, Cell]] = {}
    questions: dict[tuple[str, bool], Question] = {}
    for block, question, is_of_trial in _scales(table.plan):
        kind = question.name, is_of_trial
        questions.setdefault(kind, question)
        own = asked.setdefault(kind, {})
        if is_of_trial:
            own |= {(block.name, names): _set_cell(table.plan, block, names) for names in block.sets}
        else:
            own[block.name, ()] = Cell(block.name, block_factors(block))
    measures = []
    for (name, is_of_trial), cells in asked.items():
        points: Keyed = defaultdict(list)
        for own in counted(table):
            key = own.block, own.stimuli if is_of_trial else ()
            if own.name == name and own.kind == "scale" and (own.trial >= 0) == is_of_trial and key in cells:
                points[own.code, key].append(float(own.value or 0))
        question = questions[name, is_of_trial]
        measures.append(
            Measure(
                name=name,
                title=name.replace("_", " "),
                codes=table.codes,
                cells=tuple(cells.values()),
                values=_matrix(table.codes, list(cells), points, _mean),
                low=1.0,
                high=float(question.point_count),
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


def _scales(plan: StudyPlan) -> Iterator[tuple[PlannedBlock, Question, bool]]:
    """Each scale, with its block, and whether it is asked after each trial."""
    for block in plan.blocks:
        if block.design in ("rating", "exploration"):
            yield from ((block, own, True) for own in block.questions if own.kind == "scale")
        yield from ((block, own, False) for own in block.questions_after if own.kind == "scale")


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


def _shared_level(plan: StudyPlan, pairs: list[tuple[str, ...]]) -> Level | None:
    """The level that all second stimuli of pairs have, and no first one."""
    stimuli = {own.name: own for own in plan.stimuli}
    firsts, seconds = (_factor_values(stimuli[pair[place]] for pair in pairs) for place in (0, 1))
    for factor, levels in seconds.items():
        if len(levels) == 1 and factor in firsts and not levels & firsts[factor]:
            return next(iter(levels))
    if len({pair[1] for pair in pairs}) == 1:
        return pairs[0][1]
    return None


def _factor_values(stimuli: Iterable[PlannedStimulus]) -> dict[str, set[Level]]:
    """The values of each factor that all of some stimuli have."""
    values: dict[str, set[Level]] = {}
    for count, own in enumerate(stimuli):
        values = {
            name: values.get(name, set()) | {level}
            for name, level in own.factors.items()
            if count == 0 or name in values
        }
    return values


def _matrix(
    codes: tuple[str, ...], keys: list[Hashable], found: Keyed, function: Callable[[list[float]], float]
) -> np.ndarray:
    """Values by participant and cell; nan where there are none."""
    return np.array(
        [[function(found[code, key]) if (code, key) in found else np.nan for key in keys] for code in codes]
    ).reshape(len(codes), len(keys))


def _mean(values: list[float]) -> float:
    return float(np.mean(values))


def _word(level: Level) -> str:
    """A level as a part of a column's name."""
    return "".join(own if own.isalnum() else "_" for own in level_text(level))
