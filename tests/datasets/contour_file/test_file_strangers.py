"""What others put in a writer's way: blocks that lie with right digests, pipes, links, and its own name taken."""

import errno
import json
import os
import re
from itertools import islice

import h5py
import numpy as np
import pytest
from contour_cases import assert_same, make_contours, make_header, make_metrics, redigest, write_file, write_ranges

from palpate.datasets.contour_file import blocks
from palpate.datasets.contour_file.check import check_file
from palpate.datasets.contour_file.reader import ContourFile
from palpate.datasets.contour_file.writer import ContourWriter
from palpate.datasets.errors import ContourFileError

pytestmark = pytest.mark.exhaustive


@pytest.fixture
def begun(tmp_path):
    with ContourWriter(tmp_path / "out.h5", make_header(10)) as writer:
        write_ranges(writer, make_contours(10), [(0, 4), (4, 6)])
    return tmp_path / "out.h5"


def block_of(path):
    return path.with_name("out.h5.partial") / "poses-000000000000-000000000004.h5"


def drop(file, name):
    del file[name]


def retype(file, name, rows):
    attributes = dict(file[name].attrs)
    del file[name]
    file.create_dataset(name, data=rows, fletcher32=True).attrs.update(attributes)


LIES = {
    "no points": lambda file: drop(file, "/contours/points"),
    "no times": lambda file: drop(file, "/timing/seconds"),
    "points that no pose has": lambda file: retype(file, "/contours/points", np.zeros((99, 3), np.float32)),
    "more metrics than poses": lambda file: retype(file, "/metrics/length", np.zeros(5, np.float32)),
    "offsets that fall": lambda file: file["/contours/pose_start"].write_direct(np.array([0, 9, 1, 0, 0])),
    "times without stages": lambda file: retype(file, "/timing/seconds", np.zeros((1, 4))),
    "fewer times than chunks": lambda file: retype(file, "/timing/stop", np.zeros(3, np.int64)),
    "no recipe": lambda file: file.attrs.pop("recipe"),
    "another recipe": lambda file: file.attrs.modify("recipe", b"0" * 64),
}


@pytest.mark.parametrize("lie", LIES)
def test_a_block_that_lies_with_right_digests_is_dropped_alone(begun, lie):
    contours = make_contours(10)
    with h5py.File(block_of(begun), "r+") as file:
        LIES[lie](file)
    redigest(block_of(begun))
    assert len(check_file(begun)) > 1
    with ContourWriter(begun, make_header(10), mode="resume") as writer:
        assert writer.missing() == [(0, 4), (6, 10)]
        assert len(writer.repairs) == 1
        assert block_of(begun).name in writer.repairs[0]
        write_ranges(writer, contours, writer.missing())
        writer.seal()
    assert check_file(begun) == []
    with ContourFile(begun) as file:
        assert_same(file.contours(), contours)


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("poses-000000000000-000000000005.h5", "4 pose|4 poses, expected 5"),
        ("poses-000000000000-000000000000.h5", "names no pose"),
        ("poses-000000000004-000000000000.h5", "names no pose"),
        ("poses-000000000003-000000000007.h5", "overlaps the poses before 6"),
    ],
)
def test_a_block_whose_name_lies_is_dropped(begun, name, told):
    block_of(begun).rename(block_of(begun).with_name(name))
    if "overlaps" in told:  # the other one, which comes later
        block_of(begun).with_name(name).rename(block_of(begun))
        (block_of(begun).with_name("poses-000000000004-000000000006.h5")).rename(block_of(begun).with_name(name))
        told = "overlaps the poses before 4"
    with ContourWriter(begun, make_header(10), mode="resume") as writer:
        assert writer.missing() == ([(4, 10)] if "overlaps" in told else [(0, 4), (6, 10)])
        assert len(writer.repairs) == 1
        assert re.search(told, writer.repairs[0])
    assert not block_of(begun).with_name(name).exists()


