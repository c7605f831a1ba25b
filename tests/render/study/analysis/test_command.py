"""`palpate study analyse` from the command line to its files, what it refuses, and the power."""

import csv
import json

import numpy as np
import pytest
from answered_tables import PAPER, answer_row, plan_of, random_run, stimulus_text
from command_line import FAILED, MISUSED, answer, refused, run
from simulated_participants import simulate_study
from study_observers import paper_observers

from palpate.render.errors import StrategyError, StudyError
from palpate.render.study.analysis import command
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


NO_POWER = dict.fromkeys(command.POWER_OPTIONS)
NOTHING = {"power": False, "data": None, "output": None, "overwrite": False, **NO_POWER}


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


@pytest.mark.parametrize("name", ["report.md", "answers.csv"])
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
