"""`--set KEY=VALUE`, put into a plan's tables; and the message of an unknown key, with the key that is meant."""

import re
from collections.abc import Sequence
from typing import Any

from ....datasets.known_names import likely_name
from .axes import KEYS
from .line_search import Place
from .toml_text import parse_toml
from .values import refuse

TABLES = (*KEYS, "sample", "exclude", "only")
"""Keys of a plan that have tables."""


def unknown_key(key: str, known: Sequence[str]) -> str:
    """The message of an unknown key: the known key that is meant, or the axis that has it."""
    owners = [axis for axis, keys in KEYS.items() if key in keys]
    meant = f" (it is a key of {' and '.join(owners)})" if owners else likely_name(key, known)
    return f"unknown key{meant}; known: {', '.join(known)}"


def put_override(tables: dict[str, Any], override: str, plain: Sequence[str]) -> Place:
    """Put one `--set` into a plan's tables; returns the place of its key.

    plain: keys of a plan beside its tables. Raises PlanFault for an invalid override.
    """
    key, equals, text = override.partition("=")
    place = tuple(part.strip() for part in key.split("."))
    if not equals or not all(place):
        refuse("must be key=value, such as motion.seed=3")
    top, known = place[0], [*plain, *TABLES]
    if top not in known or len(place) > (2 if top in (*KEYS, "sample") else 1):
        refuse(unknown_key(".".join(place), known))
    try:
        value = _value(text)
    except ValueError as error:
        fault = str(error).partition(" (at line")[0]
        refuse(f"not a TOML value ({fault}); texts may need quotes")
    if len(place) == 1:
        tables[top] = value
        return place
    inner = tables.setdefault(top, {})
    for table in inner if isinstance(inner, list) else [inner]:
        if isinstance(table, dict):
            table[place[1]] = value
    return place


def _value(text: str) -> Any:
    """A TOML value; a bare word is a text."""
    try:
        values = parse_toml(f"value = {text}")
    except ValueError:
        if re.fullmatch(r"[^\s\[\]{}\"'#=]+", text.strip()):
            return text.strip()
        raise
    if set(values) != {"value"}:
        raise ValueError("more than one value")
    return values["value"]
