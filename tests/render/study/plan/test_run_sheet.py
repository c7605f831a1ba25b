"""The run sheet as text and as values."""

from pathlib import Path

from palpate.device import Limits, array_model
from palpate.render.study.plan.run_sheet import run_sheet
from palpate.render.study.plan.study_judgement import judge_study
from palpate.render.study.plan.study_plan import PlannedBlock, PlannedStimulus, Question, StudyPlan

WHICH = Question(name="which", text="Which one?", kind="choice", options=("first", "second"))
SHEET = """\
Infill density
plan STUDY.toml, seed 1, array emulator at 10000 Hz

4 participants; the order of blocks is balanced: 4 participants fill the 2 rows of a balanced Latin
square of 2 blocks 2 times.
One run: 15-37 trials, up to 47 intervals, 4.3-5.8 min if each answer takes 4 s.

block        design     practice  trials  intervals      min
1 pairs      2ifc              2       8         20      2.1
2 threshold  staircase         0    5-27         27  2.2-3.7

order of blocks
P01  1 2
P02  2 1
P03  1 2
P04  2 1

array at worst
emission without a pause of 1 s: 5.3 s (bound 120 s)
mean duty over 600 s: 0.168 (bound 0.5)
pauses that these bounds add to one run: 0 s

stimulus  kind  s  duty
oc        live  2     1
  object cube
cc        live  2     1
  object cube

The plan has no fault.
"""


def plan_of(*blocks, **fields):
    given = {
        "path": Path("STUDY.toml"),
        "text": "",
        "title": "Infill density",
        "codes": ("P01", "P02", "P03", "P04"),
        "seed": 1,
        "stimuli": tuple(
            PlannedStimulus(name=name, duration=2.0, solid="cube", strategy=name) for name in ("oc", "cc")
        ),
    }
    return StudyPlan(blocks=blocks, **(given | fields))


def pairs(name="pairs", **fields):
    given = {"design": "2ifc", "question": WHICH, "questions": (WHICH,), "sets": (("oc", "cc"),), "repetitions": 4}
    return PlannedBlock(name=name, **(given | fields))


def judged(plan):
    return judge_study(plan, array_model("emulator"))


def test_the_sheet_of_a_plan_is_this():
    stairs = pairs("threshold", design="staircase", sets=(("oc",), ("cc",)), correct_option=1, reversals=2,
                   trials_max=27, down=3)  # fmt: skip
    plan = plan_of(pairs(practice=2), stairs)
    assert run_sheet(plan, judged(plan)) == SHEET


def test_no_line_has_more_than_100_characters_and_no_word_is_lost(tmp_path):
    path = tmp_path / ("long" * 40) / "cube.PTLIST"
    stimuli = (
        PlannedStimulus(name="oc", duration=2.0, solid="cube", strategy="oc"),
        PlannedStimulus(name="a name of a stimulus that is far longer than its column", duration=1.0, file=path),
    )
    plan = plan_of(
        *(pairs(f"block number {number} of many with a long name", sets=(("oc",),)) for number in range(40)),
        title="An experiment\x1b[2J " * 9, stimuli=stimuli, limits=Limits(on_time_max=None, duty_max=None),
    )  # fmt: skip
    sheet = run_sheet(plan, judged(plan))
    assert max(map(len, sheet.splitlines())) <= 100
    assert "\x1b" not in sheet
    assert str(path) in sheet.replace("\n    ", "")
    assert "a name of a stimulus that is far longer than its column\n" in sheet
    assert "1 fault: the study cannot be run before it is mended" in sheet
    assert "no block has it" in sheet.replace("\n  ", " ")
    assert "(no bound)" in sheet
