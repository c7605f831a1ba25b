"""The combinations of a plan's axes that its constraints and tied keys allow: counted without a loop, made lazily.

A combination is begun only if it can be completed. Whether it can, and in how many ways, depends on its *state* only:
the constraints that all of its parts match so far, and its rows in the groups of tied keys that later axes have.
"""

import hashlib
import json
import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from ...user_warnings import warn_user
from .axes import AxisTable, Tie, parts_of
from .constraint import Constraint
from .recipe import Recipe, RecipePart
from .values import refuse

LISTED_MOST = 20_000
"""An axis of at most so many parts is kept as a list; parts of a longer one are made whenever they are needed."""
TIED_MOST = 200_000
"""Parts of an axis with tied keys, which is always kept as a list."""
PARTS_COUNTED_MOST = 200_000
"""Parts of an axis that are all compared with constraints, to count its recipes; of a longer one, none are."""
RECIPES_COUNTED_MOST = 100_000
"""With tied keys two rows may give the same recipe; up to so many recipes are compared to count them."""

Rows = tuple[tuple[int, int], ...]
"""Group of tied keys and row, sorted."""
State = tuple[frozenset[int], Rows]
"""Indices of constraints that all parts match so far, and rows that bind later axes."""


@dataclass(frozen=True)
class AxisChoice:
    """A part of a recipe, with all that decides what it may be combined with."""

    part: RecipePart
    rows: Mapping[int, int]
    """Row by group of tied keys."""


class PlanAxis:
    """The parts that the tables of one axis stand for, each once."""

    def __init__(self, name: str, tables: Sequence[AxisTable], ties: Sequence[Mapping[str, Tie]] = ()) -> None:
        """Warns (PalpateWarning) of parts that are the same, if the axis is kept as a list.

        ties: tied keys of each table. Raises PlanFault for more than TIED_MOST parts with tied keys.
        """
        self.name = name
        self.tables = tuple(tables)
        self.ties = tuple(ties) or ({},) * len(self.tables)
        self.groups = {tie.group for own in self.ties for tie in own.values()}
        self.listed_count = sum(
            math.prod(map(len, t.columns(own))) for t, own in zip(self.tables, self.ties, strict=True)
        )
        if self.groups and self.listed_count > TIED_MOST:
            refuse(f"the axis {name} must have at most {TIED_MOST} values with tied keys, not {self.listed_count}")
        self.listed = self._list() if self.groups or self.listed_count <= LISTED_MOST else None

    @property
    def part_count(self) -> int:
        """Number of parts; an upper bound if not `is_exact`."""
        return self.listed_count if self.listed is None else len(self.listed)

    @property
    def is_exact(self) -> bool:
        """Whether `part_count` is the number, not a bound."""
        return self.listed is not None or self._is_distinct

    @property
    def _is_distinct(self) -> bool:
        """Whether no two parts can be the same: values of a key never are, but files may have the same content."""
        given = self.tables[0].given()
        files = [given[name] for name in ("source", "alignment") if name in given and name not in self.ties[0]]
        return len(self.tables) == 1 and all(len(values) == 1 for values in files)

    @property
    def digest(self) -> str:
        """SHA-256 of its parts and their names; of an axis without a list, of the values that make them."""
        if self.listed is None:
            lines = [str(table.given()) for table in self.tables]
        else:
            # The digest of a part leaves its names out, but constraints and tables use them.
            parts = [choice.part for choice in self.listed]
            names = [[part.content["name"], part.content["source"], part.content.get("alignment")] for part in parts]
            lines = [f"{part.digest} {json.dumps(own)}" for part, own in zip(parts, names, strict=True)]
        return hashlib.sha256("\n".join(lines).encode()).hexdigest()

    def parts(self) -> Iterator[RecipePart]:
        """Every part once; those with tied keys once for each row."""
        return (choice.part for choice in self.choices())

    def choices(self) -> Iterable[AxisChoice]:
        """Every part once, with its rows."""
        return self._made() if self.listed is None else self.listed

    def _list(self) -> tuple[AxisChoice, ...]:
        repeated: list[RecipePart] = []
        listed = tuple(self._made(repeated))
        if repeated:
            same = [choice.part for choice in listed if choice.part.digest == repeated[0].digest]
            names = sorted({part.content["name"] for part in (*same, *repeated) if part.digest == same[0].digest})
            warn_user(
                f"{self.name}: {len(repeated)} of {self.listed_count} values are the same as others and left out, "
                f"such as {' and '.join(names)}"
            )
        return listed

    def _made(self, repeated: list[RecipePart] | None = None) -> Iterator[AxisChoice]:
        """Every choice once; the others are added to `repeated`."""
        seen: set[tuple[str, Rows]] = set()
        is_distinct = self._is_distinct
        for table, ties in zip(self.tables, self.ties, strict=True):
            for part, rows in parts_of(self.name, table, ties):
                if not is_distinct:
                    key = part.digest, tuple(rows.items())
                    if key in seen:
                        if repeated is not None:
                            repeated.append(part)
                        continue
                    seen.add(key)
                yield AxisChoice(part, rows)


