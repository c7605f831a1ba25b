"""Metrics that a user's function computes: a plan names `file.py:function` or `package.module:function`.

Each is a group of results of its own, "metric DIGEST FUNCTION", with the key of the contours that it is computed from.
The digest is that of the whole file, so an edited file makes this group again and no other; its place does not count.
"""

import inspect
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ...errors import PlanError, RenderError, SweepError
from ...objects.functions.user_function import find_function_code, load_module
from ...trust.permission import UNNAMED, AllowCode, Namer
from .recipe import USER_METRIC, digest_source, function_of
from .sources import SourceIndex
from .values import refuse

DIGITS = 16


def find_metric(text: str, index: SourceIndex) -> str:
    """The group of a metric that a plan names; its code is noted in the index, and run if the index permits that.

    Raises PlanFault for what is no function, or has another number of arguments than one.
    """
    where, _, function = text.rpartition(":")
    source = f"{index.file(where)}:{function}" if where.endswith(".py") else text
    try:
        index.code.append(find_function_code(source, index.namer).code)
        if index.allow_code is not None:
            load_metric(source, index.allow_code, index.namer)
        group = _group_of(source, index.digest(source))
    except RenderError as error:
        refuse(str(error))
    index.metrics[group] = source
    return group


def load_metric(source: str, allow_code: AllowCode, namer: Namer = UNNAMED) -> Callable[[Any], Any]:
    """The function of a metric; raises RenderError if it is not there or cannot be called with one argument."""
    module, name = load_module(source, allow_code=allow_code, namer=namer), source.rpartition(":")[2]
    function = getattr(module, name, None)
    if function is None:
        raise SweepError(f"{source}: the file has no function {name!r}")
    try:
        inspect.signature(function).bind(None)
    except (TypeError, ValueError) as error:
        raise SweepError(f"{source}: must be a function of one argument, the contours ({error})") from error
    return function


def load_planned(group: str, source: str, allow_code: AllowCode) -> Callable[[Any], Any]:
    """The function of a group of a plan; raises RenderError also if its file has changed since the plan was read."""
    if _group_of(source, digest_source(source)) != group:
        raise SweepError(f"{source}: has changed since the plan was read")
    return load_metric(source, allow_code)


def shown_name(source: str) -> str:
    """A metric's source for messages: the file without its folder, and the function."""
    where, colon, function = source.rpartition(":")
    return f"{Path(where).name}{colon}{function}"


def require_distinct_names(sources: Sequence[tuple[str, str]]) -> None:
    """Raise PlanError if two metrics, given as group and source, would have the same columns."""
    known: dict[str, str] = {}
    for group, _ in sources:
        name = function_of(group)
        if known.setdefault(name, group) != group:
            files = " and ".join(str(Path(own.rpartition(":")[0])) for g, own in sources if function_of(g) == name)
            raise PlanError(f"metrics: {files} both have a function {name!r}, whose columns would have one name")


def _group_of(source: str, sha256: str) -> str:
    return f"{USER_METRIC}{sha256[:DIGITS]} {source.rpartition(':')[2]}"
