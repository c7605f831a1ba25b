"""What `palpate study analyse` prints, and what it refuses before it computes anything."""

import json

import pytest
from answered_tables import PAPER, paper_answers, plan_of, table_of

from palpate.render.errors import StudyError
from palpate.render.study.analysis import command
from palpate.render.study.analysis import report_sections as sections

POWER = dict.fromkeys(command.POWER_OPTIONS)
NOTHING = {"power": False, "data": None, "output": None, "overwrite": False, **POWER}


@pytest.fixture
def analysed(monkeypatch, tmp_path):
    """A plan whose data are eight participants, all of whom call closed contours denser; no picture is drawn."""
    plan = plan_of(PAPER.replace("participants = 3", "participants = 8"))
    rows = ["1111111111 7 1", "1111111110 6 2", "1111111100 5 3", "1111111000 4 4", "1111110000 3 5", "1111100000 2 6"]
    table = table_of(plan, *(paper_answers(code, rows) for code in plan.codes))
    monkeypatch.setattr(command, "read_answers", lambda folder: table)
    for name in [own for own in vars(sections) if own.startswith("draw_")]:
        monkeypatch.setattr(sections, name, lambda *values, **options: None)
    path = tmp_path / "study.toml"
    path.touch()
    path.with_suffix(".data").mkdir()
    return path


def test_the_terminal_names_measures_and_factors_as_tables_do(analysed, capsys):
    assert command.analyse_study({**NOTHING, "study": analysed}, as_json=False) == 0
    printed = capsys.readouterr().out
    assert "\np_cc - 0.5 " in printed
    assert "\np_cc by object: cube - tube " in printed
    assert "\np_cc by opacity: 1 - 0.7 " in printed


def test_json_has_the_same_names(analysed, capsys):
    assert command.analyse_study({**NOTHING, "study": analysed}, as_json=True) == 0
    facts = json.loads(capsys.readouterr().out)
    assert {"participants", "answers", "p_cc - 0.5", "p_cc by object: cube - tube", "report"} <= facts.keys()


@pytest.mark.parametrize(
    ("is_there", "message"),
    [
        (True, "study.data is not there: nobody has taken part yet, or --data names another folder"),
        (False, "study.data is not there: nor is "),
    ],
)
def test_a_plan_without_data_is_refused_with_what_to_do(tmp_path, is_there, message):
    plan = tmp_path / "study.toml"
    if is_there:
        plan.touch()
    with pytest.raises(StudyError, match=message):
        command.analyse_study({**NOTHING, "study": plan}, as_json=False)
    assert not (tmp_path / "study.data").exists()
