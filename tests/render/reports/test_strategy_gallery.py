"""The list of strategies, and the picture of them."""

import re
from pathlib import Path

import pytest

from palpate.render.reports.strategy_gallery import draw_gallery, stage_rows, strategy_rows
from palpate.render.stages.registry import known_stages
from palpate.render.strategies.intersection_strategy import PRESETS


def test_every_preset_and_every_stage_is_listed_with_a_line():
    assert [name for name, _ in strategy_rows()] == list(PRESETS)
    assert all(line for _, line in strategy_rows())
    rows = stage_rows()
    for role in ("raw", "prune", "transform"):
        assert [name for row, name, _, _ in rows if row == role] == list(known_stages(role))
    options = {name: options for _, name, _, options in rows}
    assert options["inset"] == "distance=0.5 focal widths"
    assert "angle=0 rad" in options["hatch"]
    assert "connect=boundary" in options["hatch"]


def test_a_preset_that_a_user_adds_is_listed_by_its_docstring(monkeypatch):
    def mine():
        """What I need.

        And why.
        """
        return PRESETS["cc"]()

    monkeypatch.setitem(PRESETS, "mine", mine)
    assert ("mine", "What I need") in strategy_rows()


@pytest.mark.exhaustive
def test_the_picture_is_drawn(tmp_path):
    picture = tmp_path / "gallery.png"
    draw_gallery(picture, names=["oc", "corner-pauses", "hatch", "depth-hatch"])
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert picture.stat().st_size > 20_000


DOCS = Path(__file__).parents[3] / "docs/guide/strategies.md"


def test_the_docs_list_every_preset_and_transform_stage_with_every_option():
    text = DOCS.read_text()
    rows = dict(re.findall(r"^\| `([a-z-]+)` \| ([^|]*) \|$", text, re.MULTILINE))
    assert {name: rows.get(name) for name, _ in strategy_rows()} == dict(strategy_rows())
    table = dict(re.findall(r"^\| `([a-z]+)` \| (.*\|.*)\|$", text, re.MULTILINE))
    told = {name: set(re.findall(r"`([a-z_]+)`", line)) for name, line in table.items()}
    told["circle"] |= told["ellipse"]
    for name, entry in known_stages("transform").items():
        if entry.own:
            assert set(entry.options) <= told[name], name
