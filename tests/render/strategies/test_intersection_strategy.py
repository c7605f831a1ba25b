"""Intersection strategies as data: JSON, stages with options, order, thresholds in metres, modules of one's own."""

import json
import sys
from dataclasses import replace

import pytest

from palpate.render import IntersectionStrategy, closed_contour, open_contour
from palpate.render.errors import StrategyError
from palpate.render.stages import registry
from palpate.render.stages.registry import Stage, known_stages
from palpate.render.strategies.intersection_strategy import PRESETS, load_strategy

FOCAL_WIDTH = 0.0101


def test_oc_and_cc_describe_themselves_as_ever():
    assert open_contour().to_json() == '{"raw": "section", "prune": ["outside"], "transform": []}'
    assert closed_contour().to_json() == '{"raw": "section", "prune": ["outside"], "transform": ["close"]}'
    for strategy in (open_contour(), closed_contour()):
        assert strategy.resolved(FOCAL_WIDTH).to_json() == strategy.to_json()
        assert IntersectionStrategy.from_json(strategy.to_json()) == strategy
    assert not open_contour().needs_closed
    assert closed_contour().needs_closed
    assert closed_contour().bounded
    assert closed_contour().closes
    assert not IntersectionStrategy().bounded


def test_every_preset_comes_back_from_json_and_is_settled_once_and_for_all():
    load_strategy("oc")  # loads the modules that add presets
    assert {"oc", "cc"} < set(PRESETS)
    for make in PRESETS.values():
        strategy = make()
        assert IntersectionStrategy.from_json(strategy.to_json()) == strategy
        settled = strategy.resolved(FOCAL_WIDTH, marches=True)
        assert IntersectionStrategy.from_json(settled.to_json()) == settled
        assert settled.resolved(0.02, marches=True) == settled
        assert "null" not in settled.to_json()
        assert hash(settled) == hash(strategy.resolved(FOCAL_WIDTH, marches=True))


def test_options_are_stored_as_given_and_settled_in_metres():
    strategy = IntersectionStrategy(prune=("outside", Stage("close-together", {"angle": 0.2})), step=0.002)
    described = strategy.described()
    assert described["prune"] == ["outside", {"stage": "close-together", "angle": 0.2}]
    assert described["step"] == 0.002
    settled = strategy.resolved(FOCAL_WIDTH, marches=True).described()
    assert settled["step"] == 0.002
    assert settled["prune"][1]["angle"] == 0.2
    assert settled["prune"][1]["distance"] == pytest.approx(0.015, rel=0.005)
    assert replace(strategy, step=None).resolved(FOCAL_WIDTH, marches=True).step == FOCAL_WIDTH / 4
    assert replace(strategy, step=None).resolved(FOCAL_WIDTH).step is None
    with pytest.raises(StrategyError, match="focal width"):
        strategy.resolved(0.0)


