"""Expression trees: values against the oracle, bounds, JSON, what is refused."""

import json

import numpy as np
import pytest
from expression_oracle import bounded_expressions, expressions, solids, value
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from palpate.kernels.fields.expression_tree import STACK, tree_field
from palpate.kernels.fields.field import probe_points
from palpate.render.errors import ImplicitError
from palpate.render.objects.functions.expression import (
    DEEPEST,
    LARGEST,
    Difference,
    Sphere,
    Torus,
    Union,
    box,
    capsule,
    cylinder,
    expression_from,
    expression_from_json,
    expression_to_json,
    half_space,
    load_expression,
    sphere,
    torus,
    union,
)
from palpate.render.objects.functions.expression_compiler import compile_expression, expression_bounds

AT = np.random.default_rng(5).uniform(-0.3, 0.3, (400, 3))
NEAR = 1e-12  # [m]


def values(e, x=AT, device="cpu"):
    return probe_points(tree_field(compile_expression(e), device), x, device=device)


@pytest.mark.exhaustive
@given(expressions)
def test_values_are_those_of_the_oracle(e):
    assert np.abs(values(e) - value(e, AT)).max() <= NEAR


def test_values_are_those_of_the_oracle_on_every_device(device):
    e = (sphere(0.05) | box(0.1, 0.02, 0.3).turned(10, 20, 30)).blended(torus(0.1, 0.03).moved(0.05), 0.04)
    e = e.grown(0.002) & (cylinder(0.2, 0.1).scaled(2) - capsule((0, 0, 0), (0.1, 0.1, 0), 0.02)) - half_space(
        (1, 2, 3), -0.2
    )
    got = values(e, device=device)
    assert np.abs(got - value(e, AT)).max() <= NEAR
    assert (got == values(e)).all()


@given(expressions)
@settings(max_examples=15)
def test_no_value_changes_by_more_than_the_point_moves(e):
    apart = np.linalg.norm(AT[1:] - AT[:-1], axis=1)
    assert (np.abs(np.diff(values(e))) <= apart + NEAR).all()
    near = AT + np.random.default_rng(1).normal(size=AT.shape) * 1e-4
    assert (np.abs(values(e, near) - values(e)) <= np.linalg.norm(near - AT, axis=1) + NEAR).all()


@given(solids)
@settings(max_examples=25)
def test_the_value_of_a_primitive_is_the_distance(e):
    """Going back by the value, against the way it grows, ends on the surface."""
    assume(not (isinstance(e, Torus) and e.tube > e.radius))  # deep inside, the next test
    h = 1e-7
    slope = np.stack([(values(e, AT + d) - values(e, AT - d)) / (2 * h) for d in h * np.eye(3)], axis=1)
    smooth = np.abs(np.linalg.norm(slope, axis=1) - 1) < 1e-6  # not where two sides are equally near
    assert smooth.mean() > 0.9
    assert np.abs(values(e, AT - values(e)[:, None] * slope))[smooth].max() < 1e-7


def test_a_torus_whose_tube_crosses_the_axis_has_values_below_the_distance_there():
    radius, tube = 0.0546875, 0.05859375
    assert values(torus(radius, tube), np.zeros((1, 3)))[0] == pytest.approx(radius - tube)
    assert tube - radius < np.sqrt(tube**2 - radius**2)  # from the middle to the nearest of the surface, on the axis
    on_axis = np.array([[0.0, 0.0, np.sqrt(tube**2 - radius**2)]])
    assert abs(values(torus(radius, tube), on_axis)[0]) < NEAR


@given(expressions, expressions)
@settings(max_examples=12)
def test_operators_say_what_is_inside(a, b):
    one, other = values(a) < 0, values(b) < 0
    assert ((values(a | b) < 0) == (one | other)).all()
    assert ((values(a & b) < 0) == (one & other)).all()
    assert ((values(a - b) < 0) == (one & ~(values(b) <= 0))).all()
    assert (values(a.blended(b, 0.01)) <= values(a | b)).all()
    assert (values(a.blended(b, 0.01)) == values(b.blended(a, 0.01))).all()


@pytest.mark.exhaustive
@given(bounded_expressions)
def test_bounds_hold_all_of_it(e):
    low, high = expression_bounds(e)
    x = AT * 2
    inside = x[values(e, x) < 0]
    assert ((inside >= low - NEAR) & (inside <= high + NEAR)).all()


@pytest.mark.parametrize(
    ("e", "bounds"),
    [
        (sphere(0.04).moved(0, 0, 0.2), [[-0.04, -0.04, 0.16], [0.04, 0.04, 0.24]]),
        (box(0.2, 0.1, 0.02).turned(0, 0, 90), [[-0.05, -0.1, -0.01], [0.05, 0.1, 0.01]]),
        (cylinder(0.03, 0.2).turned(90), [[-0.03, -0.1, -0.03], [0.03, 0.1, 0.03]]),
        (torus(0.05, 0.01).scaled(2), [[-0.12, -0.12, -0.02], [0.12, 0.12, 0.02]]),
        (capsule((0, 0, 0), (0.1, 0, 0), 0.01).grown(0.005), [[-0.015, -0.015, -0.015], [0.115, 0.015, 0.015]]),
        (sphere(0.1) & half_space((0, 0, 1), 0.02), [[-0.1, -0.1, -0.1], [0.1, 0.1, 0.02]]),
        (sphere(0.04).blended(sphere(0.04), 0.04), [[-0.05] * 3, [0.05] * 3]),
        ((sphere(0.04).scaled(0.5).grown(0.01)).scaled(2), [[-0.06] * 3, [0.06] * 3]),
        (half_space((0, 0, 2), 0.02), [[-np.inf] * 3, [np.inf, np.inf, 0.02]]),
    ],
)
def test_bounds_are_close(e, bounds):
    np.testing.assert_allclose(expression_bounds(e), bounds, atol=1e-15)


