"""A plan and rows of answers that tests know in advance; as a script, a participant who answers as fast as possible.

`python study_answers.py FOLDER TRIALS` goes on where the last process stopped, and prints each row when its call has
returned. A call that fails is made again. `python study_answers.py` forks such a process for each line of its input.
"""

import os
import signal
import sys
from dataclasses import replace
from pathlib import Path

from palpate.render.errors import StudyError
from palpate.render.study.plan.study_plan import PlannedBlock, PlannedStimulus, Question, StudyPlan
from palpate.render.study.run.answer_store import AnswerStore
from palpate.render.study.run.study_file import AnswerRow, IntervalRow

TEXT = 'title = "Infill"\nseed = 3\n\n[[block]]\nname = "cube"\n'
QUESTION = Question(name="answer", text="Which one felt denser?", kind="choice", options=("First", "Second"))
BLOCK = PlannedBlock(name="cube", design="2ifc", question=QUESTION, questions=(QUESTION,), sets=(("cc", "oc"),))
PLAN = StudyPlan(
    path=Path("STUDY.toml"),
    text=TEXT,
    title="Infill",
    codes=("P01", "P02", "P03"),
    seed=3,
    consent="I take part.",
    data_statement="Answers are kept under a code.",
    stimuli=tuple(PlannedStimulus(name=name, duration=7.0, solid="cube", strategy=name) for name in ("cc", "oc")),
    blocks=(BLOCK,),
)
TRIALS = 24


def interval(trial=0, number=0, attempt=0, **values):
    """An interval whose numbers all follow from its place."""
    row = IntervalRow(
        block="cube",
        block_position=0,
        trial=trial,
        attempt=attempt,
        interval=number,
        stimulus=("cc", "oc")[number],
        is_practice=trial < 2,
        onset_planned=trial + 0.125,
        onset=trial + 0.25,
        is_estimate=False,
        latency=0.004,
        ended=trial + 7.25,
        seconds=7.0,
        outcome="played",
        poses=630 + trial,
        pose_latency_p50=0.011,
        pose_latency_p99=1 / 3 + trial,
        dropped=0,
        length_mean=0.25,
        r=1.75 if number == 0 else None,
    )
    return replace(row, **values)


def answer(trial=0, name="answer", attempt=0, **values):
    """An answer whose value follows from its place: an option, or a text that takes several of SQLite's pages."""
    is_text = name == "why"
    row = AnswerRow(
        block="cube",
        block_position=0,
        design="2ifc",
        trial=trial,
        attempt=attempt,
        name=name,
        question=QUESTION.text,
        kind="text" if is_text else "choice",
        value=f"so dicht wie ein Schwamm, {trial} ü " * 400 if is_text else trial % 2,
        label="" if is_text else QUESTION.options[trial % 2],
        key="Enter" if is_text else "ArrowLeft",
        key_order=() if is_text else (1, 0),
        stimuli=("cc", "oc"),
        is_practice=trial < 2,
        seconds=0.5 + trial / 7,
    )
    return replace(row, **values)


def take_part(folder, report, trials=TRIALS):
    """Answer what is not answered yet; `report(kind, trial, attempt, what)` after each call that saved something."""
    with again(report, lambda: AnswerStore(folder, PLAN)) as store:
        progress = again(report, lambda: store.begin("P01", resume=True))
        report("begun", 0, 0, progress.session)
        for trial in range(trials):
            names = [name for name in ("answer", "why") if ("cube", trial, name) not in progress.answers]
            if not names:
                continue
            attempt = progress.next_attempt("cube", trial)
            for row in (interval(trial, 0, attempt), interval(trial, 1, attempt)):
                again(report, lambda row=row: store.add_interval(row))
                report("interval", trial, attempt, row.interval)
            for row in (answer(trial, name, attempt) for name in names):
                again(report, lambda row=row: store.add_answer(row))
                report("answer", trial, attempt, row.name)
        again(report, store.finish)
    report("finished", 0, 0, "")


def again(report, call):
    """What a call returns, which is made again, but not for ever, while it cannot save."""
    for _ in range(4):
        try:
            return call()
        except StudyError as error:
            report("failed", 0, 0, str(error).replace("\n", " "))
    return call()


def report_line(*values):
    """Report what is saved as a line that leaves this process at once."""
    sys.stdout.write(" ".join(map(str, values)) + "\n")
    sys.stdout.flush()


def serve():
    """Fork a participant for each line `FOLDER TRIALS`, whose imports are made already; `over` when it has ended."""
    for line in sys.stdin:
        folder, trials = line.split()
        child = os.fork()
        if not child:
            report_line("forked", os.getpid())
            take_part(Path(folder), report_line, int(trials))
            signal.pause()  # until it is killed
        os.waitpid(child, 0)
        report_line("over")


if __name__ == "__main__":
    if len(sys.argv) > 1:
        take_part(Path(sys.argv[1]), report_line, int(sys.argv[2]))
    else:
        serve()
