"""JSON is read with bounds: what is hostile is one kind of error that says why."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.datasets.json_text import DEPTH_MOST, parse_json

VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=30,
)


@pytest.mark.exhaustive
@given(VALUES)
def test_what_the_standard_library_writes_is_read_back(value):
    text = json.dumps(value, ensure_ascii=False)
    assert parse_json(text) == value
    assert parse_json(text.encode()) == value


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[" * 100_000, f"more than {DEPTH_MOST} deep"),
        ("[" * 100_000 + "]" * 100_000, f"more than {DEPTH_MOST} deep"),
        ('{"a":' * 900 + "1" + "}" * 900, f"more than {DEPTH_MOST} deep"),
        ('{"a": 1, "a": 2}', "key 'a' more than once"),
        ("[NaN]", "nan is not a finite number"),
        ('{"a": [-Infinity]}', "-inf is not a finite number"),
        ("1e999", "inf is not a finite number"),
        ("1" * 5000, "4300 digits"),
        (b'"\xff"', "utf-8"),
        ("[]".encode("utf-16"), "utf-8"),
        (r'{"a": "\ud800"}', "surrogates"),
        (r'{"\ud800": 1}', "surrogates"),
        ("", "Expecting value"),
        ("{'a': 1}", "Expecting property name"),
        (" " * 101, "101 bytes, expected at most 100"),
    ],
)
def test_what_is_hostile_is_refused_with_its_value(text, message):
    with pytest.raises(ValueError, match=message):
        parse_json(text, text_most=100 if len(text) == 101 else 1 << 24)


def test_numbers_beyond_the_finite_are_read_where_they_may_stand():
    assert parse_json("[Infinity, 1e999]", allow_nan=True) == [float("inf")] * 2
