"""What a contour file holds of its hand and of a moving object: what does not fit together is refused and found."""

import h5py
import numpy as np
import pytest
from contour_cases import assert_whole, make_contours, make_header, redigest, write_file

from palpate.datasets.contour_file.check import check_file
from palpate.datasets.contour_file.pose_rows import hand_at, object_pose_at
from palpate.datasets.contour_file.reader import ContourFile
from palpate.datasets.errors import ContourFileError
from palpate.datasets.hand_model.shape import hand_shape
from palpate.render.hands.hand import hand_from
from palpate.render.hands.mesh_hand import MeshHand
from palpate.render.hands.plane_hand import HandPatch, PlaneHand

POSES = 3
STILL = np.tile(np.array([0, 0, 0.2, 0, 0, 0, 1], np.float32), (POSES, 1))
MOVED = STILL + np.arange(POSES, dtype=np.float32)[:, None] * np.float32([0.1, 0, 0, 0, 0, 0, 0])


def skin(rows=None):
    shape = hand_shape()
    vertices = shape.vertices if rows is None else np.stack([shape.vertices] * rows)
    return MeshHand(vertices, shape.faces, glabrous=shape.glabrous)


def planes(rows=POSES):
    own = np.tile(np.array([0, 0, 0, 0, 0, 0, 1.0]), (rows, 2, 1))
    own[0, 1] = np.nan
    return PlaneHand((HandPatch("palm", 0.08, 0.08), HandPatch("tip", 0.02, 0.02)), (), own)


def stored(hand, **arrays):
    return {"hand": hand.described(), "hand_arrays": hand.arrays() | arrays}


def changed(array, row, value):
    out = array.copy()
    out[row] = value
    return out


SKIN, FACES, OWN = skin().arrays(), skin().arrays()["skin_faces"], planes().arrays()["patch_pose"]
WRONG = [
    ({"hand_arrays": {"patch_pose": OWN}}, "/hand/patch_pose is there, of a hand of kind 'palm'"),
    ({"hand": skin().described()}, "/hand/skin_faces is missing, of a hand of kind 'mesh'"),
    (
        {"hand": {"kind": "new"}, "hand_arrays": {"skin_faces": FACES}},
        "/hand/skin_vertices is missing, but skin_faces is there",
    ),
    (stored(skin(), skin_faces=changed(FACES, 0, 10**6)), "skin_faces points at vertices 0 to 1000000 of 2645"),
    (stored(skin(), skin_faces=changed(FACES, 0, -1)), "skin_faces points at vertices -1 to"),
    (stored(skin(), skin_vertices=SKIN["skin_vertices"][1:]), "skin_vertices has 2644 rows, expected 2645: 1 x 2645"),
    (stored(skin(2)), "its description tells 2 poses, /motion/pose has 3"),
    (stored(planes(2)), "its description tells 2 poses, /motion/pose has 3"),
    (stored(planes(), patch_pose=OWN[:5]), "patch_pose has 5 rows, expected 6: 3 x 2 patches"),
    (stored(planes(), patch_pose=changed(OWN, 4, np.inf)), "patch_pose row 4 is not finite"),
    (stored(planes(), patch_pose=changed(OWN, (4, 0), np.nan)), "patch_pose row 4 is not finite"),
    (stored(planes(), patch_pose=changed(OWN, 4, 2.0)), "patch_pose row 4 has quaternion norm 4; it must be 1"),
    ({"moved": changed(STILL, 1, 0.0)}, "/object/moved row 1 has quaternion norm 0; it must be 1"),
    ({"moved": changed(STILL, (1, 2), np.inf)}, "/object/moved row 1 is not finite"),
]


def test_what_does_not_fit_together_is_not_written():
    for changes, said in WRONG:
        with pytest.raises(ContourFileError, match=said):
            make_header(POSES, **changes).validate()


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize(
    ("hand", "name", "row", "value", "said"),
    [
        (skin, "skin_vertices", 7, 0.5, "/hand: sha256 in the description is not of its arrays"),
        (planes, "patch_pose", 3, (0.1, 0, 0, 0, 0, 0, 1), "/hand: sha256 in the description is not of its arrays"),
        (planes, "patch_pose", 3, 2.0, "/hand/patch_pose row 3 has quaternion norm 4"),
        (skin, "skin_faces", 3, 10**6, "/hand/skin_faces points at vertices 0 to 1000000"),
    ],
)
def test_checking_finds_arrays_that_are_not_those_described(hand, name, row, value, said, tmp_path):
    path = tmp_path / "hand.h5"
    write_file(path, make_contours(POSES), **stored(hand()))
    with h5py.File(path, "r+") as file:
        file[f"/hand/{name}"][row] = value
    redigest(path)
    assert any(said in problem for problem in check_file(path)), check_file(path)


@pytest.mark.parametrize("kind", ["planes", "rigid", "posed"])
def test_a_hand_is_whole_and_read_back_as_are_the_rows_of_one_pose(tmp_path, kind):
    path, small = tmp_path / "hand.h5", hand_shape(detail=1)
    vertices = np.stack([small.vertices] * POSES) if kind == "posed" else small.vertices
    hand = planes() if kind == "planes" else MeshHand(vertices, small.faces)
    write_file(path, make_contours(POSES), **stored(hand), moved=MOVED)
    assert_whole(path, make_contours(POSES))
    with ContourFile(path) as file:
        whole = file.hand_arrays()
        assert hand_from(file.hand, whole).described() == hand.described()
        for pose in range(POSES):
            described, arrays = hand_at(file, pose)
            assert (described["kind"], "sha256" in described) == (hand.described()["kind"], False)
            assert set(arrays) == set(whole)
            for name, rows in whole.items():
                is_posed = "poses" in described and name in ("patch_pose", "skin_vertices")
                np.testing.assert_array_equal(arrays[name], np.split(rows, POSES)[pose] if is_posed else rows)
            np.testing.assert_array_equal(object_pose_at(file, pose), MOVED[pose])
        for read, pose in ((hand_at, -1), (object_pose_at, POSES)):
            with pytest.raises(ContourFileError, match=rf"pose must lie in 0\.\.2, not {pose}"):
                read(file, pose)


def test_an_object_at_rest_has_no_pose(tmp_path):
    write_file(tmp_path / "hand.h5", make_contours(POSES))
    with ContourFile(tmp_path / "hand.h5") as file:
        assert object_pose_at(file, 1) is None
