"""What a user's own stages are made of: a rendering is resumed only by the same code."""

import hashlib
import inspect
from functools import partial
from typing import Any

from .stages import find_stage
from .strategy import IntersectionStrategy


def stage_sources(strategy: IntersectionStrategy) -> dict[str, str]:
    """SHA-256 of the source of each stage that is not the package's own, by name; empty for most strategies."""
    entries = [find_stage(role, stage.name) for role, stages in strategy.stages().items() for stage in stages]
    return {entry.name: digest_of(entry.function) for entry in entries if not entry.own}


def digest_of(function: Any) -> str:
    """SHA-256 of a function's source, through partials and Warp functions; of its byte code where there is none."""
    parts = [function]
    while isinstance(function, partial):
        parts = [function.func, *function.args]
        function = function.args[0] if function.args else function.func
    texts = []
    for part in parts:
        plain = getattr(part, "func", part)
        try:
            texts.append(inspect.getsource(plain))
        except (OSError, TypeError):
            code = getattr(plain, "__code__", None)
            texts.append(repr((code.co_code, code.co_consts)) if code else repr(plain))
    return hashlib.sha256("\0".join(texts).encode()).hexdigest()