@given(expressions)
@settings(max_examples=25)
def test_json_reads_back_to_the_same_tree(e):
    assert expression_from_json(expression_to_json(e)) == e


def test_json_is_as_documented():
    e = sphere(0.04).moved(0, 0, 0.2) | box(0.1, 0.1, 0.01)
    assert json.loads(expression_to_json(e)) == {
        "op": "union",
        "of": [
            {
                "op": "transform",
                "of": [{"op": "sphere", "radius": 0.04}],
                "at": [0.0, 0.0, 0.2],
                "rotation": [0.0, 0.0, 0.0, 1.0],
                "scale": 1.0,
            },
            {"op": "box", "size": [0.1, 0.1, 0.01]},
        ],
    }
    assert (
        expression_from_json('{"op": "transform", "at": [0, 0, 1], "of": [{"op": "sphere", "radius": 1}]}').scale == 1
    )


def test_chains_of_unions_and_differences_stay_flat():
    assert union(*[sphere(0.01)] * 500).depth == 1
    many = sphere(0.01)
    for _ in range(500):
        many = many | sphere(0.01)
    assert (many.depth, many.leaf_count) == (1, 501)
    less = sphere(0.01)
    for _ in range(200):
        less = less - sphere(0.005)
    assert (less.depth, less.leaf_count) == (1, 201)


@st.composite
def tall_trees(draw):
    e = sphere(0.01)
    for k in range(draw(st.integers(1, DEEPEST - 1))):
        other = sphere(0.001 * k + 0.001).moved(0.01 * k)
        sides = draw(st.sampled_from([(e, other), (other, e)]))
        e = draw(st.sampled_from([lambda a, b: Difference((a, b)), lambda a, b: a.blended(b, 0.01)]))(*sides)
    return e


@pytest.mark.exhaustive
@given(tall_trees())
@settings(max_examples=20)
def test_a_tall_tree_needs_a_small_stack(e):
    depth, most = 0, 0
    for step in compile_expression(e):
        depth += 1 if step["code"] < 6 else (0 if step["code"] == 11 else -1)
        most = max(most, depth)
    assert most <= 2
    assert np.abs(values(e) - value(e, AT)).max() <= NEAR


@pytest.mark.exhaustive
def test_the_widest_balanced_tree_fits_the_stack():
    e = sphere(0.1)
    while e.leaf_count < LARGEST:
        e = Difference((e, e.moved(0.001))) if e.leaf_count < 8 else Difference((e, e))
    need = np.cumsum(np.where(compile_expression(e)["code"] < 6, 1, -1)).max()
    assert need == LARGEST.bit_length() == STACK


BAD = {
    "sphere: radius must be a number from 1e-07 to 1000, not -0.04": lambda: sphere(-0.04),
    "sphere: radius must be a number from 1e-07 to 1000, not '4 cm'": lambda: sphere("4 cm"),
    "capsule: start and stop are the same point": lambda: capsule((0, 0, 0), (0, 0, 0), 0.1),
    "transform: at must be a number from -1000 to 1000, not inf": lambda: sphere(1).moved(float("inf")),
    "union: works on at least 1 expressions?, not 0": lambda: union(),
    "union: works on expressions, not": lambda: Union((sphere(1), 3)),
    "more than 100 operators above one another": lambda: [e := sphere(1), *(e := e.grown(0) for _ in range(200))],
    "65536 primitives, of which a solid may have 32768": lambda: (
        [e := sphere(1)] + [e := Difference((e, e)) for _ in range(16)]
    ),
    r"expression: not JSON .*4300 digits": lambda: expression_from_json(
        '{"op": "sphere", "radius": ' + "9" * 5000 + "}"
    ),
    "sphere: radius must be .* not a number that large": lambda: sphere(10**5000),
    "unknown op 'ball'; known: sphere, box,": lambda: expression_from_json('{"op": "ball"}'),
    r"op must be one of sphere, .*, not \['sphere'\]": lambda: expression_from_json('{"op": ["sphere"]}'),
    "sphere: unknown field 'r'; known: radius": lambda: expression_from_json('{"op": "sphere", "r": 1}'),
    "union: of is missing": lambda: expression_from_json('{"op": "union"}'),
    "more than 100 operators above|deep in each other": lambda: expression_from_json(
        '{"op": "offset", "distance": 0, "of": [' * 10_000 + '{"op": "sphere", "radius": 1}' + "]}" * 10_000
    ),
    "more than 100 operators above one": lambda: expression_from_json(
        '{"op": "offset", "distance": 0, "of": [' * 120 + '{"op": "sphere", "radius": 1}' + "]}" * 120
    ),
}


@pytest.mark.parametrize("message", BAD)
def test_bad_input_is_named_in_one_sentence(message):
    with pytest.raises(ImplicitError, match=message) as caught:
        BAD[message]()
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 250


def test_a_bad_file_is_named(tmp_path):
    path = tmp_path / "solid.json"
    with pytest.raises(ImplicitError, match=r"solid\.json: cannot be read"):
        load_expression(path)
    path.write_text('{"op": "ball"}')
    with pytest.raises(ImplicitError, match=r"solid\.json: expression: unknown op 'ball'"):
        load_expression(path)
    path.write_text(expression_to_json(Sphere(0.04)))
    assert load_expression(path) == sphere(0.04)


def test_a_deep_tree_that_never_was_text_is_refused():
    described = {"op": "sphere", "radius": 1}
    for _ in range(5000):
        described = {"op": "offset", "distance": 0, "of": [described]}
    with pytest.raises(ImplicitError, match="more than 100 operators above one another"):
        expression_from(described)
