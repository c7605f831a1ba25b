"""A small private function that is called once is written where it is used, so a reader has fewer places to look up."""

import ast
import re
from collections import Counter
from collections.abc import Iterator
from functools import cache
from itertools import pairwise

import pytest
from rooms import PACKAGES, ROOT, SOURCES

LINES_MOST = 5
IMPORTED = re.compile(r"^ *from [^\n]* import (\([^)]*\)|[^\n]*)", re.MULTILINE)
HEAD = re.compile(r"def .*?(?:\)|\]|\w):\n(?: +\"{3}.*?\"{3}\n)?", re.DOTALL)  # of a function: all above its body
WORD = re.compile(r"[A-Za-z_]\w*")
COMPREHENSIONS = ast.ListComp | ast.SetComp | ast.DictComp | ast.GeneratorExp


def called_once(text: str, imported: set[str]) -> Iterator[str]:
    """Names of the small private functions of a module whose only use is a call that their body can replace.

    A function is private if its name begins with `_` and it has no decorator, or if it is a `wp.func` that no module
    imports. It is small if its body, docstring apart, has at most 5 lines. A function that is passed as a value (to
    another function, or in a table) is not called there, so it needs its name.
    """
    words = Counter(WORD.findall(text))
    chunks = re.split(r"\n+(?=[^\s)])", text)  # statements of the module; a decorator is a chunk of its own
    for before, chunk in pairwise(["", *chunks]):
        name = chunk.removeprefix("def ").partition("(")[0] if chunk.startswith("def ") else ""
        is_private = before == "@wp.func" if before.startswith("@") else name.startswith("_")
        if not is_private or words[name] != 2 or name in imported:
            continue
        if HEAD.sub("", chunk, 1).rstrip().count("\n") < LINES_MOST:
            function = ast.parse(chunk).body[0]
            body = function.body[ast.get_docstring(function) is not None :]
            users = (ast.parse(other) for other in chunks if other is not chunk and re.search(rf"\b{name}\(", other))
            way = next((way for user in users if (way := way_to_call(user, name))), [])
            if body and way and can_replace(function.args, body, way):
                yield name


def way_to_call(node: ast.AST, name: str) -> list[ast.AST]:
    """The nodes from a node down to the call of a function; none if it is not called."""
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == name:
        return [node]
    return next(([node, *way] for child in ast.iter_child_nodes(node) if (way := way_to_call(child, name))), [])


def can_replace(parameters: ast.arguments, body: list[ast.stmt], way: list[ast.AST]) -> bool:
    """Whether a body can be written where it is called.

    An expression (a single `return`) always can, unless it would compute an argument twice. What returns from within a
    block (`if`, `try`, `with`, a loop), or yields, can only if the caller returns the call itself, or yields from it.
    Other statements can if they stand in a function, where their variables are local, and if the caller's statement
    evaluates the call exactly once: neither in a comprehension or lambda, nor where `and`, `or` or `if else` may skip
    it, nor in the condition of `while` or `elif`.
    """
    if len(body) == 1 and isinstance(body[0], ast.Return) and not repeats_argument(parameters, body[0], way[-1]):
        return True
    inner = [node for statement in body for node in ast.walk(statement) if node is not body[-1]]
    if any(isinstance(node, ast.Return | ast.Yield | ast.YieldFrom) for node in inner):
        return isinstance(way[-2], ast.Return | ast.YieldFrom)
    is_local = any(isinstance(node, ast.FunctionDef) for node in way)
    return is_local and all(map(is_evaluated_once, way, way[1:], [*way[2:], None]))


def repeats_argument(parameters: ast.arguments, body: ast.Return, call: ast.Call) -> bool:
    """Whether a parameter that an expression names several times gets more than a name or an attribute."""
    given = dict(zip([parameter.arg for parameter in parameters.args], call.args, strict=False))
    given |= {keyword.arg: keyword.value for keyword in call.keywords}
    named = Counter(node.id for node in ast.walk(body) if isinstance(node, ast.Name))
    return any(
        named[name] > 1 and not isinstance(value, ast.Name | ast.Attribute | ast.Constant)
        for name, value in given.items()
    )


def is_evaluated_once(node: ast.AST, child: ast.AST, below: ast.AST | None) -> bool:
    """Whether a node evaluates what its child holds below exactly once, and its statement can have others before it."""
    if isinstance(node, COMPREHENSIONS):
        return child is node.generators[0] and below is child.iter
    if isinstance(node, ast.BoolOp):
        return child is node.values[0]
    if isinstance(node, ast.IfExp):
        return child is node.test
    if isinstance(node, ast.While):
        return child is not node.test
    is_elif = isinstance(node, ast.If) and child in node.orelse and child.col_offset == node.col_offset
    return not isinstance(node, ast.Lambda) and not (is_elif and below is child.test)


