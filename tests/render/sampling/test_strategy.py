"""Sampling strategies as data: JSON there and back; values out of range refused with field, value and bound."""

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.render.errors import StrategyError
from palpate.render.sampling.presets import PRESETS, load_sampling, preset
from palpate.render.sampling.strategy import (
    AmplitudeModulation,
    Dwell,
    Gap,
    LateralModulation,
    Order,
    Pace,
    SamplingStrategy,
    Sections,
)

positive = st.floats(0.01, 99.0)
paces = st.builds(
    Pace,
    kind=st.sampled_from(["speed", "frequency", "capped"]),
    frequency=positive,
    lowest=st.floats(0.01, 10.0),
    highest=st.floats(20.0, 999.0),  # twice `lowest`: a whole number of samples a cycle lies between
    points=st.none() | st.integers(1, 1000),
)
dwells = st.builds(Dwell, share=st.floats(0, 0.99), angle=st.floats(0, 3.1))
strategies = st.builds(
    SamplingStrategy,
    speed=positive,
    update_rate=st.floats(200.0, 40_000.0),  # twice the modulations' frequencies
    pace=paces,
    order=st.builds(Order, kind=st.sampled_from(["loop", "pendulum"]), route=st.sampled_from(["given", "shortest"])),
    gap=st.builds(Gap, kind=st.sampled_from(["jump", "return", "pendulum", "close"]), speed=positive),
    dwell=dwells,
    am=st.none() | st.builds(AmplitudeModulation, frequency=positive, wave=st.sampled_from(["sine", "square"])),
    lm=st.none() | st.builds(LateralModulation, radius=st.floats(0, 0.05), frequency=positive),
    foci=st.integers(1, 64),
    continuity=st.sampled_from(["nearest", "jump"]),
)


@given(strategy=strategies)
@settings(max_examples=50)
def test_json_gives_the_strategy_back(strategy):
    assert SamplingStrategy.from_json(strategy.to_json()) == strategy


def test_presets_go_through_json_and_keep_a_changed_update_rate():
    for name in PRESETS:
        strategy = preset(name, update_rate=40_000.0)
        assert strategy.update_rate == 40_000.0, name
        assert SamplingStrategy.from_json(strategy.to_json()) == strategy, name


def test_missing_fields_take_their_defaults():
    assert SamplingStrategy.from_json("{}") == SamplingStrategy()
    assert SamplingStrategy.from_json('{"pace": {"kind": "capped"}}').pace.highest == 200.0
    assert SamplingStrategy.from_json('{"am": null}').am is None


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[1]", "sampling: must be a JSON object, not list"),
        ("{", "sampling: not JSON"),
        ('{"speeed": 7}', "sampling: unknown field 'speeed' (did you mean 'speed'?); known: speed, update_rate"),
        ('{"pace": {"kind": "speed", "hz": 3}}', "pace: unknown field 'hz'; known: kind, frequency"),
        ('{"pace": 70}', "pace: must be a JSON object, not int"),
        ('{"pace": null}', "pace must be a Pace, not None"),
        ('{"speed": "7"}', "speed must be a number in 0.001..100 m/s, not '7'"),
        ('{"speed": true}', "speed must be a number in 0.001..100 m/s, not True"),
        ('{"foci": 1.5}', "foci must be a whole number in 1..64, not 1.5"),
        ('{"speed": NaN}', "speed must lie in 0.001..100 m/s, not nan"),
    ],
)
def test_json_that_is_no_strategy_is_refused_in_words(text, told):
    with pytest.raises(StrategyError) as error:
        SamplingStrategy.from_json(text)
    assert told in str(error.value)


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: Pace(kind="fast"), "pace.kind must be one of speed, frequency, capped, still, not 'fast'"),
        (lambda: Pace(frequency=0), "pace.frequency must lie in 0.001..10000 Hz, not 0"),
        (lambda: Pace(lowest=300.0), "pace.lowest must be at most pace.highest, 200 Hz, not 300"),
        (lambda: Pace(points=0), "pace.points must lie in 1..1e"),
        (lambda: Order(kind="spiral"), "order.kind must be one of"),
        (lambda: Order(step=0), "order.step must lie in 1"),
        (lambda: Order(seed=-1), "order.seed must lie in 0"),
        (lambda: Order(route="long"), "order.route must be one of shortest, given, not 'long'"),
        (lambda: Gap(speed=float("inf")), "gap.speed must lie in 0.001..200 m/s, not inf"),
        (lambda: Dwell(time=-1e-3), "dwell.time must lie in 0..10 s, not -0.001"),
        (lambda: Dwell(share=1.0), "dwell.share must lie in 0..0.99, not 1.0"),
        (lambda: Dwell(time=0.1, share=0.5), "dwell.time must be 0 where dwell.share is 0.5, not 0.1 s"),
        (lambda: AmplitudeModulation(depth=1.1), "am.depth must lie in 0..1, not 1.1"),
        (lambda: AmplitudeModulation(wave="saw"), "am.wave must be one of sine, square, not 'saw'"),
        (lambda: LateralModulation(radius=0.06), "lm.radius must lie in 0..0.05 m, not 0.06"),
        (lambda: Sections(count=1), "sections.count must lie in 2..1000, not 1"),
        (lambda: SamplingStrategy(update_rate=1e6), "update_rate must lie in 1..40000 Hz, not 1000000.0"),
        (lambda: SamplingStrategy(hold=-1), "hold must lie in 0..60 s, not -1"),
        (lambda: SamplingStrategy(foci=65), "foci must lie in 1..64, not 65"),
        (lambda: SamplingStrategy(continuity="far"), "continuity must be one of nearest, jump, not 'far'"),
        (
            lambda: SamplingStrategy(order=Order(kind="step")),
            "pace.points must be given for order.kind 'step', not None",
        ),
        (lambda: SamplingStrategy(sections=Sections()), "sections need pace.kind 'frequency'"),
        (lambda: SamplingStrategy(pace=Pace(kind="still", points=3)), "pace.kind 'still' needs"),
        (
            lambda: SamplingStrategy(pace=Pace(kind="frequency"), dwell=Dwell(time=0.1)),
            "dwell.time must be 0 for pace.kind 'frequency' (use share), not 0.1 s",
        ),
        (lambda: preset("sam"), "unknown sampling preset 'sam' (did you mean 'am'?); known: stm"),
        (lambda: preset("stm", rate=3), "sampling has no field 'rate'; known: speed"),
    ],
)
def test_impossible_values_are_refused_with_field_value_and_bound(make, told):
    with pytest.raises(StrategyError) as error:
        make()
    assert told in str(error.value)


