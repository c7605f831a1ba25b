"""A module's source reduced to what Python runs: without comments, docstrings, blank lines and trailing blanks.

A regular expression finds strings and comments. `ast` has other trees in other versions of Python, and `tokenize` other
tokens; both take ten times as long, and every start of a command would wait. A test compares this with `tokenize`.
"""

import re
from itertools import accumulate

_OPAQUE = re.compile(
    r"#[^\n]*"
    r'|"""[^"\\]*(?:(?:\\.|"{1,2}(?!"))[^"\\]*)*"""'
    r"|'''[^'\\]*(?:(?:\\.|'{1,2}(?!'))[^'\\]*)*'''"
    r'|"[^"\\\n]*(?:\\.[^"\\\n]*)*"'
    r"|'[^'\\\n]*(?:\\.[^'\\\n]*)*'",
    re.DOTALL,
)
"""Comments and string literals: text whose brackets and quotation marks mean nothing."""
_LITERAL, _LONE = '"', "\0"  # what stands for a string literal; for one that has its lines for itself


def bare_source(source: str) -> tuple[str, list[str]]:
    """Reduce a module's source: its code, in which a quotation mark stands for each string literal, and the literals.

    A string that is a statement of its own counts as a docstring wherever it stands, because it has no effect. Raises
    ValueError if brackets do not match.
    """
    strings: list[str] = []
    lone: list[int] = []

    def mask(match: re.Match[str]) -> str:
        text, start, end = match[0], match.start(), match.end()
        if text[0] == "#":
            return ""
        line = source.rfind("\n", 0, start) + 1
        before, after = source[line:start], source[end : source.find("\n", end)]
        strings.append(text)
        if before.strip(" \trRuU") or after.partition("#")[0].strip() or source.endswith("\\\n", 0, line):
            return _LITERAL
        lone.append(len(strings) - 1)
        return _LONE

    pieces = _OPAQUE.sub(mask, source).split(_LONE)
    depths = list(accumulate(map(_opened, pieces)))
    if depths[-1]:
        raise ValueError(f"brackets do not match: {depths[-1]} more are opened than closed")
    docstrings = {number for number, depth in zip(lone, depths, strict=False) if depth == 0}
    for place, depth in enumerate(depths[:-1]):
        pieces[place] = pieces[place] + _LITERAL if depth else pieces[place].rstrip(" \trRuU")
    lines = filter(None, map(str.rstrip, "".join(pieces).split("\n")))
    return "\n".join(lines), [text for number, text in enumerate(strings) if number not in docstrings]


def _opened(code: str) -> int:
    """How many more brackets are opened than closed."""
    return sum(map(code.count, "([{")) - sum(map(code.count, ")]}"))
