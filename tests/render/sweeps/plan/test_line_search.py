"""Lines of keys in TOML texts: every table, key and array element where it stands, whatever strings look like."""

import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.render.sweeps.plan.line_search import line_of

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


PLACES = [
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
    (("exclude", 1, "at", 0, 2), 19),  # an element within an element has the line of the outer one
    (("exclude", 1, "at", 1), 21),
    (("exclude", 1, "sub", "k"), 23),
    (("exclude", 1, "tables", 1, "deep"), 26),
]


def test_every_place_is_found_on_its_line():
    for place, line in PLACES:
        assert line_of(TEXT, place) == line_of(TEXT.replace("\n", "\r\n"), place) == line


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ('a = [\n1,\n# c\n\n2,\n"t"]\nx = 2', 5),
        ("a = [1,\n2]", 2),
        ("a = [1, # ]\n\n[2, 3],\n]", 3),
        ('a = [1, """\n""", 2,\n3]', 1),  # the string hides where the second element begins
        ("a = [1\n, 2]", 1),  # so does a comma that begins a line
        ("a = [[1,\n2],\n[3]]", 3),
    ],
)
def test_an_element_has_its_own_line_unless_that_is_in_doubt(text, line):
    assert line_of(text, ("a", 1)) == line


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
    whole = end.join(text)
    tomllib.loads(whole)
    assert {place: line_of(whole, place) for place in places} == places
