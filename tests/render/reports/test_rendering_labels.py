"""Names in legends: presets by name from the numbers that files hold, and no more than distinguishes files."""

import shutil
from contextlib import ExitStack

import pytest

from palpate.datasets import ContourFile
from palpate.render import IntersectionStrategy, Palm, Stage, load_strategy, render, static_pose
from palpate.render.reports.rendering_labels import hand_text, labels_of, short_text, strategy_name_of
from palpate.render.strategies.intersection_strategy import PRESETS


@pytest.mark.parametrize("name", list(PRESETS))
def test_every_preset_is_recognised_by_what_a_file_keeps_of_it(name):
    kept = PRESETS[name]().resolved(0.0101, marches=True).described()
    assert strategy_name_of(kept) == name
    if isinstance(kept["prune"], list) and "outside" in kept["prune"]:
        added = {"stage": "joined", "gap": 0.005}  # to hands of several patches
        assert strategy_name_of({**kept, "prune": [*kept["prune"], added]}) == name


def test_other_strategies_are_named_by_their_stages():
    mine = IntersectionStrategy(prune=("outside", "small"), transform=("close", "hatch", "depth", "simplify"))
    assert strategy_name_of(mine.described()) == "small + close + hatch + depth + simplify"


def saved(path, strategy, palm=None):
    return render("cube", palm or Palm(), static_pose([0, 0, 0.2]), strategy).save(path)


def labels(*paths):
    with ExitStack() as stack:
        return labels_of([stack.enter_context(ContourFile(path)) for path in paths])


def test_labels_name_options_of_stages_that_differ(tmp_path):
    narrow = IntersectionStrategy(prune=("outside",), transform=("close", Stage("hatch", {"spacing": 0.004})))
    hatch, fine = (saved(tmp_path / f"{k}.h5", s) for k, s in enumerate((load_strategy("hatch"), narrow)))
    first, second = labels(hatch, fine)
    assert first.startswith("hatch, spacing 0.01")
    assert second == "hatch, spacing 0.004"


def test_labels_say_what_differs_and_nothing_else(tmp_path):
    oc, cc = (saved(tmp_path / f"{name}.h5", load_strategy(name)) for name in ("oc", "cc"))
    wide = saved(tmp_path / "wide.h5", load_strategy("cc"), Palm(0.1, 0.1))
    (tmp_path / "again").mkdir()
    twin = shutil.copy(cc, tmp_path / "again")
    assert labels(oc, cc, wide) == ["oc", "cc, palm 85 x 85 mm", "cc, palm 100 x 100 mm"]
    assert len(set(labels(cc, twin))) == 2  # by their paths, as nothing else differs


def test_texts_are_short_and_visible():
    assert hand_text({"kind": "planes", "patches": [1, 2]}) == "planes (2)"
    assert hand_text({"kind": "mesh", "name": "mine\x1b[31m"}) != "mine\x1b[31m"
    assert "\x1b" not in short_text("a\x1b[2Jb")
    assert len(short_text("x" * 500)) == 40
    assert short_text("two\nlines") == "two lines"
