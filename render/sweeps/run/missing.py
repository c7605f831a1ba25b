"""What of a plan's recipes the store lacks: each result once, however many recipes share it.

| of a recipe                              | what follows                                                       |
|------------------------------------------|--------------------------------------------------------------------|
| every result is there                    | it is done                                                         |
| chunks of a result are missing           | each becomes a `PendingChunk`                                      |
| another recipe needs the same result     | both wait for it: what is made once serves all                     |
| a result that it needs cannot be made    | it fails with the same sentence, under its own name                |
| its motion cannot be read                | it fails                                                           |
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from zlib import crc32

from ....datasets.errors import DatasetError
from ....datasets.sweeps.store import Failure, Key
from ...errors import RenderError
from ..make.unit import CHUNK_POSES, Chunk, stored_text
from ..plan.recipe import WHOLE_GROUPS, Recipe

FAMILY = ("thing", "hand", "strategy")  # the parts of a recipe that decide the cost of a pose
SHARD_CHUNKS = 64  # consecutive chunks of a recipe that one shard makes

Place = tuple[str, int]
"""Key of a rendering, and number of a chunk: what is rendered once for all results."""


@dataclass(eq=False)
class PendingRecipe:
    """A recipe of which results are missing."""

    hash: str
    name: str
    results_left: int = 0
    message: str | None = None
    """Why it failed."""
    is_left: bool = False
    """Whether other shards make a part of it."""


@dataclass(eq=False)
class PendingResult:
    """A result of which chunks are missing."""

    key: Key
    chunks_left: int
    there: set[int]
    """Numbers of the chunks that the store has."""
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
    place: Place
    """Chunks of one place are rendered together."""
    pose_count: int
    deaths: int = 0
    """Workers that died while they made it alone."""
    tries: int = 0
    """Times that the system failed while it was made."""

    @property
    def is_wanted(self) -> bool:
        """Whether any of its results can still be made whole."""
        return any(result.message is None for result in self.results)


@dataclass(eq=False)
class IncompleteRecipe:
    """A recipe of which chunks are to be made."""

    recipe: Recipe
    pose_count: int
    results: tuple[PendingResult, ...]
    is_whole: bool
    """Whether its results are made of all poses at once."""

    @property
    def family(self) -> str:
        """See `PendingChunk.family`."""
        return f"{self.recipe.digest(FAMILY)}/{'whole' if self.is_whole else 'split'}"

    @property
    def chunk_count(self) -> int:
        """Chunks of its motion, those that are there included."""
        return 1 if self.is_whole else max(1, -(-self.pose_count // CHUNK_POSES))

    def chunk(self, number: int) -> PendingChunk | None:
        """A chunk that is missing; None for one that is there."""
        absent = tuple(result for result in self.results if number not in result.there)
        if not absent:
            return None
        count = self.pose_count if self.is_whole else min(CHUNK_POSES, self.pose_count - number * CHUNK_POSES)
        chunk = Chunk(self.recipe.to_json(), tuple(result.key[0] for result in absent), number)
        place = self.recipe.key("contours"), number
        return PendingChunk(chunk, absent, self.recipe.title, self.family, place, count)


@dataclass
class Counts:
    """What a plan has, and what has been done of it."""

    recipes: int = 0
    done: int = 0
    """Recipes of which every result is there."""
    failed: int = 0
    left: int = 0
    """Recipes that other shards make, in part at least."""
    poses: int = 0
    """Of all recipes."""
    poses_incomplete: int = 0
    """Of all recipes of which something is missing."""
    poses_once: int = 0
    """To be rendered, each once however many recipes and groups need it."""
    renderings: int = 0
    """Of which something is missing."""


class Missing:
    """What is missing, family by family, in the order of the recipes.

    done: which chunks of results are there (`SweepStore.done`); pose_count: of a recipe's motion; shard (k, n): chunks
    of the other n - 1 shards are left out.
    """

    def __init__(
        self,
        recipes: Sequence[Recipe],
        groups: Sequence[str],
        *,
        done: Callable[[Sequence[Key]], dict[Key, set[int]]],
        pose_count: Callable[[Recipe], int],
        shard: tuple[int, int] = (0, 1),
    ) -> None:
        self.failures: list[Failure] = []
        self.counts = Counts()
        self._done, self._shard = done, shard
        self._results: dict[Key, PendingResult] = {}
        self._families: dict[str, dict[str, list[IncompleteRecipe]]] = {}  # by family, then by rendering
        kinds = [own for own in (False, True) if any((group in WHOLE_GROUPS) is own for group in groups)]
        keys = [[(group, recipe.key(group)) for group in groups] for recipe in recipes]
        there = done(list(dict.fromkeys(key for own in keys for key in own)))
        for recipe, own in zip(recipes, keys, strict=True):
            self._add(recipe, own, there, pose_count, kinds)
        self._count_once()

    def _add(
        self,
        recipe: Recipe,
        keys: Sequence[Key],
        there: dict[Key, set[int]],
        pose_count: Callable[[Recipe], int],
        kinds: Sequence[bool],
    ) -> None:
        """Note a recipe, and results that are missing and that no recipe before needs."""
        self.counts.recipes += 1
        pending = PendingRecipe(recipe.hash, recipe.title)
        try:
            poses = pose_count(recipe)
        except (RenderError, DatasetError, OSError) as error:
            self._fail(pending, str(error))
            self._settle_recipe(pending)
            return
        self.counts.poses += poses
        for is_whole in kinds:
            own = IncompleteRecipe(recipe, poses, (), is_whole)
            of_kind = [key for key in keys if (key[0] in WHOLE_GROUPS) is is_whole]
            found = [self._wait_for(key, own.chunk_count, there.get(key, set()), pending) for key in of_kind]
            own.results = tuple(result for result in found if result is not None)
            if own.results:
                self._families.setdefault(own.family, {}).setdefault(recipe.key("contours"), []).append(own)
        if pending.results_left:
            self.counts.poses_incomplete += round(poses * self._share(recipe.key("contours"), poses))
        else:
            self._settle_recipe(pending)

    def _wait_for(self, key: Key, count: int, there: set[int], pending: PendingRecipe) -> PendingResult | None:
        """Have a recipe wait for a result; returns the result if its chunks are to be made for this recipe."""
        absent = count - sum(number < count for number in there)
        if not absent:
            return None
        result, is_new = self._results.get(key), key not in self._results
        if result is None:
            self._results[key] = result = PendingResult(key, absent, there)
        result.recipes.append(pending)
        pending.results_left += 1
        return result if is_new else None

    def _count_once(self) -> None:
        """Count poses to be rendered, and renderings."""
        poses: dict[str, int] = {}
        for renderings in self._families.values():
            for rendering, recipes in renderings.items():
                numbers = {number for own in recipes for result in own.results for number in result.there}
                needed = recipes[0].chunk_count - sum(self._is_there(recipes, number) for number in numbers)
                own = min(recipes[0].pose_count, needed * CHUNK_POSES) if not recipes[0].is_whole else None
                own = recipes[0].pose_count if own is None else own
                own = round(own * self._share(rendering, recipes[0].pose_count))
                poses[rendering] = max(poses.get(rendering, 0), own)
        self.counts.poses_once = sum(poses.values())
        self.counts.renderings = sum(count > 0 for count in poses.values())

    def _is_there(self, recipes: Sequence[IncompleteRecipe], number: int) -> bool:
        """Whether a chunk is there of every result of recipes."""
        return all(number in result.there for own in recipes for result in own.results)

    @property
    def poses_by_family(self) -> dict[str, int]:
        """Poses of this shard's recipes of which something is missing, one recipe of each rendering."""
        counts: dict[str, int] = {}
        for family, renderings in self._families.items():
            poses = {key: recipes[0].pose_count for key, recipes in renderings.items()}
            counts[family] = sum(round(count * self._share(key, count)) for key, count in poses.items())
        return counts

    def _share(self, rendering: str, pose_count: int) -> float:
        """Share of a rendering's chunks that this shard makes."""
        blocks = max(1, -(-pose_count // (CHUNK_POSES * SHARD_CHUNKS)))
        return sum(self._is_own((rendering, block * SHARD_CHUNKS)) for block in range(blocks)) / blocks

    def first_chunks(self) -> Iterator[tuple[str, PendingChunk]]:
        """Each family, and a chunk of it that is missing."""
        for family, renderings in self._families.items():
            own = next(iter(renderings.values()))[0]
            if not any(self._is_own((key, 0)) for key in renderings):
                continue
            yield family, next(chunk for k in range(own.chunk_count) if (chunk := own.chunk(k)) is not None)

    def places(self) -> Iterator[list[PendingChunk]]:
        """Chunks to be made, those of one place together; chunks of other shards are settled as left."""
        for renderings in self._families.values():
            for recipes in renderings.values():
                for number in range(max(own.chunk_count for own in recipes)):
                    made = [own.chunk(number) for own in recipes if number < own.chunk_count]
                    chunks = [chunk for chunk in made if chunk is not None]
                    if chunks and self._is_own(chunks[0].place):
                        yield chunks
                    else:
                        for chunk in chunks:
                            self._leave(chunk)

    def _is_own(self, place: Place) -> bool:
        number, count = self._shard
        rendering, at = place
        return (crc32(rendering.encode()) + at // SHARD_CHUNKS) % count == number

    def settle(self, chunk: PendingChunk) -> None:
        """A chunk is made, or given up."""
        for result in chunk.results:
            result.chunks_left -= 1
            if result.chunks_left:
                continue
            for recipe in result.recipes:
                recipe.results_left -= 1
                if not recipe.results_left:
                    self._settle_recipe(recipe)

    def _leave(self, chunk: PendingChunk) -> None:
        """A chunk is another shard's: recipes that need it are neither done nor failed."""
        for result in chunk.results:
            for recipe in result.recipes:
                recipe.is_left = True
        self.settle(chunk)

    def give_up(self, chunk: PendingChunk, message: str) -> None:
        """A chunk cannot be made: recipes that need a result that lacks it have failed.

        Results that the same unit made of it in spite of the failure must be in the store by now.
        """
        there = self._done([result.key for result in chunk.results])
        for result in chunk.results:
            if chunk.chunk.number not in there[result.key]:
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
