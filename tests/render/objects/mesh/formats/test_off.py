"""Geomview's OFF by its description (geomview.org/docs/html/OFF.html): exact solids."""

import pytest
from file_meshes import CUBE, QUADS, enclosed

from palpate.render.errors import MeshError
from palpate.render.objects.mesh.formats.off import read_off

PYRAMID = (  # over a pentagon whose area the shoelace formula gives as 2.37
    "OFF\n6 6 0\n1 0 0\n.3 .95 0\n-.8 .6 0\n-.8 -.6 0\n.3 -.95 0\n0 0 1\n"
    "5 4 3 2 1 0\n3 0 1 5\n3 1 2 5\n3 2 3 5\n3 3 4 5\n3 4 0 5\n"
)


def cube_text(head="OFF\n8 6 12\n", vertex="{} {} {}\n", face="4 {} {} {} {}\n"):
    return head + "".join(vertex.format(*row) for row in CUBE) + "".join(face.format(*quad) for quad in QUADS)


def test_a_pyramid_over_a_pentagon():
    assert enclosed(read_off(PYRAMID.encode())) == (8, [1.8, 1.9, 1], 2.37 / 3)


@pytest.mark.parametrize(
    "text",
    [
        cube_text(),
        cube_text().replace("\n", "\r"),
        cube_text("# a comment OFF\nOFF 8 6\n\n"),
        cube_text("NOFF\n8 6 0\n", "{} {} {} 0 0 1\n"),
        cube_text("COFF\n8 6 0 # counts\n", "{} {} {} 255 0 0 255\n", "4 {} {} {} {} 3 255 0 0\n"),
        cube_text("STOFF\n8 6 0\n", "{} {} {} 0.5 0.5\n"),
        cube_text("OFF\n8 7 0\n") + "2 0 1\n",
    ],
    ids=["plain", "CR", "comments", "normals", "colours", "texture", "an edge as a face"],
)
def test_a_cube_is_a_cube_however_it_is_written(text):
    assert enclosed(read_off(text.encode())) == (12, [1, 1, 1], 1)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (cube_text()[:-15], "names 8 vertices and 6 faces, but 13 lines follow, .* cut off"),
        (cube_text() + "3 0 1 2\n", "but 15 lines follow, .* the counts may be wrong"),
        (cube_text().replace("3 2 1 0", "3 2 1 8"), "faces name vertices 0 to 8, but there are 8"),
        (cube_text("4OFF\n8 6 0\n", "{} {} {} 2\n"), "begins with 4OFF"),
        ("OFF BINARY\n\0\0\0\x08", "is a binary OFF file"),
        ("ply\n", "is no OFF file"),
        ("OFF\n", "the counts of vertices, faces"),
        (cube_text().replace("1.0 0.0 0.0", "1,0 0,0 0,0"), "decimal points, not commas"),
        (cube_text(vertex="{} {}\n"), "must hold three numbers"),
        (cube_text(face="5 {} {} {} {}\n"), "a count and as many vertices"),
    ],
)
def test_what_is_not_read_is_named(text, said):
    with pytest.raises(MeshError, match=said):
        read_off(text.encode())
