"""Groups of a recipe that are made in one go: contour files, then one walk through the focal points for all the rest.

Recipes of one rendering share its contours; those of one sampling strategy, too, share its focal points.
"""

from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from ....datasets.motions.hand_motion import HandMotion
from ...intersection.scene import Scene
from ...motions.numbers import NUMBERS
from ...playback.focal_points import ContourRows, ContourSource
from ...sampling.sampler import Sampler
from ...sampling.strategy import SamplingStrategy
from ..plan.recipe import Recipe
from .acoustic_metrics import NoiseMeter, measure_pressure
from .keep import DriveKeeper, FocusKeeper, contours_of, keep_contours
from .poses import RandomPoses
from .rendering import Rendering, sampling_of
from .sampling import sample_recipe, why_not_sampled

Place = tuple[str, str]
"""Group and key."""
Wanted = Mapping[Place, Recipe]
Made = dict[Place, dict[str, Any] | Exception]
"""Payloads, or why there is none."""


KEEPERS = {"keep-focal-points": FocusKeeper, "keep-drives": DriveKeeper}


def make_unsplit(rendering: Rendering, wanted: Wanted, folder: Path, device: str) -> Made:
    """Make the groups that cannot be split, of recipes that have one rendering.

    folder: of kept files. What goes wrong with a group stands in its place; the others are made.
    """
    made: Made = {}
    kept = {place: recipe for place, recipe in wanted.items() if place[0] == "keep-contours"}
    for place in kept:
        try:
            made[place] = keep_contours(rendering.scene, rendering.poses.motion, rendering.key, folder, device)
        except Exception as error:  # of this group only
            made[place] = error
    sampled = {place: recipe for place, recipe in wanted.items() if place not in kept}
    if not sampled:
        return made
    motion = None if isinstance(rendering.poses, RandomPoses) else rendering.poses.motion
    reason = why_not_sampled(motion)
    if reason is not None or motion is None:
        return made | {place: _nothing(place, reason or "") for place in sampled}
    return made | _sampled(rendering, motion, sampled, folder, device)


def _sampled(rendering: Rendering, motion: HandMotion, sampled: Wanted, folder: Path, device: str) -> Made:
    """Groups that are made of focal points, walk by walk through the contours."""
    made: Made = {}
    try:
        with contours_of(rendering.scene, motion, rendering.key, folder, device) as contours:
            for strategy, asked in walks_of(sampled):
                made |= _walk(contours, motion, rendering.scene, strategy, asked, folder)
    except Exception as error:  # a kept file that cannot be read
        made |= {place: error for place in sampled if place not in made}
    return made


def walks_of(sampled: Wanted) -> list[tuple[SamplingStrategy, dict[Place, Recipe]]]:
    """Groups that are made by one walk through the focal points: all of one sampling strategy, but one noise at most.

    Noise has all frames of a recipe in memory, up to 4 GiB; further arrays of the same sampling get walks of their own.
    """
    by_sampling: dict[SamplingStrategy, list[dict[Place, Recipe]]] = {}
    for place, recipe in sampled.items():
        walks = by_sampling.setdefault(sampling_of(recipe.sampling), [{}])
        walk = walks[0]
        if place[0] == "noise" and any(group == "noise" for group, _ in walk):
            walks.append(walk := {})
        walk[place] = recipe
    return [(strategy, walk) for strategy, walks in by_sampling.items() for walk in walks]


def _nothing(place: Place, reason: str) -> dict[str, Any]:
    """What stands for a group that a recipe cannot have."""
    names = {"sampling": NUMBERS, "noise": (), "pressure": ()}.get(place[0], ("path",))
    return {**dict.fromkeys(names), "reason": reason, "seconds": {}}


def _walk(
    contours: ContourRows,
    motion: HandMotion,
    scene: Scene,
    strategy: SamplingStrategy,
    asked: Wanted,
    folder: Path,
) -> Made:
    """Sample once for all groups of one sampling strategy; if that fails, once for each."""
    try:
        return _walked(contours, motion, scene, strategy, asked, folder)
    except Exception as error:  # of one group, which the others are not to suffer from
        if len(asked) == 1:
            return dict.fromkeys(asked, error)
    made: Made = {}
    for place, recipe in asked.items():
        made |= _walk(contours, motion, scene, strategy, {place: recipe}, folder)
    return made


def _walked(
    contours: ContourRows,
    motion: HandMotion,
    scene: Scene,
    strategy: SamplingStrategy,
    asked: Wanted,
    folder: Path,
) -> Made:
    frame_count = ContourSource(contours, Sampler(strategy)).frame_count
    made: dict[Place, dict[str, Any]] = {}
    with ExitStack() as stack:
        keepers: dict[Place, FocusKeeper | DriveKeeper | NoiseMeter] = {}
        for place, recipe in asked.items():
            if place[0] in KEEPERS:
                keeper = KEEPERS[place[0]](recipe, place[1], folder, strategy, frame_count)
                stack.enter_context(keeper.file)
                keepers[place] = keeper
            elif place[0] == "noise":  # both on the CPU, whatever renders: the same bits by whichever worker
                keepers[place] = NoiseMeter(recipe, strategy, frame_count)
            elif place[0] == "pressure":
                made[place] = measure_pressure(contours, scene.hand, strategy, recipe)
        if len(made) == len(asked):  # pressure alone needs no focal points but those of its sample
            return dict(made)
        counted = any(place[0] == "sampling" for place in asked)
        numbers = sample_recipe(contours, motion, scene.hand, strategy, list(keepers.values()), counted=counted)
        walking, counts = numbers["seconds"], {**numbers, "seconds": {}}
        for place in asked:
            payload = keepers[place].publish() if place in keepers else made.get(place, counts)
            made[place] = {**payload, "seconds": walking | payload["seconds"]}
            walking = {}  # counted once
    return dict(made)