@cache
def texts_and_imported() -> tuple[dict[str, str], set[str]]:
    """The text of each file of the source, and all names that files import from each other."""
    texts = {path.relative_to(ROOT).as_posix(): path.read_text() for path in SOURCES}
    return texts, {word for text in texts.values() for names in IMPORTED.findall(text) for word in WORD.findall(names)}


@pytest.mark.parametrize("package", PACKAGES)
def test_no_small_private_function_is_called_only_once(package):
    texts, imported = texts_and_imported()
    own = {name: text for name, text in texts.items() if name.startswith(f"{package}/")}
    found = {(name, function) for name, text in own.items() for function in called_once(text, imported)}
    tests = "".join(path.read_text() for path in (ROOT / "tests").rglob("*.py")) if found else ""
    found = {one for one in found if not is_named(one[1], tests)}
    assert not found, "write the body of each where it is called"


def is_named(name: str, tests: str) -> bool:
    """Whether a test imports a function, or calls or replaces it as an attribute of its module: it needs its name."""
    pattern = rf"""(\.|"|^ *from .* import (.*\W)?){name}\b"""
    return name in tests and re.search(pattern, tests, re.MULTILINE) is not None


REFUSED = {
    "an expression": "def f(x):\n    return _once(x) + 1\ndef _once(a):\n    return a * a",
    "statements": "def f(x):\n    y = g(_once(x))\n    return y\ndef _once(a):\n    b = a\n    b += 1\n    return b",
    "a call without result": "def f(x):\n    _once(x)\ndef _once(a):\n    if a:\n        raise ValueError(a)",
    "early returns, returned": "def f(x):\n    return _once(x)\ndef _once(a):\n    if a:\n        return 1\n    return",
    "what is looped over": "def f(x):\n    return [y for y in _once(x)]\ndef _once(a):\n    b = a\n    return b",
    "a wp.func": "@wp.func\ndef once(a: int):\n    return a\n\n\n@wp.kernel\ndef _k(x: int):\n    y = once(x)",
    "a call in a class": "class A:\n    def f(self):\n        return _once(self.x)\ndef _once(a):\n    return a * a",
}
ALLOWED = {
    "two calls": "def f(x):\n    return _once(x) + _once(1)\ndef _once(a):\n    return a",
    "a value": "def f(x):\n    return map(_once, x)\ndef _once(a):\n    return a",
    "a value of a table": "TABLE = {'a': _once}\ndef _once(a):\n    return a",
    "recursion": "def f(x):\n    return _once(x)\ndef _once(a):\n    return _once(a - 1) if a else 0",
    "six lines": "def f(x):\n    _once(x)\ndef _once(a):\n" + "    a.b()\n" * 6,
    "a decorator": "def f(x):\n    return _once(x)\n@cache\ndef _once(a):\n    return a",
    "a public name": "def f(x):\n    return once(x)\ndef once(a):\n    return a",
    "an imported wp.func": "@wp.func\ndef theirs(a: int):\n    return a\n\n\n@wp.func\ndef g(x: int):\n    theirs(x)",
    "early returns": "def f(x):\n    return 1 + _once(x)\ndef _once(a):\n    if a:\n        return 1\n    return 2",
    "statements, several times": "def f(x):\n    return [_once(y) for y in x]\ndef _once(a):\n    a += 1\n    return a",
    "statements, perhaps never": "def f(x):\n    return x or _once(x)\ndef _once(a):\n    a = a + 1\n    return a",
    "statements in an elif": "def f(x):\n    if x:\n        g()\n    elif _once(x):\n        h()\n"
    "def _once(a):\n    a = a + 1\n    return a",
    "statements of a module": "X = _once(1)\ndef _once(a):\n    b = a\n    return b",
    "an argument computed twice": "def f(x):\n    return [_once(g(y)) for y in x]\ndef _once(a):\n    return a * a",
}


@pytest.mark.parametrize("case", REFUSED)
def test_the_rule_refuses(case):
    assert len(list(called_once(REFUSED[case], set()))) == 1


@pytest.mark.parametrize("case", ALLOWED)
def test_the_rule_allows(case):
    assert list(called_once(ALLOWED[case], {"theirs"})) == []
