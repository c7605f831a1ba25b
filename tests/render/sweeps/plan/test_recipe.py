"""Recipes: keys that depend on meaning alone and on all of it, JSON that reads back, columns, groups."""

import hashlib
import json
from dataclasses import asdict, field, make_dataclass

import numpy as np
import pytest

from palpate.render.errors import PlanError
from palpate.render.playback.drive import DriveStrategy
from palpate.render.sampling.strategy import SamplingStrategy
from palpate.render.sweeps.plan import recipe as recipe_module
from palpate.render.sweeps.plan.loading import load_plans
from palpate.render.sweeps.plan.recipe import GROUPS, PARTS, Recipe, digest_source

PLAIN = '[object]\nsource = "cube"\n'


@pytest.fixture
def folder(tmp_path):
    np.save(tmp_path / "voxels.npy", np.zeros((4, 4, 4)))
    (tmp_path / "thing.stl").write_text("solid thing")
    (tmp_path / "hand.csv").write_text("time,joint,x\n")
    for name, height in (("still", 0.0), ("raised", 0.1)):
        placed = {"position": [0, 0, height], "orientation": [0, 0, 0, 1]}
        (tmp_path / f"{name}.json").write_text(json.dumps(placed))
    (tmp_path / "ball.py").write_text(
        "import warp as wp\n\n\n@wp.func\ndef ball(x: wp.vec3) -> float:\n    return wp.length(x) - 0.05\n\n\n"
        "@wp.func\ndef egg(x: wp.vec3) -> float:\n    return wp.length(x) - 0.06\n"
    )
    return tmp_path


def one(folder, text):
    path = folder / "plan.toml"
    path.write_text(text)
    (recipe,) = load_plans([path], allow_code=True).recipes()
    return recipe


def test_keys_are_made_as_the_document_says(folder):
    """The format of keys: whoever changes it makes every baseline useless.

    A field that is added later must be left out of keys where it has the value that means what was before.
    """
    recipe = one(folder, '[object]\nsource = "tube"\nfit = 0.13\n[hand]\nsource = "planes"\n[strategy]\nstep = 0.002\n'
                 '[sampling]\nspeed = 5.0\n[motion]\nmodel = "around"')  # fmt: skip
    content = json.loads(recipe.to_json())
    for name in PARTS:
        del content[name]["name"]
        if name in ("strategy", "sampling", "array"):
            del content[name]["source"]
    assert content["thing"] == {
        "source": "tube", "sha256": None, "function": None, "scale": 1.0, "up": "z", "fit": 0.13,
        "rotate": [0.0, 0.0, 0.0], "at": None, "volume": {}, "bounds": None, "simplify": None,
    }  # fmt: skip
    assert content["hand"] == {"source": "planes", "sha256": None, "palm": None}
    assert content["motion"] == {"source": "exploration", "sha256": None, "duration": 30.0, "rate": 90.0, "seed": 1}
    assert content["strategy"] == {
        "described": {"raw": "section", "prune": ["outside"], "transform": ["close"], "step": 0.002},
        "step": 0.002,
    }
    assert (list(content["sampling"]), list(content["array"])) == (["described"], ["described"])
    assert content["sampling"]["described"].pop("speed") == 5.0
    assert content["sampling"]["described"] == {k: v for k, v in asdict(SamplingStrategy()).items() if k != "speed"}
    assert content["array"]["described"].pop("drive") == asdict(DriveStrategy(gs_pat_iterations=10, wgs_iterations=6))
    content["sampling"]["described"], content["array"]["described"]["drive"] = {"speed": 5.0}, {}
    whole = json.loads(
        json.dumps(content), parse_float=lambda text: int(float(text)) if text.endswith(".0") else float(text)
    )
    digests = {
        name: hashlib.sha256(json.dumps(part, sort_keys=True, separators=(",", ":")).encode()).hexdigest()
        for name, part in whole.items()
    }
    for group, names in GROUPS.items():
        lines = "palpate recipe 1\n" + "".join(f"{name} {digests[name]}\n" for name in names)
        assert recipe.key(group) == hashlib.sha256(lines.encode()).hexdigest()[:32]
    assert recipe.key("contours") == "d2d500c0905094e359640b99fa097f83"
    assert recipe.hash == recipe.key("keep-drives") == "1cdcd61010cda04a0eef0cdac290b02e"


SAME = [
    (PLAIN, '[object]\nsource = "cube"\nscale = 1\nup = "z"\nrotate = [0, 0.0, -0.0]\n'),
    (PLAIN, PLAIN + '[hand]\nsource = "palm"\npalm = [0.085, 0.085]'),
    (PLAIN, PLAIN + '[motion]\nsource = "exploration"\nduration = 30\nrate = 9e1\nseed = 1.0'),
    (
        PLAIN,
        PLAIN
        + '[motion]\nmodel = "Over-Array"\nexplorer = 1\nworkspace = [-0.125, -0.125, 0.135, 0.125, 0.125, 0.325]',
    ),
    (PLAIN, PLAIN + '[strategy]\nsource = "CC"'),
    (PLAIN, PLAIN + '[sampling]\nsource = "stm"\nspeed = 7\nupdate_rate = 10000'),
    (PLAIN, PLAIN + '[array]\nsolver = "gs-pat+wgs"\nwgs_iterations = 6\nsound_speed = 343'),
    (
        PLAIN + "[motion]\nsource = 'random'\ncount = 1e3",
        PLAIN + "[motion]\nsource = 'random'\ncount = 1000\nsize = 0.13",
    ),
    (PLAIN + "[sampling]\nspeed = 0.3", PLAIN + "[sampling]\nspeed = {from = 0.3, to = 0.3, count = 1}"),
]


