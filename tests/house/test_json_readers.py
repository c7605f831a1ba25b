"""One reader of JSON: text that another program may have written goes through `datasets.json_text`."""

import ast

import pytest
from rooms import ROOT, SOURCES, tree_of

UNBOUNDED = {
    "datasets/json_text.py": "the reader itself",
    "device/live/writer_handle.py": "a message of palpate's own process",
    "device/live/writer_process.py": "a message of palpate's own process, and the file that it names",
    "device/playing/limits.py": "a package that imports no other; it bounds depth and digits itself",
    "render/live/renderer_handle.py": "a message of palpate's own process",
    "render/live/renderer_process.py": "a message of palpate's own process",
    "render/live/spool.py": "what it wrote to a text in the same line",
    "render/study/run/store_rows.py": "what it wrote to a text in the line before",
    "render/sweeps/make/rendering.py": "parts of a recipe that it wrote to texts after reading it",
    "render/sweeps/run/engine.py": "a recipe that palpate's planner made",
    "render/view/served/noise_levels.py": "the output of palpate's own process",
}


def parses_json(tree):
    """Whether a module names a parser of the standard library's json."""
    names = {"load", "loads", "JSONDecoder"}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module == "json" and names & {own.name for own in node.names}:
            return True
        if isinstance(node, ast.Attribute) and node.attr in names and getattr(node.value, "id", "") == "json":
            return True
    return False


def test_only_listed_modules_parse_json_without_bounds():
    found = {path.relative_to(ROOT).as_posix() for path in SOURCES if parses_json(tree_of(path))}
    assert found == UNBOUNDED.keys()


@pytest.mark.parametrize("text", ["json.loads(a)", "from json import load", "read = json.load", "json.JSONDecoder()"])
def test_a_parser_is_found_however_it_is_named(text):
    assert parses_json(ast.parse(text))
    assert not parses_json(ast.parse("json.dumps(a); pickle.loads(a)"))
