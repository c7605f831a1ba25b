"""Texts that lz-string packed as base64.

Outside truth: the packed texts were written by lz-string 1.3.3, as leapjs-playback ships it, under Node.
"""

import base64

import pytest

from palpate.datasets.bounded_file import LIMIT_VARIABLE, FileBoundError
from palpate.datasets.recordings.lz_string import decompress_base64


@pytest.mark.parametrize(
    ("packed", "text"),
    [
        ("BYUwNmD2CMoZAmOUDMzIBZ0FZ0DYgA==", "hello1hello2hello3hello4hello5hello6"),
        ("IY18ZJAA", "a" * 30),  # an entry is used before it is complete
        ("N4IgLglmA2CmIC4QAkBvALWACQ0kYgL5AAA=", '{"title":"Höhe 手"}'),  # characters of 8 and of 16 bits
        ("IZA=", "a"),
        ("IZ\nA", "a"),  # as some versions leave the padding out
        ("QAA=", ""),
        ("\ufeffIZA=", "a"),  # with a byte order mark
    ],
)
def test_a_packed_text_is_what_lz_string_was_given(packed, text):
    assert decompress_base64(packed.encode()) == text


def bits(text):
    """Base64 of bits."""
    text = text.replace(" ", "")
    text += "0" * (-len(text) % 8)
    return base64.b64encode(bytes(int(text[k : k + 8], 2) for k in range(0, len(text), 8)))


@pytest.mark.parametrize(
    ("packed", "said"),
    [
        (b"IZ!A", "not a text that lz-string packed as base64: "),
        (b"", "it breaks off"),
        (b"BYUwNmD2CMoZAmOUD", "it breaks off"),
        (bits("11"), "entry 3 of 3"),
        (bits("00 10000110 101"), "entry 5 of 4"),
    ],
)
def test_what_lz_string_did_not_pack_is_refused(packed, said):
    with pytest.raises(ValueError, match=said):
        decompress_base64(packed)


def test_a_packed_text_that_grows_beyond_the_budget_of_a_file_is_refused(monkeypatch):
    """An "a", then 2,000 entries, each the one before and an "a": 1.5 kB would be 2 MB of text."""
    codes, count = ["00", "10000110"], 4
    for _ in range(2000):
        codes.append(f"{count:0{count.bit_length()}b}"[::-1])
        count += 1
    packed = bits("".join(codes))
    monkeypatch.setenv(LIMIT_VARIABLE, "1")
    with pytest.raises(FileBoundError, match="what is packed in it takes 100"):
        decompress_base64(packed)
