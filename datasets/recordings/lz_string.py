"""Texts that lz-string's `compressToBase64` wrote, as leapjs-playback keeps recordings (`.json.lz`).

The text is base64 of a stream of bits, most significant first. A code in it has its least significant bit first, and
as many bits as the number of entries needs. It stands for an entry, a text that occurred before, and each code adds
another entry: the text before and its own first character.

| code | stands for                                               |
|------|----------------------------------------------------------|
| 0    | a new entry: the character whose 8 bits follow           |
| 1    | a new entry: the character whose 16 bits follow          |
| 2    | the end                                                  |
| n    | entry n; the first has number 3                          |
"""

import base64
import binascii
import codecs

from ..bounded_file import require_bytes

_CHARACTER_BITS = {0: 8, 1: 16}
_END = 2
_BLOCK = 8192  # [byte] whose bits are made a text at a time
_NOT_ONE = "not a text that lz-string packed as base64"


class _Bits:
    """A stream of bits."""

    def __init__(self, content: bytes) -> None:
        self._content, self._next = content, 0
        self._bits, self._at = "", 0

    def take(self, count: int) -> int:
        """The next number of `count` bits, at most 64; ValueError where the stream is over."""
        if len(self._bits) - self._at < count:
            block = self._content[self._next : self._next + _BLOCK]
            self._next += _BLOCK
            self._bits = self._bits[self._at :] + "".join(f"{byte:08b}" for byte in block)
            self._at = 0
            if len(self._bits) < count:
                raise ValueError(f"{_NOT_ONE}: it breaks off")
        self._at += count
        return int(self._bits[self._at - count : self._at][::-1], 2)


def decompress_base64(text: bytes) -> str:
    """The text that was packed; raises ValueError where none was, FileBoundError beyond the budget of a file."""
    plain = b"".join(text.removeprefix(codecs.BOM_UTF8).split()).rstrip(b"=")
    try:
        bits = _Bits(base64.b64decode(plain + b"A" * (-len(plain) % 4), validate=True))
    except binascii.Error as error:
        raise ValueError(f"{_NOT_ONE}: {error}") from None
    entries = [""] * 3  # so that entry n has number n
    out: list[str] = []
    size, before = 0, ""
    while True:
        code = bits.take(len(entries).bit_length() if out else 2)
        if code == _END:
            return "".join(out)
        if code in _CHARACTER_BITS:
            entries.append(chr(bits.take(_CHARACTER_BITS[code])))
            entry = entries[-1]
        elif code < len(entries):
            entry = entries[code]
        elif code == len(entries) and before:
            entry = before + before[0]
        else:
            raise ValueError(f"{_NOT_ONE}: entry {code} of {len(entries)}")
        if before:
            entries.append(before + entry[0])
        out.append(entry)
        before = entry
        size += len(entry)
        require_bytes(size, "what is packed in it")
