"""PLY by Greg Turk's description of 1994: files that this test writes value by value, in every type and byte order."""

import numpy as np
import pytest
from file_meshes import CUBE, QUADS, corners_of, enclosed, moved, triangles_of
from ply_files import FORMS, INTEGERS, MIXED, face_element, ply_file, vertex_element

from palpate.datasets.bounded_file import LIMIT_VARIABLE, FileBoundError
from palpate.render.errors import MeshError
from palpate.render.objects.mesh.formats.ply import read_ply


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("polygons", [QUADS, MIXED], ids=["quads", "mixed"])
@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
def test_a_cube_of_quads_and_triangles_is_read_in_every_form(form, polygons, newline):
    content = ply_file(form, [vertex_element(), face_element(polygons)], newline)
    assert enclosed(read_ply(content)) == (12, [1, 1, 1], 1)


@pytest.mark.parametrize("seed", range(4))
def test_random_tables_are_read_as_they_were_written(seed):
    rng = np.random.default_rng(seed)
    form, count, kind = (str(rng.choice(list(names))) for names in (FORMS, INTEGERS, INTEGERS))
    along = np.arange(20.0)
    points = np.stack([along, along**2, 3 * along], axis=1)  # on a curve in a plane, so that polygons are convex
    polygons = [np.sort(rng.choice(20, rng.integers(1, 7), replace=False)).tolist() for _ in range(15)]
    extras = [("quality", "float"), ("flags", "ushort", "uchar"), ("n", "char")]
    vertex = ["vertex", [("n", "uchar"), ("x", "double"), ("y", "float"), ("z", "double"), extras[0]], []]
    vertex[2] = [[3, *map(float, row), 0.5] for row in points]
    own = [*extras[: rng.integers(0, 4)], ("vertex_index", count, kind)]
    given = {"quality": 0.25, "n": -1}
    lists = [[*(given.get(name[0], [1] * int(rng.integers(0, 3))) for name in own[:-1]), poly] for poly in polygons]
    edge = ("edge", [("a", "int"), ("b", "int")], [[0, 1], [2, 3]])
    elements = [vertex, ("face", own, lists), edge]
    elements = [elements[k] for k in rng.permutation(3)]
    found = read_ply(ply_file(form, elements))
    np.testing.assert_array_equal(corners_of(found), triangles_of(points, polygons))


@pytest.mark.parametrize("form", FORMS)
def test_strips_of_stanford_are_read(form):
    """A tetrahedron of 1/6 m^3 in one strip, and one 2 m away whose four triangles are strips that -1 ends."""
    corners = CUBE[[0, 1, 3, 4]]
    strips = [[2, 1, 0, 3, 2, 1], [6, 5, 4, -1, 4, 5, 7, -1, 5, 6, 7, -1, 4, 7, 6]]
    element = ("tristrips", [("vertex_indices", "int", "int")], [[own] for own in strips])
    content = ply_file(form, [vertex_element([*corners, *moved(corners, 2)]), element])
    count, size, volume = enclosed(read_ply(content))
    assert (count, size) == (8, [3, 1, 1])
    assert abs(volume) == pytest.approx(1 / 3)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("polygons", [QUADS, MIXED], ids=["quads", "mixed"])
def test_a_file_cut_off_anywhere_is_refused(form, polygons):
    whole = ply_file(form, [vertex_element(), face_element(polygons)])
    begin = whole.index(b"end_header")
    for length in [*range(begin, len(whole) - 2, 3), len(whole) - 2]:
        with pytest.raises(MeshError):
            read_ply(whole[:length])


ONE_FACE = ply_file("ascii", [vertex_element(), face_element([[0, 1, 2]])])


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"plyx", "is no PLY file"),
        (b"ply\nformat ascii 1.0\n", "is no PLY file"),
        (b"ply\nformat utf8 1.0\nend_header\n", "its format must be one of ascii, binary"),
        (b"ply\nformat ascii 1.0\nproperty float x\nend_header\n", "'property float x' of its header"),
        (b"ply\nformat ascii 1.0\nelement vertex 1\nproperty half x\nend_header\n", "'property half x'"),
        (b"ply\nformat binary_little_endian 1.0\nelement f 1\nproperty list float int i\nend_header\n", "in fractions"),
        (
            ply_file("ascii", [("range_grid", [("a", "uchar", "int")], [[[0]]])]),
            "no element vertex .* but range_grid",
        ),
        (ply_file("ascii", [vertex_element(), face_element([[0, 1, 8]])]), "faces name vertices 0 to 8"),
        (
            ply_file("binary_big_endian", [vertex_element(), face_element([[0, 1, -1]])]),
            "faces name vertices -1 to 1",
        ),
        (
            ply_file(
                "ascii", [vertex_element(), ("face", [("a", "uchar", "int"), ("b", "uchar", "int")], [[[0], [1]]])]
            ),
            "has no list vertex_indices or vertex_index, but a, b",
        ),
        (
            ply_file("ascii", [vertex_element()]).replace(b"1.0 0.0 0.0", b"1,0 0,0 0,0"),
            "decimal points, not commas",
        ),
        (ONE_FACE.replace(b"comment", b"comment " + b"x" * 2**20), "is no PLY file"),
        (ply_file("ascii", [vertex_element(), vertex_element()]), "has two elements vertex"),
        (
            ONE_FACE.replace(b"3 0 1 2", b"3 0 1 inf"),
            "whole ones",
        ),
        (
            ONE_FACE.replace(b"3 0 1 2", b"3 0 1 1.5"),
            "whole ones",
        ),
        (ply_file("binary_little_endian", [vertex_element()]) + b"\x01", "1 bytes more than its header names"),
        (b"ply\nformat ascii 1.0\nelement vertex 999999999999\nproperty float x\nend_header\n1\n", "ends before"),
        (
            ONE_FACE.replace(b"3 0 1 2", b"-1 0 1 2"),
            "has -1.0 values",
        ),
    ],
)
def test_what_is_not_read_is_named(content, said):
    with pytest.raises(MeshError, match=said):
        read_ply(content)


@pytest.mark.parametrize("faces", [[200_000], [3, 200_000]], ids=["alike", "of unequal width"])
def test_lists_of_single_bytes_stay_within_the_budget_as_what_they_become(monkeypatch, faces):
    """A polygon of 200,000 corners of a byte each, which a zip holds in 200 bytes: 8 bytes for each corner."""
    monkeypatch.setenv(LIMIT_VARIABLE, "1")
    lists = [("vertex_indices", "uint", "uchar")]
    content = ply_file("binary_little_endian", [vertex_element(), ("face", lists, [[[0] * n] for n in faces])])
    with pytest.raises(FileBoundError, match=r"what its (polygons|rows) (become|need) takes (1600000|4800072) bytes"):
        read_ply(content)
