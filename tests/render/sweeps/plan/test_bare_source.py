"""Sources without comments and docstrings: what Python's own tokenizer leaves of them, in each version of Python."""

import io
import json
import re
import subprocess
import sys
import tokenize
from pathlib import Path

import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from palpate.render.sweeps.plan import bare_source as bare_module
from palpate.render.sweeps.plan.bare_source import bare_source
from palpate.render.sweeps.plan.code_version import HOUSE, PACKAGES

SOURCES = sorted(path for name in PACKAGES for path in (HOUSE / name).rglob("*.py"))
LAYOUT = {tokenize.COMMENT, tokenize.NL, tokenize.ENCODING, tokenize.ENDMARKER}
STARTS = {tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT}


def tokens(source):
    """Tokens without layout, comments and strings that are statements of their own."""
    found = [t for t in tokenize.generate_tokens(io.StringIO(source).readline) if t.type not in LAYOUT]
    out = []
    for place, token in enumerate(found):
        is_first = place == 0 or found[place - 1].type in STARTS
        is_alone = is_first and token.type == tokenize.STRING and found[place + 1].type == tokenize.NEWLINE
        if is_alone and token.string.lower()[0] in "'\"ru" and not token.string.lower().startswith("rb"):
            found[place + 1] = found[place + 1]._replace(type=tokenize.DEDENT)  # its line's end goes, too
        elif token.type not in {tokenize.INDENT, tokenize.DEDENT}:
            out.append((token.type, token.string if token.type != tokenize.NEWLINE else ""))
    return out


def restored(code, strings):
    """Code with its string literals put back."""
    pieces = code.split('"')
    assert len(pieces) == len(strings) + 1
    return "".join(text for pair in zip(pieces, [*strings, ""], strict=True) for text in pair)


@pytest.mark.exhaustive
@pytest.mark.skipif(sys.version_info >= (3, 12), reason="this version splits f-strings, so lone strings look otherwise")
def test_every_module_has_the_tokens_that_python_sees():
    for path in SOURCES:
        source = path.read_text()
        left = restored(*bare_source(source))
        expected = [own for own in tokens(source) if own[0] != tokenize.NEWLINE]
        try:
            seen = [own for own in tokens(left) if own[0] != tokenize.NEWLINE]
        except IndentationError:  # a class or function with nothing but a docstring
            seen = [own for own in tokens(left.replace(":\n", ": ...\n")) if own[1] != "..."]
            expected = [own for own in expected if own[1] != "..."]
        assert seen == expected, path


KEPT = [
    'x = "a # no comment"',
    "x = '''\n# no comment\n\n'''",
    'x = (\n    "lone"\n    "lone, too"\n)',
    'f(\n    """\n    code\n    """\n)',
    'x = \\\n    "lone"',
    'b"bytes"',
    'f"{call()}"',
    'x = r"\\\\"\ny = "it\'s"',
    '"""doc""" "continued"',
]


def test_strings_that_are_values_stay():
    for source in KEPT:
        code, strings = bare_source(source)
        assert restored(code, strings).split() == source.split()
        assert strings


GONE = ['"""doc"""', "r'''doc\n\n# of it\n'''", '"doc"  # noqa', "def f():\n    '''doc'''", "# only this", "\n \n"]


def test_docstrings_comments_and_blank_lines_go():
    for source in GONE:
        code, strings = bare_source(f"{source}\nx = 1\n\n\n")
        assert strings == []
        assert code.removeprefix("def f():\n") == "x = 1"


PIECES = st.sampled_from(["a", "f(", "[", ")", "]", "'", '"', '"""', "\\", "#", " ", "\n", "r", "1"])


@given(st.lists(PIECES, max_size=30).map(lambda pieces: "".join([*pieces, "\n"])))
@example("a\\\n.b # c")
def test_what_python_can_read_keeps_its_tokens(source):
    assume(not re.search(r"\\\n\s*(#|$)", source))  # a line that goes on into nothing: no formatter writes that
    try:
        compile(source, "", "exec")
        expected = tokens(source)
    except (SyntaxError, tokenize.TokenError, ValueError):
        return
    code, strings = bare_source(source)
    left = tokens(restored(code, strings))
    ends = {tokenize.NEWLINE}
    assert [own for own in left if own[0] not in ends] == [own for own in expected if own[0] not in ends]


def test_brackets_that_do_not_match_are_refused():
    with pytest.raises(ValueError, match="1 more are opened than closed"):
        bare_source("f((1)")


OTHERS = [
    path
    for name in ("3.12", "3.13", "3.14")
    for path in sorted(Path(sys.base_prefix).parent.glob(f"{name}.*/bin/python"))[:1]
]


@pytest.mark.exhaustive
@pytest.mark.skipif(not OTHERS, reason="no other version of Python is installed beside this one")
@pytest.mark.parametrize("python", OTHERS, ids=lambda path: path.parts[-3])
def test_other_versions_of_python_leave_the_same(python):
    code = f"""
import sys, json, hashlib
sys.path.insert(0, {str(Path(bare_module.__file__).parent)!r})
from bare_source import bare_source
texts = [repr(bare_source(open(path).read())) for path in sys.stdin.read().split()]
print(json.dumps([hashlib.sha256(text.encode()).hexdigest() for text in texts]))
"""
    names = "\n".join(map(str, SOURCES))
    runs = [
        subprocess.run([own, "-I", "-c", code], input=names, capture_output=True, text=True, check=True)
        for own in (sys.executable, python)
    ]
    first, second = (json.loads(done.stdout) for done in runs)
    assert first == second
    assert len(first) == len(SOURCES) > 100
