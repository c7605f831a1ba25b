"""All combinations of a plan's axes that its constraints let pass: counted without going through them, made lazily.

Every constraint has a bit. A part's mask has the bits of the constraints all of whose entries about its axis it
matches; a recipe matches a constraint if the masks of all its parts have its bit. Parts of an axis with the same mask
are a class, so that recipes are counted by classes, and combinations that can lead to none are not entered.
"""

import hashlib
import json
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path

from ...errors import PalpateWarning
from .axes import AxisTable, variants
from .constraint import Constraint
from .recipe import Recipe, RecipePart

SPELT_OUT = 20_000
"""An axis of no more parts is kept as a list; parts of a longer one are made whenever they are needed."""
LOOKED_AT = 100_000
"""Combinations, begun ones too, among which a recipe is looked for where recipes cannot be counted."""


class Axis:
    """The parts that the tables of one axis stand for, each once."""

    def __init__(self, name: str, tables: Sequence[AxisTable]) -> None:
        """Warns (PalpateWarning) of parts that are the same, if they are not too many to compare."""
        self.name = name
        self.tables = tuple(tables)
        self._parts = tuple(self._made()) if self.listed_count <= SPELT_OUT else None
        if self._parts is not None:
            self._warn()

    @property
    def listed_count(self) -> int:
        """Parts as they are listed, the same ones too."""
        return sum(table.combination_count for table in self.tables)

    @property
    def is_lazy(self) -> bool:
        """Whether its parts are too many for a list."""
        return self._parts is None

    @property
    def is_exact(self) -> bool:
        """Whether `part_count` is, not a bound."""
        return self._parts is not None or self._is_distinct

    @property
    def part_count(self) -> int:
        """Parts; of a lazy axis at most so many."""
        return self.listed_count if self._parts is None else len(self._parts)

    @property
    def _is_distinct(self) -> bool:
        """Whether no two parts can be the same, since values of a key never are."""
        given = self.tables[0].given()
        files = [given[name] for name in ("source", "alignment") if name in given]  # which may be the same within
        return len(self.tables) == 1 and all(len(values) == 1 for values in files)

    @property
    def digest(self) -> str:
        """SHA-256 of what its parts are and are called; of a lazy axis, of what they are made of."""
        told = [str(table.given()) for table in self.tables] if self.is_lazy else [_told(p) for p in self.parts()]
        return hashlib.sha256("\n".join(told).encode()).hexdigest()

    def parts(self) -> Iterator[RecipePart]:
        """Every part once."""
        return self._made() if self._parts is None else iter(self._parts)

    def _made(self) -> Iterator[RecipePart]:
        seen: set[str] = set()
        is_distinct = self._is_distinct
        for table in self.tables:
            for part in variants(self.name, table):
                if is_distinct:
                    yield part
                elif part.digest not in seen:
                    seen.add(part.digest)
                    yield part

    def _warn(self) -> None:
        """Tell how many are there twice, and one of them."""
        dropped = self.listed_count - self.part_count
        if not dropped:
            return
        listed = [part for table in self.tables for part in variants(self.name, table)]
        digest, _ = Counter(part.digest for part in listed).most_common(1)[0]
        names = sorted({part.content["name"] for part in listed if part.digest == digest})
        warnings.warn(
            f"{self.name}: {dropped} of {len(listed)} values are the same as others and left out, such as "
            f"{' and '.join(names)}",
            PalpateWarning,
            stacklevel=2,
        )


def tell_apart(products: Sequence["Product"]) -> None:
    """Have what is called alike in several plans, but is not the same, shown with the path that tells it apart."""
    for place in range(len(products[0].axes)):
        sources = [s for product in products for table in product.axes[place].tables for s in table.source]
        alike: dict[str, set[str]] = {}
        for source in sources:
            alike.setdefault(source.name, set()).add(source.source)
        for name, paths in alike.items():
            if len(paths) > 1:
                ends = _ends_apart(sorted(paths))
                for product in products:
                    product.shown |= {(path, name): end for path, end in ends.items()}


def _ends_apart(paths: Sequence[str]) -> dict[str, str]:
    """The shortest ends of paths, of as many names each, that are all different."""
    parts = [Path(path).parts for path in paths]
    for count in range(2, max(map(len, parts)) + 1):
        ends = [str(Path(*own[-count:])) for own in parts]
        if len(set(ends)) == len(ends):
            return dict(zip(paths, ends, strict=True))
    return {path: path for path in paths}


def _told(part: RecipePart) -> str:
    """A part with the names that its digest leaves out: constraints and tables have them."""
    content = part.content
    return f"{part.digest} {json.dumps([content['name'], content['source'], content.get('alignment')])}"


