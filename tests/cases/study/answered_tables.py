"""Study tables from a plan's text and answers that are written as short rows, so that tests see what was answered."""

from palpate.render.study.analysis.study_table import AnswerRecord, RatioRecord, StudyTable
from palpate.render.study.plan.study_reading import read_stored_study
from palpate.render.study.run.store_rows import AnswerRow

QUESTION = 'question = "Which one felt denser?"'
PAPER = """
title = "Infill density"
participants = 3
[[stimulus]]
for = { object = ["cube", "tube", "dog"], strategy = ["oc", "cc"] }
name = "{object}-{strategy}"
object = "{object}"
strategy = "{strategy}"
duration = 7.0
[[block]]
for = { object = ["cube", "tube", "dog"], opacity = [1.0, 0.7] }
name = "{object}-{opacity}"
design = "2ifc"
pairs = [["{object}-oc", "{object}-cc"]]
repetitions = 5
question = "Which one of the two shapes felt the most densely filled?"
random_keys = true
opacity = "{opacity}"
[[block.question_after]]
name = "confidence"
text = "How confident are you in your answers?"
kind = "scale"
[[block.question_after]]
name = "difficulty"
text = "How difficult was it?"
kind = "scale"
"""
"""The founding paper's study, with 3 participants."""
BLOCKS = ("cube-1.0", "cube-0.7", "tube-1.0", "tube-0.7", "dog-1.0", "dog-0.7")


def stimulus_text(*names, **values):
    """Tables of live stimuli; values: `value` of each, by its name, with _ for -."""
    return "".join(
        f'[[stimulus]]\nname = "{name}"\nobject = "cube"\nduration = 1.0\n'
        + (f"value = {values[name.replace('-', '_')]}\n" if name.replace("-", "_") in values else "")
        for name in names
    )


def levels_text(values):
    """Tables of live stimuli that are called after their values: `s1`, `s2`, ..."""
    return "".join(
        f'[[stimulus]]\nname = "s{number}"\nobject = "cube"\nduration = 1.0\nvalue = {value}\n'
        for number, value in enumerate(values, 1)
    )


def plan_of(*parts, participants=3):
    """A plan, read as one that is kept with data; parts: of its text, to which title and participants are added."""
    head = "" if any("title =" in own for own in parts) else f'title = "A study"\nparticipants = {participants}\n'
    return read_stored_study(head + "\n".join(parts), "study.toml")


def table_of(plan, *answers, ratios=(), unfinished=()):
    """A table of lists of answers; its participants are those who have given one."""
    listed = tuple(one for own in answers for one in (own if isinstance(own, list) else [own]))
    having = {own.code for own in listed}
    return StudyTable(
        plan=plan, codes=tuple(own for own in plan.codes if own in having), answers=listed,
        ratios=tuple(RatioRecord(*own) for own in ratios), unfinished=tuple(unfinished),
    )  # fmt: skip


def chosen(
    code, block, pair, marks, *, practice=0, first=0, keys=("ArrowLeft", "ArrowRight"), labels=("First", "Second")
):
    """Choices within a pair: each mark is 0 or 1, the place in `pair` of the stimulus that was chosen.

    The pair's order alternates from trial to trial. first: number of the first trial.
    """
    records = []
    for trial, mark in enumerate(marks, first):
        stimuli = tuple(pair) if trial % 2 == 0 else tuple(pair)[::-1]
        value = stimuli.index(pair[int(mark)])
        records.append(
            AnswerRecord(
                code, block, 0, trial, "answer", "choice", value, labels[value], keys[value], stimuli,
                is_practice=trial - first < practice, seconds=0.8,
            )
        )  # fmt: skip
    return records


def point(code, block, name, value, *, trial=-1, stimuli=(), **values):
    """A scale's point, asked after a block."""
    return AnswerRecord(code, block, 0, trial, name, "scale", value, "", str(value), stimuli, seconds=2.0, **values)


def option(code, block, trial, value, labels, stimuli, *, name="answer", **values):
    """One choice of a trial."""
    return AnswerRecord(
        code, block, 0, trial, name, "choice", value, labels[value], str(value + 1), tuple(stimuli),
        **({"seconds": 0.8} | values),
    )  # fmt: skip


def number(code, block, trial, value, stimuli=(), *, name="answer", **values):
    """A number that was typed; None: left empty."""
    return AnswerRecord(
        code, block, 0, trial, name, "number", value, "", "Enter", tuple(stimuli), seconds=3.0, **values
    )


def text(code, block, name, value, *, trial=-1, stimuli=()):
    """A text that was typed."""
    return AnswerRecord(code, block, 0, trial, name, "text", value, "", "Enter", tuple(stimuli), seconds=9.0)


def paper_block(code, block, marks, confidence=None, difficulty=None, *, first=0):
    """A block of the paper's plan: which stimulus was chosen (1: cc), and the points after it; None: not given."""
    shape = block.split("-")[0]
    points = {"confidence": confidence, "difficulty": difficulty}
    return [
        *chosen(code, block, (f"{shape}-oc", f"{shape}-cc"), marks, first=first),
        *(point(code, block, name, value) for name, value in points.items() if value is not None),
    ]


def paper_answers(code, rows):
    """All blocks of the paper's plan. rows: a text for each, "1101111011 5 3": choices, confidence, difficulty."""
    found = []
    for block, row in zip(BLOCKS, rows, strict=True):
        marks, *points = row.split()
        found += paper_block(code, block, marks, *map(int, points))
    return found


def answer_row(record, attempt=0, design="2ifc"):
    """What a run keeps of an answer."""
    return AnswerRow(
        block=record.block, block_position=record.position, design=design,
        trial=record.trial, attempt=attempt, name=record.name, question="?", kind=record.kind, value=record.value,
        label=record.label, key=record.key, stimuli=record.stimuli, is_practice=record.is_practice,
        seconds=record.seconds, track=record.track, level=record.level, comparison=record.comparison,
        clipped=record.clipped,
    )  # fmt: skip
