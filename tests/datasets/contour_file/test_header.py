"""What a contour file knows before its first pose: its hand, a moving object, a live run; what does not fit is told."""

import h5py
import numpy as np
import pytest
from contour_cases import (
    assert_whole,
    finish,
    live_run,
    make_contours,
    make_header,
    redigest,
    write_file,
    write_ranges,
)

from palpate.datasets.contour_file.check import check_file
from palpate.datasets.contour_file.header_live import RecordedRun, require_live
from palpate.datasets.contour_file.live_summary import summarise_run
from palpate.datasets.contour_file.pose_rows import hand_at, object_pose_at
from palpate.datasets.contour_file.reader import ContourFile
from palpate.datasets.contour_file.writer import ContourWriter
from palpate.datasets.errors import ContourFileError
from palpate.datasets.hand_model.shape import hand_shape
from palpate.datasets.storage.schema import LIVE
from palpate.render.hands.mesh_hand import MeshHand
from palpate.render.hands.plane_hand import HandPatch, PlaneHand
from palpate.render.hands.stored_hand import hand_from

POSES = 3
CONTOURS = make_contours(POSES)
STILL = np.tile(np.array([0, 0, 0.2, 0, 0, 0, 1], np.float32), (POSES, 1))
MOVED = STILL + np.arange(POSES, dtype=np.float32)[:, None] * np.float32([0.1, 0, 0, 0, 0, 0, 0])
SHAPE = hand_shape(detail=1)
COUNT = len(SHAPE.vertices)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "a.h5"


def skin(rows=None):
    vertices = SHAPE.vertices if rows is None else np.stack([SHAPE.vertices] * rows)
    return MeshHand(vertices, SHAPE.faces, glabrous=SHAPE.glabrous)


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
NO_HEADER = [
    ({"pose": np.zeros((0, 7), np.float32), "time": None}, "at least 1 pose"),
    ({"pose": np.full((3, 7), np.nan, np.float32), "time": None}, "row 0 is not finite"),
    ({"time": np.array([0.0, 1.0, 1.0])}, "increase"),
    ({"time": np.zeros(2)}, "/motion/pose has 3 pose rows, other fields have 2"),
    ({"faces": np.array([[0, 1, 4]], np.int32)}, "vertices 0 to 4 of 4"),
    ({"strategy": {"x": float("nan")}}, "strategy cannot be stored as JSON"),
    ({"hand": {"x": object()}}, "hand cannot be stored as JSON"),
    ({"object_name": "a\0b"}, "NUL"),
    ({"object_name": "\udcff"}, "not valid Unicode"),
    ({"versions": {}}, "must name palpate"),
    ({"moved": np.zeros((2, 7), np.float32)}, "moved must be 3 poses"),
    ({"moved": np.zeros((3, 6), np.float32)}, r"/object/moved has shape \[3, 6\]"),
    ({"moved": changed(STILL, 1, 0.0)}, "/object/moved row 1 has quaternion norm 0; it must be 1"),
    ({"moved": changed(STILL, (1, 2), np.inf)}, "/object/moved row 1 is not finite"),
    ({"hand_arrays": {"bones": np.zeros(3)}}, "/hand has no field 'bones'"),
    ({"hand_arrays": {"skin_faces": np.zeros((2, 3))}}, "/hand/skin_faces is float64, expected int32"),
    ({"hand_arrays": {"patch_pose": OWN}}, "/hand/patch_pose is there, of a hand of kind 'palm'"),
    ({"hand": skin().described()}, "/hand/skin_faces is missing, of a hand of kind 'mesh'"),
    ({"hand": {"kind": "new"}, "hand_arrays": {"skin_faces": FACES}}, "skin_vertices is missing, but skin_faces is"),
    (stored(skin(), skin_faces=changed(FACES, 0, 10**6)), f"skin_faces points at vertices 0 to 1000000 of {COUNT}"),
    (stored(skin(), skin_faces=changed(FACES, 0, -1)), "skin_faces points at vertices -1 to"),
    (stored(skin(), skin_vertices=SKIN["skin_vertices"][1:]), f"has {COUNT - 1} rows, expected {COUNT}: 1 x {COUNT}"),
    (stored(skin(2)), "its description tells 2 poses, /motion/pose has 3"),
    (stored(planes(2)), "its description tells 2 poses, /motion/pose has 3"),
    (stored(planes(), patch_pose=OWN[:5]), "patch_pose has 5 rows, expected 6: 3 x 2 patches"),
    (stored(planes(), patch_pose=changed(OWN, (4, 0), np.nan)), "patch_pose row 4 is not finite"),
    (stored(planes(), patch_pose=changed(OWN, 4, 2.0)), "patch_pose row 4 has quaternion norm 4; it must be 1"),
    (live_run(POSES) | {"live": live_run(POSES)["live"] | {"samples": 8}}, "/live/mark has 9 rows, expected 8"),
]


