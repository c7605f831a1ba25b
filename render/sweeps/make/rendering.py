"""The objects, hands, poses, strategies and arrays that recipes name: each is loaded once, and kept while it is in use.

They are found by the digest of all that they depend on, contents of files included, so none is ever out of date.
"""

import json
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from threading import RLock
from typing import Any, Generic, TypeVar

from ....datasets.errors import MotionError
from ....device.array import ArrayModel
from ...errors import StrategyError, SweepError
from ...hands.hand import Hand
from ...intersection.named_inputs import (
    is_recording,
    load_hand,
    load_hand_and_motion,
    load_motion,
    load_solid,
    simplified,
)
from ...intersection.scene import Scene
from ...motions.explorations.explored import ExploredPoses, HostPoses
from ...motions.explorations.options import EXPLORATION_OPTIONS
from ...objects.mesh.placement import Placement
from ...objects.solid import Solid
from ...playback.drive import DriveStrategy
from ...playback.placed_arrays import load_rig
from ...sampling.strategy import SamplingStrategy
from ...strategies.intersection_strategy import IntersectionStrategy, read_strategy
from ...strategies.user_stage_sources import has_own_stages, stage_sources
from ...trust.permission import AllowCode
from ..plan.recipe import PARTS, RANDOM_AT, RANDOM_SIZE, Recipe, RecipePart, model_of
from .metrics import UserMetric
from .poses import ARTICULATED, EXPLORATION, RANDOM, Poses, RandomPoses, require_unchanged

Value = TypeVar("Value")
SOLIDS_KEPT = 8
HANDS_KEPT = 16
BYTES_KEPT = 256_000_000  # of motions, posed hands with them; and of the posed hands of scenes
SCENE_BYTES = BYTES_KEPT // 16  # that a scene counts for, so that there are not too many
POSE_BYTES = 36  # a pose and its time on the host
POSES_BYTES = BYTES_KEPT // 65536  # that any motion counts for: numbers of random poses are small, but many


class CostCache(Generic[Value]):
    """The values that were used last, up to a limit of their costs, but at least one. Threads may ask at once."""

    def __init__(self, limit: int, cost: Callable[[Value], int] = lambda _: 1) -> None:
        self._limit, self._cost = limit, cost
        self._values: OrderedDict[str, tuple[Value, int]] = OrderedDict()  # with its cost
        self._cost_sum = 0  # kept, as adding up thousands for each new one takes longer than making them
        self._lock = RLock()

    def get(self, key: str, make: Callable[[], Value]) -> Value:
        """The value of a key, made now if it is not there; raises what `make` raises."""
        with self._lock:  # held while it is made, so that two threads do not make the same
            if key not in self._values:
                value = make()
                self._values[key] = value, self._cost(value)
                self._cost_sum += self._values[key][1]
                while len(self._values) > 1 and self._cost_sum > self._limit:
                    self._cost_sum -= self._values.popitem(last=False)[1][1]
            self._values.move_to_end(key)
            return self._values[key][0]


@dataclass(frozen=True, eq=False)
class Rendering:
    """All that contours depend on: object, hand, poses and intersection strategy of a recipe."""

    key: str
    """Of the group "contours"."""
    name: str
    """The title of the first recipe that has it, for messages."""
    scene: Scene
    family: str
    """Renderings of one family have the same scene."""
    poses: Poses
    has_own_stages: bool = False
    """Whether a user's stages see its batches."""

    @property
    def is_fusable(self) -> bool:
        """Whether its poses may be rendered together with those of other motions.

        A user's stage rules that out, as it may depend on `Setting.first` and on the other poses of its batch.
        """
        return self.scene.hand.pose_count is None and self.scene.object_pose is None and not self.has_own_stages


@dataclass(eq=False)
class AskedResult:
    """A result that chunks of a unit ask for."""

    group: str
    recipe: Recipe
    rendering: Rendering
    metric: UserMetric | None = None
    """The user's function that computes it, if one does."""
    places: set[int] = field(default_factory=set)
    """Chunks of the unit that ask for it."""

    @property
    def key(self) -> str:
        """Under which it is stored."""
        return self.recipe.key(self.group)

    @cached_property
    def sampling(self) -> SamplingStrategy | None:
        """The sampling strategy that it depends on; None where contours are all that it needs."""
        needs_contours_only = self.group in ("contours", "keep-contours") or self.metric is not None
        return None if needs_contours_only else sampling_of(self.recipe.sampling)