class Product:
    """The recipes of one plan."""

    def __init__(self, axes: Sequence[PlanAxis], exclude: Sequence[Constraint], only: Sequence[Constraint]) -> None:
        """Axes in the order of a recipe's parts; the last varies fastest."""
        self.axes = tuple(axes)
        self.constraints = (*exclude, *only)
        self._all = frozenset(range(len(self.constraints)))
        self._excluding = frozenset(range(len(exclude)))
        self._later = [{g for axis in self.axes[depth + 1 :] for g in axis.groups} for depth in range(len(axes))]
        self._counts: dict[tuple[int, State], int] = {}
        self._kind_counts: dict[tuple[int, Rows], Mapping[State, int]] = {}
        self.shown: dict[tuple[str, str], str] = {}
        """Names by source and name in its own plan, see `show_distinct_names`."""
        self._renamed: dict[str, RecipePart] = {}

    @cached_property
    def recipe_count(self) -> int:
        """Number of recipes; an upper bound if not `is_exact`."""
        bound = self._count(0, (self._all, ()))
        return sum(1 for _ in self.recipes()) if self._is_tied and bound <= RECIPES_COUNTED_MOST else bound

    @property
    def is_exact(self) -> bool:
        """Whether `recipe_count` is the number, not a bound."""
        axes = all(axis.is_exact and self._is_counted(axis) for axis in self.axes)
        return axes and not (self._is_tied and self.recipe_count > RECIPES_COUNTED_MOST)

    @property
    def _is_tied(self) -> bool:
        return any(axis.groups for axis in self.axes)

    def recipes(self) -> Iterator[Recipe]:
        """Every recipe once, made when it is asked for."""
        seen: set[bytes] = set()
        for parts in self._completed(0, (self._all, ())):
            recipe = Recipe.of([self._renamed_part(part) for part in parts] if self.shown else parts)
            if self._is_tied:
                key = bytes.fromhex(recipe.hash)
                if key in seen:
                    continue
                seen.add(key)
            yield recipe

    def endings(self, axis_count: int) -> Iterator[tuple[RecipePart, ...]]:
        """Parts of the last axes, so many, that recipes have together; some may come again."""
        first = len(self.axes) - axis_count
        states = {(self._all, Rows())}
        for depth in range(first):
            states = {self._next(depth, state, kind) for state in states for kind in self._kinds(depth, state[1])}
        for state in states:
            yield from self._completed(first, state)

    def unmatched(self) -> list[int]:
        """Indices of constraints that no part of some listed axis matches: of all constraints, `only` last."""
        matched = self._all
        for depth, axis in enumerate(self.axes):
            if axis.listed is not None:
                matched &= frozenset().union(*(kind[0] for kind in self._kinds(depth, ())))
        return sorted(self._all - matched)

    def _renamed_part(self, part: RecipePart) -> RecipePart:
        """A part under the name that it has among several plans; constraints use the name in its own plan."""
        name = self.shown.get((part.content["source"], part.content["name"]))
        if name is None:
            return part
        return self._renamed.setdefault(part.digest, RecipePart(part.content | {"name": name}))

    def _about(self, axis: PlanAxis) -> list[int]:
        """Indices of constraints with entries of an axis."""
        return [k for k, constraint in enumerate(self.constraints) if axis.name in constraint.entries]

    def _is_counted(self, axis: PlanAxis) -> bool:
        """Whether the parts of an axis that constraints leave are counted."""
        return axis.part_count <= PARTS_COUNTED_MOST or not self._about(axis)

    def _matched(self, axis: PlanAxis, part: RecipePart) -> frozenset[int]:
        """Indices of constraints whose entries of an axis a part matches."""
        differing = [k for k in self._about(axis) if not self.constraints[k].matches(axis.name, part.content)]
        return self._all.difference(differing) if differing else self._all

    @cached_property
    def _candidates(self) -> list[dict[tuple[int, int] | None, list[tuple[AxisChoice, frozenset[int]]]]]:
        """Choices of each listed axis, and the constraints that they match: all, and those of each row."""
        out = []
        for axis in self.axes:
            choices = [(choice, self._matched(axis, choice.part)) for choice in axis.listed or ()]
            by_row = {None: choices}
            for group in axis.groups:
                rows = {choice.rows[group]: [] for choice, _ in choices if group in choice.rows}
                for pair in choices:  # one without a row goes with every row
                    own = pair[0].rows.get(group)
                    for row in rows if own is None else (own,):
                        rows[row].append(pair)
                by_row |= {(group, row): some for row, some in rows.items()}
            out.append(by_row)
        return out

    def _fitting(self, depth: int, rows: Rows) -> Iterable[tuple[AxisChoice, frozenset[int]]]:
        """Choices of an axis that go with the rows so far, and the constraints that they match."""
        axis = self.axes[depth]
        if axis.listed is None:
            return ((choice, self._matched(axis, choice.part)) for choice in axis.choices())
        binding = [(group, row) for group, row in rows if group in axis.groups]
        some = self._candidates[depth][binding[0] if binding else None]
        rest = binding[1:]
        return [pair for pair in some if all(pair[0].rows.get(g, r) == r for g, r in rest)] if rest else some

    def _kinds(self, depth: int, rows: Rows) -> Mapping[State, int]:
        """How many choices that go with the rows so far match the same constraints and have the same rows.

        Parts of an axis that is too long are counted as if no constraint left them out: an upper bound.
        """
        axis = self.axes[depth]
        if not (self._is_counted(axis) and self._about(axis)) and axis.listed is None:
            return {(self._all - (self._excluding & set(self._about(axis))), ()): axis.part_count}
        key = depth, tuple((group, row) for group, row in rows if group in axis.groups)
        if key not in self._kind_counts:
            fitting = self._fitting(depth, rows)
            self._kind_counts[key] = Counter((matched, tuple(choice.rows.items())) for choice, matched in fitting)
        return self._kind_counts[key]

    def _next(self, depth: int, state: State, kind: State) -> State:
        """The state after a choice of this kind."""
        later = self._later[depth]
        rows = {group: row for group, row in (*state[1], *kind[1]) if group in later}
        return state[0] & kind[0], tuple(sorted(rows.items()))

    def _count(self, depth: int, state: State) -> int:
        """Number of ways to complete a combination."""
        if depth == len(self.axes):
            only = self._all - self._excluding
            return int(not state[0] & self._excluding and (not only or bool(state[0] & only)))
        known = self._counts.get((depth, state))
        if known is None:
            kinds = self._kinds(depth, state[1]).items()
            known = sum(count * self._count(depth + 1, self._next(depth, state, kind)) for kind, count in kinds)
            self._counts[depth, state] = known
        return known

    def _completed(self, depth: int, state: State) -> Iterator[tuple[RecipePart, ...]]:
        """All ways to complete a combination."""
        if depth == len(self.axes):
            yield ()
            return
        for choice, matched in self._fitting(depth, state[1]):
            following = self._next(depth, state, (matched, tuple(choice.rows.items())))
            if self._count(depth + 1, following):
                for rest in self._completed(depth + 1, following):
                    yield (choice.part, *rest)


def show_distinct_names(products: Sequence[Product]) -> None:
    """Have sources that differ, but have one name in their plans, shown with as much of their paths as is needed."""
    for place in range(len(products[0].axes)):
        paths: dict[str, set[str]] = defaultdict(set)
        for source in (s for product in products for table in product.axes[place].tables for s in table.source):
            paths[source.name].add(source.source)
        for name, own in paths.items():
            for product in products if len(own) > 1 else ():
                product.shown |= {(path, name): end for path, end in _distinct_ends(sorted(own)).items()}


def _distinct_ends(paths: Sequence[str]) -> dict[str, str]:
    """The shortest ends of paths, of one number of names each, that all differ."""
    parts = [Path(path).parts for path in paths]
    for count in range(2, max(map(len, parts)) + 1):
        ends = [str(Path(*own[-count:])) for own in parts]
        if len(set(ends)) == len(ends):
            return dict(zip(paths, ends, strict=True))
    return {path: path for path in paths}
