"""Expands a plan's axes into its recipes: every combination that tied keys and constraints allow, last axis fastest.

Combinations grow axis by axis. One that no later axis can complete is left out at once, so constraints keep the number
of unfinished combinations small.
"""

import glob
import math
from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, NamedTuple

from ....datasets.known_names import likely_name
from ...errors import PlanError
from ...user_warnings import warn_user
from ...validation import value_text
from .axes import KEYS, AxisPart, AxisTable, part_count, value_of
from .recipe import RecipePart
from .tied_keys import Ties
from .values import NumberCheck, read_values, refuse, within

BOUNDS = ("at_least", "at_most")
Matches = Callable[[Mapping[str, Any]], bool]
"""Whether the content of a recipe's part matches an entry."""


@dataclass(frozen=True, eq=False)
class Constraint:
    """One table of a plan: entries by axis."""

    entries: Mapping[str, Sequence[Matches]]

    def matches(self, axis: str, content: Mapping[str, Any]) -> bool:
        """Whether a part matches all entries of its axis."""
        return all(matches(content) for matches in self.entries.get(axis, ()))


def constraint_of(table: object, folder: Path) -> Constraint:
    """The constraint of a plan's table; raises PlanFault."""
    if not isinstance(table, dict) or not table:
        refuse(f"must be a table of at least one axis.key = value, not {value_text(table)}")
    entries: dict[str, list[Matches]] = defaultdict(list)
    for path, value in _flat(table):
        axis, _, key = ".".join(path).partition(".")
        if axis not in KEYS or key not in ("source", *KEYS[axis]):
            known = [f"{name}.{one}" for name, keys in KEYS.items() for one in ("source", *keys)]
            meant = likely_name(f"{axis}.{key}", known)
            refuse(f"unknown key {'.'.join(path)!r}{meant}; it must be axis.key, such as strategy.source", path)
        with within(*path):
            entries[axis].append(_entry(axis, key, value, folder))
    return Constraint(dict(entries))


def _flat(table: Mapping[str, Any]) -> list[tuple[tuple[str, ...], Any]]:
    """Entries by their path; `strategy.source` with and without quotes is the same."""
    out: list[tuple[tuple[str, ...], Any]] = []
    for name, value in table.items():
        if name in KEYS and isinstance(value, dict):
            out += [((name, key), inner) for key, inner in value.items()]
        else:
            out.append(((name,), value))
    return out


def _entry(axis: str, key: str, given: object, folder: Path) -> Matches:
    """The entry of a key; folder: from which patterns of sources start. Raises PlanFault."""
    check = None if key == "source" else KEYS[axis][key].check
    if isinstance(given, dict):
        if not isinstance(check, NumberCheck):
            refuse(f"must be a value or a list of them, not {value_text(given)}: it is no number")
        return _bounds(axis, key, given, check)
    if check is None:
        listed = given if isinstance(given, list) else [given]
        texts = [text for text in listed if isinstance(text, str) and text]
        if not texts or len(texts) < len(listed):
            refuse(f"must be a name, or a list of names, not {value_text(given)}")
        exact = {*texts, *(str(folder / text) for text in texts)}  # a name with brackets is no pattern of itself
        patterns = (*texts, *(str(Path(glob.escape(str(folder))) / text) for text in texts))
        return lambda content: _is_named(value_of(axis, key, content), exact, patterns)
    accepted = list(read_values(given, check))
    return lambda content: value_of(axis, key, content) in accepted


def _bounds(axis: str, key: str, given: Mapping[str, Any], check: NumberCheck) -> Matches:
    """The entry of a table of at_least, at_most or both."""
    if not given or set(given) - set(BOUNDS):
        refuse(f"must have at_least, at_most or both, not {value_text(given)}")
    for name, bound in given.items():
        if isinstance(bound, bool) or not isinstance(bound, int | float) or bound != bound:
            refuse(f"{name} must be a number in {check.span}, not {value_text(bound)}")
    low, high = (given.get(name, default) for name, default in zip(BOUNDS, (-math.inf, math.inf), strict=True))
    return lambda content: (value := value_of(axis, key, content)) is not None and low <= value <= high


def _is_named(named: Mapping[str, Any] | None, exact: Collection[str], patterns: Sequence[str]) -> bool:
    """Whether the name or the path of a source or an alignment is one of `exact`, or matches a pattern."""
    known = (named["name"], named["source"]) if named else ()
    return any(name in exact or any(fnmatchcase(name, pattern) for pattern in patterns) for name in known)


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