class Product:
    """The recipes of one plan."""

    def __init__(self, axes: Sequence[Axis], exclude: Sequence[Constraint], only: Sequence[Constraint]) -> None:
        """Axes in the order of a recipe's parts; the last varies fastest."""
        self.axes = tuple(axes)
        self.constraints = (*exclude, *only)
        self._excluding = (1 << len(exclude)) - 1
        self._all = (1 << len(self.constraints)) - 1
        self._only = self._all & ~self._excluding
        self._counts: dict[tuple[int, int], int] = {}
        self.shown: dict[tuple[str, str], str] = {}
        """Names by source and name in its own plan, see `tell_apart`."""
        self._renamed: dict[str, RecipePart] = {}

    @cached_property
    def recipe_count(self) -> int:
        """How many recipes there are, or at most if it is not `is_exact`."""
        return self._count(0, self._all)

    @property
    def is_exact(self) -> bool:
        """Whether `recipe_count` is, not a bound."""
        return all(axis.is_exact and not (axis.is_lazy and self._about(axis)) for axis in self.axes)

    def recipes(self) -> Iterator[Recipe]:
        """Every recipe once, made when it is asked for."""
        for parts in self._combined(0, self._all):
            yield Recipe.of([self._shown(part) for part in parts] if self.shown else parts)

    def _shown(self, part: RecipePart) -> RecipePart:
        """A part under the name that it has among several plans; constraints know that of its own plan."""
        name = self.shown.get((part.content["source"], part.content["name"]))
        if name is None:
            return part
        known = self._renamed.get(part.digest)
        if known is None:
            known = self._renamed[part.digest] = RecipePart(part.content | {"name": name})
        return known

    @cached_property
    def is_empty(self) -> bool:
        """Whether no recipe is left; where that cannot be counted, the first `LOOKED_AT` combinations tell, or none."""
        return not self.recipe_count or (not self.is_exact and not self._may_lead(0, self._all, iter(range(LOOKED_AT))))

    def unmatched(self) -> list[int]:
        """Constraints that no part of some axis matches: of all of them, those of `only` last."""
        seen = [self._all & ~self._bits_or(axis) for axis in self.axes if not axis.is_lazy]
        return [k for k in range(len(self.constraints)) if any(mask >> k & 1 for mask in seen)]

    def has(self, parts: Mapping[str, RecipePart]) -> bool:
        """Whether a recipe may have these parts, given by axis, together."""
        masks = {self._all}
        for axis in self.axes:
            own = [self._mask(axis, parts[axis.name])] if axis.name in parts else self._classes[axis.name]
            masks = {mask & bits for mask in masks for bits in own}
        return any(map(self._passes, masks))

    def _passes(self, mask: int) -> bool:
        return not mask & self._excluding and (not self._only or bool(mask & self._only))

    def _bits_or(self, axis: Axis) -> int:
        found = 0
        for mask in self._classes[axis.name]:
            found |= mask
        return found

    def _about(self, axis: Axis) -> list[int]:
        """Constraints with entries of an axis."""
        return [k for k, constraint in enumerate(self.constraints) if axis.name in constraint.entries]

    def _mask(self, axis: Axis, part: RecipePart) -> int:
        mask = self._all
        for k in self._about(axis):
            if not self.constraints[k].matches(axis.name, part.content):
                mask &= ~(1 << k)
        return mask

    @cached_property
    def _masks(self) -> Mapping[str, Sequence[int]]:
        """Mask of every part of the axes that are lists."""
        return {axis.name: [self._mask(axis, part) for part in axis.parts()] for axis in self.axes if not axis.is_lazy}

    @cached_property
    def _classes(self) -> Mapping[str, Mapping[int, int]]:
        """How many parts have each mask; those of a lazy axis as if they passed all."""
        out: dict[str, Mapping[int, int]] = {}
        for axis in self.axes:
            if axis.is_lazy:
                about = sum(1 << k for k in self._about(axis))
                out[axis.name] = {self._all & ~(about & self._excluding): axis.part_count}
            else:
                out[axis.name] = Counter(self._masks[axis.name])
        return out

    def _count(self, depth: int, mask: int) -> int:
        """Recipes from a depth on, of combinations that have a mask so far."""
        if depth == len(self.axes):
            return int(self._passes(mask))
        known = self._counts.get((depth, mask))
        if known is None:
            classes = self._classes[self.axes[depth].name]
            known = sum(number * self._count(depth + 1, mask & own) for own, number in classes.items())
            self._counts[depth, mask] = known
        return known

    def _combined(self, depth: int, mask: int) -> Iterator[tuple[RecipePart, ...]]:
        """Combinations of parts from a depth on."""
        if depth == len(self.axes):
            if self._count(depth, mask):
                yield ()
            return
        for part, both in self._entered(self.axes[depth], mask):
            if self._count(depth + 1, both):
                for rest in self._combined(depth + 1, both):
                    yield (part, *rest)

    def _entered(self, axis: Axis, mask: int) -> Iterator[tuple[RecipePart, int]]:
        """Every part of an axis, and the mask that a combination has with it."""
        masks = self._masks.get(axis.name)
        for k, part in enumerate(axis.parts()):
            yield part, mask & (self._mask(axis, part) if masks is None else masks[k])

    def _may_lead(self, depth: int, mask: int, left: Iterator[int]) -> bool:
        """Whether combinations from a depth on have a recipe, or are more than are `left` to be looked at."""
        if depth == len(self.axes):
            return self._passes(mask)
        for _, both in self._entered(self.axes[depth], mask):
            if next(left, None) is None:
                return True
            if self._count(depth + 1, both) and self._may_lead(depth + 1, both, left):
                return True
        return False
