"""`palpate study analyse` from the command line to its files, what it refuses, and the power."""

import csv
import json

import numpy as np
import pytest
from answered_tables import PAPER, answer_row, paper_answers, plan_of, random_run, stimulus_text, table_of
from command_line import FAILED, MISUSED, answer, refused, run
from simulated_participants import simulate_study
from study_observers import paper_observers

from palpate.render.errors import StrategyError, StudyError
from palpate.render.study.analysis import command
from palpate.render.study.analysis import report_sections as sections
from palpate.render.study.analysis.power import FoundPower
from palpate.render.study.plan.study_reading import read_study
from palpate.render.study.run.answer_store import AnswerStore

POWER = ("--power", "--tables", "100")


@pytest.fixture
def plan(tmp_path):
    path = tmp_path / "paper.toml"
    path.write_text(PAPER.replace("repetitions = 5", "repetitions = 1"))
    return path


@pytest.fixture
def data(plan):
    return simulate_study(read_study(plan), paper_observers(3), plan.with_suffix(".data"))


@pytest.fixture
def without_pictures(monkeypatch):
    names = ("draw_measure", "draw_participants", "draw_scale")
    for name in names:
        monkeypatch.setattr(f"palpate.render.study.analysis.report_sections.{name}", lambda *_, **__: None)


@pytest.mark.exhaustive
def test_a_plan_names_its_data_and_everything_is_written(plan, data):
    found = answer("study", "analyse", plan)
    assert (found["participants"], found["answers"]) == (3, 3 * (6 * 2 + 6 * 2))
    folder = data / "analysis"
    names = {own.name for own in folder.iterdir()}
    assert {"report.html", "report.md", "answers.csv", "measures.csv", "tests.csv", "p_cc_participants.svg"} <= names
    report = (folder / "report.md").read_text()
    assert report.startswith("# Infill density: analysis")
    for name in names:
        if name.endswith(".svg"):
            assert f"]({name})" in report
    with (folder / "answers.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == found["answers"]
    assert {row["block_object"] for row in rows} == {"cube", "tube", "dog"}
    before = (folder / "answers.csv").read_bytes()
    refused(MISUSED, f"{folder / 'report.html'}: exists; --overwrite replaces it", "study", "analyse", data)
    assert run("study", "analyse", data, "--overwrite").exit_code == 0
    assert (folder / "answers.csv").read_bytes() == before


@pytest.mark.exhaustive
def test_facts_and_tables_of_a_folder_are_written_elsewhere(plan, data, tmp_path, without_pictures):
    found = answer("study", "analyse", data, "--output", tmp_path / "new" / "here")
    assert found["report"] == str(tmp_path / "new" / "here" / "report.html")
    assert "n = 3" in found["p_cc - 0.5"]
    assert not (data / "analysis").exists()


def test_data_without_answers_are_refused(plan):
    with AnswerStore(plan.with_suffix(".data"), read_study(plan)):
        pass
    sentence = f"{plan.with_suffix('.data')} has no answers yet: nobody has taken part"
    refused(FAILED, sentence, "study", "analyse", plan)


def test_data_of_another_plan_are_analysed_by_their_own_and_that_is_said(analysed, capsys):
    analysed.write_text("title = 'Another'")
    assert command.analyse_study({**NOTHING, "study": analysed}, as_json=False) == 0
    assert "is not the plan that is kept with the data, 'Infill density', which is used" in capsys.readouterr().err


def test_another_programs_database_is_refused(tmp_path):
    path = tmp_path / "answers.sqlite"
    path.write_bytes(b"not a database, and long enough to be looked at as one" * 40)
    result = run("study", "analyse", tmp_path)
    assert result.exit_code != 0
    assert str(path) in result.output
    assert "Traceback" not in result.output


def test_the_missing_extra_is_named_with_the_command_that_installs_it(plan, monkeypatch):
    monkeypatch.setattr(command, "find_spec", lambda _: None)
    refused(FAILED, 'statsmodels is missing: pip install "palpate[study]"', "study", "analyse", plan)


@pytest.mark.exhaustive
def test_power_says_how_many_participants_find_an_effect(plan):
    found = answer("study", "analyse", plan, *POWER, "--mean", "0.75")
    assert found["sought"] == "p_cc differs from chance"
    powers = {own["participants"]: own["power"] for own in found["powers"]}
    assert 3 in powers  # the plan's own
    assert powers[3] == 0.0  # of 3 participants no p is below 0.05
    assert found["needed"] == min(own for own, power in powers.items() if power >= 0.8)
    for own in found["powers"]:
        assert own["low"] <= own["power"] <= own["high"]
    text = run("study", "analyse", plan, *POWER, "--mean", "0.75").output
    assert "(planned)" in text
    assert json.dumps(found["needed"]) in text


def test_powers_are_shown_with_the_least_number_that_has_enough(plan, monkeypatch):
    powers = [FoundPower(participants=own, power=own / 10, low=own / 12, high=own / 9) for own in (3, 6, 8)]
    monkeypatch.setattr(command, "find_power", lambda _: powers)
    lines = run("study", "analyse", plan, *POWER, "--mean", "0.75").output.splitlines()
    assert [line.split() for line in lines[1:5]] == [
        ["participants", "power", "95", "%", "interval"],
        ["3", "(planned)", "0.30", "0.25", "to", "0.33"],
        ["6", "0.60", "0.50", "to", "0.67"],
        ["8", "0.80", "0.67", "to", "0.89"],
    ]
    assert answer("study", "analyse", plan, *POWER, "--mean", "0.75")["needed"] == 8
    monkeypatch.setattr(command, "find_power", lambda _: powers[:2])
    assert answer("study", "analyse", plan, *POWER, "--mean", "0.75")["needed"] == "more than 6"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--mean", "0.7"), "--mean is of --power"),
        (POWER, "--power needs --mean, the proportion of answers for cc that you expect, 0 to 1"),
        ((*POWER, "--mean", "1.5"), "--mean must be 0 to 1, not 1.5"),
        ((*POWER, "--mean", "0.5"), "--mean must differ from 0.5, with which it is compared: else there is no effect"),
        (
            (*POWER, "--mean", "0.7", "--measure", "joy"),
            "--measure must be one of p_cc, confidence, difficulty, not 'joy'",
        ),
        ((*POWER, "--mean", "5", "--measure", "confidence"), "confidence has no chance level"),
    ],
)
def test_questions_of_power_that_have_no_answer_are_refused(plan, options, message):
    result = run("study", "analyse", plan, *options)
    assert result.exit_code == MISUSED
    assert message in " ".join(result.output.split())


