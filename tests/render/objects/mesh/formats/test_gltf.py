"""glTF 2.0 by its specification: cubes whose sizes and volumes are exact, however a file says where they are."""

import json

import numpy as np
import pytest
from file_meshes import CUBE, enclosed
from gltf_files import GltfFile

from palpate.datasets.bounded_file import LIMIT_VARIABLE, FileBoundError
from palpate.render.errors import MeshError
from palpate.render.objects.mesh.formats.gltf import read_gltf

TURN = [0, 0, np.sqrt(0.5), np.sqrt(0.5)]  # a quarter turn about z
SHIFT = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 0, 0, 1]  # by columns: 5 along x


def read(file):
    return read_gltf(json.loads(file.text()), None)


def cube_file(**tree):
    file = GltfFile(**tree)
    file.mesh()
    return file


def low(mesh):
    return np.asarray(mesh.vertices)[mesh.faces].min(axis=(0, 1)).round(6).tolist()


@pytest.mark.parametrize(
    ("nodes", "size", "corner"),
    [
        ([{"mesh": 0, "matrix": SHIFT}], [1, 1, 1], [5, 0, 0]),
        ([{"mesh": 0, "translation": [1, 2, 3], "rotation": TURN, "scale": [2, 3, 4]}], [3, 2, 4], [-2, 2, 3]),
        ([{"mesh": 0, "scale": [-2, 1, 1]}], [2, 1, 1], [-2, 0, 0]),
        ([{"children": [1], "scale": [2, 2, 2]}, {"mesh": 0, "matrix": SHIFT}], [2, 2, 2], [10, 0, 0]),
        ([{"children": [1], "matrix": SHIFT, "camera": 0}, {"mesh": 0}], [1, 1, 1], [5, 0, 0]),
        ([{"children": [1], "rotation": TURN}, {"mesh": 0, "translation": [1, 0, 0]}], [1, 1, 1], [-1, 1, 0]),
    ],
    ids=["matrix", "TRS", "mirrored", "below a scale", "below a camera", "turned, then moved"],
)  # fmt: skip
def test_nodes_place_their_meshes(nodes, size, corner):
    """Sections 3.5.3 and 3.7.4: T * R * S, below the parent; a mirrored place turns the triangles over."""
    file = cube_file(nodes=nodes, cameras=[{"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}}])
    found = read(file)
    assert enclosed(found) == (12, size, np.prod(size))
    assert low(found) == corner


def test_the_default_scene_is_read():
    nodes = [{"mesh": 0}, {"mesh": 0, "matrix": SHIFT, "name": "b"}]
    for chosen, corner in ((0, 0), (1, 5)):
        found = read(cube_file(nodes=nodes, scenes=[{"nodes": [0]}, {"nodes": [1]}], scene=chosen))
        assert low(found) == [corner, 0, 0]
        assert list(found.nodes) == ["b"] * chosen
    both = read(cube_file(nodes=nodes, scenes=[{"nodes": [0, 1]}]))
    assert enclosed(both) == (24, [6, 1, 1], 2)
    assert both.nodes["b"][0, 3] == 5


def test_two_boxes_of_normalised_integers_have_their_sizes():
    """KHR_mesh_quantization: 0.1 m around 0 and 0.02 m around 0.2 m, from corners of -1 and 1 in 16 bits."""
    nodes = [{"mesh": 0, "scale": [0.05] * 3}, {"mesh": 0, "scale": [0.01] * 3, "translation": [0.2, 0, 0]}]
    file = GltfFile(nodes=nodes, scenes=[{"nodes": [0, 1]}], extensionsRequired=["KHR_mesh_quantization"])
    index = file.array((2 * CUBE - 1) * 32767, "i2", normalized=True)
    file.mesh(attributes={"POSITION": index})
    count, size, volume = enclosed(read(file))
    assert (count, size) == (24, [0.26, 0.1, 0.1])
    assert volume == pytest.approx(0.1**3 + 0.02**3)


@pytest.mark.parametrize(
    ("of_mesh", "of_node", "length"),
    [([1.0], None, 2), ([0.5], None, 1.5), (None, None, 1), ([1.0], [0.0], 1), (None, [1.0], 2), ([0.0], [0.25], 1.25)],
)
def test_morph_targets_are_added_by_their_weights(of_mesh, of_node, length):
    """Section 3.7.2.2: weights of the mesh, or of the node that uses it; 0 without either."""
    file = GltfFile(nodes=[{"mesh": 0} | ({} if of_node is None else {"weights": of_node})])
    target = {"POSITION": file.array(CUBE * [1, 0, 0], "f4")}
    file.mesh(targets=[target]).update({} if of_mesh is None else {"weights": of_mesh})
    assert enclosed(read(file)) == (12, [length, 1, 1], length)


def skinned_file(joints, weights, moved, vertices=CUBE, **skin):
    """A cube on two joints, of which the second is moved by `moved`; its own node lies 7 m away."""
    nodes = [{"mesh": 0, "skin": 0, "translation": [7, 7, 7]}, {"name": "a"}, {"name": "b", "translation": moved}]
    file = GltfFile(nodes=nodes, scenes=[{"nodes": [0, 1, 2]}])
    inverse = np.stack([np.eye(4), np.eye(4)])
    inverse[1, 3, :3] = [-3, 0, 0]  # b was at x = 3 when the skin was bound; by columns
    file.tree["skins"] = [{"joints": [1, 2], "inverseBindMatrices": file.array(inverse.reshape(2, 16), "f4")} | skin]
    attributes = {"JOINTS_0": file.array(joints, "u1"), "WEIGHTS_0": file.array(weights, "f4")}
    file.mesh(vertices, attributes=attributes)
    return file


def test_a_skin_moves_its_mesh_and_the_place_of_its_node_does_not():
    """Section 3.7.3.3: only the transforms of the joints count."""
    first, ends = [[0, 0, 0, 0]] * 8, [[int(x), 0, 0, 0] for x in CUBE[:, 0]]
    one, halves = [[1, 0, 0, 0]] * 8, [[0.5, 0.5, 0, 0]] * 8
    bound = read(skinned_file(first, one, [3, 0, 0]))
    assert (enclosed(bound), low(bound)) == ((12, [1, 1, 1], 1), [0, 0, 0])
    assert bound.nodes["b"][0, 3] == 3
    stretched = read(skinned_file(ends, one, [4, 0, 0]))  # the far face follows b, 1 m further than it was bound
    assert (enclosed(stretched), low(stretched)) == ((12, [2, 1, 1], 2), [0, 0, 0])
    shared = read(skinned_file([[0, 1, 0, 0]] * 8, halves, [4, 0, 0]))
    assert (enclosed(shared), low(shared)) == ((12, [1, 1, 1], 1), [0.5, 0, 0])
    moved = skinned_file(first, one, [5, 0, 0])
    moved.tree["nodes"][1]["translation"] = [2, 0, 0]  # both joints by the same
    assert low(read(moved)) == [2, 0, 0]


def test_a_skin_stays_within_the_budget_by_what_its_vertices_need(monkeypatch):
    """Arrays of 3,000 vertices take 0.2 MB, matrices of them 16 times 8 bytes each, three at a time."""
    monkeypatch.setenv(LIMIT_VARIABLE, "1")
    vertices = np.zeros((3000, 3))
    vertices[:8] = CUBE
    file = skinned_file([[0, 1, 0, 0]] * 3000, [[0.5, 0.5, 0, 0]] * 3000, [4, 0, 0], vertices)
    with pytest.raises(FileBoundError, match="what its skin needs takes 1152000 bytes"):
        read(file)


def test_strips_fans_and_corners_in_order_are_triangles():
    """Section 3.7.2.1; a tetrahedron of 1/6 m^3 as a fan of three, a strip of one, and corners without indices."""
    a, b, c, d = (0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)
    file = GltfFile()
    file.mesh([d, a, b, c], [0, 1, 2, 3, 1], mode=6)
    file.tree["meshes"][0]["primitives"].append({"attributes": {"POSITION": file.array([a, c, b], "f4")}, "mode": 5})
    file.tree["meshes"][0]["primitives"].append({"attributes": {"POSITION": file.array([a, b], "f4")}, "mode": 1})
    assert enclosed(read(file)) == (4, [1, 1, 1], round(1 / 6, 9))
    file.tree["meshes"][0]["primitives"][1].pop("mode")
    assert enclosed(read(file)) == (4, [1, 1, 1], round(1 / 6, 9))
    strip = GltfFile()
    strip.mesh([a, c, b, d], [0, 1, 2, 3, 0, 1], mode=5)
    assert enclosed(read(strip)) == (4, [1, 1, 1], round(1 / 6, 9))


BOUND = [{"mesh": 0, "skin": 0, "children": [1]}, {"translation": [1, 0, 0]}]
DRACO = {"extensions": {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {"POSITION": 0}}}}
INSTANCES = {"extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 0}}}}


@pytest.mark.parametrize(
    ("tree", "said"),
    [
        ({"extensionsRequired": ["KHR_draco_mesh_compression"]}, "needs the glTF extension KHR_draco_mesh_compression"),
        ({"extensionsRequired": ["ACME_of_tomorrow"]}, "ACME_of_tomorrow, which is not read"),
        ({"nodes": [{"mesh": 0} | INSTANCES]}, "EXT_mesh_gpu_instancing, which is not read"),
        ({"asset": {"version": "1.0"}}, "is glTF 1.0, and only glTF 2 is read"),
        ({"meshes": {"a": {}}}, "is glTF 1.0, and only glTF 2 is read"),
        ({"asset": {"version": "2.1", "minVersion": "2.1"}}, r"is glTF 2.1 \(at least 2.1\)"),
        ({"nodes": [{"mesh": 0, "matrix": SHIFT, "scale": [1, 1, 1]}]}, "node 0 has both a matrix and scale"),
        ({"nodes": [{"children": [0]}]}, "node 0 has two parents, or is its own"),
        ({"nodes": [{"mesh": 0, "rotation": [0, 0, 0, 0]}]}, "the rotation of node 0 must be four numbers of length 1"),
        ({"nodes": [{"mesh": 0, "translation": [float("nan"), 0, 0]}]}, "the place of node 0 must be finite"),
        ({"nodes": [{"mesh": 0, "scale": 2}]}, "the scale of node 0 must be 3 numbers, not 2"),
        ({"scenes": None}, "is no valid glTF"),
        ({"nodes": BOUND, "skins": [{"joints": [0, 1]}]}, "has a skin, but its mesh has no JOINTS_0"),
        ({"nodes": [{"mesh": 0, "skin": 0}], "skins": [{"joints": [4]}]}, "the joint 4, which is no node of the scene"),
    ],
)  # fmt: skip
def test_what_is_not_read_is_named(tree, said):
    file = cube_file()
    assert enclosed(read(file)) == (12, [1, 1, 1], 1)
    file.tree |= tree
    with pytest.raises(MeshError, match=said):
        read(file)


def test_arrays_of_one_row_are_not_repeated_for_every_vertex():
    """Section 3.7.2.2 and 3.7.3.3: targets, joints and weights have as many rows as the positions."""
    file = GltfFile()
    file.mesh(targets=[{"POSITION": file.array(CUBE[:1], "f4")}])["weights"] = [1]
    with pytest.raises(MeshError, match="a morph target of a primitive has 1 rows, but the primitive 8 vertices"):
        read(file)
    for joints, weights in ((1, 8), (8, 1)):
        with pytest.raises(MeshError, match="a skin of a primitive has 1 rows, but the primitive 8 vertices"):
            read(skinned_file([[0, 1, 0, 0]] * joints, [[0.5, 0.5, 0, 0]] * weights, [4, 0, 0]))


@pytest.mark.parametrize("stride", [0, 4])
def test_rows_that_overlap_are_named(stride):
    """ACCESSOR_SMALL_BYTESTRIDE of Khronos' glTF-Validator."""
    file = cube_file()
    file.tree["bufferViews"][0]["byteStride"] = stride
    with pytest.raises(MeshError, match=f"bufferView 0 has a byteStride of {stride}, less than the 12 bytes of a row"):
        read(file)


@pytest.mark.parametrize(
    ("primitive", "said"),
    [
        ({"mode": 7}, "the mode of a primitive must be 0 to 6, not 7"),
        ({"indices": 0}, "accessor 0 must be of type SCALAR, not VEC3"),
        ({"attributes": {}, **DRACO}, "no POSITION, but the extension KHR_draco_mesh_compression"),
    ],
)
def test_a_primitive_that_is_not_read_is_named(primitive, said):
    file = cube_file()
    file.tree["meshes"][0]["primitives"][0] |= primitive
    with pytest.raises(MeshError, match=said):
        read(file)


@pytest.mark.parametrize("triangles", [[0, 1], [0, 1, 8]])
def test_indices_that_are_no_triangles_are_named(triangles):
    file = GltfFile()
    file.mesh(triangles=triangles)
    with pytest.raises(MeshError, match=r"has 2 corners, not three|indices of a primitive name vertices 0 to 8"):
        read(file)