@given(points=st.integers(1, 200), step=st.integers(1, 200))
def test_a_step_that_leaves_points_out_is_refused(points, step):
    make = lambda: SamplingStrategy(pace=Pace(points=points), order=Order(kind="step", step=step))  # noqa: E731  made twice
    visited = {k * step % points for k in range(points)}
    if len(visited) == points:
        assert make().order.step == step
    else:
        with pytest.raises(StrategyError, match=f"order.step.*{points}.*not {step}"):
            make()


@given(length=st.floats(1e-3, 1.0), rate=st.sampled_from([40_000.0, 10_000.0, 40_000 / 3]))
def test_samples_a_cycle_are_as_the_pace_says(length, rate):
    constant = SamplingStrategy(update_rate=rate)
    count = constant.samples_a_cycle(length)
    assert (count - 1) * 7.0 / rate < length <= count * 7.0 / rate * (1 + 1e-2 / count)
    frequency = SamplingStrategy(update_rate=rate, pace=Pace(kind="frequency", frequency=70.0))
    assert abs(frequency.samples_a_cycle(length) - rate / 70.0) <= 0.5
    capped = SamplingStrategy(update_rate=rate, pace=Pace(kind="capped"))
    drawn = rate / capped.samples_a_cycle(length)
    assert 60.0 * (1 - 1e-9) <= drawn <= 200.0 * (1 + 1e-9)
    assert drawn == pytest.approx(float(capped.draw_frequency(length)), rel=200.0 / rate)
    assert SamplingStrategy(pace=Pace(kind="still")).samples_a_cycle(length) == 1


def test_draw_frequency_follows_the_pace():
    length = np.array([0.0, 0.02, 0.1, 1.0])
    kinds = {
        kind: SamplingStrategy(pace=Pace(kind=kind)).draw_frequency(length)
        for kind in ("speed", "frequency", "capped", "still")
    }
    assert all(np.isnan(found[0]) for found in kinds.values())
    assert kinds["speed"][1:] == pytest.approx([350.0, 70.0, 7.0])
    assert kinds["frequency"][1:].tolist() == [70.0, 70.0, 70.0]
    assert kinds["capped"][1:] == pytest.approx([200.0, 70.0, 60.0])
    assert kinds["still"][1:].tolist() == [0.0, 0.0, 0.0]


def test_strategy_is_loaded_by_preset_name_or_from_a_file(tmp_path):
    path = tmp_path / "mine.json"
    path.write_text(SamplingStrategy(speed=5.0).to_json())
    assert load_sampling(str(path)).speed == 5.0
    assert load_sampling("STP").sections == Sections()
    path.write_text(json.dumps({"speed": 0}))
    with pytest.raises(StrategyError, match=r"mine.json: speed must lie in 0.001..100 m/s, not 0"):
        load_sampling(str(path))
    with pytest.raises(StrategyError, match="unknown sampling 'nothing': neither a preset"):
        load_sampling("nothing")


def test_strategies_with_equal_values_are_equal_and_cannot_be_changed():
    assert SamplingStrategy() == SamplingStrategy()
    assert hash(preset("stp")) == hash(preset("stp"))
    with pytest.raises(AttributeError):
        SamplingStrategy().pace.kind = "still"
    assert math.isclose(Dwell().angle, math.pi / 6)
