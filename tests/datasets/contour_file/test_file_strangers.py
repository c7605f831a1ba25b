"""What others put in a writer's way: blocks that lie with right digests, pipes, links, and its own name taken."""

import errno
import os
import re

import h5py
import numpy as np
import pytest
from contour_cases import assert_same, assert_whole, finish, make_contours, make_header, redigest, write_ranges

from palpate.datasets.contour_file.check import check_file
from palpate.datasets.contour_file.reader import ContourFile
from palpate.datasets.contour_file.writer import ContourWriter
from palpate.datasets.errors import ContourFileError

CONTOURS = make_contours(10)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "out.h5"


@pytest.fixture
def begun(path):
    with ContourWriter(path, make_header(10)) as writer:
        write_ranges(writer, CONTOURS, [(0, 4), (4, 6)])
    return path


def block_of(path, first=0, stop=4):
    return path.with_name(path.name + ".partial") / f"poses-{first:012d}-{stop:012d}.h5"


def lie(change):
    """Change a block, and give it the digests of what it holds now."""

    def put(path):
        with h5py.File(block_of(path), "r+") as file:
            change(file)
        redigest(block_of(path))

    return put


def retyped(name, rows):
    def change(file):
        attributes = dict(file[name].attrs)
        del file[name]
        file.create_dataset(name, data=rows, fletcher32=True).attrs.update(attributes)

    return lie(change)


def renamed(first, stop, of=(0, 4)):
    return lambda path: block_of(path, *of).rename(block_of(path, first, stop))


def replaced(make):
    def put(path):
        block_of(path).unlink()
        make(block_of(path))

    return put


def foreign(first, stop, **changes):
    """A block that another rendering has committed."""

    def put(path):
        with ContourWriter(path.with_name("b.h5"), make_header(10, **changes)) as writer:
            write_ranges(writer, make_contours(10, seed=3), [(first, stop)])
        block_of(path.with_name("b.h5"), first, stop).rename(block_of(path, first, stop))

    return put


NO_BLOCKS = {
    "no points": (lie(lambda file: file.pop("/contours/points")), "points is missing"),
    "no times": (lie(lambda file: file.pop("/timing/seconds")), "seconds is missing"),
    "points that no pose has": (retyped("/contours/points", np.zeros((99, 3), np.float32)), "points? "),
    "more metrics than poses": (retyped("/metrics/length", np.zeros(5, np.float32)), "length"),
    "offsets that fall": (retyped("/contours/pose_start", np.array([0, 9, 1, 0, 0])), "offsets"),
    "times without stages": (retyped("/timing/seconds", np.zeros((1, 4))), "stages"),
    "fewer times than chunks": (retyped("/timing/stop", np.zeros(3, np.int64)), "chunk rows"),
    "no recipe": (lie(lambda file: file.attrs.pop("recipe")), "recipe"),
    "another recipe": (lie(lambda file: file.attrs.modify("recipe", b"0" * 64)), "of another rendering"),
    "a name of too many poses": (renamed(0, 5), "4 poses?, expected 5|has 4 pose"),
    "a name of no pose": (renamed(0, 0), "names no pose"),
    "a name that falls": (renamed(4, 0), "names no pose"),
    "a pipe": (replaced(os.mkfifo), "pipe"),
    "nothing": (replaced(lambda block: block.touch()), "empty"),
    "6 GB of nothing": (replaced(lambda block: (block.touch(), os.truncate(block, 6 << 30))), "not an HDF5 file"),
    "a link to nowhere": (replaced(lambda block: block.symlink_to("nowhere")), "does not exist"),
    "one of another rendering": (foreign(7, 9, strategy={}), "of another rendering"),
    "one that overlaps": (foreign(5, 7), "overlaps the poses before 6"),
}


