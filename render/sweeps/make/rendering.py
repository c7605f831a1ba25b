"""A recipe's things, loaded once and kept while they are in use: object, hand, poses, strategies, arrays.

What is kept is found by the digest of what it depends on, contents of files included, so nothing is ever out of date.
"""

import json
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
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
from .poses import ARTICULATED, EXPLORATION, RANDOM, Poses, RandomPoses, require_unchanged

Thing = TypeVar("Thing")
THINGS_KEPT = 8
HANDS_KEPT = 16
BYTES_KEPT = 256_000_000  # of motions, posed hands with them; and of the posed hands of scenes
SCENE_BYTES = BYTES_KEPT // 16  # that a scene counts for, so that there are not too many
POSE_BYTES = 36  # a pose and its time on the host
POSES_BYTES = BYTES_KEPT // 65536  # that any motion counts for: numbers of random poses are small, but many


class CostCache(Generic[Thing]):
    """What was made last, up to a limit of its costs; one thing at least. Threads may ask at once."""

    def __init__(self, limit: int, cost: Callable[[Thing], int] = lambda _: 1) -> None:
        self._limit, self._cost = limit, cost
        self._values: OrderedDict[str, tuple[Thing, int]] = OrderedDict()  # with its cost
        self._cost_sum = 0  # kept, as adding up thousands for each new one takes longer than making them
        self._lock = RLock()

    def get(self, key: str, make: Callable[[], Thing]) -> Thing:
        """What was made for this key; made now if it is not there. What `make` raises passes through."""
        with self._lock:  # held while it is made, so that two threads do not make the same
            if key not in self._values:
                made = make()
                self._values[key] = made, self._cost(made)
                self._cost_sum += self._values[key][1]
                while len(self._values) > 1 and self._cost_sum > self._limit:
                    self._cost_sum -= self._values.popitem(last=False)[1][1]
            self._values.move_to_end(key)
            return self._values[key][0]


@dataclass(frozen=True, eq=False)
class Rendering:
    """What contours depend on: object, hand, poses and intersection strategy of a recipe."""

    key: str
    """Of the group "contours"."""
    name: str
    """For people: object, hand, motion, strategy."""
    scene: Scene
    family: str
    """Renderings of one family have the same scene."""
    poses: Poses
    has_own_stages: bool = False
    """Whether a user's stages see its batches."""

    @property
    def is_fusable(self) -> bool:
        """Whether its poses may be rendered together with those of other motions.

        Not where a user's stage sees them, which may go by `Setting.first` and by what else is in its batch.
        """
        return self.scene.hand.pose_count is None and self.scene.object_pose is None and not self.has_own_stages


