"""Study tables from a plan's text and answers that are written as short rows, so that tests see what was answered."""

import contextlib

from palpate.render.study.analysis.answer_reading import AnswerRecord, RatioRecord, StudyTable
from palpate.render.study.plan.block_designs import block_numbers, rng_of, trials_of
from palpate.render.study.plan.study_reading import read_stored_study
from palpate.render.study.run.study_file import AnswerRow

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


EVERY_DESIGN = "\n".join(
    (
        '[[question_before]]\nname = "age"\ntext = "Age?"\nkind = "number"\noptional = true\n',
        '[[question_after]]\nname = "note"\ntext = "Note?"\nkind = "text"\noptional = true\n',
        levels_text([1, 2, 4, 8]),
        stimulus_text("none"),
        f'[[block]]\nname = "pairs"\ndesign = "2ifc"\npractice = 2\npairs = [["s1", "s2"]]\nrepetitions = 3\n'
        f'{QUESTION}\n[[block.question_after]]\nname = "ease"\ntext = "?"\nkind = "scale"\n',
        '[[block]]\nname = "constant"\ndesign = "constant"\nstandard = "none"\ncomparisons = ["s1", "s2", "s3", "s4"]\n'
        f"repetitions = 2\n{QUESTION}\n",
        '[[block]]\nname = "stairs"\ndesign = "staircase"\nlevels = ["s4", "s3", "s2", "s1"]\nstandard = "none"\n'
        f"tracks = 2\nsteps = [2, 1]\nreversals = 4\ntrials_max = 30\npractice = 2\n{QUESTION}\n",
        '[[block]]\nname = "seen"\ndesign = "staircase"\nlevels = ["s4", "s3", "s2", "s1"]\noptions = ["no", "yes"]\n'
        f'correct = "yes"\ndown = 1\nreversals = 5\n{QUESTION}\n',
        '[[block]]\nname = "sizes"\ndesign = "magnitude"\nstimuli = ["s1", "s2", "s3"]\n'
        f'modulus = {{ stimulus = "s1", number = 10 }}\n{QUESTION}\n',
        '[[block]]\nname = "rated"\ndesign = "rating"\nstimuli = ["s1", "s2"]\nrepetitions = 2\n'
        '[[block.question]]\nname = "soft"\ntext = "?"\nkind = "scale"\npoints = 5\n',
        '[[block]]\nname = "look"\ndesign = "exploration"\nsets = [["s1", "s2"], ["s3"]]\n'
        '[[block.question]]\nname = "felt"\ntext = "?"\nkind = "text"\n'
        '[[block.question]]\nname = "which"\ntext = "?"\nkind = "choice"\noptions = ["a", "b", "c"]\n'
        '[[block.question]]\nname = "warm"\ntext = "?"\nkind = "scale"\n',
    )
)
"""A plan's text with a block of each design, and of each kind of staircase."""


def random_answer(question, rng):
    """Any answer that a question takes."""
    if question.kind == "choice":
        return int(rng.integers(len(question.options)))
    if question.kind == "scale":
        return int(rng.integers(question.point_count)) + 1
    return None if question.is_optional and rng.random() < 0.3 else "words" if question.kind == "text" else rng.random()


def random_run(plan, code, rng):
    """All answers of a participant who answers at random, to the trials that the study itself would ask."""
    found, participant = [], plan.codes.index(code)

    def take(question, block, position, trial, planned=None):
        value = random_answer(question, rng)
        of_trial = {} if planned is None else {
            "stimuli": planned.stimuli, "is_practice": planned.is_practice, "track": planned.track,
            "level": planned.level, "comparison": planned.comparison, "clipped": planned.clipped,
        }  # fmt: skip
        label = question.options[value] if question.kind == "choice" else ""
        record = AnswerRecord(code, block, position, trial, question.name, question.kind, value, label, **of_trial)
        found.append(record._replace(key=str(value), seconds=0.2 + rng.random()))
        return value

    for question in plan.questions_before:
        take(question, "before", -1, -1)
    for position, number_of_block in enumerate(block_numbers(plan, participant)):
        block = plan.blocks[number_of_block]
        trials, trial = trials_of(block, rng_of(plan, participant, number_of_block)), 0
        with contextlib.suppress(StopIteration):
            planned = next(trials)
            while True:
                given = {own.name: take(own, block.name, position, trial, planned) for own in planned.questions}
                trial += 1
                planned = trials.send(given)
        for question in block.questions_after:
            take(question, block.name, position, -1)
    for question in plan.questions_after:
        take(question, "after", -1, -1)
    return found