@pytest.mark.exhaustive(but="times without")
@pytest.mark.parametrize("name", NO_BLOCKS)
def test_what_is_no_block_is_dropped_alone_and_its_poses_are_rendered_again(begun, name):
    put, told = NO_BLOCKS[name]
    put(begun)
    assert len(check_file(begun)) > 1
    gone = not name.startswith("one ")  # else it lies beside the two that are right
    with ContourFile(begun) as file, pytest.raises(ContourFileError, match=r"not done|damaged|poses|points"):
        file.contours(0, 10)
    missing, (repair,) = finish(begun, CONTOURS)
    assert missing == ([(0, 4), (6, 10)] if gone else [(6, 10)])
    assert re.search(told, repair), repair


def test_a_block_that_the_system_does_not_let_be_read_is_not_dropped(begun, monkeypatch):
    """As of a process with too many open files (POSIX: EMFILE)."""
    real = os.open

    def failing(path, *args):
        if os.fspath(path) == str(block_of(begun)):
            raise OSError(errno.EMFILE, os.strerror(errno.EMFILE), path)
        return real(path, *args)

    with monkeypatch.context() as patch:
        patch.setattr(os, "open", failing)
        with pytest.raises(ContourFileError, match="Too many open files"):
            ContourWriter(begun, make_header(10), mode="resume")
    assert finish(begun, CONTOURS) == ([(6, 10)], ())


@pytest.mark.exhaustive
def test_many_blocks_are_read_and_sealed_one_at_a_time(path):
    with ContourWriter(path, make_header(10)) as writer:
        write_ranges(writer, CONTOURS, [(k, k + 2) for k in range(0, 10, 2)])
        before = len(os.listdir("/proc/self/fd"))
        with ContourFile(path) as file:
            assert len(os.listdir("/proc/self/fd")) - before == 1  # the header
            assert_same(file.contours(), CONTOURS)
            assert len(os.listdir("/proc/self/fd")) - before == 2  # and a block
        assert len(os.listdir("/proc/self/fd")) == before
        writer.seal()
    assert_whole(path, CONTOURS)


@pytest.mark.exhaustive
@pytest.mark.parametrize("at", [1, 2, 3])
def test_a_file_that_is_sealed_while_it_is_opened_is_read_as_sealed(path, monkeypatch, at):
    """Blocks go one by one, the header last."""
    with ContourWriter(path, make_header(10)) as writer:
        write_ranges(writer, CONTOURS, [(0, 4), (4, 10)])
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
            assert_same(file.contours(), CONTOURS)


def test_a_file_that_is_sealed_while_it_is_read_must_be_opened_again(path):
    with ContourWriter(path, make_header(10)) as writer:
        write_ranges(writer, CONTOURS, [(0, 4), (4, 10)])
        with ContourFile(path) as file:
            writer.seal()
            with pytest.raises(ContourFileError, match="was finished while it was read: open it again"):
                file.contours()
        assert_whole(path, CONTOURS)


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("mode", ["create", "resume"])
def test_a_file_that_appears_meanwhile_is_not_replaced(path, mode):
    with ContourWriter(path, make_header(10), mode=mode) as writer:
        write_ranges(writer, CONTOURS, [(0, 10)])
        path.write_text("somebody's")
        with pytest.raises(
            ContourFileError, match=r"out.h5 is not of the unfinished rendering .*move it away.*mode=.resume"
        ):
            writer.seal()
    with pytest.raises(ContourFileError, match="is not of the unfinished rendering"):
        ContourWriter(path, make_header(10), mode="resume")
    assert path.read_text() == "somebody's"
    path.rename(path.with_name("theirs"))
    assert finish(path, CONTOURS) == ([], ())


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("mode", ["create", "resume", "overwrite"])
def test_a_work_folder_that_is_a_link_is_refused_and_what_lies_there_stays(path, mode):
    theirs = path.with_name("documents")
    theirs.mkdir()
    for name in ("a.tmp", "poses-000000000000.log", "thesis.txt"):
        (theirs / name).write_text(name)
    path.with_name("out.h5.partial").symlink_to(theirs)
    with pytest.raises(ContourFileError, match=r"out.h5.partial is no folder of its own, but a file or a link"):
        ContourWriter(path, make_header(10), mode=mode)
    assert sorted(own.read_text() for own in theirs.iterdir()) == ["a.tmp", "poses-000000000000.log", "thesis.txt"]
