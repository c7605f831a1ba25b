"""Pictures of strategies: each strategy is a scene of one figure, under its name and its stages."""

import re
from pathlib import Path

import pytest
from matplotlib.collections import LineCollection

from palpate.render import IntersectionStrategy, StrategyError, load_strategy
from palpate.render.reports.strategy_figure import draw_strategies, stages_text, strategies_figure, strategy_rows
from palpate.render.stages.registry import known_stages
from palpate.render.strategies.intersection_strategy import PRESETS


def test_every_preset_is_listed_with_a_line():
    assert [name for name, _ in strategy_rows()] == list(PRESETS)
    assert all(line for _, line in strategy_rows())


def test_a_preset_that_a_user_adds_is_listed_by_its_docstring(monkeypatch):
    def mine():
        """What I need.

        And why.
        """
        return PRESETS["cc"]()

    monkeypatch.setitem(PRESETS, "mine", mine)
    assert ("mine", "What I need") in strategy_rows()


def test_stages_are_written_with_their_options_and_units():
    strategy = IntersectionStrategy.from_json(
        '{"prune": ["outside"], "transform": ["close", {"stage": "inset", "distance": 0.004}]}'
    )
    assert stages_text(strategy) == "outside + close + inset, distance 0.004 m"
    assert "hatch, angle 0 rad" not in stages_text(load_strategy("cc"))


@pytest.mark.exhaustive
def test_a_strategy_stands_beside_its_raw_intersection_which_is_drawn_once():
    figure = strategies_figure({"open": load_strategy("oc"), "closed": load_strategy("cc")})
    scenes = [axes for axes in figure.axes if any(isinstance(own, LineCollection) for own in axes.collections)]
    assert len(scenes) == len(figure.axes) == 3
    shown = [text.get_text() for text in figure.texts]
    assert [text for text in shown if text in ("raw: section", "open", "closed")] == ["raw: section", "open", "closed"]
    assert "outside + close" in shown


def test_no_strategy_and_too_many_are_refused(tmp_path):
    for count in (0, 13):
        with pytest.raises(StrategyError, match=f"shows 1 to 12 strategies, not {count}"):
            draw_strategies(tmp_path / "a.png", {str(k): load_strategy("cc") for k in range(count)})
    assert not list(tmp_path.iterdir())


@pytest.mark.exhaustive
def test_a_picture_of_all_presets_has_a_scene_for_each(tmp_path):
    draw_strategies(tmp_path / "all.svg", None)
    content = (tmp_path / "all.svg").read_text()
    assert all(f">{name}<" in content for name in PRESETS)


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