class RecipeCache:
    """Everything that recipes name, for one Warp device; what is loaded is kept within bounds.

    Raises what loading raises (RenderError, DatasetError, DeviceError), and SweepError for a file that has changed
    since the plan was read.
    """

    def __init__(self) -> None:
        self._solids: CostCache[Solid] = CostCache(SOLIDS_KEPT)
        self._hands: CostCache[Hand] = CostCache(HANDS_KEPT)
        self._scenes: CostCache[Scene] = CostCache(BYTES_KEPT, lambda scene: SCENE_BYTES + hand_bytes(scene.hand))
        self._placed: CostCache[tuple[Hand, Poses]] = CostCache(BYTES_KEPT, _placed_bytes)

    def rendering(self, recipe: Recipe, *, allow_code: AllowCode = frozenset()) -> Rendering:
        """The scene and the poses of a recipe. allow_code: code that it names and that may be run, by default none."""
        solid = self._solids.get(recipe.digest(["thing"]), lambda: _load_solid(recipe.thing, allow_code))
        bounds = ("thing",) if recipe.motion["source"] == EXPLORATION else ()  # which it keeps to
        placed = recipe.digest(["hand", "motion", *bounds])
        hand, poses = self._placed.get(placed, lambda: self._hand_and_poses(recipe, solid))
        rows = () if hand.pose_count is None else ("motion",)  # which a posed hand has
        family = recipe.digest(["thing", "hand", "strategy", *rows])
        scene = self._scenes.get(family, lambda: Scene.of(solid, hand, strategy_of(recipe.strategy, allow_code)))
        if has_own := has_own_stages(scene.strategy):
            _require_planned(scene.strategy, recipe.strategy)
        return Rendering(recipe.key("contours"), recipe.title, scene, family, poses, has_own)

    def _hand_and_poses(self, recipe: Recipe, solid: Solid) -> tuple[Hand, Poses]:
        """A hand, posed if a recording poses it, and its motion."""
        motion, source = recipe.motion, recipe.motion["source"]
        if source == RANDOM:
            at, size = motion.get("at") or RANDOM_AT, float(motion.get("size") or RANDOM_SIZE)
            return self._rigid(recipe), RandomPoses(int(motion["count"]), int(motion["seed"]), size, tuple(at))
        require_unchanged(source, motion.get("sha256"))
        if source == EXPLORATION:
            return self._rigid(recipe), _explored_poses(solid, motion)
        if not is_recording(source):
            return self._rigid(recipe), HostPoses(load_motion(source, solid, {}))
        alignment = motion.get("alignment")
        if alignment is not None:
            require_unchanged(alignment["source"], alignment.get("sha256"))
        is_posed = recipe.hand["source"] in ARTICULATED
        posed, poses = load_hand_and_motion(
            recipe.hand["source"] if is_posed else "palm",
            None,
            source,
            solid,
            exploration_options={"duration": None, "rate": motion.get("rate"), "seed": None},
            side=motion.get("side"),
            alignment=None if alignment is None else Path(alignment["source"]),
        )
        return (posed if is_posed else self._rigid(recipe)), HostPoses(poses)

    def _rigid(self, recipe: Recipe) -> Hand:
        """A hand of one shape, the same for all motions, so that it is on the device once."""
        hand = recipe.hand

        def load() -> Hand:
            require_unchanged(hand["source"], hand.get("sha256"))
            palm = hand.get("palm")
            return load_hand(hand["source"], None if palm is None else (palm[0], palm[1]))

        return self._hands.get(recipe.digest(["hand"]), load)


@lru_cache(maxsize=16)
def recipe_cache(device: str) -> RecipeCache:
    """The cache of a device, kept from unit to unit."""
    del device  # whose copies of objects and hands the cached ones hold
    return RecipeCache()


@lru_cache(maxsize=1024)
def _part_from(text: str) -> RecipePart:
    return RecipePart(json.loads(text))


@lru_cache(maxsize=1024)
def read_recipe(text: str) -> Recipe:
    """A recipe from its JSON; parts that many recipes have are hashed once. Raises PlanError for any other text."""
    recipe = Recipe.from_json(text)
    return Recipe.of([_part_from(json.dumps(getattr(recipe, name))) for name in PARTS])


