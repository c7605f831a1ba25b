"""Implicit objects: expressions and Warp functions, placed, judged, refused."""

import json

import implicit_functions as functions
import numpy as np
import pytest

from palpate.kernels.fields.field import probe_points
from palpate.render.errors import ImplicitError, PalpateWarning
from palpate.render.objects.functions.expression import (
    box,
    expression_from,
    expression_to_json,
    half_space,
    sphere,
    torus,
)
from palpate.render.objects.functions.implicit_object import ImplicitObject
from palpate.render.objects.mesh.placement import Placement
from palpate.render.objects.mesh.solid_mesh import MeshObject
from palpate.render.objects.solid import Solid

AROUND = [[-0.06] * 3, [0.06] * 3]
UP = Placement(at=(0, 0, 0.2))


def made(source, bounds=None, **options):
    options.setdefault("placement", UP)
    return ImplicitObject(source, bounds=bounds, **options)


def inside(thing, x, device="cpu"):
    return probe_points(thing.field_on(device), x, device=device) < 0


@pytest.mark.exhaustive
@pytest.mark.parametrize("source", [sphere(0.04), functions.ball, functions.ball_of_doubles, functions.steep])
def test_a_ball_is_a_ball_however_it_is_told(source, device, rng):
    thing = made(source, AROUND, placement=Placement(scale=2, at=(0.01, -0.02, 0.2)))
    assert isinstance(thing, Solid)
    thing.require_closed()
    middle = np.array([0.01, -0.02, 0.2])
    x = middle + rng.uniform(-0.15, 0.15, (2000, 3))
    far = np.linalg.norm(x - middle, axis=1) - 0.08
    sure = np.abs(far) > 1e-6
    assert (inside(thing, x, device) == (far < 0))[sure].all()
    vertices, faces = thing.outline_mesh()
    np.testing.assert_allclose(np.linalg.norm(vertices - middle, axis=1), 0.08, atol=2e-6)
    assert MeshObject(vertices, faces).report.closed
    assert (vertices >= thing.bounds[0] - 1e-6).all()
    assert (vertices <= thing.bounds[1] + 1e-6).all()


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize(
    "placement",
    [
        Placement(up="y", rotate=(10, 20, 30), at=(0, 0, 0.2)),
        UP,
        Placement(scale=0.5, at=(0.1, 0, 0.3)),
        Placement(up="-x", fit=0.13, rotate=(0, 0, 90), at=(0.01, 0.02, 0.2)),
        Placement(rotate=(90, 0, 0)),
    ],
)
@pytest.mark.parametrize("given", [None, "function"])
def test_placement_is_that_of_a_mesh(placement, given, rng):
    """A box of the same bounds as a mesh lands where the mesh does."""
    size, at = np.array([0.1, 0.06, 0.03]), np.array([0.02, 0.01, 0.25])
    corners = at + size / 2 * np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
    bounds = np.stack([corners.min(axis=0), corners.max(axis=0)])
    if given is None:
        thing = made(box(*size).moved(*at), placement=placement)
    else:  # a function that fills its bounds but for a sheet, and so is cut by them
        with pytest.warns(PalpateWarning, match="reaches its bounds' border"):
            thing = made(functions.low_but_on_a_sheet, bounds, placement=placement)
    after = placement.applied_to(corners)
    np.testing.assert_allclose(thing.bounds, [after.min(axis=0), after.max(axis=0)], atol=1e-12)
    middle = after.mean(axis=0)
    assert inside(thing, middle + 0.999 * (after - middle)).all()
    assert not inside(thing, middle + 1.001 * (after - middle)).any()


def test_an_expression_without_bounds_needs_some_and_is_cut_by_them():
    with pytest.raises(ImplicitError, match="has no end along x, y, z: give bounds, or intersect"):
        made(half_space((0, 0, 1)))
    with pytest.raises(ImplicitError, match="has no end along x, y: give bounds"):
        made(half_space((0, 0, 1)) & half_space((0, 0, -1), 0.01))
    thing = made(half_space((0, 0, 1)), AROUND, placement=None, hand=True)
    np.testing.assert_allclose(thing.bounds, [[-0.06] * 3, [0.06, 0.06, 0]])
    assert inside(thing, np.array([[0.05, 0.05, -0.01], [0.05, 0.05, 0.01], [0.05, 0.07, -0.01]])).tolist() == [1, 0, 0]


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("jumping", r"not continuous: it jumps from -1 to 1 at \(.*\) m"),
        ("jumping_a_little", r"not continuous: it jumps from -1\.0.*e-05 to 1\.0.*e-05 at"),
        ("level", "is 3 at all 274625 points tried within its bounds; it must be below 0 inside"),
        ("high", r"is never below 0, so nothing is inside \(0.94 to 1.06 at all"),
        ("low", r"is below 0 at all .* \(-1.06 to -0.94\), so they hold no surface"),
        ("unknown_below_zero", r"is not a number at 135200 of 274625 points .*, at \(-0.06, -0.06, -0.06\) m for one"),
        ("of_two", r"must take one position, wp.vec3 or wp.vec3d, and give a number, not \(x: vec3f, y: float\)"),
        ("of_a_number", "must take one position"),
        ("a_vector", "cannot be compiled"),
        ("plain", "must be a function decorated with @wp.func, not function"),
    ],
)
def test_a_function_that_is_no_solid_is_refused(name, message):
    with pytest.raises(ImplicitError, match=f"^{name}: .*{message}") as caught:
        made(getattr(functions, name), AROUND, name=name)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("bounds", "message"),
    [
        (None, "ball: a function needs bounds"),
        ([[0, 0, 0], [0, 0, 0]], "bounds must be finite"),
        ([[1, 1, 1], [0, 0, 0]], "bounds must be finite"),
        ([0, 1], "bounds must be finite"),
        ("wide", "bounds must be finite"),
        ([[0, 0, 0], [1, 1, float("nan")]], "bounds must be finite"),
    ],
)
def test_bounds_that_are_none_are_refused(bounds, message):
    with pytest.raises(ImplicitError, match=message):
        made(functions.ball, bounds)


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize(
    ("e", "message"),
    [
        (sphere(0.04) - sphere(0.05), "nothing is inside"),
        (sphere(0.01) & sphere(0.01).moved(1), "nothing is inside"),
        (sphere(0.01) & sphere(0.01).moved(0.015, 0.015), "nothing is inside"),
        (sphere(0.04).grown(-0.05), "nothing is inside"),
        (box(0.1, 0.1, 0.1) & box(0.1, 0.1, 0.1).moved(0.1), "is it a mere sheet"),
    ],
)
def test_an_expression_with_nothing_inside_is_refused(e, message):
    with pytest.raises(ImplicitError, match=message):
        made(e, name="nothing")


