"""What `palpate study analyse` leaves in folders: nothing where it fails, and nothing of others where it does not."""

import pytest
from answered_tables import answer_row, plan_of, random_run, stimulus_text

from palpate.render.errors import StrategyError, StudyError
from palpate.render.study.analysis.command import POWER_OPTIONS, analyse_study
from palpate.render.study.run.answer_store import AnswerStore

OPTIONS = {"data": None, "output": None, "overwrite": False, "power": False, **dict.fromkeys(POWER_OPTIONS)}
PAIRS = '[[block]]\nname = "x"\ndesign = "2ifc"\npairs = [["a", "b"]]\nquestion = "Which one?"\n'


@pytest.fixture
def data(tmp_path, monkeypatch):
    """Data of one participant, whose study asks no scale and draws few pictures."""
    import numpy as np

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
        analyse_study(OPTIONS | {"study": tmp_path / name}, as_json=True)
    assert [own.name for own in tmp_path.rglob("*")] == ["folder"]


@pytest.mark.parametrize("name", ["report.md", "answers.csv", "fits.parquet"])
def test_a_file_that_is_there_is_kept(data, name):
    output = data.parent / "output"
    output.mkdir()
    (output / name).write_text("mine")
    with pytest.raises(StrategyError, match=f"{name}: exists; --overwrite replaces it"):
        analyse_study(OPTIONS | {"study": data, "output": output}, as_json=True)
    assert [own.name for own in output.iterdir()] == [name]
    assert (output / name).read_text() == "mine"


@pytest.mark.exhaustive
def test_tables_of_an_analysis_that_is_replaced_do_not_stay_beside_it(data):
    analyse_study(OPTIONS | {"study": data}, as_json=True)
    (data / "analysis" / "fits.csv").write_text("of another study")
    analyse_study(OPTIONS | {"study": data, "overwrite": True}, as_json=True)
    assert not (data / "analysis" / "fits.csv").exists()
    assert (data / "analysis" / "answers.csv").exists()
