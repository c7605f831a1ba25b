"""Recipes and units for tests of what a sweep's worker makes, without a plan; and their results."""

import json
from dataclasses import asdict
from hashlib import sha256
from pathlib import Path

from palpate.datasets.sweeps.result_row import columns_of, payload_of
from palpate.device.registry import array_model
from palpate.render.playback.drive import DriveStrategy
from palpate.render.sampling.presets import load_sampling
from palpate.render.sampling.strategy import SamplingStrategy
from palpate.render.strategies.intersection_strategy import draft_strategy, load_strategy
from palpate.render.strategies.user_stage_sources import stage_sources
from palpate.render.sweeps.make.unit import Chunk, Unit
from palpate.render.sweeps.make.unit_making import make_unit
from palpate.render.sweeps.plan.code_version import code_version
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
ELSEWHERE = ("another host", 1)
"""A process that gives units, so that users' code may run in this one."""


def unit_of(recipes, groups=SPLIT, *, chunk_count=1, scratch="", parent=ELSEWHERE):
    """Chunks of each recipe: so many of the groups that can be split, and one of the others."""
    chunks = []
    for recipe in recipes:
        split = tuple(group for group in groups if group not in WHOLE_GROUPS)
        whole = tuple(group for group in groups if group in WHOLE_GROUPS)
        chunks += [Chunk(recipe.to_json(), split, k) for k in range(chunk_count)] if split else []
        chunks += [Chunk(recipe.to_json(), whole)] if whole else []
    return Unit(tuple(chunks), code_version(), code_of(recipes), scratch=str(scratch), parent=parent)


def payloads_of(result):
    """The payload of each result by (group, key, chunk)."""
    payloads = {(row.group, row.key, row.chunk): payload_of(row.payload) for row in result.rows}
    assert len(payloads) == len(result.rows)
    return payloads


def made(recipes, groups=SPLIT, device="cpu", **options):
    """Payloads without seconds, and bytes of columns, by (group, key, chunk), of a unit in which nothing fails."""
    result = make_unit(unit_of(recipes, groups, **options), device)
    assert (result.failed, result.refusal) == ((), None)
    payloads = payloads_of(result)
    columns = [{} if row.columns is None else columns_of(row.columns) for row in result.rows]
    return {
        place: ({**payload, "seconds": None}, {name: array.tobytes() for name, array in own.items()})
        for (place, payload), own in zip(payloads.items(), columns, strict=True)
    }


def code_of(recipes):
    """SHA-256 of the modules' files that strategies of recipes name: what a sweep would grant."""
    files = {recipe.strategy["source"] for recipe in recipes if recipe.strategy["described"].get("modules")}
    return frozenset(sha256 for file in files for code in draft_strategy(file)[1] for _, sha256 in code.files)
