"""Accessors by section 3.6 of the specification of glTF 2.0, and GLB by its section 4."""

import base64
import struct

import numpy as np
import pytest
from gltf_files import GltfFile

from palpate.render.errors import MeshError
from palpate.render.objects.mesh.formats.gltf import (
    GltfArrays,
    accessor_bytes,
    embedded,
    glb_chunks,
)

ROWS = np.arange(12).reshape(4, 3)


def read(file, index, kind="VEC3"):
    tree = file.tree | {"buffers": [{"byteLength": len(file.content)}]}
    return GltfArrays(tree, None, file.content).accessor(index, kind)


@pytest.mark.parametrize("kind", ["i1", "u1", "i2", "u2", "u4", "f4"])
def test_arrays_of_every_type_are_read_packed_and_interleaved(kind):
    file = GltfFile()
    packed = file.array(ROWS, kind)
    size = np.dtype(kind).itemsize
    rows = b"".join(b"\xff" * 4 + row.astype(kind).tobytes() + b"\xff" * 4 for row in ROWS)
    view = file.view(b"\xff\xff\xff\xff" + rows, byteStride=8 + 3 * size)
    strided = file.array(ROWS, kind, bufferView=view, byteOffset=8)
    for index in (packed, strided):
        found = read(file, index)
        np.testing.assert_array_equal(found, ROWS)
        assert found.dtype == kind
    assert accessor_bytes(file.tree["accessors"][packed]) == 12 * size


@pytest.mark.parametrize(
    ("kind", "values", "expected"),
    [
        ("i1", [-128, -127, 0, 127], [-1, -1, 0, 1]),
        ("u1", [0, 51, 102, 255], [0, 0.2, 0.4, 1]),
        ("i2", [-32768, -32767, 0, 32767], [-1, -1, 0, 1]),
        ("u2", [0, 13107, 26214, 65535], [0, 0.2, 0.4, 1]),
    ],
)
def test_normalised_integers_are_fractions(kind, values, expected):
    """Section 3.11, table 'Dequantization equations'."""
    file = GltfFile()
    index = file.array(np.repeat(values, 3).reshape(4, 3), kind, normalized=True)
    np.testing.assert_allclose(read(file, index), np.repeat(expected, 3).reshape(4, 3), rtol=1e-15)


@pytest.mark.parametrize("is_based", [True, False])
def test_sparse_changes_are_made(is_based):
    file = GltfFile()
    changes = {
        "count": 2,
        "indices": {"bufferView": file.view(np.array([1, 3], "u1").tobytes()), "componentType": 5121},
        "values": {"bufferView": file.view(np.array([[7, 8, 9], [4, 5, 6]], "f4").tobytes())},
    }
    base = {"bufferView": file.view(ROWS.astype("f4").tobytes())} if is_based else {}
    index = file.array(ROWS, "f4", sparse=changes, **base)
    expected = ROWS.copy() if is_based else np.zeros((4, 3))
    expected[[1, 3]] = [[7, 8, 9], [4, 5, 6]]
    np.testing.assert_array_equal(read(file, index), expected)
    file.tree["accessors"][index]["count"] = 3
    with pytest.raises(MeshError, match="of 3 rows has a sparse change of row 3"):
        read(file, index)


@pytest.mark.parametrize(
    ("entries", "said"),
    [
        ({"count": 5}, "bufferView 0 has 48 and the buffer 48: it may be cut off"),
        ({"byteOffset": 4}, "needs bytes 0 to 52"),
        ({"type": "VEC4"}, "must be of type VEC3, not VEC4"),
        ({"bufferView": 1}, "names entry 1 of bufferViews, which has 1"),
        ({"bufferView": -1}, "names entry -1 of bufferViews"),
        ({"count": 2.5}, "a whole number of 0 or more, not 2.5"),
    ],
)
def test_arrays_that_cannot_be_are_named(entries, said):
    file = GltfFile()
    index = file.array(ROWS, "f4")
    assert read(file, index).shape == (4, 3)
    file.tree["accessors"][index] |= entries
    with pytest.raises(MeshError, match=said):
        read(file, index)


def test_an_array_without_data_is_named():
    file = GltfFile()
    index = file.array(ROWS, "f4")
    del file.tree["accessors"][index]["bufferView"]
    with pytest.raises(MeshError, match="accessor 0 has no data"):
        read(file, index)
    tree = file.tree | {"buffers": [{"byteLength": 48, "extensions": {"EXT_meshopt_compression": {}}}]}
    file.tree["accessors"][index]["bufferView"] = 0
    with pytest.raises(MeshError, match=r"buffer 0 has no data \(but EXT_meshopt_compression\)"):
        GltfArrays(tree, None, None).accessor(index, "VEC3")


def test_a_glb_is_cut_into_its_chunks():
    whole_file = GltfFile().glb()
    text, binary = glb_chunks(whole_file)
    assert text.startswith(b'{"asset"')
    assert binary == b""
    extra = whole_file[:8] + struct.pack("<I", len(whole_file) + 12) + whole_file[12:]
    assert glb_chunks(extra + struct.pack("<I4s4x", 4, b"ABCD"))[0] == text  # unknown chunks are passed over
    for content, said in (
        (whole_file[:-1], "but has"),
        (b"glTF", "is no GLB file"),
        (b"glTF" + struct.pack("<II", 1, 20) + bytes(8), "is glTF 1, and only glTF 2"),
        (whole_file[:12] + struct.pack("<I", 999) + whole_file[16:], "ends within its chunk 'JSON'"),
        (whole_file[:16] + b"ABCD" + whole_file[20:], "no chunk JSON"),
    ):
        with pytest.raises(MeshError, match=said):
            glb_chunks(content)


def test_data_uris_are_read_or_refused():
    assert embedded("data:;base64," + base64.b64encode(b"abc").decode()) == b"abc"
    assert embedded("data:text/plain,a%20b") == b"a b"
    for uri, said in (("data:;base64", "without a comma"), ("data:;base64,abc", "no base64")):
        with pytest.raises(MeshError, match=said):
            embedded(uri)