def test_flush_is_stored_where_it_is_given_and_refused_out_of_its_range():
    assert "flush" not in closed_contour().described()
    for flush in (0.0, 1e-6, 1e-3):
        strategy = replace(closed_contour(), flush=flush)
        assert strategy.described()["flush"] == flush
        assert IntersectionStrategy.from_json(strategy.to_json()) == strategy
        assert strategy.resolved(FOCAL_WIDTH).flush == flush
    for flush in (-1e-9, 1.1e-3, float("nan")):
        with pytest.raises(StrategyError, match=rf"flush must lie in 0..0.001 m, not {flush}"):
            replace(closed_contour(), flush=flush)
    with pytest.raises(StrategyError, match=r"flush must be a number in 0..0.001 m, not 'none'"):
        replace(closed_contour(), flush="none")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[]", "JSON object"),
        ('{"rew": "section"}', "unknown field 'rew'"),
        ('{"raw": "slices"}', "raw: unknown stage 'slices'; known: section, contact"),
        ('{"raw": ["section"]}', "raw: a stage is a name"),
        ('{"prune": "outside"}', "prune must be a list, not 'outside'"),
        ('{"prune": ["tiny"]}', "prune: unknown stage 'tiny'; known: outside, off-skin"),
        ('{"prune": ["close"]}', "prune: unknown stage 'close'"),
        ('{"prune": [3]}', "prune: a stage is a name or"),
        ('{"prune": [{"name": "small"}]}', "prune: a stage is a name or"),
        ('{"prune": [{"stage": "small", "size": 1}]}', "stage 'small' has no option 'size'; known: perimeter, length"),
        ('{"prune": [{"stage": "outside", "by": 1}]}', "stage 'outside' has no option 'by'; known: none"),
        ('{"prune": [{"stage": "small", "length": -1}]}', r"prune: small.length must lie in 0\.\.100 m, not -1"),
        ('{"prune": [{"stage": "small", "length": "1"}]}', "small.length must be a number"),
        ('{"prune": [{"stage": "small", "length": [1]}]}', "small.length must be a number"),
        ('{"prune": [{"stage": "close-together", "across": 1}]}', "across must be true or false, not 1"),
        ('{"prune": ["outside", "small", "small"]}', "stage 'small' is listed twice with the same options"),
        ('{"transform": ["close"]}', '"close" needs "outside" in prune'),
        ('{"raw": "contact", "prune": ["outside"], "transform": ["close"]}', '"close" needs raw "section"'),
        ('{"prune": ["outside"], "transform": ["simplify", "close"]}', '"close" must come first'),
        ('{"step": 0}', "step must lie in"),
        ('{"step": "fine"}', "step must be a number"),
        ('{"modules": "mine"}', "modules must be a list"),
        ('{"modules": [1]}', "must be names of Python modules, not 1"),
        ('{"modules": ["no_such_module"]}', "cannot import 'no_such_module'"),
    ],
)
def test_what_is_no_strategy_is_refused_by_name(text, words):
    with pytest.raises(StrategyError, match=words):
        IntersectionStrategy.from_json(text)


def test_a_stage_may_be_listed_again_with_other_options():
    twice = IntersectionStrategy(prune=(Stage("small", {"length": 0.01}), "outside", "small"))
    assert IntersectionStrategy.from_json(twice.to_json()) == twice


@pytest.fixture
def own_module(tmp_path):
    """A strategy file with a module of stages beside it."""
    (tmp_path / "palpate_test_stages.py").write_text(
        "from palpate.render.stages.registry import register_transform\n"
        "def same(batch, setting, *, times):\n"
        '    """Leave everything as it is."""\n'
        "    return batch\n"
        'register_transform("test-same", same, times=1)\n'
    )
    path = tmp_path / "strategy.json"
    path.write_text(json.dumps({"transform": [{"stage": "test-same", "times": 3}], "modules": ["palpate_test_stages"]}))
    yield path
    registry._ENTRIES.pop("test-same", None)


def test_a_file_names_the_modules_that_its_stages_come_from(own_module):
    before = list(sys.path)
    strategy = load_strategy(str(own_module), allow_code=True)
    assert sys.path == before
    assert known_stages("transform")["test-same"].line == "Leave everything as it is"
    assert strategy.transform == (Stage("test-same", {"times": 3}),)
    assert strategy.modules == ("palpate_test_stages",)
    assert "palpate_test_stages" not in sys.modules  # it runs under a name of its own
    with pytest.raises(StrategyError, match="cannot import 'palpate_test_stages'"):  # a text has no folder beside it
        IntersectionStrategy.from_json(strategy.to_json())


@pytest.mark.parametrize("options", [{"length": None}, {"length": None, "perimeter": None}])
def test_a_stage_with_its_defaults_written_out_is_the_same_stage(options):
    with pytest.raises(StrategyError, match="listed twice with the same options"):
        IntersectionStrategy(prune=("small", Stage("small", options)))
    with pytest.raises(StrategyError, match="listed twice with the same options"):
        IntersectionStrategy(prune=(Stage("hidden", {"share": 0.5}), "hidden"))


def test_an_unknown_strategy_lists_the_presets():
    with pytest.raises(StrategyError, match=r"unknown strategy 'nix': neither a preset \(oc, cc, "):
        load_strategy("nix")
