"""TOML of plans, read within bounds."""

import re
import tomllib
from typing import Any

TOML_MOST = 1 << 24
"""Most characters of one TOML text, a hundred times the longest sweep plan."""
KEY_PARTS_MOST = 32
"""Most parts of one dotted key."""

# One bare or quoted part of a key and its dot; possessive quantifiers never backtrack, so matching takes linear time.
_PART = r"""(?>(?<![A-Za-z0-9_-])[A-Za-z0-9_-]++|(?<!\\)"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+"""
_LONG_KEY = re.compile(f"(?:{_PART}){{{KEY_PARTS_MOST}}}")


def parse_toml(text: str) -> dict[str, Any]:
    """The table of a TOML text.

    Raises ValueError (tomllib.TOMLDecodeError) if it is not TOML, is nested too deeply, has more than TOML_MOST
    characters, or more than KEY_PARTS_MOST parts joined by dots, also in a text or a comment. The reason: memory of
    Python's parser grows with the square of a key's parts, to 4 GB for a key of 60 kB.
    """
    if len(text) > TOML_MOST:
        raise ValueError(f"it holds {len(text)} characters, more than {TOML_MOST}")
    if found := _LONG_KEY.search(text):
        line = text.count("\n", 0, found.start()) + 1
        raise ValueError(f"a key has more than {KEY_PARTS_MOST} parts (at line {line})")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("nested too deeply") from None
