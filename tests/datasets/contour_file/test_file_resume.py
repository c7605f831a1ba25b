"""Who may write a contour file: modes, recipes, locks, and parts that are not to be trusted."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from contour_cases import (
    Killed,
    assert_same,
    killed_at,
    make_contours,
    make_header,
    make_metrics,
    small_chunks,
    write_file,
    write_ranges,
)

from palpate.datasets.contour_file.check import check_file
from palpate.datasets.contour_file.parts import part_logs, read_part
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
        assert part_logs(begun.with_name("out.h5.partial")) == []


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


@pytest.mark.exhaustive(but="1-")
@pytest.mark.parametrize("where", ["first rows", "last rows", "record", "tails", "prefix"])
@pytest.mark.parametrize("commit", [0, 1, 2])
def test_damage_drops_the_poses_from_there_on_reports_it_and_they_are_rendered_again(path, long, commit, where):
    log = part_logs(path.with_name("out.h5.partial"))[0]
    part = read_part(log)
    if where == "last rows":
        flip(part.path, part.commits[commit].rows_end - 1)
    elif where == "first rows":
        flip(part.path, part.commits[commit - 1].rows_end if commit else part.rows.addresses[0][0])
    elif where == "tails":
        flip(log, part.commits[commit].log_end - 3)
    else:
        begin = part.commits[commit - 1].log_end if commit else part.begun_end
        flip(log, begin + (2 if where == "prefix" else 40))
    missing, repairs = resume_long(path, long)
    assert missing == [(10 * commit, 40)]
    assert len(repairs) == 1
    assert f"{log.name} is truncated or damaged after pose {10 * commit}" in repairs[0]


def test_motion_and_mesh_of_a_part_that_were_damaged_are_written_again(path, long):
    log = part_logs(path.with_name("out.h5.partial"))[0]
    with ContourFile(path) as file:
        pose = file.motion()["pose"][:7].tobytes()  # a chunk
    flip(log.with_suffix(".rows"), log.with_suffix(".rows").read_bytes().index(pose) + 100)
    assert resume_long(path, long) == ([(30, 40)], ())


def test_rows_cut_short_are_dropped_reported_and_rendered_again(path, long):
    rows = read_part(part_logs(path.with_name("out.h5.partial"))[0])
    with rows.path.open("r+b") as file:
        file.truncate((rows.commits[0].rows_end + rows.commits[1].rows_end) // 2)
    missing, repairs = resume_long(path, long)
    assert missing == [(10, 40)]
    assert "is truncated or damaged" in repairs[0]


def test_a_record_cut_short_was_never_reported_done(path, long):
    log = part_logs(path.with_name("out.h5.partial"))[0]
    with log.open("r+b") as file:
        file.truncate(log.stat().st_size - 3)
    assert resume_long(path, long) == ([(20, 40)], ())


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("content", [b"", b"not a log", bytes(500)])
def test_a_log_that_is_none_is_dropped_and_reported(path, long, content):
    log = part_logs(path.with_name("out.h5.partial"))[0]
    log.write_bytes(content)
    missing, repairs = resume_long(path, long)
    assert missing == [(0, 40)]
    assert f"{log.name} is truncated or damaged" in repairs[0]


@pytest.mark.exhaustive
def test_a_part_of_another_rendering_is_dropped_at_resume_and_refused_by_the_reader(begun, contours, tmp_path):
    with ContourWriter(tmp_path / "b.h5", make_header(10, strategy={})) as writer:
        write_ranges(writer, make_contours(10, seed=3), [(5, 7)])
    foreign = part_logs(tmp_path / "b.h5.partial")[0]
    for path in (foreign, foreign.with_suffix(".rows")):
        shutil.copy(path, begun.with_name("out.h5.partial"))
    with ContourFile(begun) as file, pytest.raises(ContourFileError, match="of another rendering"):
        file.contours(4, 8)
    with ContourWriter(begun, make_header(10), mode="resume") as writer:
        assert writer.missing() == [(5, 7)]
        assert "is of another rendering" in writer.repairs[0]
    resume_and_seal(begun, contours)


def test_shards_of_an_older_palpate_are_dropped_and_reported(begun, contours):
    shard = begun.with_name("out.h5.partial") / "poses-000000000005-000000000007-0badf00d.h5"
    shard.write_bytes(b"HDF5")
    with ContourWriter(begun, make_header(10), mode="resume") as writer:
        assert writer.missing() == [(5, 7)]
        assert writer.repairs == (f"{shard.name} is of an older palpate: dropped, its poses are rendered again",)
    resume_and_seal(begun, contours)


def test_overlapping_parts_are_dropped_and_reported(path, begun, contours, tmp_path):
    with ContourWriter(tmp_path / "b.h5", make_header(10)) as writer:
        write_ranges(writer, contours, [(4, 7)])
    for file in (tmp_path / "b.h5.partial").glob("poses-*"):
        shutil.copy(file, begun.with_name("out.h5.partial"))
    with ContourWriter(begun, make_header(10), mode="resume") as writer:
        assert writer.missing() == [(5, 7)]
        assert "overlaps others" in writer.repairs[0]
    resume_and_seal(begun, contours)


def test_parts_without_their_header_are_refused_not_removed(begun):
    folder = begun.with_name("out.h5.partial")
    (folder / "header.h5").unlink()
    with pytest.raises(ContourFileError, match="has no header"):
        ContourWriter(begun, make_header(10), mode="resume")
    assert len(part_logs(folder)) == 2


@pytest.mark.exhaustive
def test_leftovers_of_a_kill_are_removed_and_other_peoples_files_are_not(begun, contours):
    folder = begun.with_name("out.h5.partial")
    with pytest.raises(Killed), ContourWriter(begun, make_header(10), mode="overwrite") as writer, killed_at(2):
        write_ranges(writer, contours, [(5, 7)])
    assert list(folder.glob("*.tmp"))
    assert list(folder.glob("*.rows"))
    (folder / "notes.txt").write_text("mine")
    with ContourWriter(begun, make_header(10), mode="resume"):
        assert sorted(path.name for path in folder.iterdir()) == ["header.h5", "lock", "notes.txt", "overwrite"]
    resume_and_seal(begun, contours)
    assert [path.name for path in folder.iterdir()] == ["notes.txt"]


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
        ((2, 4), {}, "overlap poses that are done"),
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
