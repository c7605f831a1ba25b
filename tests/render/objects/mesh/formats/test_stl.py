"""STL as 3D Systems described it: exact solids in both forms."""

import struct

import pytest
from file_meshes import CUBE, TRIANGLES, enclosed, moved

from palpate.render.errors import MeshError
from palpate.render.objects.mesh.formats.stl import read_stl


def solid_text(name, by=0, facet="facet normal 0 0 0\nouter loop\n{}endloop\nendfacet\n", vertex="vertex {} {} {}\n"):
    body = "".join(
        facet.format("".join(vertex.format(*moved(CUBE[corner], by)) for corner in face)) for face in TRIANGLES
    )
    return f"solid {name}\n{body}endsolid {name}\n"


def binary(head=b"", tail=b""):
    rows = b"".join(struct.pack("<12fH", 0, 0, 0, *CUBE[face].ravel(), 7) for face in TRIANGLES)
    return head.ljust(80, b" ") + struct.pack("<I", len(TRIANGLES)) + rows + tail


def test_all_solids_of_a_file_are_read_whatever_their_names():
    names = ["", "vertex 1 2 3", "my solid", "facet", "endfacet"]
    text = "".join(solid_text(name, 2 * k) for k, name in enumerate(names))
    assert enclosed(read_stl(text.encode())) == (60, [9, 1, 1], 5)


@pytest.mark.parametrize(
    "content",
    [
        solid_text("a").upper().encode(),
        solid_text("a").replace("\n", "\r").encode(),
        solid_text("a").replace("\n", " ").encode(),
        solid_text("Gr\xf6\xdfe").encode("latin-1"),
        solid_text("a", vertex="\t vertex\t{:e}  {:e} {:e} \n").encode(),
        binary(),
        binary(b"solid of a program that begins its binary files so"),
    ],
    ids=["upper", "CR", "one line", "Latin-1", "exponents", "binary", "binary that begins with solid"],
)
def test_a_cube_is_a_cube_however_it_is_written(content):
    assert enclosed(read_stl(content)) == (12, [1, 1, 1], 1)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (solid_text("a")[:-300].encode(), "has 10 facets, of which 9 end, and 27 vertices"),
        (solid_text("a").partition("endsolid")[0].encode(), "ends without endsolid"),
        (solid_text("a", facet="facet normal 0 0 0 {} vertex 0 0 0 endfacet\n").encode(), "48 vertices, not three"),
        (solid_text("a", vertex="vertex {},5 {} {}\n").encode(), "decimal points, not commas"),
        (binary()[:-1], "nor the 684 bytes of the 12 triangles .* 683 bytes: it may be cut off"),
        (binary(tail=b"\0"), "nor the 684 bytes .* 685 bytes: the count may be wrong"),
    ],
)
def test_what_is_cut_off_or_wrong_is_named(content, said):
    with pytest.raises(MeshError, match=said):
        read_stl(content)
