"""Recipes that could not be made, as people read them."""

from __future__ import annotations

from collections.abc import Sequence

from ....datasets.sweeps.store import Failure


def failure_rows(failures: Sequence[Failure]) -> list[tuple[str, str]]:
    """Recipes that failed and why, one row a reason."""
    names: dict[str, list[str]] = {}
    for failure in failures:
        names.setdefault(failure.sentence.removeprefix(f"{failure.name}: "), []).append(failure.name)
    return [(own[0] + (f" and {len(own) - 1} more" if own[1:] else ""), why) for why, own in names.items()]
