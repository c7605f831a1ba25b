"""Expressions as JSON.

Every node is an object whose "op" names what it is; the other fields are those of its class in `expression`, operators
have their operands in "of". A file holds one node.
"""

import json
from collections.abc import Mapping
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

from ....datasets.bounded_file import read_text
from ....datasets.json_text import parse_json
from ....datasets.known_names import unknown_name
from ...errors import ImplicitError
from ...validation import value_text
from .expression import (
    DEEPEST,
    Box,
    Capsule,
    Cylinder,
    Difference,
    Expression,
    HalfSpace,
    Intersection,
    Offset,
    SmoothUnion,
    Sphere,
    Torus,
    Transform,
    Union,
)

PRIMITIVES = (Sphere, Box, Cylinder, Torus, Capsule, HalfSpace)
OPERATORS = (Union, Intersection, Difference, SmoothUnion, Offset, Transform)
KINDS = {kind.op: kind for kind in (*PRIMITIVES, *OPERATORS)}


def expression_from(described: Any, depth: int = 0) -> Expression:
    """The expression that `Expression.described` tells of.

    Raises ImplicitError for an unknown operator or field, a missing one, a value out of range, and a tree too deep.
    """
    if depth > DEEPEST:
        raise ImplicitError(f"expression: more than {DEEPEST} operators above one another")
    if not isinstance(described, Mapping):
        raise ImplicitError(f'expression: a node must be a JSON object with an "op", not {value_text(described)}')
    op = described.get("op")
    if not isinstance(op, str):
        raise ImplicitError(f"expression: op must be one of {', '.join(KINDS)}, not {value_text(op)}")
    kind = KINDS.get(op)
    if kind is None:
        raise ImplicitError("expression: " + unknown_name("op", op, KINDS))
    known = {field.name: field for field in fields(kind)}
    unknown = sorted(str(name) for name in set(described) - set(known) - {"op"})
    if unknown:
        raise ImplicitError(f"{op}: unknown field {unknown[0]!r:.60}; known: {', '.join(known)}")
    missing = [name for name, field in known.items() if name not in described and field.default is MISSING]
    if missing:
        raise ImplicitError(f"{op}: {missing[0]} is missing; it has {', '.join(known)}")
    values = {name: described[name] for name in known if name in described}
    if "of" in values:
        if not isinstance(values["of"], list | tuple):
            raise ImplicitError(f"{op}: of must be a list of expressions, not {value_text(values['of'])}")
        values["of"] = tuple(expression_from(part, depth + 1) for part in values["of"])
    return kind(**{name: tuple(value) if isinstance(value, list) else value for name, value in values.items()})


def expression_from_json(text: str) -> Expression:
    """Read an expression's JSON.

    Raises ImplicitError for what is no JSON or no expression.

    >>> from palpate.render import expression_from_json
    >>> expression_from_json('{"op": "sphere", "radius": 0.04}')
    Sphere(radius=0.04)
    """
    try:
        described = parse_json(text, allow_nan=True)
    except ValueError as error:
        raise ImplicitError(f"expression: not JSON ({error})") from error
    return expression_from(described)


def expression_to_json(expression: Expression) -> str:
    """An expression as one line of JSON, which `expression_from_json` reads back to the same tree.

    >>> from palpate.render import box, expression_to_json, sphere
    >>> print(expression_to_json(box(0.1, 0.1, 0.02) - sphere(0.03)))
    {"op": "difference", "of": [{"op": "box", "size": [0.1, 0.1, 0.02]}, {"op": "sphere", "radius": 0.03}]}
    """
    return json.dumps(expression.described())


def load_expression(path: str | Path) -> Expression:
    """Read a file's expression.

    Raises ImplicitError, which names the file, for one that is missing or no expression.

    >>> from pathlib import Path
    >>> from palpate.render import load_expression
    >>> _ = Path("ball.json").write_text('{"op": "sphere", "radius": 0.04}')
    >>> load_expression("ball.json")
    Sphere(radius=0.04)
    """
    path = Path(path)
    try:
        return expression_from_json(read_text(path))
    except (OSError, UnicodeDecodeError) as error:
        raise ImplicitError(f"{path}: cannot be read ({error})") from error
    except ImplicitError as error:
        raise ImplicitError(f"{path}: {error}") from error