def _explored_poses(solid: Solid, motion: dict[str, Any]) -> ExploredPoses:
    """Poses of an exploration, by the motion of a recipe; raises StrategyError as `load_motion` does."""
    options = {name: motion.get(name) for name in EXPLORATION_OPTIONS} | {"model": model_of(motion)}
    given = {name: value for name, value in options.items() if value is not None}
    try:
        return ExploredPoses.of(solid.bounds, **given)
    except MotionError as error:
        raise StrategyError(f"{EXPLORATION}: {error}") from error


@lru_cache(maxsize=64)
def _strategy_from(text: str, source: str, allow_code: AllowCode) -> IntersectionStrategy:
    described: dict[str, Any] = json.loads(text)
    described.pop("sources", None)
    path = Path(source).resolve()
    return read_strategy(json.dumps(described), path.parent, allow_code=allow_code, path=str(path))


def _require_planned(made: IntersectionStrategy, strategy: dict[str, Any]) -> None:
    """Refuse a user's stages that are not those that the plan saw; they may be registered again at any time."""
    if stage_sources(made) != strategy["described"].get("sources", {}):
        raise SweepError(
            f"{strategy['source']}: stages of one's own are not those of the plan: their files have changed since it "
            "was read, or this process imported them before they changed (start it anew)"
        )


def strategy_of(strategy: dict[str, Any], allow_code: AllowCode = frozenset()) -> IntersectionStrategy:
    """The intersection strategy of a recipe; modules are looked for beside its file."""
    made = _strategy_from(json.dumps(strategy["described"]), strategy["source"], allow_code)
    _require_planned(made, strategy)
    step = strategy.get("step")
    return made if step is None else replace(made, step=step)


@lru_cache(maxsize=64)
def _sampling_from(text: str) -> SamplingStrategy:
    return SamplingStrategy.from_json(text)


def sampling_of(sampling: dict[str, Any]) -> SamplingStrategy:
    """The sampling strategy of a recipe."""
    return _sampling_from(json.dumps(sampling["described"]))


def arrays_of(array: dict[str, Any]) -> tuple[tuple[ArrayModel, ...], DriveStrategy]:
    """The arrays of a recipe where they stand, and how they are driven; SweepError if they are no longer the plan's."""
    models = tuple(placed.model for placed in load_rig(array["source"]))
    if "+".join(model.identity() for model in models) != array["described"]["identity"]:
        raise SweepError(f"{array['source']}: the array has changed since the plan was read")
    return models, DriveStrategy.from_json(json.dumps(array["described"]["drive"]))


def playing_arrays(recipe: Recipe, strategy: SamplingStrategy) -> tuple[tuple[ArrayModel, ...], DriveStrategy]:
    """The same; raises DeviceError for an array that cannot play the update rate of a sampling strategy."""
    models, drive = arrays_of(recipe.array)
    for model in models:
        model.divider(strategy.update_rate)
    return models, drive


def _load_solid(thing: dict[str, Any], allow_code: AllowCode) -> Solid:
    require_unchanged(thing["source"], thing.get("sha256"))
    at, bounds = thing.get("at"), thing.get("bounds")
    placement = Placement(
        scale=thing.get("scale", 1.0),
        up=thing.get("up", "z"),
        fit=thing.get("fit"),
        rotate=tuple(thing.get("rotate") or (0.0, 0.0, 0.0)),
        at=None if at is None else tuple(at),
    )
    solid = load_solid(
        thing["source"],
        placement,
        volume=thing.get("volume") or {},
        mesh=thing.get("mesh") or {},
        bounds=None if bounds is None else tuple(bounds),
        allow_code=allow_code,
    )
    return simplified(solid, thing.get("simplify"))[0]


def hand_bytes(hand: Hand) -> int:
    """Memory of a hand that a recording poses [byte]; a rigid one counts as nothing."""
    return 0 if hand.pose_count is None else sum(array.nbytes for array in hand.arrays().values())


def _placed_bytes(placed: tuple[Hand, Poses]) -> int:
    """Memory of a hand and its poses [byte]."""
    hand, poses = placed
    arrays = 0
    if isinstance(poses, ExploredPoses):  # its motion is made where something needs it on the host
        arrays = POSE_BYTES * poses.count
    elif isinstance(poses, HostPoses):
        time = poses.motion.time
        arrays = poses.motion.pose.nbytes + (0 if time is None else time.nbytes)
    return POSES_BYTES + hand_bytes(hand) + arrays
