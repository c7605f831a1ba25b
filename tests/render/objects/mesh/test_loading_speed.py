"""Loading of large meshes and long explorations: fast where it was slow, the same result, and never silent."""

import io
import time
import warnings
from itertools import pairwise

import numpy as np
import pytest
import trimesh
from rich.console import Console

from palpate.datasets.shapes.built_in import shape
from palpate.kernels.section.half_edges import group_starts, order_of
from palpate.render import MeshObject
from palpate.render.errors import PalpateWarning
from palpate.render.intersection.named_inputs import load_motion, load_solid
from palpate.render.objects.mesh import kept_repairs
from palpate.render.objects.mesh.placement import Placement
from palpate.render.objects.mesh.solid_mesh import repeats_at_most
from palpate.render.objects.mesh.welding import coordinate_order
from palpate.render.terminal import bars, foreign_text


@pytest.mark.parametrize("largest", [1, 7, 1000, 2**40])
def test_rows_are_ordered_as_numpys_stable_sort_orders_them(rng, largest):
    for count in (0, 1, 2, 1000):
        columns = rng.integers(0, largest, (3, count))
        np.testing.assert_array_equal(order_of(*columns), np.lexsort(columns))
        rows = columns[:, np.lexsort(columns)]
        _, start = np.unique(rows, axis=1, return_index=True) if count else (0, [])
        np.testing.assert_array_equal(group_starts(*rows), np.sort(start))


@pytest.mark.parametrize("steps", [1, 3, 50, 2**30])
def test_points_are_ordered_by_their_coordinates(rng, steps):
    points = rng.integers(-steps, steps, (500, 3)) / 8.0
    for given in (points, points[np.lexsort(points.T[::-1])]):
        expected = np.array(sorted(map(tuple, given)))
        np.testing.assert_array_equal(given[coordinate_order(given)], expected)


def test_repeated_points_are_never_counted_too_low(rng):
    for steps in (2, 5, 1000, 2**22):
        points = rng.integers(-steps, steps, (3000, 3)).astype(np.float32) / 1024
        repeats = len(points) - len({tuple(row) for row in points.tolist()})
        assert repeats <= repeats_at_most(points) <= repeats + 1


@pytest.mark.exhaustive
@pytest.mark.parametrize(("model", "duration", "rate"), [("over-array", 7000.0, 1000.0), ("around", 20000.0, 1.0)])
def test_an_exploration_reports_how_far_it_is(model, duration, rate):
    heard = []
    load_motion(
        "exploration",
        MeshObject.load("cube"),
        {"duration": duration, "rate": rate, "model": model},
        watch=lambda *word: heard.append(word),
    )
    assert len(heard) > 5
    assert {word[0] for word in heard} == {"exploration"}
    done, total = zip(*(word[1:] for word in heard), strict=True)
    assert all(a < b for a, b in pairwise(done))
    assert set(total) == {max(total)}
    assert done[-1] <= total[-1] < 1.1 * done[-1]


def tetrahedra(count):
    """Separate bodies on a grid."""
    side = int(np.ceil(np.cbrt(count)))
    at = np.stack(np.unravel_index(np.arange(count), (side,) * 3), axis=1)
    corners = np.array([[0, 0, 0], [0.5, 0, 0], [0, 0.5, 0], [0, 0, 0.5]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    vertices = (at[:, None] + corners).reshape(-1, 3) * 0.13 / side + [0, 0, 0.2]
    return vertices, (4 * np.arange(count)[:, None, None] + faces).reshape(-1, 3)


def seconds_of(count):
    vertices, faces = tetrahedra(count)
    started = time.process_time()
    thing = MeshObject(vertices, faces)
    assert thing.report.bodies == count
    return time.process_time() - started


@pytest.mark.exhaustive
def test_loading_of_many_bodies_is_not_quadratic():
    seconds_of(100)
    few, many = (min(seconds_of(count) for _ in range(3)) for count in (2000, 16000))
    assert many < 20 * few  # n log n: 10; quadratic, as it was: 64


def test_stages_are_heard_while_a_mesh_loads(tmp_path):
    heard = []
    trimesh.creation.icosphere(subdivisions=3, radius=0.05).export(tmp_path / "ball.stl")
    load_solid(str(tmp_path / "ball.stl"), Placement(at=(0, 0, 0.2)), watch=lambda *word: heard.append(word))
    assert [word[0] for word in heard] == ["reading", "welding", "orientation", "bodies", "crossings", "nesting"]
    assert (1280, 1280) in [word[1:] for word in heard]  # triangles


def test_a_large_mesh_is_announced_before_it_is_repaired_and_only_then(monkeypatch, tmp_path):
    monkeypatch.setattr("palpate.render.objects.mesh.solid_mesh.TRIANGLES_ANNOUNCED", 1000)
    monkeypatch.setattr(kept_repairs, "SECONDS_LEAST", 0.0)
    monkeypatch.setenv("PALPATE_CACHE", str(tmp_path))
    heard = []

    def watch(stage, done, total):
        heard.append((stage, len(said)))

    for announced in (1, 0):
        heard.clear()
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            MeshObject(*shape("sphere"), name="sphere", watch=watch)
        assert len(said) == announced
        assert all(count == announced for stage, count in heard if stage == "welding")
        if announced:
            assert said[0].category is PalpateWarning
            assert "sphere: 0.00128 million triangles take about 0 s and 0.0 GB of memory" in str(said[0].message)
            assert said[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        MeshObject.load("cube")


@pytest.fixture
def terminal(monkeypatch):
    screen = io.StringIO()
    for module in (bars, foreign_text):
        monkeypatch.setattr(module, "errors", Console(file=screen, force_terminal=True, width=100))
    monkeypatch.setattr(bars, "LOADING_SILENT", 0.05)
    return screen


@pytest.mark.parametrize(("quiet", "seconds"), [(True, 0.2), (False, 0.0)])
def test_no_bar_for_machines_nor_for_what_loads_at_once(terminal, quiet, seconds):
    with bars.loading_bar("cube", quiet=quiet) as watch:
        watch("welding", 0, 1)
        time.sleep(seconds)
    assert terminal.getvalue() == ""


def test_the_bar_goes_when_loading_fails(terminal):
    def load():
        with bars.loading_bar("cube", quiet=False):
            time.sleep(0.2)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        load()
    assert terminal.getvalue().endswith("\x1b[2K")