@pytest.mark.parametrize(("text", "other"), SAME, ids=range(len(SAME)))
def test_equal_meaning_has_equal_json_and_keys(folder, text, other):
    assert one(folder, text).to_json() == one(folder, other).to_json()
    assert one(folder, text).hash == one(folder, other).hash


def test_files_are_known_by_what_is_in_them(folder):
    text = '[object]\nsource = "thing.stl"\n[strategy]\nsource = "mine.json"\n'
    (folder / "mine.json").write_text('{"prune": ["outside"], "transform": ["close", {"stage": "hatch"}]}')
    before = one(folder, text)
    moved = folder / "moved"
    moved.mkdir()
    (folder / "thing.stl").rename(moved / "renamed.stl")
    (moved / "yours.json").write_text('{"transform": ["close", "hatch"], "raw": "section", "prune": ["outside"]}')
    after = one(moved, text.replace("thing", "renamed").replace("mine", "yours"))
    assert after.to_json() != before.to_json()
    assert after.hash == before.hash
    (moved / "renamed.stl").write_text("solid changed")
    assert one(moved, text.replace("thing", "renamed").replace("mine", "yours")).hash != before.hash


def changed(recipe, part, name, value):
    """A recipe with one field of a sampling strategy or a drive set."""
    content = json.loads(recipe.to_json())
    described = content[part]["described"]
    (described if part == "sampling" else described["drive"])[name] = value
    return Recipe.from_json(json.dumps(content))


NEW_FIELDS = [("sampling", "option", SamplingStrategy), ("array", "option", DriveStrategy)]


@pytest.mark.parametrize(("part", "name", "kind"), NEW_FIELDS, ids=lambda given: str(given))
def test_a_field_that_is_new_changes_no_key_where_it_has_its_default(folder, monkeypatch, part, name, kind):
    recipe = one(folder, PLAIN)
    before = recipe.hash
    newer = make_dataclass(kind.__name__, [(name, float, field(default=0.5))], bases=(kind,), frozen=True)
    module = "sampling.strategy" if part == "sampling" else "playback.drive"
    monkeypatch.setattr(f"palpate.render.{module}.{kind.__name__}", newer)
    for cached in (recipe_module._sampling_defaults, recipe_module._drive_defaults):
        cached.cache_clear()
    try:
        assert changed(recipe, part, name, 0.5).hash == before
        assert changed(recipe, part, name, 0.6).hash != before
    finally:
        for cached in (recipe_module._sampling_defaults, recipe_module._drive_defaults):
            cached.cache_clear()


def test_recipes_read_back_from_their_json(folder):
    recipe = one(folder, '[object]\nsource = "thing.stl"\n[motion]\nsource = "hand.csv"\nalignment = "still.json"')
    again = Recipe.from_json(recipe.to_json())
    assert again == recipe
    assert (again.hash, again.to_json(), again.columns()) == (recipe.hash, recipe.to_json(), recipe.columns())
    for text in ("{", "[]", '{"thing": {}}'):
        with pytest.raises(PlanError, match="recipe: "):
            Recipe.from_json(text)


def test_words_for_alignments_have_digests_of_their_own(folder):
    """A word's spellings have one digest; a file, whatever its name and transform, has another."""
    plan = PLAIN + '[motion]\nsource = "hand.csv"\nalignment = '
    (folder / "y-up.json").write_text((folder / "still.json").read_text())
    known = {
        word: one(folder, f"{plan}{word!r}") for word in ("unity", "y-up", "yup", "Y_UP", "y-up.json", "still.json")
    }
    assert known["y-up"].hash == known["yup"].hash == known["Y_UP"].hash
    assert known["y-up.json"].hash == known["still.json"].hash
    assert len({recipe.hash for recipe in known.values()}) == 3
    assert [known[word].columns()["alignment"] for word in ("unity", "yup")] == ["unity", "y-up"]
    assert Recipe.from_json(known["unity"].to_json()) == known["unity"]


def test_files_that_hold_their_data_elsewhere_are_hashed_with_it(folder):
    (folder / "a.nhdr").write_text("NRRD0004\ntype: uchar\ndata file: a.raw\n")
    (folder / "a.raw").write_bytes(b"1")
    (folder / "b.gltf").write_text(json.dumps({"buffers": [{"uri": "b%201.bin"}, {"uri": "data:,x"}]}))
    (folder / "b 1.bin").write_bytes(b"1")
    for source, data in (("a.nhdr", "a.raw"), ("b.gltf", "b 1.bin")):
        before = digest_source(str(folder / source))
        (folder / data).write_bytes(b"2")
        assert digest_source(str(folder / source)) != before
        (folder / data).unlink()
        with pytest.raises(PlanError, match=rf"names the file '{data}', which is not there"):
            digest_source(str(folder / source))
        (folder / data).write_bytes(b"1")
    (folder / "c.nhdr").write_text("NRRD0004\ndata file: LIST\na.raw\n")  # which the reader of volumes does not take
    with pytest.raises(PlanError, match="names the file 'LIST', which is not there"):
        digest_source(str(folder / "c.nhdr"))
    plain = digest_source(str(folder / "thing.stl"))
    assert plain == hashlib.sha256(b"solid thing").hexdigest()
    assert digest_source(f"{folder}/ball.py:ball") == hashlib.sha256((folder / "ball.py").read_bytes()).hexdigest()
