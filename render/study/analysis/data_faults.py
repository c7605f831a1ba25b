"""What is odd about a study's data: it is named, so that a person decides; nothing is left out for it."""

from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence

from ..plan.block_designs import trial_counts
from ..plan.study_plan import StudyPlan
from .answer_measures import counted
from .answer_reading import AnswerRecord, StudyTable
from .level_answers import replay_tracks

SAME_LEAST = 8
"""Choices that are all alike are named from so many on: by chance, 1 of 128 participants makes them, of two options."""
SAME_POINTS_LEAST = 6
"""Points of one scale that are all alike are named from so many on: the blocks of the founding paper's study."""
SYNTHETIC = ("exploration", "simulated")
"""Sources of poses without a person."""
FAST_SECONDS = 0.15
"""An answer that came earlier was not thought about [s]: simple reactions to sounds take as long."""


def data_faults(table: StudyTable) -> list[str]:
    """Sentences about missing answers, and about participants who answered oddly. All of them stay in the analysis."""
    by_code: dict[str, list[AnswerRecord]] = defaultdict(list)
    for own in counted(table):
        by_code[own.code].append(own)
    absent = [code for code in table.plan.codes if code not in table.codes]
    sentences = []
    if absent:
        have = "has" if len(absent) == 1 else "have"
        sentences.append(f"{len(absent)} of {len(table.plan.codes)} planned participants {have} not begun")
    synthetic = sum(own.source in SYNTHETIC for own in table.sessions)
    if synthetic:
        sentences.append(
            f"the hand of {synthetic} of {len(table.sessions)} sessions was synthetic: nobody felt anything"
        )
    emulated = sum("emulator" in own.array for own in table.sessions)
    if emulated:
        sentences.append(
            f"{emulated} of {len(table.sessions)} sessions played to the emulated array: nobody felt anything"
        )
    for code in table.codes:
        sentences += _missing(table, code, by_code[code])
        sentences += _alike(table.plan, code, by_code[code])
        fast = sum(own.seconds is not None and own.seconds < FAST_SECONDS and own.trial >= 0 for own in by_code[code])
        if fast:
            answers = f"answer{'s' * (fast != 1)}"
            sentences.append(f"{code} gave {fast} {answers} within {FAST_SECONDS:g} s of the question")
    return sentences


def _missing(table: StudyTable, code: str, answers: Sequence[AnswerRecord]) -> Iterator[str]:
    """Blocks in which a participant has fewer answers than the plan asks for."""
    given = Counter((own.block, own.name, own.trial >= 0) for own in answers)
    blocks = {own.block for own in answers}
    lacking = []
    for block in table.plan.blocks:
        if block.name not in blocks:
            lacking.append(block.name)
            continue
        trials = trial_counts(block).least
        found = min(given[block.name, own.name, True] for own in block.questions)
        if block.design == "staircase":
            own_answers = [own for own in answers if own.block == block.name and own.name == block.question.name]
            ended = sum(track.state.has_ended for track in replay_tracks(block, own_answers))
            if ended < block.tracks:
                lacking.append(f"{block.name} ({ended} of {block.tracks} staircases ended, {found} trials)")
        elif found < trials:
            lacking.append(f"{block.name} ({found} of {trials} trials)")
        lacking += [
            f"{block.name} ({own.name})" for own in block.questions_after if not given[block.name, own.name, False]
        ]
    if lacking:
        state = "has not finished" if code in table.unfinished else "has finished"
        yield (
            f"{code} {state} and lacks {', '.join(lacking)}: this participant is left out of comparisons that need "
            "what lacks wholly; blocks with fewer trials count by those that were answered"
        )
    elif code in table.unfinished:
        yield f"{code} has answered all blocks, but not all that the study asks after them"


def _alike(plan: StudyPlan, code: str, answers: Sequence[AnswerRecord]) -> Iterator[str]:
    """Keys, options and points that a participant gave each time, and how often.

    Choices are compared with those that have the same options, as others have other keys.
    """
    options = {(block.name, own.name): own.options for block in plan.blocks for own in block.questions}
    choices: dict[tuple[str, ...], list[AnswerRecord]] = defaultdict(list)
    for own in answers:
        if own.kind == "choice" and own.trial >= 0:
            choices[options.get((own.block, own.name), ())].append(own)
    for given in choices.values():
        if len(given) < SAME_LEAST:
            continue
        if len(keys := {own.key for own in given}) == 1:
            yield f"{code} always pressed the key {min(keys)!r}, in {len(given)} answers"
        if len(labels := {own.label for own in given}) == 1:
            yield f"{code} always chose {min(labels)!r}, in {len(given)} answers"
    scales: dict[str, list[AnswerRecord]] = defaultdict(list)
    for own in answers:
        if own.kind == "scale":
            scales[own.name].append(own)
    for name, given in scales.items():
        if len(given) >= SAME_POINTS_LEAST and len({own.value for own in given}) == 1:
            yield f"{code} gave {name} the same point, {given[0].value}, in {len(given)} answers"
