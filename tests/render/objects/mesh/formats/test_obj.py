"""Wavefront OBJ by its specification: exact solids, and a reader of this test that takes one line at a time."""

import numpy as np
import pytest
from file_meshes import CUBE, QUADS, corners_of, enclosed, moved, triangles_of

from palpate.render.errors import MeshError
from palpate.render.objects.mesh.formats.obj import read_obj

GROUP = "g part{0}\n{1}f -5 -6 -7 -8\nf -4 -3 -2 -1\nf -8 -7 -3 -4\nf -7 -6 -2 -3\nf -6 -5 -1 -2\nf -5 -8 -4 -1\n"


def vertex_lines(vertices, form="v {} {} {}\n"):
    return "".join(form.format(*row) for row in vertices)


def cube_text(face="f {} {} {} {}\n", vertex="v {} {} {}\n"):
    return vertex_lines(CUBE, vertex) + "".join(face.format(*(corner + 1 for corner in quad)) for quad in QUADS)


def test_relative_indices_count_back_from_where_the_face_stands():
    """Two unit boxes 2 m apart, each with indices of its own: 24 triangles, 3 x 1 x 1 m, 2 m^3."""
    text = "".join(GROUP.format(k, vertex_lines(moved(CUBE, 2 * k))) for k in range(2))
    assert enclosed(read_obj(text.encode())) == (24, [3, 1, 1], 2)


def by_the_specification(text):
    """Polygons with absolute indices, as appendix B1 counts them: a line at a time."""
    vertices, polygons = [], []
    for line in text.split("\n"):
        words = line.split()
        if words[:1] == ["v"]:
            vertices.append([float(word) for word in words[1:4]])
        elif words[:1] == ["f"]:
            own = [int(word.split("/")[0]) for word in words[1:]]
            polygons.append([k - 1 if k > 0 else len(vertices) + k for k in own])
    return triangles_of(vertices, polygons)


@pytest.mark.parametrize("seed", range(3))
def test_random_files_are_read_as_the_specification_counts(seed):
    rng = np.random.default_rng(seed)
    lines, count = ["# random", "mtllib none.mtl"], 0
    for _ in range(60):
        if count < 3 or rng.random() < 0.6:
            at = [count, count**2, 3 * count]  # on a curve in a plane, so that polygons are convex
            numbers = [*at, *rng.normal(size=rng.choice([0, 1, 3, 4])).round(3)]
            lines.append(" ".join(["v", *map(str, numbers)]))
            count += 1
        else:
            form = rng.choice(["{}", "{}/7", "{}//8", "{}/7/8", "{}/-1/-2"])
            own = np.sort(rng.choice(count, min(count, rng.integers(3, 6)), replace=False)) + 1
            own -= (count + 1) * rng.integers(0, 2)
            lines.append("\t".join(["f", *(form.format(k) for k in own)]))
        lines.append(str(rng.choice(["", "g a b", "usemtl f 1 2 3", "s 1", "vt 0 1", "vn 0 0 1", "o f"])))
    text = "\n".join(lines)
    np.testing.assert_array_equal(corners_of(read_obj(text.encode())), by_the_specification(text))


@pytest.mark.parametrize(
    "text",
    [
        cube_text().replace("\n", "\r"),
        cube_text().replace("\n", "\r\n"),
        "\ufeff" + cube_text(),
        cube_text(face="f {} {} \\\n{} {}\n"),
        cube_text(face="f {} {}\\\n{} {}\n"),
        cube_text(face="\tf  {}\t{} {} {} # v 9 9 9\n", vertex="  v\t{} {} {}  # one\n"),
        cube_text(vertex="v {} {} {} 1 0 0\n"),
        cube_text(face="fo {} {} {} {}\n"),
        cube_text() + "l 1 2\nf 1 2\np 1\n",
        "# from C:\\models\\\n" + cube_text().replace("f", "o a\\\nf"),
    ],
    ids=[
        "CR",
        "CRLF",
        "BOM",
        "continued",
        "continued without a space",
        "tabs",
        "colours",
        "fo",
        "lines and points",
        "names that end in a backslash",
    ],
)
def test_a_cube_is_a_cube_however_it_is_written(text):
    assert enclosed(read_obj(text.encode())) == (12, [1, 1, 1], 1)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 3 2 1\nf 0 2 1\n",
            r"'f 0 2 1' \(number 2\) must name vertices from 1 to 4",
        ),
        (cube_text() + "f 1 2 9\n", r"'f 1 2 9' \(number 7\)"),
        ("v 0 0 0\nv 1 0 0\nf -1 -2 -3\nv 0 1 0\n", "back to the first vertex above it"),
        (cube_text().replace("v 1.0 0.0 0.0", "v 1,0 0,0 0,0"), r"'v 1,0 0,0 0,0'|with decimal points, not commas"),
        ("v 0 0 x\nv 1 2 3\n", "the line '0 0 x' must hold numbers"),
        (cube_text() + "v 0 0\n", "'v 0 0' must hold three numbers after v"),
        (cube_text(face="f {}.0 {} {} {}\n"), "whole numbers"),
        ("v 0 0 0\ncstype bezier\nsurf 0 1 0 1 1 1 1\n", "names a free-form surface, which is not read"),
        ("call other.obj\n", "names another file"),
    ],
)
def test_what_is_not_read_is_named(text, said):
    with pytest.raises(MeshError, match=said):
        read_obj(text.encode())