def test_power_is_of_a_plan_and_not_of_data(tmp_path):
    result = run("study", "analyse", tmp_path, *POWER, "--mean", "0.7")
    assert result.exit_code == MISUSED
    assert f"--power is computed from a plan, STUDY.toml, not {tmp_path}" in " ".join(result.output.split())


NO_POWER = dict.fromkeys(command.POWER_OPTIONS)
NOTHING = {"power": False, "data": None, "output": None, "overwrite": False, **NO_POWER}


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
    assert "\np_cc by opacity: opacity 1 - opacity 0.7 " in printed


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


PAIRS = '[[block]]\nname = "x"\ndesign = "2ifc"\npairs = [["a", "b"]]\nquestion = "Which one?"\n'


@pytest.fixture
def small_data(tmp_path, monkeypatch):
    """Data of one participant, whose study asks no scale and draws few pictures."""
    monkeypatch.setattr("palpate.render.study.run.study_file.sync", lambda *_: None)
    plan = plan_of(stimulus_text("a", "b"), PAIRS, participants=1)
    with AnswerStore(tmp_path / "data", plan) as store:
        store.begin("P01")
        for own in random_run(plan, "P01", np.random.default_rng(1)):
            store.add_answer(answer_row(own))
        store.finish()
    return tmp_path / "data"


@pytest.mark.parametrize("name", ["study.toml", "folder", "nothing"])
def test_without_answers_no_folder_is_made(tmp_path, name):
    (tmp_path / "folder").mkdir()
    with pytest.raises(StudyError, match="is not there"):
        command.analyse_study(NOTHING | {"study": tmp_path / name}, as_json=True)
    assert [own.name for own in tmp_path.rglob("*")] == ["folder"]


@pytest.mark.parametrize("name", ["report.md", "answers.csv", "fits.parquet"])
def test_a_file_that_is_there_is_kept(small_data, name):
    output = small_data.parent / "output"
    output.mkdir()
    (output / name).write_text("mine")
    with pytest.raises(StrategyError, match=f"{name}: exists; --overwrite replaces it"):
        command.analyse_study(NOTHING | {"study": small_data, "output": output}, as_json=True)
    assert [own.name for own in output.iterdir()] == [name]
    assert (output / name).read_text() == "mine"


@pytest.mark.exhaustive
def test_tables_of_an_analysis_that_is_replaced_do_not_stay_beside_it(small_data):
    command.analyse_study(NOTHING | {"study": small_data}, as_json=True)
    (small_data / "analysis" / "fits.csv").write_text("of another study")
    command.analyse_study(NOTHING | {"study": small_data, "overwrite": True}, as_json=True)
    assert not (small_data / "analysis" / "fits.csv").exists()
    assert (small_data / "analysis" / "answers.csv").exists()
