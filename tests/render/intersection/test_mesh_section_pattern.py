"""Meshes whose contours come from the table of loops: the bits of the search, and where the table is chosen."""

import copy
import pickle

import numpy as np
import pytest
import warp as wp
from small_solids import SOLIDS
from tally_outputs import empty

from palpate.kernels.offsets import PointLimitError
from palpate.render import MeshObject, Palm, closed_contour, open_contour
from palpate.render.bench.cases import random_poses
from palpate.render.errors import MeshError
from palpate.render.hands.plane_hand import flat_hand
from palpate.render.intersection import mesh_section
from palpate.render.intersection.mesh_section import PATTERN, intersect, tally_intersection
from palpate.render.strategies.intersection_strategy import IntersectionStrategy

FIELDS = ("points", "kind", "polyline_start", "polyline_patch", "polyline_closed", "pose_start")
SIMPLE = ("cube", "tetrahedra apart", "ring")


def poses_on(device, count=60):
    return wp.array(random_poses(count), dtype=wp.transform, device=device)


@pytest.mark.parametrize(
    "strategy", [IntersectionStrategy(), open_contour(), closed_contour()], ids=["raw", "oc", "cc"]
)
@pytest.mark.parametrize("name", SIMPLE)
def test_meshes_and_hands_are_intersected_and_measured_alike(name, strategy, device):
    """Relative points and a flush, too, which the objects and hands bring."""
    mesh, pose, sums = MeshObject(*SOLIDS[name]()), poses_on(device), []
    hand = flat_hand() if name == "ring" else Palm()
    for relative in (False, True):
        batches = [
            intersect(mesh, hand, pose, strategy, method=method, relative=relative) for method in ("trace", PATTERN)
        ]
        assert batches[0][1] == batches[1][1] > 0
        for field in FIELDS:
            one, two = (getattr(batch.numpy(), field) for batch, _ in batches)
            assert one.tobytes() == two.tobytes(), field
    for method in ("trace", PATTERN):
        value, length = empty(len(pose), device)
        tally_intersection(mesh, hand, pose, strategy, value, length, method=method)
        sums.append(np.nan_to_num(value.numpy(), nan=-1.0).tobytes() + length.numpy().tobytes())
    assert sums[0] == sums[1]


def test_the_table_is_taken_where_there_is_one(device, monkeypatch):
    def refuse(*_, **__):
        raise AssertionError("searched")

    monkeypatch.setattr(mesh_section, "find_pieces", refuse)
    assert intersect(MeshObject.load("cube"), Palm(), poses_on(device), closed_contour())[1] > 0
    with pytest.raises(AssertionError, match="searched"):
        intersect(MeshObject.load("tube"), Palm(), poses_on(device), closed_contour())


def test_a_mesh_without_a_table_cannot_be_cut_by_it(device):
    with pytest.raises(ValueError, match="tube is open or has too many vertices for the method 'pattern'"):
        intersect(MeshObject.load("tube"), Palm(), poses_on(device), closed_contour(), method=PATTERN)


@pytest.mark.filterwarnings("ignore:.*open:palpate.render.errors.PalpateWarning")
def test_an_open_mesh_is_refused_where_it_must_be_closed(device):
    vertices, faces = SOLIDS["cube"]()
    torn = MeshObject(vertices, faces[1:])
    with pytest.raises(MeshError, match="need a closed surface"):
        intersect(torn, Palm(), poses_on(device), closed_contour())
    assert intersect(torn, Palm(), poses_on(device), open_contour())[1] > 0


def test_more_points_than_the_limit_are_refused(device):
    cube, pose = MeshObject.load("cube"), poses_on(device)
    count = intersect(cube, Palm(), pose, closed_contour(), method=PATTERN)[1]
    with pytest.raises(PointLimitError, match=f"{count} points exceed the limit of {count - 1}"):
        intersect(cube, Palm(), pose, closed_contour(), method=PATTERN, point_limit=count - 1)


def test_a_table_is_made_once_and_stays_out_of_copies(device):
    cube = MeshObject.load("cube")
    table = cube.loop_table_on(device)
    assert cube.loop_table_on(device) is table
    for other in (copy.copy(cube), pickle.loads(pickle.dumps(cube))):
        assert other.loop_table_on(device) is not table
