"""Who may write a contour file: modes, recipes, locks, and what is refused before anything is written."""

import re

import numpy as np
import pytest
from contour_cases import (
    assert_same,
    assert_whole,
    finish,
    make_contours,
    make_header,
    make_metrics,
    write_file,
    write_ranges,
)

from palpate.datasets.contour_file.blocks import block_files
from palpate.datasets.contour_file.check import check_file
from palpate.datasets.contour_file.reader import ContourFile
from palpate.datasets.contour_file.writer import ContourWriter
from palpate.datasets.errors import ContourFileError

OTHER_POSE = np.tile(np.array([0, 0, 1, 0, 0, 0, 1], np.float32), (10, 1))
CONTOURS = make_contours(10)
MODES = ("create", "resume", "overwrite")


@pytest.fixture
def path(tmp_path):
    return tmp_path / "out.h5"


@pytest.fixture
def begun(path):
    """A rendering of 10 poses that stopped with 0 to 3, 3 to 5 and 7 to 10 done."""
    with ContourWriter(path, make_header(10, moved=OTHER_POSE)) as writer:
        write_ranges(writer, CONTOURS, [(7, 10), (0, 3), (3, 5)])
    return path


def test_resuming_writes_what_is_missing_and_keeps_the_header_of_the_beginning(begun):
    other = {"device": "cuda:0", "created": "2030", "seed": 8}
    assert finish(begun, CONTOURS, moved=OTHER_POSE, **other) == ([(5, 7)], ())
    with ContourFile(begun) as file:
        assert {name: file.attributes[name] for name in other} == {
            name: getattr(make_header(10), name) for name in other
        }


ANOTHER = [
    ("strategy", {"strategy": {"raw": "voxel"}}, r'"mesh".* is now \{"raw": "voxel"'),
    ("object", {"object_name": "cube"}, "tetrahedron sha256:.* is now cube sha256:"),
    ("object", {"faces": np.zeros((1, 3), np.int32)}, "tetrahedron"),
    ("motion", {"pose": OTHER_POSE}, "10 poses"),
    ("motion", {"time": None}, "10 poses"),
    ("hand", {"hand": {"kind": "glove"}}, "palm"),
    ("hand", {"hand": {"kind": "palm", "width": 0.085, "length": 0.1, "note": "x" * 99}}, r"0\.1, "),
    ("placement", {"placement": {"scale": 0.001}}, "0.001"),
    ("palpate", {"versions": {"palpate": "9.9"}}, "0.1.0 and is now 9.9"),
    ("object motion", {"moved": None}, "and is now absent"),
]


def test_a_sealed_file_has_nothing_to_resume_and_another_rendering_is_refused_naming_the_field(path):
    write_file(path, CONTOURS, moved=OTHER_POSE)
    before = path.read_bytes()
    with ContourWriter(path, make_header(10, moved=OTHER_POSE), mode="resume") as writer:
        assert writer.missing() == []
        writer.seal()
        with pytest.raises(ContourFileError, match="sealed already"):
            write_ranges(writer, CONTOURS, [(0, 1)])
    for field, changes, shown in ANOTHER:
        with pytest.raises(ContourFileError, match=f"another rendering: {field} was .*{shown}.*overwrite") as refusal:
            ContourWriter(path, make_header(10, **{"moved": OTHER_POSE} | changes), mode="resume")
        assert str(refusal.value).count(" is now ") == 1
    assert path.read_bytes() == before
    assert list(path.parent.iterdir()) == [path]


def test_creating_refuses_what_exists_naming_both_ways_out(begun):
    for _ in range(2):  # an unfinished one, then a sealed one
        with pytest.raises(ContourFileError, match=re.escape(str(begun))) as refusal:
            ContourWriter(begun, make_header(10))
        assert all(f'mode="{mode}"' in str(refusal.value) for mode in ("resume", "overwrite"))
        finish(begun, CONTOURS, moved=OTHER_POSE)


def test_overwriting_keeps_the_old_file_until_the_new_one_is_sealed_though_another_process_resumes_it(path):
    old = make_contours(4, seed=1)
    write_file(path, old)
    for mode, part in (("overwrite", (0, 4)), ("resume", (4, 6))):
        with ContourWriter(path, make_header(10), mode=mode) as writer:
            write_ranges(writer, CONTOURS, [part])
        with ContourFile(path) as file:
            assert_same(file.contours(), old)
    assert check_file(path) == []
    assert finish(path, CONTOURS) == ([(6, 10)], ())
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize("mode", MODES)
def test_a_folder_without_a_commit_counts_as_nothing(path, mode):
    """As a writer leaves it that is killed before its first commit, and had leave to overwrite."""
    folder = path.with_name("out.h5.partial")
    folder.mkdir()
    for name in ("lock", "overwrite", "header.h5.0.tmp"):
        (folder / name).touch()
    with pytest.raises(ContourFileError, match=r"out\.h5 was never saved"):
        ContourFile(path)
    with ContourWriter(path, make_header(10), mode=mode) as writer:
        assert {own.name for own in folder.iterdir()} == {"lock"} | ({"overwrite"} if mode == "overwrite" else set())
        write_ranges(writer, CONTOURS, writer.missing(), held=True)
        writer.seal()
    assert_whole(path, CONTOURS)


