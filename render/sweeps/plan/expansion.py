"""Expands a plan's axes into its recipes: every combination that tied keys and constraints allow, last axis fastest.

Combinations grow axis by axis. One that no later axis can complete is left out at once, so constraints keep the number
of unfinished combinations small.
"""

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from ...errors import PlanError
from ...user_warnings import warn_user
from .axes import AxisPart, AxisTable, part_count
from .constraint import Constraint
from .recipe import RecipePart
from .tied_keys import Ties
from .values import refuse

RECIPES_MOST = 10**6
"""Recipes of one plan, or of several together, and parts of one axis: all of them are held in memory."""
WAY_OUT = "list fewer values, or draw some of them with [sample]"
PartTuple = tuple[RecipePart, ...]


class _Prefix(NamedTuple):
    """A combination of parts of the first axes."""

    parts: PartTuple
    rows: dict[int, int]
    """Row in each group of tied keys."""
    matched: frozenset[Constraint]
    """The constraints that all of the parts match."""


def require_few(tables: Mapping[str, Sequence[AxisTable]], ties: Ties, *, is_whole: bool) -> None:
    """Raise PlanFault for an axis, or a product of all axes, that is too long to be expanded.

    is_whole: whether there are no constraints. With constraints or tied keys only the axes are judged.
    """
    counts = [sum(map(part_count, own, ties[axis])) for axis, own in tables.items()]
    is_exact = is_whole and not any(tied for own in ties.values() for tied in own)
    if max(counts) > RECIPES_MOST or (is_exact and math.prod(counts) > RECIPES_MOST):
        combinations = f"{math.prod(counts):,} {'recipes' if is_exact else 'combinations of its axes'}"
        refuse(f"a plan must have at most {RECIPES_MOST:,} recipes, not {combinations}: {WAY_OUT}")


def distinct_parts(axis: str, tables: Sequence[AxisTable], listed: Sequence[AxisPart]) -> Sequence[AxisPart]:
    """The parts of an axis, each once, or once for each row of tied keys; warns (PalpateWarning) of the others."""
    files = [values for key, values in tables[0].items() if key in ("source", "alignment")]
    if len(tables) == 1 and all(len(values.listed) == 1 for values in files):
        return listed  # values of a key differ; only two files, or two tables, can mean the same
    known: dict[object, AxisPart] = {}
    repeated: list[RecipePart] = []
    for own in listed:
        if known.setdefault((own.part.digest, tuple(own.rows.items())), own) is not own:
            repeated.append(own.part)
    if repeated:
        same = {own.part.content["name"] for own in listed if own.part.digest == repeated[0].digest}
        warn_user(
            f"{axis}: {len(repeated)} of {len(listed)} values are the same as others and left out, "
            f"such as {' and '.join(sorted(same))}"
        )
    return list(known.values())


def combine(
    axes: Mapping[str, Sequence[AxisPart]], exclude: Sequence[Constraint], only: Sequence[Constraint]
) -> list[PartTuple]:
    """The parts of each recipe, for axes in the order of a recipe's parts; raises PlanFault for too many recipes."""
    every, kept = frozenset((*exclude, *only)), frozenset(only)
    prefixes: Iterable[_Prefix] = [_Prefix((), {}, every)]
    later, bound = list(axes), set[int]()
    for axis, parts in axes.items():
        later.remove(axis)
        about = [own for own in every if axis in own.entries]
        choices = [
            _Prefix((part,), rows, every.difference(own for own in about if not own.matches(axis, part.content)))
            for part, rows in parts
        ]
        groups = {group for own in parts for group in own.rows}
        longer = _extended(prefixes, choices, min(groups & bound, default=None))
        decided = frozenset(own for own in exclude if not own.entries.keys() & later)
        prefixes = _allowed(longer, axis, decided, kept)
        bound |= groups
    combinations = [own.parts for own in prefixes]
    return unique(combinations) if bound else combinations  # two rows of zip may have the same values


def _extended(prefixes: Iterable[_Prefix], choices: Sequence[_Prefix], group: int | None) -> Iterator[_Prefix]:
    """Each prefix followed by each choice of the next axis that has the prefix's rows.

    group: one that both may have a row in, by which the choices are looked up.
    """
    by_row: dict[int, list[_Prefix]] = {own.rows[group]: [] for own in choices if group in own.rows}
    for own in choices:
        for row in [own.rows[group]] if group in own.rows else by_row:  # a choice without a row fits every row
            by_row[row].append(own)
    for prefix in prefixes:
        for own in by_row[prefix.rows[group]] if group in prefix.rows else choices:
            if all(prefix.rows.get(other, row) == row for other, row in own.rows.items()):
                rows = prefix.rows | own.rows if own.rows else prefix.rows
                yield _Prefix(prefix.parts + own.parts, rows, prefix.matched & own.matched)


def _allowed(
    prefixes: Iterable[_Prefix], axis: str, decided: frozenset[Constraint], only: frozenset[Constraint]
) -> Iterator[_Prefix]:
    """Prefixes that constraints do not leave out; raises PlanFault after RECIPES_MOST of them.

    axis: of their last parts. decided: constraints that exclude what they match, and have no entry of a later axis.
    only: constraints of which one must match.
    """
    count = 0
    for own in prefixes:
        if own.matched & decided or (only and not own.matched & only):
            continue
        count += 1
        if count > RECIPES_MOST:
            left = f"but more combinations are left after the axis {axis}"
            refuse(f"a plan must have at most {RECIPES_MOST:,} recipes, {left}: {WAY_OUT}")
        yield own


def unmatched(axes: Mapping[str, Sequence[AxisPart]], constraints: Sequence[Constraint]) -> list[int]:
    """Indices of constraints that match no part of some axis, and therefore no recipe."""
    return [
        k
        for k, constraint in enumerate(constraints)
        if not all(any(constraint.matches(axis, own.part.content) for own in axes[axis]) for axis in constraint.entries)
    ]


def unique(combinations: Iterable[PartTuple]) -> list[PartTuple]:
    """The first of all combinations that mean the same; raises PlanError for more than RECIPES_MOST."""
    known: dict[tuple[str, ...], PartTuple] = {}
    for parts in combinations:
        known.setdefault(tuple(part.digest for part in parts), parts)
    if len(known) > RECIPES_MOST:
        raise PlanError(f"the plans must have at most {RECIPES_MOST:,} recipes together, not {len(known):,}")
    return list(known.values())


def distinct_names(plans: Sequence[Mapping[str, Sequence[AxisPart]]]) -> dict[tuple[str, str], str]:
    """Names that tell apart sources of several plans that have one name in their plans, by source and this name."""
    names: dict[tuple[str, str], str] = {}
    for axis in plans[0]:
        paths: dict[str, set[str]] = defaultdict(set)
        for part, _ in (own for axes in plans for own in axes[axis]):
            paths[part.content["name"]].add(part.content["source"])
        for name, own in paths.items():
            names |= {(path, name): end for path, end in _distinct_ends(sorted(own)).items() if len(own) > 1}
    return names


def _distinct_ends(paths: Sequence[str]) -> dict[str, str]:
    """The shortest ends of paths, of one number of names each, that all differ."""
    parts = [Path(path).parts for path in paths]
    for count in range(2, max(map(len, parts)) + 1):
        ends = [str(Path(*own[-count:])) for own in parts]
        if len(set(ends)) == len(ends):
            return dict(zip(paths, ends, strict=True))
    return {path: path for path in paths}
