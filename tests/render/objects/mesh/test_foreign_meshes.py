"""Meshes of trimesh and PyVista, taken and given back; their own volumes are the truth."""

import json

import numpy as np
import pytest
import trimesh

from palpate.render import MeshObject, VoxelObject
from palpate.render.errors import MeshError, PlacementError, RenderError


@pytest.fixture
def ball():
    return trimesh.creation.icosphere(subdivisions=3, radius=0.05)


def test_trimesh_there_and_back(ball):
    mesh = MeshObject(ball, name="ball", at=(0, 0, 0.2))
    assert mesh.to_trimesh().volume == pytest.approx(ball.volume, rel=1e-5)
    assert np.allclose(mesh.to_trimesh().center_mass, (0, 0, 0.2), atol=1e-6)
    assert mesh.to_trimesh().is_watertight


def test_a_scene_is_taken_with_its_transforms(ball):
    scene = trimesh.Scene()
    scene.add_geometry(ball, transform=trimesh.transformations.translation_matrix([0, 0, 0.3]))
    assert np.allclose(MeshObject.load(scene).bounds.mean(axis=0), (0, 0, 0.3), atol=1e-6)


def test_pyvista_there_and_back():
    pyvista = pytest.importorskip("pyvista", reason="PyVista is not installed: pip install -e '.[dev]'")
    box = pyvista.Box((-0.05, 0.05, -0.03, 0.03, 0.15, 0.25))  # of quadrilaterals, each with its own corners
    mesh = MeshObject(box, name="box")
    assert mesh.report.closed
    assert mesh.to_pyvista().volume == pytest.approx(0.1 * 0.06 * 0.1, rel=1e-5)
    mesh.to_pyvista().points[:] = 0.0
    assert np.ptp(mesh.vertices, axis=0) == pytest.approx([0.1, 0.06, 0.1])  # a copy was given
    with pytest.raises(MeshError, match="no triangles"):
        MeshObject(pyvista.PolyData(box.points))
    grid = pyvista.ImageData(dimensions=(5, 5, 5), spacing=(0.02, 0.02, 0.02), origin=(0, 0, 0.1))
    assert MeshObject.load(grid).to_pyvista().volume == pytest.approx(0.08**3, rel=1e-5)


def test_placement_by_its_fields(ball):
    placed = MeshObject.load("tube", at=np.array([0, 0, 0.3]), rotate=np.zeros(3), scale=np.float32(0.5))
    assert placed.bounds.mean(axis=0) == pytest.approx([0, 0, 0.3], abs=1e-6)
    assert json.loads(json.dumps(placed.described()))["placement"]["at"] == [0.0, 0.0, 0.3]
    assert np.ptp(MeshObject.load("tube", fit=0.1).bounds, axis=0).max() == pytest.approx(0.1)
    with pytest.raises(PlacementError, match="fit is a field of placement, which is given, too"):
        MeshObject.load("tube", fit=0.1, placement=MeshObject.load("tube").placement)
    with pytest.raises(TypeError, match=r"unexpected argument 'fitt' \(did you mean 'fit'\?\)"):
        MeshObject(ball, fitt=0.1)


@pytest.mark.parametrize("given", [5, "tube", [[0, 0, 0]]])
def test_vertices_without_faces_are_no_mesh(given):
    with pytest.raises(MeshError, match="is no mesh: give vertices and faces"):
        MeshObject(given)


def test_what_pyvista_has_beside_meshes_is_answered_by_the_way_out():
    pyvista = pytest.importorskip("pyvista", reason="PyVista is not installed: pip install -e '.[dev]'")
    image = pyvista.ImageData(dimensions=(4, 4, 4))
    image["density"] = np.arange(64)
    for taken in (MeshObject, VoxelObject):
        with pytest.raises(RenderError, match=r"VoxelObject\(image\.active_scalars"):
            taken(image)
    with pytest.raises(MeshError, match="has no mesh"):
        MeshObject(pyvista.MultiBlock())