def test_blocks_without_their_header_are_refused_not_removed(begun):
    folder = begun.with_name("out.h5.partial")
    (folder / "header.h5").unlink()
    for mode, message in (("resume", "has no header.*overwrite"), ("create", "holds an unfinished rendering")):
        with pytest.raises(ContourFileError, match=message):
            ContourWriter(begun, make_header(10), mode=mode)
    assert len(block_files(folder)) == 3


def test_a_second_writer_is_refused(path):
    with ContourWriter(path, make_header(10)) as writer:
        write_ranges(writer, CONTOURS, [(0, 3)])
        for mode in MODES:
            with pytest.raises(ContourFileError, match="is being written by another process"):
                ContourWriter(path, make_header(10), mode=mode)
        write_ranges(writer, CONTOURS, writer.missing())
        writer.seal()
    assert_whole(path, CONTOURS)


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize(
    "name", ["poses-000000000000.log", "poses-000000000000.rows", "poses-000000000005-000000000007-0badf00d.h5"]
)
def test_a_folder_of_an_older_palpate_is_refused_and_overwriting_begins_anew(begun, name):
    older = begun.with_name("out.h5.partial") / name
    older.write_bytes(b"older")
    for refused in (lambda: ContourWriter(begun, make_header(10), mode="resume"), lambda: ContourFile(begun)):
        with pytest.raises(ContourFileError, match=f"older palpate, which wrote {name}.*mode=.overwrite. begins anew"):
            refused()
    assert older.exists()
    with ContourWriter(begun, make_header(10), mode="overwrite") as writer:
        write_ranges(writer, CONTOURS, [(0, 10)], held=True)
        writer.seal()
    assert [own.name for own in begun.parent.iterdir()] == ["out.h5"]


def test_leftovers_of_a_kill_are_removed_and_other_peoples_files_are_not(begun):
    folder = begun.with_name("out.h5.partial")
    blocks = {file.name for _, _, file in block_files(folder)}
    for name in ("header.h5", "poses-000000000005-000000000007.h5"):
        (folder / f"{name}.0.tmp").write_bytes(b"half")
    begun.with_name("out.h5.0.tmp").write_bytes(b"half sealed")
    theirs = {"notes.txt", "poses-of-mine.h5", "poses-000000000000.csv", "mine.tmp"}
    for name in theirs:
        (folder / name).write_text("mine")
    with pytest.raises(ContourFileError, match="another rendering"):
        ContourWriter(begun, make_header(10, strategy={}), mode="resume")
    assert len(list(folder.iterdir())) == 5 + 2 + 4  # header and lock, blocks, leftovers
    with ContourWriter(begun, make_header(10, moved=OTHER_POSE), mode="resume") as writer:
        assert writer.repairs == ()
        assert {own.name for own in folder.iterdir()} == {"header.h5", "lock"} | blocks | theirs
        assert not begun.with_name("out.h5.0.tmp").exists()
        write_ranges(writer, CONTOURS, writer.missing())
        writer.seal()
    assert {own.name for own in folder.iterdir()} == theirs
    assert {own.name for own in begun.parent.iterdir()} == {"out.h5", "out.h5.partial"}


NOT_WRITTEN = [
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
]


def test_arrays_that_do_not_fit_are_refused_and_nothing_is_written(path):
    contours = make_contours(2, seed=8)
    assert len(contours["polyline_patch"]) > 1
    with ContourWriter(path, make_header(10)) as writer:
        write_ranges(writer, CONTOURS, [(0, 3)], held=True)
        for poses, change, message in NOT_WRITTEN:
            made = {name: make and make(contours.get(name)) for name, make in change.items()}
            broken = {name: rows for name, rows in (contours | made).items() if rows is not None}
            with pytest.raises(ContourFileError, match=message):
                writer.write(*poses, broken, make_metrics(contours))
        assert writer.missing() == [(3, 10)]
    for call in (lambda: write_ranges(writer, CONTOURS, [(3, 4)]), writer.seal):
        with pytest.raises(ContourFileError, match="closed"):
            call()
