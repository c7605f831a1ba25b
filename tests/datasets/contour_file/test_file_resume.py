"""Who may write a contour file: modes, recipes, locks, and blocks that are not to be trusted."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from contour_cases import (
    assert_same,
    make_contours,
    make_header,
    make_metrics,
    small_chunks,
    write_file,
    write_ranges,
)

from palpate.datasets.contour_file.blocks import block_files
from palpate.datasets.contour_file.check import check_file
from palpate.datasets.contour_file.reader import ContourFile
from palpate.datasets.contour_file.writer import ContourWriter
from palpate.datasets.errors import ContourFileError

PROCESS = Path(__file__).parents[2] / "faults" / "contour_process.py"
OTHER_POSE = np.tile(np.array([0, 0, 1, 0, 0, 0, 1], np.float32), (10, 1))


@pytest.fixture
def path(tmp_path):
    return tmp_path / "out.h5"


@pytest.fixture
def contours():
    return make_contours(10)


@pytest.fixture
def begun(path, contours):
    """A rendering of 10 poses that stopped with 0 to 3, 3 to 5 and 7 to 10 done."""
    with ContourWriter(path, make_header(10)) as writer:
        write_ranges(writer, contours, [(7, 10), (0, 3), (3, 5)])
    return path


def resume_and_seal(path, contours, **changes):
    with ContourWriter(path, make_header(10, **changes), mode="resume") as writer:
        write_ranges(writer, contours, writer.missing())
        writer.seal()
    assert check_file(path) == []
    with ContourFile(path) as file:
        assert_same(file.contours(), contours)
        return file.attributes


@pytest.mark.exhaustive
def test_resuming_writes_what_is_missing_and_keeps_the_header_of_the_beginning(begun, contours):
    with ContourWriter(begun, make_header(10), mode="resume") as writer:
        assert writer.missing() == [(5, 7)]
    attributes = resume_and_seal(begun, contours, device="cuda:0", created="2030", versions={"palpate": "0.1.0"})
    assert attributes["device"] == "cpu"
    assert attributes["created"] == make_header(10).created


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize(
    ("field", "changes", "shown"),
    [
        ("strategy", {"strategy": {"raw": "voxel"}}, r'"mesh".* is now \{"raw": "voxel"'),
        ("object", {"object_name": "cube"}, "tetrahedron sha256:.* is now cube sha256:"),
        ("object", {"faces": np.zeros((1, 3), np.int32)}, "tetrahedron"),
        ("motion", {"pose": OTHER_POSE}, "10 poses"),
        ("motion", {"time": None}, "10 poses"),
        ("hand", {"hand": {"kind": "glove"}}, "palm"),
        ("hand", {"hand": {"kind": "palm", "width": 0.085, "length": 0.1, "note": "x" * 99}}, r"0\.1, "),
        ("placement", {"placement": {"scale": 0.001}}, "0.001"),
        ("palpate", {"versions": {"palpate": "9.9"}}, "0.1.0 and is now 9.9"),
    ],
)
def test_resuming_another_rendering_is_refused_naming_the_field(begun, contours, field, changes, shown):
    with pytest.raises(ContourFileError, match=f"another rendering: {field} was .*{shown}.*mode=.overwrite") as refusal:
        ContourWriter(begun, make_header(10, **changes), mode="resume")
    assert str(refusal.value).count(" is now ") == 1
    resume_and_seal(begun, contours)


def test_resuming_without_the_motion_of_the_object_is_refused(path, contours):
    with ContourWriter(path, make_header(10, moved=OTHER_POSE)) as writer:
        write_ranges(writer, contours, [(0, 3)])
    with pytest.raises(ContourFileError, match=r"another rendering: object motion was .* and is now absent"):
        ContourWriter(path, make_header(10), mode="resume")


def test_resuming_a_sealed_file_has_nothing_to_do_and_refuses_another_recipe(path):
    write_file(path, make_contours(4))
    before = path.read_bytes()
    with ContourWriter(path, make_header(4), mode="resume") as writer:
        assert writer.missing() == []
        writer.seal()
        with pytest.raises(ContourFileError, match="sealed already"):
            write_ranges(writer, make_contours(4), [(0, 1)])
    assert path.read_bytes() == before
    assert list(path.parent.iterdir()) == [path]
    with pytest.raises(ContourFileError, match="another rendering: strategy was"):
        ContourWriter(path, make_header(4, strategy={}), mode="resume")
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.exhaustive
def test_creating_refuses_what_exists_naming_both_ways_out(begun, contours):
    for _ in range(2):  # an unfinished one, then a sealed one
        with pytest.raises(
            ContourFileError, match=r"(?s)mode=.resume.*mode=.overwrite|mode=.overwrite.*mode=.resume"
        ) as refusal:
            ContourWriter(begun, make_header(10))
        assert str(begun) in str(refusal.value)
        resume_and_seal(begun, contours)


def test_overwriting_keeps_the_old_file_until_the_new_one_is_sealed(path):
    old, new = make_contours(4, seed=1), make_contours(4, seed=2)
    write_file(path, old)
    with ContourWriter(path, make_header(4, strategy={"raw": "new"}), mode="overwrite") as writer:
        write_ranges(writer, new, [(0, 4)])
        with ContourFile(path) as file:
            assert_same(file.contours(), old)
        assert check_file(path) == []
        writer.seal()
    with ContourFile(path) as file:
        assert_same(file.contours(), new)


def test_overwriting_an_unfinished_rendering_begins_anew(begun):
    with ContourWriter(begun, make_header(10, strategy={}), mode="overwrite") as writer:
        assert writer.missing() == [(0, 10)]
        assert block_files(begun.with_name("out.h5.partial")) == []


def test_a_second_writer_is_refused(path, contours):
    with ContourWriter(path, make_header(10)) as writer:
        write_ranges(writer, contours, [(0, 3)])
        for mode in ("create", "resume", "overwrite"):
            with pytest.raises(ContourFileError, match="is being written by another process"):
                ContourWriter(path, make_header(10), mode=mode)
        write_ranges(writer, contours, writer.missing())
        writer.seal()
    assert check_file(path) == []


@pytest.mark.exhaustive
def test_a_second_writer_of_another_process_is_refused(begun):
    with ContourWriter(begun, make_header(10), mode="resume"):
        command = [sys.executable, PROCESS, begun, "overwrite", "10", "5"]
        other = subprocess.run(command, capture_output=True, text=True, check=False)
        assert "is being written by another process" in other.stderr


@pytest.fixture
def long(path):
    """A rendering of 40 poses, 30 done in three ranges, in many small chunks; and its contours."""
    contours = make_contours(40)
    with small_chunks():
        with ContourWriter(path, make_header(40)) as writer:
            write_ranges(writer, contours, [(0, 10), (10, 20), (20, 30)])
        yield contours


def flip(path, at):
    content = bytearray(path.read_bytes())
    content[at] ^= 1
    path.write_bytes(content)


def resume_long(path, contours):
    with ContourWriter(path, make_header(40), mode="resume") as writer:
        missing, repairs = writer.missing(), writer.repairs
        write_ranges(writer, contours, missing)
        writer.seal()
    assert check_file(path) == []
    with ContourFile(path) as file:
        assert_same(file.contours(), contours)
    return missing, repairs


@pytest.mark.exhaustive(but="1-middle")
@pytest.mark.parametrize("where", ["first", "middle", "last", "short"])
@pytest.mark.parametrize("block", [0, 1, 2])
def test_damage_drops_its_block_alone_reports_it_and_those_poses_are_rendered_again(path, long, block, where):
    first, stop, file = block_files(path.with_name("out.h5.partial"))[block]
    assert (first, stop) == (10 * block, 10 * block + 10)
    size = file.stat().st_size
    if where == "short":
        os.truncate(file, size // 2)
    else:
        with h5py.File(file) as opened:
            rows = opened["/contours/points"].id.get_chunk_info(0).byte_offset
        flip(file, {"first": 0, "middle": rows, "last": size - 1}[where])
    missing, repairs = resume_long(path, long)
    assert missing == ([(20, 40)] if block == 2 else [(first, stop), (30, 40)])
    assert len(repairs) == 1
    assert file.name in repairs[0]
    assert repairs[0].endswith("dropped, its poses are rendered again")


@pytest.mark.exhaustive
def test_a_block_of_another_rendering_is_dropped_at_resume_and_refused_by_the_reader(begun, contours, tmp_path):
    with ContourWriter(tmp_path / "b.h5", make_header(10, strategy={})) as writer:
        write_ranges(writer, make_contours(10, seed=3), [(5, 7)])
    (_, _, foreign), folder = block_files(tmp_path / "b.h5.partial")[0], begun.with_name("out.h5.partial")
    shutil.copy(foreign, folder)
    with ContourFile(begun) as file, pytest.raises(ContourFileError, match=r"pose 5 .*not done"):
        file.contours(4, 8)
    assert any("is of another rendering" in problem for problem in check_file(begun))
    with ContourWriter(begun, make_header(10), mode="resume") as writer:
        assert writer.missing() == [(5, 7)]
        assert "is of another rendering" in writer.repairs[0]
    resume_and_seal(begun, contours)


@pytest.mark.parametrize(
    "name", ["poses-000000000000.log", "poses-000000000000.rows", "poses-000000000005-000000000007-0badf00d.h5"]
)
def test_a_folder_of_an_older_palpate_is_refused_and_overwriting_begins_anew(begun, contours, name):
    older = begun.with_name("out.h5.partial") / name
    older.write_bytes(b"older")
    for refused in (lambda: ContourWriter(begun, make_header(10), mode="resume"), lambda: ContourFile(begun)):
        with pytest.raises(ContourFileError, match=f"older palpate, which wrote {name}.*mode=.overwrite. begins anew"):
            refused()
    assert older.exists()
    with ContourWriter(begun, make_header(10), mode="overwrite") as writer:
        assert writer.missing() == [(0, 10)]
        write_ranges(writer, contours, [(0, 10)])
        writer.seal()
    assert [own.name for own in begun.parent.iterdir()] == ["out.h5"]


@pytest.mark.exhaustive
def test_overlapping_blocks_are_dropped_and_reported(path, begun, contours, tmp_path):
    with ContourWriter(tmp_path / "b.h5", make_header(10)) as writer:
        write_ranges(writer, contours, [(4, 7)])
    for _, _, file in block_files(tmp_path / "b.h5.partial"):
        shutil.copy(file, begun.with_name("out.h5.partial"))
    with ContourWriter(begun, make_header(10), mode="resume") as writer:
        assert writer.missing() == [(5, 7)]
        assert "overlaps the poses before 5" in writer.repairs[0]
    resume_and_seal(begun, contours)


def test_blocks_without_their_header_are_refused_not_removed(begun):
    folder = begun.with_name("out.h5.partial")
    (folder / "header.h5").unlink()
    with pytest.raises(ContourFileError, match="has no header"):
        ContourWriter(begun, make_header(10), mode="resume")
    assert len(block_files(folder)) == 3


@pytest.mark.exhaustive
def test_leftovers_of_a_kill_are_removed_and_other_peoples_files_are_not(begun, contours):
    folder = begun.with_name("out.h5.partial")
    blocks = [file.name for _, _, file in block_files(folder)]
    for name in ("header.h5.tmp", "sealed.h5.tmp", "poses-000000000005-000000000007.h5.tmp"):
        (folder / name).write_bytes(b"half")
    theirs = {"notes.txt", "poses-of-mine.h5", "poses-000000000000.csv", "mine.tmp"}
    for name in theirs:
        (folder / name).write_text("mine")
    with ContourWriter(begun, make_header(10), mode="resume") as writer:
        assert writer.repairs == ()
        assert {own.name for own in folder.iterdir()} == {"header.h5", "lock", *blocks, *theirs}
    resume_and_seal(begun, contours)
    assert {own.name for own in folder.iterdir()} == theirs


def test_a_closed_writer_writes_no_more(path, contours):
    with ContourWriter(path, make_header(10)) as writer:
        pass
    for call in (lambda: write_ranges(writer, contours, [(0, 1)]), writer.seal):
        with pytest.raises(ContourFileError, match="closed"):
            call()


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize(
    ("poses", "change", "message"),
    [
        ((0, 11), {}, "out of range, there are 10 poses"),
        ((3, 3), {}, "out of range"),
        ((2, 4), {}, "overlap poses that were written already"),
        ((3, 5), {"points": lambda a: a.astype(np.float64)}, "/contours/points is float64, expected float32"),
        ((3, 5), {"points": lambda a: a[:, :2]}, r"/contours/points has shape .*, expected \[point, 3\]"),
        ((3, 5), {"kind": lambda a: a[1:]}, "/contours/kind has .* point rows, other fields have"),
        ((3, 5), {"kind": None}, "/contours/kind is missing"),
        ((3, 5), {"colour": lambda _: np.zeros(2)}, "/contours has no field 'colour'"),
        ((3, 5), {"pose_start": lambda a: a + 1}, "pose_start must rise from 0"),
        ((3, 5), {"polyline_start": lambda a: np.where(a == a[1], 0, a)}, "polyline_start must rise from 0"),
        ((3, 6), {}, "arrays are of 2 and 2 poses"),
    ],
)
def test_arrays_that_do_not_fit_are_refused_and_nothing_is_written(path, poses, change, message):
    contours = make_contours(2, seed=8)
    assert len(contours["polyline_patch"]) > 1
    broken = dict(contours)
    for name, make in change.items():
        if make is None:
            del broken[name]
        else:
            broken[name] = make(contours.get(name))
    with ContourWriter(path, make_header(10)) as writer:
        write_ranges(writer, make_contours(10), [(0, 3)])
        with pytest.raises(ContourFileError, match=message):
            writer.write(*poses, broken, make_metrics(contours))
        assert writer.missing() == [(3, 10)]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
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
        ({"moved": np.full((3, 7), np.nan, np.float32)}, "moved row 0 is not finite"),
        ({"moved": np.zeros((3, 6), np.float32)}, r"/object/moved has shape \[3, 6\]"),
        ({"hand_arrays": {"bones": np.zeros(3)}}, "/hand has no field 'bones'"),
        ({"hand_arrays": {"skin_faces": np.zeros((2, 3))}}, "/hand/skin_faces is float64, expected int32"),
    ],
)
def test_a_header_that_does_not_fit_is_refused_and_nothing_is_made(path, changes, message):
    with pytest.raises(ContourFileError, match=message):
        ContourWriter(path, make_header(3, **changes))
    assert list(path.parent.iterdir()) == []


def test_places_that_cannot_be_written_are_refused(tmp_path):
    with pytest.raises(ContourFileError, match="there is no folder"):
        ContourWriter(tmp_path / "none" / "out.h5", make_header(1))
    with pytest.raises(ContourFileError, match="is a folder"):
        ContourWriter(tmp_path, make_header(1))
