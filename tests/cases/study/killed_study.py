"""Runs a study without an array in children that may be killed: `python killed_study.py FOLDER`.

Each line of standard input begins a child, which goes on where the one before stopped. It tells its process number,
then each answer once the study goes on behind it, then what came of the run.
"""

import os
import sys
from pathlib import Path

from scripted_participant import ScriptedParticipant, first_key
from study_plans import CONFIDENCE, EMISSIONS, TYPED, SilentPlayer, block, study

from palpate.render.study.plan.duty_account import DutyAccount
from palpate.render.study.run import desk as desk_module
from palpate.render.study.run import study_run as module
from palpate.render.study.run.answer_store import AnswerStore
from palpate.render.study.run.desk import StudyDesk
from palpate.render.study.run.study_run import StudyRun

PLAN = study(
    questions_before=TYPED,
    blocks=(block(practice=1, repetitions=20, questions_after=(CONFIDENCE,)), block(name="again", repetitions=10)),
)


def run_once(folder: Path) -> None:
    """Run until the end, or until this process is killed."""
    module.LEAD_IN, desk_module.LOST_SECONDS = 0.0, 30.0
    with AnswerStore(folder, PLAN) as store:
        desk = StudyDesk()
        run = StudyRun(
            PLAN,
            "P01",
            store=store,
            progress=store.begin("P01", resume=True),
            desk=desk,
            player=SilentPlayer(),
            account=DutyAccount(PLAN.limits),
            send=lambda name, **values: _tell(name, values),
            file_hashes={},
            emissions=EMISSIONS,
            shown_names={},
        )
        with ScriptedParticipant(desk, first_key):
            _print(run.run())


def _tell(name: str, values: dict) -> None:
    if name == "answer":
        _print("answer", values["block"], values["trial"], values["question"], values["value"])


def _print(*words: object) -> None:
    sys.stdout.write(" ".join(map(str, words)) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    for _ in sys.stdin:
        child = os.fork()
        if child == 0:
            _print("child", os.getpid())
            run_once(Path(sys.argv[1]))
            os._exit(0)
        os.waitpid(child, 0)
        _print("over")