def test_a_time_that_is_no_number_loses_no_poses(tmp_path):
    path, contours = tmp_path / "out.h5", make_contours(4)
    with ContourWriter(path, make_header(4)) as writer:
        writer.write(0, 4, contours, make_metrics(contours), {"trace": float("nan")})
    with ContourWriter(path, make_header(4), mode="resume") as writer:
        assert (writer.missing(), writer.repairs) == ([], ())
        writer.seal()
    with ContourFile(path, verify=True) as file:
        assert np.isnan(file.timing().seconds).all()


@pytest.mark.parametrize("content", ["pipe", "empty", "6 GB of nothing", "link to nowhere"])
def test_what_is_no_file_in_place_of_a_block_is_dropped_unread(begun, content):
    path = block_of(begun)
    path.unlink()
    if content == "pipe":
        os.mkfifo(path)
    elif content == "link to nowhere":
        path.symlink_to("nowhere")
    else:
        path.touch()
        os.truncate(path, 6 << 30 if content == "6 GB of nothing" else 0)
    assert [problem for problem in check_file(begun) if path.name in problem]
    with ContourWriter(begun, make_header(10), mode="resume") as writer:
        assert writer.missing() == [(0, 4), (6, 10)]
        assert path.name in writer.repairs[0]
    assert not path.is_symlink()
    assert not path.exists()


def test_a_block_that_is_a_link_is_read_and_what_it_leads_to_stays(begun, tmp_path):
    theirs = block_of(begun).rename(tmp_path / "theirs.h5")
    block_of(begun).symlink_to(theirs)
    before = theirs.read_bytes()
    with ContourWriter(begun, make_header(10), mode="resume") as writer:
        write_ranges(writer, make_contours(10), writer.missing())
        writer.seal()
    assert theirs.read_bytes() == before
    with ContourFile(begun, verify=True) as file:
        assert_same(file.contours(), make_contours(10))


def test_a_block_that_the_system_does_not_let_be_read_is_not_dropped(begun, monkeypatch):
    """As of a process with too many open files (POSIX: EMFILE)."""
    real = os.open

    def failing(path, *args):
        if os.fspath(path) == str(block_of(begun)):
            raise OSError(errno.EMFILE, os.strerror(errno.EMFILE), path)
        return real(path, *args)

    monkeypatch.setattr(os, "open", failing)
    with pytest.raises(ContourFileError, match="Too many open files"):
        ContourWriter(begun, make_header(10), mode="resume")
    monkeypatch.undo()
    with ContourWriter(begun, make_header(10), mode="resume") as writer:
        assert (writer.missing(), writer.repairs) == ([(6, 10)], ())


def test_more_blocks_than_may_be_open_at_once_are_read_and_sealed(tmp_path):
    path, contours = tmp_path / "out.h5", make_contours(20, dwell=True)
    with pytest.MonkeyPatch.context() as patch, ContourWriter(path, make_header(20)) as writer:
        patch.setattr(blocks, "_OPEN_MOST", 2)
        write_ranges(writer, contours, [(k, k + 2) for k in range(0, 20, 2)])
        before = len(os.listdir("/proc/self/fd"))
        with ContourFile(path) as file:
            assert len(os.listdir("/proc/self/fd")) - before == 3  # the header, and two blocks
            assert_same(file.contours(), contours)
            assert_same(file.metrics(), make_metrics(contours))
        assert len(os.listdir("/proc/self/fd")) == before
        assert len(check_file(path)) == 1
        writer.seal()
    assert check_file(path) == []
    with ContourFile(path) as file:
        assert_same(file.contours(), contours)


@pytest.mark.parametrize("at", [2, 3, 4])
def test_a_file_that_is_sealed_while_it_is_opened_is_read_as_sealed(tmp_path, monkeypatch, at):
    """Blocks go one by one, the header last."""
    path, contours = tmp_path / "out.h5", make_contours(10)
    with ContourWriter(path, make_header(10)) as writer:
        write_ranges(writer, contours, [(0, 4), (4, 10)])
        real, calls = os.open, 0

        def sealing(*args):
            nonlocal calls
            calls += 1
            if calls == at:
                monkeypatch.undo()
                writer.seal()
            return real(*args)

        monkeypatch.setattr(os, "open", sealing)
        with ContourFile(path) as file:
            assert_same(file.contours(), contours)


