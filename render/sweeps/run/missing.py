"""What of a plan's recipes the store lacks: read lazily, each result once, however many recipes share it.

| of a recipe                                | what follows                                                         |
|--------------------------------------------|----------------------------------------------------------------------|
| every result is there                      | it counts as done                                                    |
| chunks of a result are missing             | each becomes a `PendingChunk`                                        |
| another recipe has asked for the result    | it waits for that one: what is made once serves all                  |
| a result that it needs could not be made   | it fails with the same sentence, under its own name                  |
| its motion cannot be read                  | it fails                                                             |
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from zlib import crc32

from ....datasets.errors import DatasetError
from ...errors import RenderError
from ..make.task import CHUNK_POSES, Chunk, stored_text
from ..plan.recipe import WHOLE_GROUPS, Recipe

FAMILY = ("thing", "hand", "strategy")  # what decides the cost of a pose
RECIPES_FIRST, RECIPES_READ = 256, 4096  # asked for at once: few at first, so that work begins at once
BUCKETS, BUCKET_CHUNKS = 8, 64  # of a family; consecutive chunks of a motion that are in one bucket
CHUNKS_READ = 1 << 16  # given at once: a recipe of 10^12 poses has millions

ResultKey = tuple[str, str]
"""A group and the key that its result is stored under."""


@dataclass(eq=False)
class PendingRecipe:
    """A recipe of which results are missing."""

    hash: str
    name: str
    results_left: int = 0
    message: str | None = None
    """Why it failed."""
    is_left: bool = False
    """Whether chunks of it are left to other shards."""


@dataclass(eq=False)
class PendingResult:
    """A result of which chunks are missing."""

    key: ResultKey
    chunks_left: int
    recipes: list[PendingRecipe] = field(default_factory=list)
    """That wait for it."""
    message: str | None = None
    """Why it could not be made."""


@dataclass(eq=False)
class PendingChunk:
    """A chunk that is to be made."""

    chunk: Chunk
    results: tuple[PendingResult, ...]
    """Of its groups."""
    title: str
    """Of its recipe."""
    family: str
    """Chunks of one family cost the same time a pose."""
    rendering: str
    """Chunks of one rendering and number are rendered once."""
    pose_count: int
    failure_count: int = 0
    """Workers that died, or were ended, while they made it alone."""

    @property
    def place(self) -> tuple[str, str, int]:
        """Chunks of one place are rendered together."""
        return self.family, self.rendering, self.chunk.number

    @property
    def bucket_number(self) -> int:
        """The same in every parent: of its rendering and place, for sharing work."""
        return crc32(self.rendering.encode()) + self.chunk.number // BUCKET_CHUNKS

    @property
    def bucket(self) -> str:
        """Chunks of one bucket are made by one parent, where several share a sweep."""
        return f"{self.family.replace('/', '-')}-{self.bucket_number % BUCKETS}"

    def is_in(self, there: Mapping[ResultKey, Collection[int]]) -> bool:
        """Whether all its results are there. there: numbers of the chunks of each result."""
        return all(self.chunk.number in there.get(result.key, ()) for result in self.results)

    @property
    def is_wanted(self) -> bool:
        """Whether any of its results can still be made whole."""
        return any(result.message is None for result in self.results)


@dataclass(eq=False)
class IncompleteRecipe:
    """A recipe of which chunks are still to be given."""

    recipe: Recipe
    text: str
    family: str
    rendering: str
    pose_count: int
    split: list[tuple[PendingResult, set[int]]]
    """Results that chunks make, and which of their chunks are there."""
    whole: tuple[PendingResult, ...]
    """Results that all poses make at once."""

    @property
    def chunk_count(self) -> int:
        """Chunks of its motion, those that are there included."""
        return max(1, -(-self.pose_count // CHUNK_POSES)) if self.split else 1

    def chunks(self, numbers: range) -> Iterator[PendingChunk]:
        """Those that are missing of some numbers; what cannot be split is of number 0."""
        for number in range(numbers.start, min(numbers.stop, self.chunk_count)):
            absent = tuple(result for result, there in self.split if number not in there)
            if absent:
                yield self._chunk(absent, number, min(CHUNK_POSES, self.pose_count - number * CHUNK_POSES))
        if self.whole and numbers.start == 0:
            yield self._chunk(self.whole, 0, self.pose_count)

    def _chunk(self, results: tuple[PendingResult, ...], number: int, pose_count: int) -> PendingChunk:
        chunk = Chunk(self.text, tuple(result.key[0] for result in results), number)
        family = f"{self.family}/{'whole' if results is self.whole else 'split'}"
        return PendingChunk(chunk, results, self.recipe.title, family, self.rendering, pose_count)


@dataclass(frozen=True)
class Failure:
    """A recipe that could not be made."""

    recipe_hash: str
    name: str
    sentence: str


@dataclass
class Counts:
    """What has been read of a plan, and what has been done."""

    recipes: int = 0
    done: int = 0
    """Recipes of which every result is there."""
    failed: int = 0
    left: int = 0
    """Recipes that other shards make, in part at least."""
    poses: int = 0
    """Of all recipes read."""
    poses_missing: int = 0
    """Of chunks to be made; a rendering that several recipes share counts once, or twice if it is sampled, too."""
    poses_incomplete: int = 0
    """Of all recipes read of which something is missing."""
    poses_once: int = 0
    """Of which something is missing, each once however many recipes and groups need it."""


class Missing:
    """What is missing, in the order of the recipes; of those that are read at once, family by family.

    done: which chunks of results are there (`SweepStore.done`); pose_count: of a recipe's motion; failed: hashes of
    recipes that could not be made before.
    """

    def __init__(
        self,
        recipes: Iterable[Recipe],
        groups: Sequence[str],
        *,
        done: Callable[[Sequence[ResultKey]], dict[ResultKey, set[int]]],
        pose_count: Callable[[Recipe], int],
        failed: Collection[str] = (),
    ) -> None:
        self._recipes, self._done, self._pose_count, self._failed = iter(recipes), done, pose_count, failed
        self._split = tuple(group for group in groups if group not in WHOLE_GROUPS)
        self._whole = tuple(group for group in groups if group in WHOLE_GROUPS)
        self._read_count = RECIPES_FIRST
        self._incomplete: list[IncompleteRecipe] = []
        """Of which chunks are given from `_number` on."""
        self._number = 0
        self._results: dict[ResultKey, PendingResult] = {}
        self._given_up: dict[ResultKey, str] = {}
        self.failures: list[Failure] = []
        """Not reported yet."""
        self.counts = Counts()
        self.is_exhausted = False
        """Whether all recipes were read."""
        self.met_again: set[str] = set()
        """Recipes that could not be made before and are asked for again."""

    def there(self, keys: Sequence[ResultKey]) -> dict[ResultKey, set[int]]:
        """Which chunks of results the store has now."""
        return self._done(list(dict.fromkeys(keys)))

    @property
    def poses_unread(self) -> int:
        """At most so many poses of recipes that were read are in chunks that were not given yet."""
        left = {own.rendering: own.pose_count - self._number * CHUNK_POSES for own in self._incomplete}
        return sum(max(0, count) for count in left.values())

    def read(self) -> list[PendingChunk]:
        """Read on; returns chunks that are missing, and sets `is_exhausted` after the last."""
        if not self._incomplete:
            self._read_recipes()
        step = max(1, CHUNKS_READ // max(1, len(self._incomplete)))
        numbers = range(self._number, self._number + step)
        found: dict[tuple[str, str, int], list[PendingChunk]] = {}
        for own in self._incomplete:
            for chunk in own.chunks(numbers):
                found.setdefault(chunk.place, []).append(chunk)
        self._number = numbers.stop
        if all(own.chunk_count <= numbers.stop for own in self._incomplete):
            self._incomplete = []
        self._count(chunks[0] for chunks in found.values())
        families: dict[str, list[PendingChunk]] = {}
        for (family, _, _), chunks in found.items():
            families.setdefault(family, []).extend(chunks)
        return [chunk for family in families.values() for chunk in family]

    def _read_recipes(self) -> None:
        """Read the next recipes, and note those that lack something; `is_exhausted` if there is none."""
        recipes = list(islice(self._recipes, self._read_count))
        self._read_count, self._number = RECIPES_READ, 0
        self.is_exhausted = not recipes
        keys = [{group: recipe.key(group) for group in (*self._split, *self._whole)} for recipe in recipes]
        there = self._done(list(dict.fromkeys(pair for one in keys for pair in one.items())))
        for recipe, own in zip(recipes, keys, strict=True):
            incomplete = self._read_recipe(recipe, own, there)
            if incomplete is not None:
                self._incomplete.append(incomplete)

    def _read_recipe(
        self, recipe: Recipe, own: dict[str, str], there: dict[ResultKey, set[int]]
    ) -> IncompleteRecipe | None:
        """A recipe, if it has results that are missing and that no other recipe has asked for."""
        self.counts.recipes += 1
        if self._failed and recipe.hash in self._failed:
            self.met_again.add(recipe.hash)
        pending = PendingRecipe(recipe.hash, recipe.title)
        try:
            pose_count = self._pose_count(recipe)
        except (RenderError, DatasetError, OSError) as error:
            self._fail(pending, str(error))
            self._settle_recipe(pending)
            return None
        self.counts.poses += pose_count
        split: list[tuple[PendingResult, set[int]]] = []
        whole: list[PendingResult] = []
        for group, key in own.items():
            is_whole, done = group in self._whole, there.get((group, key), set())
            chunk_count = 1 if is_whole else max(1, -(-pose_count // CHUNK_POSES))
            absent = chunk_count - sum(number < chunk_count for number in done)
            result = self._wait_for((group, key), absent, pending) if absent else None
            if result is not None and is_whole:
                whole.append(result)
            elif result is not None:
                split.append((result, done))
        if pending.results_left or pending.message:
            self.counts.poses_incomplete += pose_count
        if not pending.results_left:
            self._settle_recipe(pending)
        if not split and not whole:
            return None
        text, family, rendering = recipe.to_json(), recipe.digest(FAMILY), recipe.key("contours")
        return IncompleteRecipe(recipe, text, family, rendering, pose_count, split, tuple(whole))

    def _wait_for(self, key: ResultKey, chunk_count: int, pending: PendingRecipe) -> PendingResult | None:
        """Have a recipe wait for a result; gives the result if its chunks are to be made for this recipe."""
        if key in self._given_up:
            self._fail(pending, self._given_up[key])
            return None
        result, is_new = self._results.get(key), False
        if result is None:
            result, is_new = PendingResult(key, chunk_count), True
            self._results[key] = result
        result.recipes.append(pending)
        pending.results_left += 1
        if result.message is not None:
            self._fail(pending, result.message)
        return result if is_new else None

    def _count(self, chunks: Iterable[PendingChunk]) -> None:
        """Add up poses of chunks, one of each place."""
        once: dict[str, int] = {}
        whole: dict[str, int] = {}
        for chunk in chunks:
            self.counts.poses_missing += chunk.pose_count
            if chunk.family.endswith("/whole"):
                whole[chunk.rendering] = chunk.pose_count
            else:
                once[chunk.rendering] = once.get(chunk.rendering, 0) + chunk.pose_count
        self.counts.poses_once += sum((once | whole).values())

    def settle(self, chunk: PendingChunk) -> None:
        """A chunk is made, or given up."""
        for result in chunk.results:
            result.chunks_left -= 1
            if result.chunks_left:
                continue
            del self._results[result.key]
            if result.message is not None:
                self._given_up[result.key] = result.message
            for recipe in result.recipes:
                recipe.results_left -= 1
                if not recipe.results_left:
                    self._settle_recipe(recipe)

    def leave(self, chunk: PendingChunk) -> None:
        """A chunk is another shard's: recipes that need it are neither done nor failed."""
        for result in chunk.results:
            for recipe in result.recipes:
                recipe.is_left = True
        self.settle(chunk)

    def give_up(self, chunk: PendingChunk, message: str) -> None:
        """A chunk cannot be made: recipes that need a result that lacks it have failed."""
        there = self._done([result.key for result in chunk.results])
        for result in chunk.results:
            if chunk.chunk.number not in there.get(result.key, set()):
                result.message = result.message or message
                for recipe in result.recipes:
                    self._fail(recipe, message)
        self.settle(chunk)

    def _fail(self, recipe: PendingRecipe, message: str) -> None:
        if recipe.message is None:
            recipe.message = stored_text(message)
            self.failures.append(Failure(recipe.hash, recipe.name, recipe.message))

    def _settle_recipe(self, recipe: PendingRecipe) -> None:
        if recipe.message is not None:
            self.counts.failed += 1
        elif recipe.is_left:
            self.counts.left += 1
        else:
            self.counts.done += 1
