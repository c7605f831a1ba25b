"""Orders of transformations: those that make no sense are refused by name, presets are strategies that survive JSON."""

import pytest

from palpate.render import IntersectionStrategy
from palpate.render.errors import StrategyError
from palpate.render.stages.registry import Stage, known_stages
from palpate.render.strategies.intersection_strategy import PRESET_LINES, PRESETS
from palpate.render.strategies.stage_order import require_order


@pytest.mark.parametrize(
    ("raw", "prune", "transform", "message"),
    [
        ("section", ("outside",), ("hatch",), '"hatch" fills .*"outside" without "close"'),
        ("contact", (), ("inset",), '"inset" fills .*raw "contact"'),
        ("section", ("outside",), ("close", "hatch", "inset"), '"inset" fills .*"hatch" leaves none'),
        ("section", ("outside",), ("close", "corners", "ellipse"), '"ellipse" draws .*"corners"'),
        ("section", (), ("depth", "smooth", "inset"), '"inset" draws .*"depth"'),
        ("section", ("outside",), ("close", "circle", "edges"), '"edges" tells .*"circle"'),
        ("contact", (), ("edges",), '"edges" tells .*raw "contact"'),
    ],
)
def test_orders_that_make_no_sense_are_refused(raw, prune, transform, message):
    with pytest.raises(StrategyError, match=message):
        require_order(raw, prune, transform)
    with pytest.raises(StrategyError, match=message):
        IntersectionStrategy(raw=raw, prune=prune, transform=transform)


@pytest.mark.parametrize(
    ("raw", "prune", "transform"),
    [
        (
            "section",
            ("outside",),
            ("close", "resample", "smooth", "inset", "hatch", "simplify", "depth", "resample", "corners"),
        ),
        ("section", (), ("hatch",)),
        ("section", ("outside",), ("corners", "edges")),
        ("contact", (), ("ellipse", "hatch")),
        ("section", ("outside",), ("mine", "hatch")),
        ("section", ("outside",), ("close", "corners", "mine", "ellipse")),
    ],
)
def test_orders_that_make_sense_are_taken(raw, prune, transform):
    require_order(raw, prune, transform)


def test_every_preset_has_a_line_of_its_own():
    assert set(PRESET_LINES) == set(PRESETS)
    assert len(set(PRESET_LINES.values())) == len(PRESET_LINES)
    assert all(len(line) < 80 for line in PRESET_LINES.values())


def test_every_stage_says_what_it_does_in_one_line():
    for name, entry in known_stages("transform").items():
        assert 10 < len(entry.line) < 100, name
        assert entry.line != "without description", name


def test_options_out_of_range_are_refused_by_name():
    with pytest.raises(StrategyError, match=r"hatch\.spacing must lie in 0\.0001\.\.0\.5 m"):
        IntersectionStrategy(prune=("outside",), transform=("close", Stage("hatch", {"spacing": 0.0})))
    with pytest.raises(StrategyError, match=r"ellipse\.of must be one of area, moments, line"):
        IntersectionStrategy(prune=("outside",), transform=("close", Stage("ellipse", {"of": "edges"})))