@pytest.mark.parametrize("mode", ["create", "resume"])
def test_a_file_that_appears_meanwhile_is_not_replaced(tmp_path, mode):
    path, contours = tmp_path / "out.h5", make_contours(10)
    with ContourWriter(path, make_header(10), mode=mode) as writer:
        write_ranges(writer, contours, [(0, 10)])
        path.write_text("somebody's")
        with pytest.raises(
            ContourFileError, match=r"out.h5 is not of the unfinished rendering .*move it away.*mode=.resume"
        ):
            writer.seal()
        assert path.read_text() == "somebody's"
    with pytest.raises(ContourFileError, match="is not of the unfinished rendering"):
        ContourWriter(path, make_header(10), mode="resume")
    path.rename(tmp_path / "theirs")
    with ContourWriter(path, make_header(10), mode="resume") as writer:
        assert writer.missing() == []
        writer.seal()
    with ContourFile(path, verify=True) as file:
        assert_same(file.contours(), contours)


def test_permission_to_overwrite_lasts_until_the_file_is_sealed(tmp_path):
    path, contours = tmp_path / "out.h5", make_contours(10)
    write_file(path, make_contours(4))
    with ContourWriter(path, make_header(10), mode="overwrite") as writer:
        write_ranges(writer, contours, [(0, 4)])
    with ContourWriter(path, make_header(10), mode="resume") as writer:
        write_ranges(writer, contours, [(4, 10)])
        writer.seal()
    with ContourFile(path) as file:
        assert_same(file.contours(), contours)
    assert sorted(own.name for own in tmp_path.iterdir()) == ["out.h5"]


@pytest.mark.parametrize("mode", ["create", "resume", "overwrite"])
def test_a_work_folder_that_is_a_link_is_refused_and_what_lies_there_stays(tmp_path, mode):
    theirs = tmp_path / "documents"
    theirs.mkdir()
    for name in ("a.tmp", "poses-000000000000.log", "thesis.txt"):
        (theirs / name).write_text(name)
    (tmp_path / "out.h5.partial").symlink_to(theirs)
    with pytest.raises(ContourFileError, match=r"out.h5.partial is no folder of its own, but a file or a link"):
        ContourWriter(tmp_path / "out.h5", make_header(10), mode=mode)
    assert {own.name: own.read_text() for own in theirs.iterdir()} == {own.name: own.name for own in theirs.iterdir()}
    assert len(list(theirs.iterdir())) == 3


def test_nothing_is_removed_from_a_folder_that_resuming_refuses(begun):
    mine = block_of(begun).with_name("mine.tmp")
    mine.write_text("mine")
    with pytest.raises(ContourFileError, match="another rendering"):
        ContourWriter(begun, make_header(10, strategy={}), mode="resume")
    assert mine.read_text() == "mine"


def changed_digests(path, change):
    with h5py.File(path, "r+") as file:
        told = json.loads(file.attrs["digests"])
        change(told)
        text = json.dumps(told).encode()
        file.attrs["digests"] = np.array(text, h5py.string_dtype("utf-8", len(text)))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda told: told["datasets"].pop("/contours/points"), "/contours/points.* no digest"),
        (lambda told: told["attributes"].clear(), "attribute .* of / has no digest"),
        (lambda told: told["attributes"]["/"].pop("seed"), "attribute seed of / has no digest"),
        (lambda told: told["datasets"].update({"/contours": [0, ""]}), "/contours"),
    ],
)
def test_what_digests_leave_out_is_no_whole_file(tmp_path, change, message):
    path = tmp_path / "out.h5"
    write_file(path, make_contours(10), seed=3)
    redigest(path)
    assert check_file(path) == []
    changed_digests(path, change)
    with pytest.raises(ContourFileError, match=message):
        ContourFile(path, verify=True)
    assert list(islice((problem for problem in check_file(path) if "digest" in problem), 1))