def test_a_header_or_place_that_does_not_fit_is_refused_and_nothing_is_made(path):
    for changes, message in NO_HEADER:
        with pytest.raises(ContourFileError, match=message):
            ContourWriter(path, make_header(POSES, **changes))
    for place, message in ((path / "out.h5", "there is no folder"), (path.parent, "is a folder")):
        with pytest.raises(ContourFileError, match=message):
            ContourWriter(place, make_header(1))
    assert list(path.parent.iterdir()) == []


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
def test_checking_finds_arrays_that_are_not_those_described(hand, name, row, value, said, path):
    write_file(path, CONTOURS, **stored(hand()))
    with h5py.File(path, "r+") as file:
        file[f"/hand/{name}"][row] = value
    redigest(path)
    assert any(said in problem for problem in check_file(path)), check_file(path)


@pytest.mark.parametrize("hand", [planes(), skin(), skin(POSES)], ids=["planes", "rigid", "posed"])
def test_a_hand_is_whole_and_read_back_as_are_the_rows_of_one_pose(path, hand):
    write_file(path, CONTOURS, **stored(hand), moved=MOVED)
    assert_whole(path, CONTOURS)
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


ROWS = {"stamp": 3, "emitted": 3, "position": 18, "intensity": 18, "mark": 9, "events": 40}
RUN = live_run(3)["live"]


def test_a_live_run_is_resumed_read_back_in_parts_and_summed_up(path):
    given = live_run(POSES)
    with ContourWriter(path, make_header(POSES, **given)) as writer:
        write_ranges(writer, CONTOURS, [(0, 1)])
    assert finish(path, CONTOURS, **given) == ([(1, 3)], ())
    with ContourFile(path) as file:
        assert file.live_run == RecordedRun.from_json(RUN)
        assert file.live_run.duration == 0.09
        for name, rows in given["live_arrays"].items():
            np.testing.assert_array_equal(file.live_rows(name), rows, strict=True)
            np.testing.assert_array_equal(file.live_rows(name, 1, 3), rows[1:3], strict=True)
        summary = summarise_run(file)
    assert summary["latency_p50"] == summary["latency_max"] == pytest.approx(1.0 - 2 / 90 + 0.006)
    assert (summary["poses"], summary["poses_emitted"], summary["seconds_dropped"]) == (3, 1, 1)
    assert [summary[name] for name in ("emitted", "dropped", "held", "faded")] == [3, 2, 2, 2]


def test_a_live_run_of_which_no_emission_is_known_has_no_latency(path):
    given = live_run(POSES)
    given["live_arrays"]["emitted"][:] = np.nan
    del given["live_arrays"]["gain"]
    write_file(path, CONTOURS, **given)
    assert_whole(path, CONTOURS)
    with ContourFile(path) as file:
        assert summarise_run(file)["latency_p99"] is None
        assert not file.has_live("gain")


def test_a_file_of_an_object_at_rest_and_no_live_run_has_neither(path):
    write_file(path, CONTOURS)
    with ContourFile(path) as file:
        assert file.live_run is summarise_run(file) is object_pose_at(file, 1) is None
        assert not any(file.has_live(spec.name) for spec in LIVE)


BAD_RUNS = {
    "hold": (float("nan"), "hold must be a finite number above 0, not nan"),
    "update_rate": (0, "update_rate must be a finite number above 0, not 0"),
    "samples": (9.0, "samples must be a whole number of 1 or more, not 9.0"),
    "foci": (True, "foci must be a whole number of 1 or more, not True"),
    "realtime": (1, "realtime must be of type bool, not 1"),
    "source": (None, "source must be of type str, not None"),
    "sampling": ("stm", "sampling must be a JSON object, not 'stm'"),
}


def test_a_live_run_with_a_wrong_value_or_other_arrays_is_refused_by_name():
    require_live(RUN, ROWS, 3)
    cases = [(RUN | {name: value}, ROWS, sentence) for name, (value, sentence) in BAD_RUNS.items()]
    for name in BAD_RUNS:
        lacking = {key: own for key, own in RUN.items() if key != name}
        cases.append((lacking, ROWS, f"its attribute run has no '{name}'"))
    for name, count in ROWS.items():
        cases.append((RUN, {key: own for key, own in ROWS.items() if key != name}, f"/live/{name} is missing"))
        cases.append((None, {name: 3}, f"/live/{name} is there, but /live has no attribute run"))
        if name != "events":
            cases.append((RUN, ROWS | {name: count + 1}, f"/live/{name} has {count + 1} rows, expected {count}"))
    for run, rows, sentence in cases:
        with pytest.raises(ContourFileError, match=sentence):
            require_live(run, rows, 3)
