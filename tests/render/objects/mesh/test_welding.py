"""Orders of rows and points as NumPy has them, repeats never counted too low, stages of loading in order."""

import numpy as np
import pytest
import trimesh

from palpate.render.intersection.named_inputs import load_solid
from palpate.render.objects.mesh.placement import Placement
from palpate.render.objects.mesh.solid_mesh import repeats_at_most
from palpate.render.objects.mesh.welding import coordinate_order


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


def test_stages_are_heard_while_a_mesh_loads(tmp_path):
    heard = []
    trimesh.creation.icosphere(subdivisions=3, radius=0.05).export(tmp_path / "ball.stl")
    load_solid(str(tmp_path / "ball.stl"), Placement(at=(0, 0, 0.2)), watch=lambda *word: heard.append(word))
    assert [word[0] for word in heard] == ["reading", "welding", "orientation", "bodies", "crossings", "nesting"]
    assert (1280, 1280) in [word[1:] for word in heard]  # triangles
