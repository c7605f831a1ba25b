"""JSON of strangers: what is hostile is a ValueError that says why; what the standard library writes is read back."""

import json
import sys
import tracemalloc

import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.datasets.bounded_file import LIMIT_VARIABLE
from palpate.datasets.json_text import DEPTH_MOST, TEXT_MOST, parse_json, read_json

MARKS = st.text('[]{}"\\,:a\u00e9')  # brackets and quotes in texts must not be taken for those of lists
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text() | MARKS,
    lambda inner: st.lists(inner) | st.dictionaries(st.text() | MARKS, inner),
    max_leaves=30,
)


def deep(count, unit=("[", "]")):
    return unit[0] * count + "1" + unit[1] * count


@pytest.mark.exhaustive
@given(VALUES, st.booleans())
def test_what_the_standard_library_writes_is_read_back(value, allow_nan):
    text = json.dumps([value] * DEPTH_MOST, ensure_ascii=False)
    assert parse_json(text, allow_nan=allow_nan) == [value] * DEPTH_MOST
    assert parse_json(text.encode()) == [value] * DEPTH_MOST


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[" * 100_000, f"lie 100000 deep in each other, more than {DEPTH_MOST}"),
        (deep(DEPTH_MOST + 1), f"lie {DEPTH_MOST + 1} deep"),
        (deep(900, ('{"a":', "}")), "lie 900 deep"),
        (f'["]", "\\"]", {deep(DEPTH_MOST)}, "\\\\"]', f"lie {DEPTH_MOST + 1} deep"),
        ('{"a": 1, "a": 2}', "key 'a' more than once"),
        ("[NaN]", "NaN is not a finite number"),
        ('{"a": [-Infinity]}', "-Infinity is not a finite number"),
        ("-1e999", "-1e999 is not a finite number"),
        ("1" * 5000, "4300 digits"),
        (b'"\xff"', "utf-8"),
        ("[]".encode("utf-16"), "utf-8"),
        (r'{"a": "\ud800"}', "surrogates"),
        (r'{"\uDFFF": 1}', "surrogates"),
        ('"\ud800"', "surrogates"),
        ("", "Expecting value"),
        ("{'a': 1}", "Expecting property name"),
        (" " * (TEXT_MOST + 1), f"{TEXT_MOST + 1} bytes, expected at most {TEXT_MOST}"),
    ],
)
def test_what_is_hostile_is_refused_with_its_value(text, message):
    with pytest.raises(ValueError, match=message):
        parse_json(text)


def test_what_is_near_a_bound_is_read():
    closing = '", "\\"'.join("[" * DEPTH_MOST)  # brackets of texts, which close nothing and open nothing
    for text in (deep(DEPTH_MOST), f'["{closing}", {deep(DEPTH_MOST - 1)}]', r'"\ud83d\ude00"', "[1e308, 1.5]"):
        assert parse_json(text) == json.loads(text)
    assert parse_json("[Infinity, 1e999]", allow_nan=True) == [float("inf")] * 2


def test_a_key_that_is_there_twice_is_found_among_many_in_linear_time():
    """Comparing each of 50,000 keys with all others would take a minute of CPU; a quick test may take 0.3 s."""
    text = "{" + ",".join(f'"{number}":0' for number in [*range(50_000), 49_999]) + "}"
    with pytest.raises(ValueError, match="an object has the key '49999' more than once"):
        parse_json(text)


@pytest.mark.exhaustive
@pytest.mark.parametrize("unit", ["[],", "{},", '{"":0},', "0.5,", '"ab",', "[0],"])
def test_a_text_takes_no_more_memory_than_it_is_refused_for(unit, monkeypatch):
    monkeypatch.setenv(LIMIT_VARIABLE, "2")
    text = f"[{unit * (2_000_000 // len(unit))}0]"
    with pytest.raises(ValueError, match="what its text holds takes") as caught:
        parse_json(text)
    reported = int(str(caught.value).partition("takes ")[2].split()[0])
    monkeypatch.setenv(LIMIT_VARIABLE, "1000")
    tracemalloc.start()
    assert parse_json(text)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak - sys.getsizeof(text) <= reported < 5 * peak


def test_a_file_may_be_longer_than_a_message_and_begin_with_a_byte_order_mark(tmp_path):
    (tmp_path / "a.json").write_text("[1]" + " " * TEXT_MOST, encoding="utf-8-sig")
    assert read_json(tmp_path / "a.json") == [1]