def test_thin_and_small_insides_are_found():
    made(box(0.1, 0.1, 1e-4).turned(10, 20, 30))
    made((sphere(0.05) - sphere(0.0499)) & half_space((1, 1, 1), -0.0499))
    made(torus(0.1, 0.001) & sphere(0.001).moved(0.1))
    made(box(0.1, 0.1, 0.1) - half_space((1, 1, 1), 0.149 / 3**0.5))  # 1 mm of a corner


@pytest.mark.exhaustive
def test_files_and_names_are_loaded(tmp_path, monkeypatch):
    path = tmp_path / "solid.json"
    path.write_text(expression_to_json(sphere(0.04)))
    assert ImplicitObject(path, placement=UP).identity == made(sphere(0.04)).identity
    assert ImplicitObject(str(path), placement=UP).name == "solid.json"
    one = ImplicitObject("implicit_functions:ball", bounds=AROUND, placement=UP)
    assert (one.name, one.identity) == ("ball", made(functions.ball, AROUND).identity)
    module = tmp_path / "blob.py"
    module.write_text("import warp as wp\n\n@wp.func\ndef blob(x: wp.vec3) -> float:\n    return wp.length(x) - 0.04\n")
    two = ImplicitObject(f"{module}:blob", bounds=AROUND, placement=UP, allow_code=True)
    assert ImplicitObject(f"{module}:blob", bounds=AROUND, placement=UP, allow_code=True).function is two.function
    for name, message in [
        (f"{module}:none", "has no 'none'; its Warp functions are blob"),
        (f"{tmp_path}/other.py:blob", "cannot be imported .ImportError: no such file"),
        ("nowhere.at.all:blob", "cannot be imported .ModuleNotFoundError"),
        (":blob", "must be package.module:function or file.py:function"),
        (str(tmp_path / "none.json"), "none.json: cannot be read"),
    ]:
        with pytest.raises(ImplicitError, match=message):
            ImplicitObject(name, bounds=AROUND, allow_code=True)
    bad = tmp_path / "bad.py"
    bad.write_text("raise RuntimeError('unfit')\n")
    with pytest.raises(ImplicitError, match=r"cannot be imported .RuntimeError: unfit"):
        ImplicitObject(f"{bad}:blob", bounds=AROUND, allow_code=True)


@pytest.mark.exhaustive
def test_files_whose_paths_look_alike_keep_their_own_functions(tmp_path):
    (tmp_path / "a").mkdir()
    for path, radius in ((tmp_path / "a_b.py", 0.04), (tmp_path / "a" / "b.py", 0.02)):
        text = f"import warp as wp\n@wp.func\ndef f(x: wp.vec3) -> float:\n    return wp.length(x) - {radius}\n"
        path.write_text(text)
        thing = ImplicitObject(f"{path}:f", bounds=[[-0.05] * 3, [0.05] * 3], hand=True, allow_code=True)
        found = probe_points(thing.field_on("cpu"), np.array([[0.03, 0.0, 0.0]]), device="cpu")
        np.testing.assert_allclose(found, 0.03 - radius, atol=1e-8)


def test_a_file_that_ends_the_program_is_refused(tmp_path):
    (tmp_path / "ends.py").write_text("raise SystemExit(3)\n")
    with pytest.raises(ImplicitError, match=r"ends\.py: cannot be imported \(SystemExit: 3\)"):
        ImplicitObject(f"{tmp_path / 'ends.py'}:f", bounds=[[-1] * 3, [1] * 3], allow_code=True)


@pytest.mark.exhaustive
def test_a_constant_that_a_function_reads_counts_to_its_identity(tmp_path):
    """Its own source is the same, but not where it is below 0."""
    of = set()
    for radius in (0.04, 0.042):
        module = tmp_path / f"ball{radius}.py"
        module.write_text(
            f"import warp as wp\n\nR = wp.constant({radius})\n\n@wp.func\ndef f(x: wp.vec3) -> float:\n"
            "    return wp.length(x) - R\n"
        )
        of.add(ImplicitObject(f"{module}:f", bounds=AROUND, placement=UP, allow_code=True).identity)
    assert len(of) == 2


def test_described_is_json_that_an_expression_comes_back_from():
    thing = made(sphere(0.04) | box(0.1, 0.02, 0.02))
    described = json.loads(json.dumps(thing.described()))
    assert described["representation"] == "expression"
    again = ImplicitObject(expression_from(described["expression"]), placement=Placement(**described["placement"]))
    assert again.identity == described["hash"]
    described = json.loads(json.dumps(made(functions.ball, AROUND).described()))
    assert described["function"] == "ball"
    assert "RADIUS" in described["source"]
    assert described["bounds"] == AROUND
