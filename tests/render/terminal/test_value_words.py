"""Tables say values in words, with units."""

from palpate.render.terminal.value_words import UNITS, WORDS, words_of


def test_levels_have_words_and_units_in_tables():
    assert words_of("db_40_300") == "noise, 40 to 300 Hz"
    assert words_of("jump_length") == "jump length"
    assert [UNITS[name] for name in ("db_40_300", "dba", "held")] == ["dB", "dB(A)", "focal points"]
    assert len(set(WORDS.values())) == len(WORDS)  # two values never have the same words
