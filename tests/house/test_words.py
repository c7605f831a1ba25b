"""The field's words: a word that had several meanings, or none outside this project, does not come back in a name."""

import ast
import re

import pytest
from rooms import SOURCES, folder_of, tree_of

TERMS = {
    "course": "timing, or cycle",
    "door": "start: a point from which a polyline may be drawn",
    "kept": "stored, drawn or chosen",
    "knot": "parameter: the curve parameter",
    "rough": "float32, or what is left out",
    "taken": "claimed, or used",
    "track": "cycle: a closed path laid out in time",
    "way": "segment, length or direction",
}
IN_SECTIONS = {"row": "query: a section that is searched", "roughly": "in float32"}
WITH_MORE = ("kernels/section",)
FOLDERS = {folder_of(path): TERMS for path in SOURCES if folder_of(path).split("/")[0] == "kernels"}
RENDERING = "sampling", "intersection", "stages", "hands", "playback"
FOLDERS |= dict.fromkeys((f"render/{folder}" for folder in RENDERING), TERMS)
FOLDERS |= dict.fromkeys(WITH_MORE, TERMS | IN_SECTIONS)


def names_of(tree):
    """Names that a module gives to its functions, classes, parameters, variables and fields."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.arg):
            yield node.arg
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id


def words_of(name):
    """Words of a name, in the singular."""
    return {word.lower().removesuffix("s") for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+", name)}


@pytest.mark.parametrize("folder", FOLDERS)
def test_names_use_the_words_of_the_field(folder):
    terms = FOLDERS[folder]
    paths = [path for path in SOURCES if folder_of(path) == folder]
    assert paths
    found = {(path.name, name) for path in paths for name in (path.stem, *names_of(tree_of(path)))}
    assert {(*at, word, terms[word]) for at in found for word in words_of(at[1]) & terms.keys()} == set()


def test_words_are_found_in_names_of_any_kind():
    tree = ast.parse("class TrackNodes:\n    knot: int\ndef find_ways(door): DOOR_ROOM = door")
    assert [words_of(name) & TERMS.keys() for name in names_of(tree)] == [
        {"track"},
        {"way"},
        {"knot"},
        {"door"},
        {"door"},
    ]
