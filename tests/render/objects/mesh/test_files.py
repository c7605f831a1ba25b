"""Mesh files of every format as the object reads them: stray vertices, and what is said of files not read."""

import json

import numpy as np
import pytest
import trimesh
from file_meshes import CUBE, QUADS, enclosed
from gltf_files import GltfFile

from palpate.datasets.bounded_file import LIMIT_VARIABLE
from palpate.render import MeshHand, MeshObject
from palpate.render.errors import MeshError
from palpate.render.file_kinds import NOT_READ
from palpate.render.objects.mesh.files import load_mesh
from palpate.render.objects.mesh.formats.polygons import FileMesh

STRAY = """ply
format ascii 1.0
element vertex 5
property float x
property float y
property float z
element face 4
property list uchar int vertex_indices
end_header
nan nan nan
0 0 0
1 0 0
0 1 0
0 0 1
3 1 3 2
3 1 2 4
3 2 3 4
3 1 4 3
"""
OBJ = "".join(f"v {x} {y} {z}\n" for x, y, z in CUBE) + "".join("f {} {} {} {}\n".format(*np.add(q, 1)) for q in QUADS)


def test_a_vertex_that_is_no_number_counts_only_where_it_is_used(tmp_path):
    """The tetrahedron of 1/6 m^3 whose first vertex, NaN, no face has; then one face has it."""
    path = tmp_path / "a.ply"
    path.write_text(STRAY)
    assert enclosed(load_mesh(path)) == (4, [1, 1, 1], round(1 / 6, 9))
    assert MeshObject.load(path).report.closed
    path.write_text(STRAY.replace("3 1 4 3", "3 0 4 3"))
    with pytest.raises(MeshError, match="not finite"):
        MeshObject.load(path)


@pytest.mark.parametrize("blank", [" ", "\v", "\f"])
def test_words_between_any_blanks_stay_within_the_budget(tmp_path, monkeypatch, blank):
    """20,000 corners of a face: bytes.split() parts words at each of these, and 64 bytes count for each word."""
    monkeypatch.setenv(LIMIT_VARIABLE, "1")
    (tmp_path / "a.obj").write_text(OBJ + "f " + f"1{blank}" * 20_000 + "\n")
    with pytest.raises(MeshError, match="what its text holds takes 1"):
        load_mesh(tmp_path / "a.obj")


@pytest.mark.parametrize("suffix", [".stl", ".obj", ".ply", ".off", ".glb"])
def test_what_trimesh_writes_is_read_as_it_was(suffix, tmp_path):
    mesh = trimesh.creation.icosphere(2)
    mesh.export(tmp_path / f"a{suffix}")
    found = load_mesh(tmp_path / f"a{suffix}")
    assert isinstance(found, FileMesh)
    count, size, volume = enclosed(found)
    assert (count, size) == (320, pytest.approx(mesh.extents.tolist(), abs=1e-6))
    assert volume == pytest.approx(mesh.volume, abs=1e-6)


@pytest.mark.parametrize("suffix", NOT_READ)
def test_a_format_that_is_not_read_is_named_with_the_way_out(suffix, tmp_path):
    path = tmp_path / f"a{suffix.upper()}"
    path.write_bytes(b"x")
    with pytest.raises(
        MeshError, match=rf"a{suffix.upper()}: cannot be read as a mesh: is .*(export|save|take|unpack)"
    ):
        load_mesh(path)


@pytest.mark.parametrize("suffix", [".stl", ".obj", ".ply", ".off", ".glb", ".gltf"])
@pytest.mark.parametrize(
    "content", [b"", b"\0" * 100, b"\xff" * 90, b"{}", b"x y z\n"], ids=["empty", "zeros", "ones", "JSON", "words"]
)
def test_what_is_no_mesh_is_refused_in_one_line_that_names_no_code(suffix, content, tmp_path, capfd):
    path = tmp_path / f"a{suffix}"
    path.write_bytes(content)
    with pytest.raises(MeshError, match=rf"a\{suffix}: (cannot be read as a mesh: |has no triangles)") as caught:
        load_mesh(path)
    assert "Error" not in str(caught.value).partition("a mesh")[2]
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_a_skinned_hand_is_where_its_joints_are(tmp_path):
    """A skin bound to a wrist that lies 0.3 m along z: the mesh's own node, 7 m away, does not count."""
    nodes = [{"mesh": 0, "skin": 0, "translation": [7, 7, 7]}, {"name": "wrist", "translation": [0, 0, 0.3]}]
    file = GltfFile(nodes=nodes, scenes=[{"nodes": [0, 1]}], skins=[{"joints": [1]}])
    file.mesh(CUBE * 0.1)
    (tmp_path / "a.glb").write_bytes(file.glb())
    (tmp_path / "a.gltf").write_bytes(file.text())
    for name in ("a.glb", "a.gltf"):
        hand = MeshHand.load(tmp_path / name)
        np.testing.assert_allclose(hand.vertices.reshape(-1, 3).min(axis=0), [0, 0, 0.3], atol=1e-7)


def test_a_file_beside_a_gltf_is_read(tmp_path):
    file = GltfFile()
    file.mesh()
    (tmp_path / "a b.bin").write_bytes(file.content)
    buffers = [{"uri": "a%20b.bin", "byteLength": len(file.content)}]
    (tmp_path / "a.gltf").write_text(json.dumps(file.tree | {"buffers": buffers}))
    assert enclosed(load_mesh(tmp_path / "a.gltf")) == (12, [1, 1, 1], 1)
    (tmp_path / "a b.bin").write_bytes(file.content[:50])
    with pytest.raises(MeshError, match=r"bufferView 0 has 96 and the buffer 50: it may be cut off"):
        load_mesh(tmp_path / "a.gltf")


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        (
            lambda tree, plain: {"accessors": [plain, {"componentType": 5123, "count": 10**12, "type": "SCALAR"}]},
            "hold",
        ),
        (lambda tree, plain: {"accessors": [*tree["accessors"], {**plain, "count": 10**6}]}, "its arrays hold takes"),
        (lambda tree, plain: {"bufferViews": tree["bufferViews"] + [{"buffer": 0, "byteLength": 900}] * 5600}, "hold"),
        (lambda tree, plain: {"meshes": [{"primitives": tree["meshes"][0]["primitives"] * 200}]}, "its arrays hold"),
        (lambda tree, plain: {"nodes": [{"mesh": 0}] * 300, "scenes": [{"nodes": [*range(300)]}]}, "copies"),
        (lambda tree, plain: {"accessors": [{**plain, "count": -1}] * 2}, "whole number"),
        (lambda tree, plain: {"accessors": [{**plain, "count": 1e300}] * 2}, "takes"),
        (lambda tree, plain: {"accessors": 3}, "cannot be read as a mesh"),
        (lambda tree, plain: {"nodes": [{"mesh": 0, "matrix": [float("nan")] * 16}]}, "NaN is not a finite number"),
    ],
)
def test_a_scene_that_multiplies_is_refused(changed, said, tmp_path, monkeypatch):
    monkeypatch.setenv(LIMIT_VARIABLE, "5")
    file = GltfFile()
    file.mesh(CUBE[:3], [[0, 1, 2]] * 1000)
    (tmp_path / "a.glb").write_bytes(file.glb())
    assert len(load_mesh(tmp_path / "a.glb").faces) == 1000
    file.tree |= changed(file.tree, file.tree["accessors"][0])
    (tmp_path / "a.glb").write_bytes(file.glb())
    with pytest.raises(MeshError, match=said):
        load_mesh(tmp_path / "a.glb")
