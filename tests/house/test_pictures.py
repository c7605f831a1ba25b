"""Pictures of the documents are what the code draws, and the comparison finds what is not."""

import copy
import re
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest
from matplotlib.figure import Figure

ROOT = Path(__file__).parents[2]
spec = spec_from_file_location("pictures", ROOT / "docs" / "pictures.py")
assert spec is not None
assert spec.loader is not None
pictures = module_from_spec(spec)
spec.loader.exec_module(pictures)


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", pictures.PICTURES)
def test_each_picture_is_what_the_code_draws(name):
    assert pictures.problems(name) == []


def test_every_picture_that_a_page_shows_is_made_by_the_command():
    shown = set()
    for page in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]:
        shown |= {(page.parent / name).resolve() for name in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", page.read_text())}
    assert {str(path.relative_to(ROOT / "docs")) for path in shown} == {
        *pictures.PICTURES,
        *pictures.ELSEWHERE,
    }


def figure(**changes):
    """A small figure of every kind of mark."""
    look = {"at": 0.5, "colour": "#b1121f", "text": "a tube", "dot": True, **changes}
    made = Figure()
    axes = made.add_subplot()
    axes.plot([0, 1, 2], [0, look["at"], 1], color=look["colour"], label="length")
    axes.fill_between([0, 1, 2], 0, [0.2, 0.3, 0.4], color="#999999")
    if look["dot"]:
        axes.plot([1], [0.5], "o")
    axes.set_title(look["text"])
    axes.set_ylim(0, 1)
    axes.legend()
    made.canvas.draw()
    return made


@pytest.mark.parametrize(
    ("changes", "count"), [({"at": 0.51}, 1), ({"colour": "#b1121e"}, 1), ({"text": "a dog"}, 1), ({"dot": False}, 1)]
)
def test_a_moved_line_another_colour_another_word_and_a_missing_mark_are_found(changes, count):
    stands = pictures.drawn(figure())
    assert pictures.differences(stands, pictures.drawn(figure())) == []
    assert len(pictures.differences(stands, pictures.drawn(figure(**changes)))) >= count


def test_rounding_is_no_difference():
    stands = pictures.drawn(figure())
    moved = copy.deepcopy(stands)
    for entry in moved:
        if "extent" in entry:
            entry["extent"] = [value + 5e-4 for value in entry["extent"]]
    assert pictures.differences(stands, moved) == []


def test_a_picture_that_carries_nothing_is_told(tmp_path, monkeypatch):
    figure().savefig(tmp_path / "a.png", dpi=10)
    monkeypatch.setattr(pictures, "DOCS", tmp_path)
    monkeypatch.setitem(pictures.PICTURES, "a.png", figure)
    assert pictures.problems("a.png") == ["a.png does not carry what was drawn"]


def test_a_picture_that_is_written_carries_what_was_drawn(tmp_path, monkeypatch):
    monkeypatch.setattr(pictures, "DOCS", tmp_path)
    monkeypatch.setitem(pictures.PICTURES, "a.png", figure)
    pictures.write("a.png")
    assert pictures.problems("a.png") == []
