"""Recipes for tests of a sweep's worker, made without a plan; and what renders them without a sweep."""

import json
from dataclasses import asdict
from hashlib import sha256
from pathlib import Path

from palpate.device.registry import array_model
from palpate.render.playback.drive import DriveStrategy
from palpate.render.sampling.presets import load_sampling
from palpate.render.sampling.strategy import SamplingStrategy
from palpate.render.strategies.intersection_strategy import draft_strategy, load_strategy
from palpate.render.strategies.user_stage_sources import stage_sources
from palpate.render.sweeps.make.task import Chunk, Task
from palpate.render.sweeps.plan.recipe import WHOLE_GROUPS, Recipe


def digest(source):
    return sha256(Path(source).read_bytes()).hexdigest() if Path(source).is_file() else None


def thing_of(source="tube", **given):
    placed = {"scale": 1.0, "up": "z", "fit": None, "rotate": [0.0, 0.0, 0.0], "at": None}
    rest = {"volume": {}, "bounds": None, "simplify": None}
    return {**file_of(source), **placed, **rest, **given}


def hand_of(source="palm", palm=None):
    palm = [0.085, 0.085] if source == "palm" and palm is None else palm
    return {**file_of(source), "palm": palm}


def explored(duration=2.0, rate=90.0, seed=1):
    return {
        "source": "exploration",
        "name": "exploration",
        "sha256": None,
        "duration": duration,
        "rate": rate,
        "seed": seed,
    }


def random_motion(count, seed=1):
    motion = {"source": "random", "name": "random", "sha256": None, "count": count, "seed": seed}
    return {**motion, "size": 0.13, "at": [0.0, 0.0, 0.2]}


def file_of(source):
    return {"source": str(source), "name": Path(source).name, "sha256": digest(source)}


def recorded(source, *, rate=None, alignment=None):
    return {**file_of(source), "side": None, "alignment": alignment and file_of(alignment), "rate": rate}


def strategy_of(source="cc", step=None):
    strategy = load_strategy(str(source), allow_code=True)
    sources = stage_sources(strategy)
    described = strategy.described() | ({"sources": sources} if sources else {})
    return {"source": str(source), "name": Path(source).stem, "described": described, "step": step}


def sampling_of(source="stm", **changes):
    described = {**load_sampling(source).described(), **changes}
    SamplingStrategy.from_json(json.dumps(described))
    return {"source": source, "name": source, "described": described}


def array_of(name="emulator"):
    described = {"identity": array_model(name).identity(), "drive": asdict(DriveStrategy())}
    return {"source": name, "name": name, "described": described}


def recipe_of(thing="tube", hand="palm", motion=None, strategy="cc", sampling="stm", array="emulator"):
    """A recipe; parts are names, or dicts made by the functions above."""
    return Recipe(
        thing if isinstance(thing, dict) else thing_of(thing),
        hand if isinstance(hand, dict) else hand_of(hand),
        explored() if motion is None else motion,
        strategy if isinstance(strategy, dict) else strategy_of(strategy),
        sampling if isinstance(sampling, dict) else sampling_of(sampling),
        array_of(array),
    )


SPLIT = ("contours", "frequency")


def task_of(store, recipes, groups=SPLIT, *, chunk_count=1, number=0, name=None):
    """Chunks of each recipe: so many of the groups that can be split, and one of the others."""
    chunks = []
    for recipe in recipes:
        split = tuple(group for group in groups if group not in WHOLE_GROUPS)
        whole = tuple(group for group in groups if group in WHOLE_GROUPS)
        chunks += [Chunk(recipe.to_json(), split, k) for k in range(chunk_count)] if split else []
        chunks += [Chunk(recipe.to_json(), whole)] if whole else []
    return Task(number, tuple(chunks), str(store), name or f"shard-{number}", code_of(recipes))


def code_of(recipes):
    """SHA-256 of the modules' files that strategies of recipes name: what the parent of a sweep would grant."""
    files = {recipe.strategy["source"] for recipe in recipes if recipe.strategy["described"].get("modules")}
    return frozenset(sha256 for file in files for code in draft_strategy(file)[1] for _, sha256 in code.files)