class RecipeCache:
    """Everything that recipes name, for one Warp device; what is loaded is kept within bounds.

    Raises what loading raises (RenderError, DatasetError, DeviceError), and SweepError for a file that is no longer
    what the plan saw.
    """

    def __init__(self, device: str) -> None:
        self.device = device
        self._things: CostCache[Solid] = CostCache(THINGS_KEPT)
        self._hands: CostCache[Hand] = CostCache(HANDS_KEPT)
        self._scenes: CostCache[tuple[Scene, bool]] = CostCache(
            BYTES_KEPT, lambda kept: SCENE_BYTES + hand_bytes(kept[0].hand)
        )
        self._placed: CostCache[tuple[Hand, Poses]] = CostCache(BYTES_KEPT, _pose_bytes)

    def rendering(self, recipe: Recipe, *, allow_code: AllowCode = frozenset()) -> Rendering:
        """The scene and the poses of a recipe. allow_code: which code that it names may be run, by default none."""
        thing = self._things.get(recipe.digest(["thing"]), lambda: _load_thing(recipe.thing, allow_code))
        hand, poses = self._hand_and_poses(recipe, thing)
        posed = () if hand.pose_count is None else ("motion",)  # whose rows a posed hand has
        family = recipe.digest(["thing", "hand", "strategy", *posed])
        scene, has_own = self._scenes.get(
            family, lambda: _scene_of(thing, hand, strategy_of(recipe.strategy, allow_code))
        )
        if has_own:
            _require_planned(scene.strategy, recipe.strategy)
        return Rendering(recipe.key("contours"), title_of(recipe), scene, family, poses, has_own)

    def _hand_and_poses(self, recipe: Recipe, thing: Solid) -> tuple[Hand, Poses]:
        explored = ("thing",) if recipe.motion["source"] == EXPLORATION else ()  # whose bounds it keeps to
        key = recipe.digest(["hand", "motion", *explored])
        return self._placed.get(key, lambda: self._made(recipe, thing))

    def _made(self, recipe: Recipe, thing: Solid) -> tuple[Hand, Poses]:
        hand, motion = recipe.hand, recipe.motion
        source = motion["source"]
        if source == RANDOM:
            return self._rigid(recipe), random_poses_of(motion)
        require_unchanged(source, motion.get("sha256"))
        options = {name: motion.get(name) for name in EXPLORATION_OPTIONS} | {"model": model_of(motion)}
        if not is_recording(source):
            if source == EXPLORATION:
                return self._rigid(recipe), explored_poses_of(thing, options)
            return self._rigid(recipe), HostPoses(load_motion(source, thing, {}))
        alignment = motion.get("alignment")
        if alignment is not None:
            require_unchanged(alignment["source"], alignment.get("sha256"))
        is_posed = hand["source"] in ARTICULATED
        posed, poses = load_hand_and_motion(
            hand["source"] if is_posed else "palm",
            None,
            source,
            thing,
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
    return RecipeCache(device)


@lru_cache(maxsize=1024)
def _part_from(text: str) -> RecipePart:
    return RecipePart(json.loads(text))


def read_recipe(text: str) -> Recipe:
    """A recipe from its JSON; parts that many recipes have are hashed once. Raises PlanError for what is none."""
    recipe = Recipe.from_json(text)
    return Recipe.of([_part_from(json.dumps(getattr(recipe, name))) for name in PARTS])


def title_of(recipe: Recipe) -> str:
    """A recipe as a sentence names it: object, hand, motion and strategy."""
    seed = recipe.motion.get("seed")
    motion = recipe.motion["name"] if seed is None else f"{recipe.motion['name']} of seed {seed}"
    return f"{recipe.thing['name']}, {recipe.hand['name']}, {motion}, {recipe.strategy['name']}"


def explored_poses_of(thing: Solid, options: dict[str, Any]) -> ExploredPoses:
    """Poses of an exploration, by its options; raises StrategyError as `load_motion` does."""
    given = {name: value for name, value in options.items() if value is not None}
    try:
        return ExploredPoses.of(thing.bounds, **given)
    except MotionError as error:
        raise StrategyError(f"{EXPLORATION}: {error}") from error


def random_poses_of(motion: dict[str, Any]) -> RandomPoses:
    """Poses of a random motion, by its part of a recipe."""
    at = motion.get("at") or RANDOM_AT
    return RandomPoses(
        int(motion["count"]), int(motion["seed"]), float(motion.get("size") or RANDOM_SIZE), (at[0], at[1], at[2])
    )


@lru_cache(maxsize=64)
def _strategy_from(text: str, source: str, allow_code: AllowCode) -> IntersectionStrategy:
    described: dict[str, Any] = json.loads(text)
    described.pop("sources", None)
    path = Path(source).resolve()
    return read_strategy(json.dumps(described), path.parent, allow_code=allow_code, path=str(path))


def _require_planned(made: IntersectionStrategy, strategy: dict[str, Any]) -> None:
    """Refuse stages of a user's own that are not those that the plan saw; they may be registered again at any time."""
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


def _scene_of(thing: Solid, hand: Hand, strategy: IntersectionStrategy) -> tuple[Scene, bool]:
    """A scene, and whether it has a user's own stages."""
    return Scene.of(thing, hand, strategy), has_own_stages(strategy)


def _load_thing(thing: dict[str, Any], allow_code: AllowCode) -> Solid:
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
    """What a hand that a recording poses takes; a rigid one's is left out [byte]."""
    return 0 if hand.pose_count is None else sum(array.nbytes for array in hand.arrays().values())


def _pose_bytes(kept: tuple[Hand, Poses]) -> int:
    hand, poses = kept
    if isinstance(poses, RandomPoses):
        return POSES_BYTES + hand_bytes(hand)
    if isinstance(poses, ExploredPoses):  # its motion is made where something needs it on the host
        return POSES_BYTES + hand_bytes(hand) + POSE_BYTES * poses.count
    time = poses.motion.time
    return POSES_BYTES + hand_bytes(hand) + poses.motion.pose.nbytes + (0 if time is None else time.nbytes)
