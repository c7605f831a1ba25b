"""JSON of bounded size, whose objects name each key once."""

import pytest

from palpate.datasets.json_text import parse_json


def test_a_key_that_is_there_twice_is_found_among_many_in_linear_time():
    """Comparing each of 50,000 keys with all others would take a minute of CPU; a quick test may take 0.3 s."""
    text = "{" + ",".join(f'"{number}":0' for number in [*range(50_000), 49_999]) + "}"
    with pytest.raises(ValueError, match="an object has the key '49999' more than once"):
        parse_json(text)
