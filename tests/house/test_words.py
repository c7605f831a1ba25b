"""The field's words: a word that had several meanings, or none outside this project, does not come back in a name."""

import ast
import re

import pytest
from rooms import ROOT, SOURCES, tree_of

INSTEAD = {
    "course": "timing",
    "door": "start: a point from which a polyline may be drawn",
    "doors": "starts",
    "knot": "parameter: the curve parameter",
    "knots": "parameters",
    "track": "cycle: a closed path laid out in time",
    "tracks": "cycles",
    "way": "segment, distance, or direction",
    "ways": "segments",
}
FOLDERS = ("kernels/sampling", "render/sampling")


def words_of(tree):
    """Words of the names that a module gives to its functions, classes, parameters, variables and fields."""
    for node in ast.walk(tree):
        name = (
            node.name
            if isinstance(node, ast.FunctionDef | ast.ClassDef)
            else node.arg
            if isinstance(node, ast.arg)
            else node.id
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
            else ""
        )
        for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+", name):
            yield name, word.lower()


@pytest.mark.parametrize("folder", FOLDERS)
def test_names_use_the_words_of_the_field(folder):
    paths = [path for path in SOURCES if path.relative_to(ROOT).as_posix().startswith(f"{folder}/")]
    assert paths
    found = {
        f"{path.name}: {name}: {INSTEAD[word]}"
        for path in paths
        for name, word in words_of(tree_of(path))
        if word in INSTEAD
    }
    found |= {f"{path.name}: {INSTEAD[path.stem]}" for path in paths if path.stem in INSTEAD}
    assert found == set()


def test_words_of_a_name_are_found_whatever_its_kind():
    text = "class TrackNodes:\n    knot: int\ndef find_way(door): DOOR_ROOM = door"
    assert sorted({word for _, word in words_of(ast.parse(text))}) == [
        "door",
        "find",
        "knot",
        "nodes",
        "room",
        "track",
        "way",
    ]
