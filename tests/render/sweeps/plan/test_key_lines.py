"""Lines of keys in TOML texts: every table, key and array element where it stands, whatever strings look like."""

import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.render.sweeps.plan.key_lines import key_lines, line_of

TEXT = '''metrics = [
  "contours",   # ] not the end
  "frequency",
]
name = """
[object]
x = 1 \\""" "
"""
odd = \'\'\'[hand]
\'\'\'
"d.o\\u0074" = 3
[object]
source = ["cu]be", 'a#b', "x\\"y"]
fit = { from = 1, to = [2.0, 3], "c.d" = "}" }
[[exclude]]
"strategy.source" = "hatch"
a.b = 1979-05-27 07:32:00
[[exclude]]
at = [[0, 0,
  0.2], # c
  [1,2,3]]
[exclude.sub]
k = true
[[exclude.tables]]
[[exclude.tables]]
 deep = 1
'''


@pytest.mark.parametrize(
    ("place", "line"),
    [
        (("metrics",), 1),
        (("metrics", 1), 3),
        (("name",), 5),
        (("odd",), 9),
        (("d.ot",), 11),
        (("object",), 12),
        (("object", "source", 2), 13),
        (("object", "fit", "to", 1), 14),
        (("object", "fit", "c.d"), 14),
        (("exclude", 0, "strategy.source"), 16),
        (("exclude", 0, "a", "b"), 17),
        (("exclude", 1), 18),
        (("exclude", 1, "at", 0, 2), 20),
        (("exclude", 1, "at", 1), 21),
        (("exclude", 1, "sub", "k"), 23),
        (("exclude", 1, "tables", 1, "deep"), 26),
    ],
)
def test_every_thing_is_found_on_its_line(place, line):
    assert key_lines(TEXT)[place] == line


def test_what_strings_and_comments_hold_is_nothing():
    assert ("x",) not in key_lines(TEXT)
    assert ("hand",) not in key_lines(TEXT)
    assert key_lines("# [object]\n\r\n") == {}


def test_what_is_not_there_has_the_line_of_what_is_around_it():
    lines = key_lines(TEXT)
    assert line_of(lines, ("object", "at", 3)) == 12
    assert line_of(lines, ("exclude", 1, "nothing")) == 18
    assert line_of(lines, ("hand", "palm")) is None


NAMES = st.text("abc-_", min_size=1, max_size=4)
VALUES = st.recursive(
    st.integers(-9, 9) | st.booleans() | st.sampled_from(["", "[a]", "x = 1", '"', "'", "#", "\\", "a\nb = 2", "{"]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(NAMES, inner, max_size=3),
    max_leaves=6,
)


def written(value):
    """TOML of a value on as few lines as can be."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {written(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(written, value)) + "]"
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n") + '"'
    return str(value)


@pytest.mark.exhaustive
@given(
    st.lists(st.tuples(NAMES, st.dictionaries(NAMES, VALUES, max_size=3)), max_size=4), st.sampled_from(["\n", "\r\n"])
)
def test_keys_written_one_a_line_are_found_there(tables, end):
    text, places, counts = [], {}, {}
    for name, content in tables:
        k = counts[name] = counts.get(name, -1) + 1
        text += ["# [comment]", f" [[{name}]]  # x"]
        places[name, k] = len(text)
        for key, value in content.items():
            text.append(f"{key} = {written(value)}")
            places[name, k, key] = len(text)
    lines = key_lines(end.join(text))
    tomllib.loads(end.join(text))
    assert {place: line for place, line in lines.items() if place in places} == places
    assert {place for place in lines if len(place) == 3} == {place for place in places if len(place) == 3}
