"""Tables that stand for several: values put into texts, types that stay, and what of a `for` is refused."""

import pytest

from palpate.render.study.plan.study_reading import expand_table


def expand(table):
    """The tables, and the faults."""
    faults = []
    return expand_table(table, lambda place, sentence: faults.append((place, sentence))), faults


def test_a_table_stands_for_every_combination_the_last_key_fastest():
    table = {
        "for": {"a": ["x", "y"], "b": [1, 2.5, 1.0]},
        "name": "{a}-{b}",
        "b": "{b}",
        "deep": {"{a}": [["{a}"], 3, "{{a}} {1} {b}"]},
    }
    found, faults = expand(table)
    assert faults == []
    assert [own["name"] for own in found] == ["x-1", "x-2.5", "x-1.0", "y-1", "y-2.5", "y-1.0"]
    assert [own["b"] for own in found[:3]] == [1, 2.5, 1.0]
    assert type(found[0]["b"]) is int  # a number alone stays one
    assert found[3]["deep"] == {"{a}": [["y"], 3, "{a} {1} 1"]}
    assert "for" not in found[0]
    assert "for" in table


def test_a_table_without_for_stays_as_it_is():
    table = {"text": "{x} {{y}}"}
    assert expand(table) == ([table], [])


@pytest.mark.parametrize(
    ("choices", "place", "sentence"),
    [
        ({}, (), "must be a table of lists"),
        (["cube"], (), "must be a table of lists"),
        ({"a": "cube"}, ("a",), "must be a list of at least one value, not 'cube'"),
        ({"a": []}, ("a",), "must be a list of at least one value, not []"),
        ({"a": [[1]]}, ("a",), "must be a list of texts, or of numbers in +-1e+12, not [[1]]"),
        ({"a": [True]}, ("a",), "must be a list of texts, or of numbers in +-1e+12, not [True]"),
        ({"a": [float("nan")]}, ("a",), "must be a list of texts, or of numbers in +-1e+12, not [nan]"),
        ({"a": [16**5000]}, ("a",), "must be a list of texts, or of numbers in +-1e+12, not a list with too large a"),
        ({"a": ["x", "x"]}, ("a",), "must be a list of different values"),
        ({"a": [1, "1"]}, ("a",), "must be a list of different values"),  # their names would be the same
        ({"a b": ["x"]}, ("a b",), "must be called by letters, digits and _"),
        ({key: list(range(32)) for key in "abcdefgh"}, (), "at most 1000 combinations"),
    ],
)
def test_a_for_that_cannot_be_used_is_refused(choices, place, sentence):
    found, ((where, what),) = expand({"for": choices, "name": "{a}"})
    assert (found, where) == ([], ("for", *place))
    assert sentence in what


def test_placeholders_that_are_unknown_or_unused_are_reported_where_they_stand():
    _, faults = expand({"for": {"object": ["cube"], "size": [1]}, "pairs": [["a", "{objekt}"]]})
    assert faults == [
        (
            ("pairs", 0, 1),
            "{objekt} is no key of this table's `for` (did you mean 'object'?); known: object, size",
        ),
        (("for", "object"), "is not used: no other value of the table contains {object}"),
        (("for", "size"), "is not used: no other value of the table contains {size}"),
    ]
