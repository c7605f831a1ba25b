"""What stimuli name: built-in names in any case, and files beside the plan."""

import pytest

from palpate.render.study.plan.study_reading import StimulusSources
from palpate.render.sweeps.plan.values import PlanFault


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "circle.h5").write_text("never opened")
    (tmp_path / "mine.stl").write_text("never opened")
    (tmp_path / "own.py").write_text("raise SystemExit  # never run")
    (tmp_path / "slow.json").write_text('{"speed": 5.0}')
    (tmp_path / "bad.json").write_text('{"speed": "fast"}')
    (tmp_path / "filled.json").write_text('{"raw": "section"}')
    return tmp_path


def test_names_are_found_in_any_case_and_files_beside_the_plan(folder):
    sources = StimulusSources(folder)
    assert sources.find("object", "Dog_Detailed") == "dog-detailed"
    assert sources.find("shown", "mine.stl") == str(folder / "mine.stl")
    assert sources.find("object", "own.py:ball") == f"{folder / 'own.py'}:ball"
    assert sources.find("object", "package.module:ball") == "package.module:ball"
    assert sources.find("strategy", "CC") == "cc"
    assert sources.find("strategy", "filled.json") == str(folder / "filled.json")
    assert sources.find("sampling", "slow.json") == str(folder / "slow.json")
    assert sources.find("sampling", "multi_focus") == "multi-focus"
    assert sources.find("hand", "Palm") == "palm"
    assert sources.find("file", str(folder / "circle.h5")) == str(folder / "circle.h5")


@pytest.mark.parametrize(
    ("key", "text", "sentence"),
    [
        ("object", "tubs", "neither a built-in object .* nor a file in .*did you mean 'tube'"),
        ("object", "min.stl", "did you mean 'mine.stl'"),
        ("object", "owm.py:ball", "neither a module|no file"),
        ("strategy", "hatsch", "neither a strategy .*did you mean 'hatch'"),
        ("strategy", "slow.json", "speed"),
        ("sampling", "stmm", "did you mean 'stm'"),
        ("sampling", "bad.json", "speed"),
        ("hand", "plam", "did you mean 'palm'"),
        ("file", "circel.h5", "is no file in .*did you mean 'circle.h5'"),
        ("file", ".", "is no file"),
        ("file", "a\0b", "is no file"),
        ("file", "x" * 5000, "is no file"),
    ],
)
def test_what_stands_for_nothing_is_refused_each_time(folder, key, text, sentence):
    sources = StimulusSources(folder)
    for _ in range(2):
        with pytest.raises(PlanFault, match=sentence):
            sources.find(key, text)
