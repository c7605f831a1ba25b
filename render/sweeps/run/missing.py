"""What of a plan's recipes is missing in a store: read lazily, each thing once, whoever wants it.

| of a recipe                                | what comes of it                                                     |
|--------------------------------------------|----------------------------------------------------------------------|
| everything is there                        | counted as done                                                      |
| parts are missing                          | a `Want`; wants of one rendering and the same parts share a `Stretch` |
| somebody else's want makes the same        | waits for it: what is made once serves all                           |
| what it waits for could not be made        | fails with the same sentence, under its own name                     |
| its motion cannot be read                  | fails                                                                |
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby, islice

from ....datasets.errors import DatasetError
from ...errors import RenderError
from ..make.task import PART
from ..plan.recipe import WHOLE_GROUPS, Recipe

FAMILY = ("thing", "hand", "strategy")  # what decides the cost of a pose
WHOLE_MOST = 16  # wants of what is made in one go, made of one rendering
CHUNK_FIRST, CHUNK = 256, 4096  # recipes asked for at once: few at first, so that work begins at once

Key = tuple[str, str]
"""A group and the key that its result is stored under."""

Place = tuple[str, str, int, int]
"""Family, rendering, first part, stop."""


@dataclass(eq=False)
class Wanted:
    """A recipe that something is missing of."""

    hash: str
    name: str
    left: int = 0
    """Wants that it waits for."""
    sentence: str | None = None
    """Why it failed."""


@dataclass(eq=False)
class Want:
    """Groups of one recipe that are missing of some parts."""

    recipe: str
    """JSON."""
    groups: tuple[str, ...]
    keys: tuple[Key, ...]
    left: int
    """Parts to come."""
    waiting: list[tuple[Wanted, tuple[Key, ...]]]
    """Recipes that wait for this, and which of its keys each needs."""
    parts: range
    """All that it was of, in the beginning."""
    sentence: str | None = None
    """Why it was given up."""
    absent: frozenset[Key] = frozenset()
    """Its keys of which parts are missing since it was given up."""


@dataclass(eq=False)
class Stretch:
    """Parts first..stop of one rendering, missing alike for all who want them; cut from the front."""

    family: str
    wants: tuple[Want, ...]
    first: int
    stop: int
    pose_count: int
    """Of the whole motion."""
    is_whole: bool
    """Whether it must be made in one go; `first` is then 0 and `stop` 1."""

    def poses(self, first: int, stop: int) -> int:
        """How many poses its parts first..stop have."""
        return self.pose_count if self.is_whole else min(stop * PART, self.pose_count) - first * PART


@dataclass(frozen=True)
class Failure:
    """A recipe that could not be made."""

    recipe_hash: str
    name: str
    sentence: str


@dataclass
class Counts:
    """What has been read of a plan, and what came of it."""

    recipes: int = 0
    done: int = 0
    """Recipes of which all is there."""
    reused: int = 0
    """Recipes of which all was there from the beginning."""
    failed: int = 0
    poses: int = 0
    """Of all recipes read."""
    poses_missing: int = 0
    """To be rendered; a rendering that several recipes share counts once."""
    poses_incomplete: int = 0
    """Of all recipes read, those of which something is missing."""
    poses_once: int = 0
    """Of which something is missing, each once however many recipes and groups want it."""


class Missing:
    """What is missing, by family, in the order of the recipes.

    done: which parts of keys are there (`SweepStore.done`); pose_count: of a recipe's motion; failed: hashes of recipes
    that could not be made before.
    """

    def __init__(
        self,
        recipes: Iterator[Recipe],
        groups: Sequence[str],
        *,
        done: Callable[[Sequence[Key]], dict[Key, set[int]]],
        pose_count: Callable[[Recipe], int],
        failed: Collection[str] = (),
    ) -> None:
        self._recipes, self._done, self._pose_count, self._failed = recipes, done, pose_count, failed
        self._cut = tuple(group for group in groups if group not in WHOLE_GROUPS)
        self._whole = tuple(group for group in groups if group in WHOLE_GROUPS)
        self._chunk = CHUNK_FIRST
        self._open: dict[Key, list[Want]] = {}  # wants under way, by what they make
        self._given_up: dict[Key, str] = {}
        self.stretches: dict[str, deque[Stretch]] = {}
        """By family, the next one first."""
        self.failures: list[Failure] = []
        """Not told yet."""
        self.counts = Counts()
        self.is_exhausted = False
        self.met_again: set[str] = set()
        """Recipes that could not be made before and are asked for again."""

    def read(self) -> list[Stretch]:
        """Read some recipes more, and tell what is new; sets `is_exhausted` after the last."""
        chunk = list(islice(self._recipes, self._chunk))
        self._chunk = CHUNK
        if not chunk:
            self.is_exhausted = True
            return []
        keys = [{group: recipe.key(group) for group in (*self._cut, *self._whole)} for recipe in chunk]
        there = self._done(list(dict.fromkeys(pair for one in keys for pair in one.items())))
        found: dict[Place, list[Want]] = {}
        counts: dict[Place, int] = {}
        for recipe, own in zip(chunk, keys, strict=True):
            self.counts.recipes += 1
            if self._failed and recipe.hash in self._failed:
                self.met_again.add(recipe.hash)
            try:
                count = self._pose_count(recipe)
            except (RenderError, DatasetError, OSError) as error:
                wanted = Wanted(recipe.hash, recipe.title)
                self._fail(wanted, str(error))
                self._settle(wanted)
                continue
            self.counts.poses += count
            for place, want in self._wants(recipe, own, there, count):
                found.setdefault(place, []).append(want)
                counts[place] = count
        return self._add(found, counts)

    def _wants(
        self, recipe: Recipe, own: dict[str, str], there: dict[Key, set[int]], pose_count: int
    ) -> list[tuple[Place, Want]]:
        """What nobody makes yet of a recipe, each with its family, rendering and parts."""
        part_count = max(1, -(-pose_count // PART))
        absent = {group: self._absent(group, own[group], there, part_count) for group in own}
        if not any(absent.values()):
            self.counts.done += 1
            self.counts.reused += 1
            return []
        self.counts.poses_incomplete += self._poses(absent, pose_count)
        wanted = Wanted(recipe.hash, recipe.title)
        for group, parts in absent.items():
            if parts and self._is_made_elsewhere((group, own[group]), wanted):
                absent[group] = frozenset()
        runs = [
            *runs_of({group: absent[group] for group in self._cut}, part_count),
            *runs_of({group: absent[group] for group in self._whole}, 1),
        ]
        text, family, rendering = recipe.to_json() if runs else "", recipe.digest(FAMILY), recipe.key("contours")
        out = []
        for first, stop, groups in runs:
            made = tuple((group, own[group]) for group in groups)
            want = Want(text, groups, made, stop - first, [(wanted, made)], range(first, stop))
            wanted.left += 1
            for key in want.keys:
                self._open.setdefault(key, []).append(want)
            kind = "whole" if groups[0] in self._whole else "cut"
            out.append(((f"{family}/{kind}", rendering, first, stop), want))
        if wanted.left == 0:  # all that it lacks was given up
            self._settle(wanted)
        return out

    def _absent(self, group: str, key: str, there: dict[Key, set[int]], part_count: int) -> frozenset[int]:
        count = part_count if group not in WHOLE_GROUPS else 1
        have = there.get((group, key))
        if not have:
            return frozenset(range(count))
        return frozenset() if len(have) >= count else frozenset(range(count)) - have

    def _poses(self, absent: dict[str, frozenset[int]], pose_count: int) -> int:
        """How many poses lack something."""
        whole = any(absent[group] for group in self._whole)
        if whole or any(len(absent[group]) * PART >= pose_count for group in self._cut):
            return pose_count
        parts = frozenset[int]().union(*(absent[group] for group in self._cut))
        return _poses_of(parts, pose_count)

    def _is_made_elsewhere(self, key: Key, wanted: Wanted) -> bool:
        """Whether another want makes this, or could not; the recipe then waits, or fails."""
        if key in self._given_up:
            self._fail(wanted, self._given_up[key])
            return True
        for want in self._open.get(key, ()):
            want.waiting.append((wanted, (key,)))
            wanted.left += 1
            if want.sentence is not None and key in want.absent:
                self._fail(wanted, want.sentence)
        return key in self._open

    def _add(self, found: dict[Place, list[Want]], counts: dict[Place, int]) -> list[Stretch]:
        stretches: list[Stretch] = []
        for place, wants in found.items():
            family, _, first, stop = place
            is_whole = family.endswith("/whole")
            most = WHOLE_MOST if is_whole else len(wants)
            for k in range(0, len(wants), most):
                some = tuple(wants[k : k + most])
                stretches.append(Stretch(family, some, first, stop, counts[place], is_whole))
        for stretch in stretches:
            self.stretches.setdefault(stretch.family, deque()).append(stretch)
            self.counts.poses_missing += stretch.poses(stretch.first, stretch.stop)
        self.counts.poses_once += _poses_once(found, counts)
        return stretches

    def settle(self, want: Want, part_count: int) -> None:
        """So many parts of a want are made, or given up."""
        want.left -= part_count
        if want.left > 0:
            return
        for key in want.keys:
            others = self._open[key]
            others.remove(want)
            if want.sentence is not None and key in want.absent:
                self._given_up[key] = want.sentence
            if not others:
                del self._open[key]
        for wanted, _ in want.waiting:
            wanted.left -= 1
            if wanted.left == 0:
                self._settle(wanted)

    def give_up(self, want: Want, sentence: str) -> None:
        """A want cannot be made: recipes that wait for what is not there of it have failed."""
        if want.sentence is None:
            want.sentence = sentence
            there = self._done(want.keys)
            want.absent = frozenset(key for key in want.keys if not there.get(key, set()).issuperset(want.parts))
            for wanted, keys in want.waiting:
                if not want.absent.isdisjoint(keys):
                    self._fail(wanted, sentence)

    def _fail(self, wanted: Wanted, sentence: str) -> None:
        if wanted.sentence is None:
            wanted.sentence = sentence
            self.failures.append(Failure(wanted.hash, wanted.name, sentence))

    def _settle(self, wanted: Wanted) -> None:
        if wanted.sentence is None:
            self.counts.done += 1
        else:
            self.counts.failed += 1


def _poses_once(places: Iterable[Place], counts: Mapping[Place, int]) -> int:
    """Poses of renderings' parts, each once."""
    parts: dict[str, set[int]] = {}
    sizes: dict[str, int] = {}
    complete: set[str] = set()
    for place in places:
        family, rendering, first, stop = place
        sizes[rendering] = counts[place]
        if family.endswith("/whole") or (stop - first) * PART >= counts[place]:
            complete.add(rendering)
        else:
            parts.setdefault(rendering, set()).update(range(first, stop))
    return sum(sizes[name] if name in complete else _poses_of(parts[name], sizes[name]) for name in sizes)


def _poses_of(parts: Collection[int], pose_count: int) -> int:
    """How many poses some parts of a motion have; the last one may be short."""
    part_count = -(-pose_count // PART)
    return len(parts) * PART - (part_count * PART - pose_count if part_count - 1 in parts else 0)


def runs_of(absent: dict[str, frozenset[int]], part_count: int) -> list[tuple[int, int, tuple[str, ...]]]:
    """Parts first..stop that lack the same groups, in order."""
    lacking = {group: parts for group, parts in absent.items() if parts}
    if not lacking:
        return []
    if len(set(lacking.values())) == 1 and len(next(iter(lacking.values()))) == part_count:
        return [(0, part_count, tuple(lacking))]
    out: list[tuple[int, int, tuple[str, ...]]] = []
    parts = sorted(set().union(*lacking.values()))
    for groups, run in groupby(parts, key=lambda part: tuple(group for group in lacking if part in lacking[group])):
        for part in run:
            if out and out[-1][1] == part and out[-1][2] == groups:
                out[-1] = (out[-1][0], part + 1, groups)
            else:
                out.append((part, part + 1, groups))
    return out
