"""Poses that are held until they are committed: when that is, and what leaving by whichever way costs of them."""

import tracemalloc

import numpy as np
import pytest
from contour_cases import (
    assert_same,
    assert_whole,
    cut_contours,
    finish,
    make_contours,
    make_header,
    make_metrics,
    write_ranges,
)

from palpate.datasets.contour_file import writer as writer_module
from palpate.datasets.contour_file.blocks import block_files, work_folder
from palpate.datasets.contour_file.reader import ContourFile
from palpate.datasets.contour_file.writer import ContourWriter
from palpate.datasets.errors import ContourFileError


@pytest.fixture
def path(tmp_path):
    return tmp_path / "out.h5"


@pytest.fixture
def clock(monkeypatch):
    """A clock that the test moves [s]."""
    now = [1000.0]
    monkeypatch.setattr(writer_module.time, "monotonic", lambda: now[0])
    return now


CONTOURS = make_contours(20, seed=1)


def names(path):
    return [(first, stop) for first, stop, _ in block_files(work_folder(path))]


def hold(writer, *ranges):
    write_ranges(writer, CONTOURS, ranges, held=True)


@pytest.mark.parametrize("error", [None, KeyboardInterrupt])
def test_leaving_by_whichever_way_commits_what_is_held(path, error):
    def leave():
        with ContourWriter(path, make_header(20)) as writer:
            hold(writer, (5, 10), (12, 15), (0, 5))
            assert (writer.committed, names(path)) == (0, [])
            if error is not None:
                raise error

    if error is None:
        leave()
    else:
        with pytest.raises(error):
            leave()
    assert names(path) == [(0, 10), (12, 15)]  # a block of each run of consecutive poses
    with ContourWriter(path, make_header(20), mode="resume") as writer:
        assert (writer.missing(), writer.committed, writer.repairs) == ([(10, 12), (15, 20)], 13, ())
        hold(writer, *writer.missing())
        writer.seal()
        assert (writer.missing(), writer.committed) == ([], 20)
    assert_whole(path, CONTOURS)


@pytest.mark.exhaustive
def test_poses_are_committed_once_ten_seconds_have_passed(path, clock):
    with ContourWriter(path, make_header(20)) as writer:
        for second, poses, committed in (
            (0.0, (0, 2), 0),
            (10.0, (2, 4), 0),
            (10.5, (4, 6), 6),
            (20.0, (6, 8), 6),
            (20.6, (10, 12), 10),
            (40.0, (8, 10), 12),
        ):
            clock[0] = 1000.0 + second
            hold(writer, poses)
            assert writer.committed == committed, second
        assert names(path) == [(0, 6), (6, 8), (8, 10), (10, 12)]
        with ContourFile(path) as file:
            assert_same(file.contours(0, 12), cut_contours(CONTOURS, 0, 12))


@pytest.mark.exhaustive
def test_poses_are_committed_once_they_take_too_much_memory(path, monkeypatch):
    part = cut_contours(CONTOURS, 0, 10)
    size = sum(own.nbytes for own in (*part.values(), *make_metrics(part).values()))
    monkeypatch.setattr(writer_module, "COMMIT_BYTES", size)
    with ContourWriter(path, make_header(20)) as writer:
        for poses, committed in (((0, 10), 0), ((10, 11), 11), ((11, 12), 11)):  # it counts from nothing again
            hold(writer, poses)
            assert writer.committed == committed


def test_arrays_may_be_used_again_and_may_lie_in_memory_as_they_like(path):
    part = {name: np.asfortranarray(own.copy()) for name, own in CONTOURS.items()}
    part["kind"] = np.repeat(part["kind"], 2)[::2]  # not contiguous
    metrics = make_metrics(CONTOURS)
    with ContourWriter(path, make_header(20)) as writer:
        writer.write(0, 20, part, metrics)
        for own in (*part.values(), *metrics.values()):
            own[...] = 0
        writer.seal()
    assert_whole(path, CONTOURS)


@pytest.fixture
def failing(monkeypatch):
    """Whatever stands in it says which blocks fail, by their first poses."""
    of, real = set(), writer_module.write_block

    def write_block(folder, rows, *rest):
        if rows[0].first in of:
            raise OSError(28, "No space left on device")
        real(folder, rows, *rest)

    monkeypatch.setattr(writer_module, "write_block", write_block)
    return of


def test_a_commit_that_fails_inside_a_write_keeps_all_that_is_held_and_the_next_write_tries_again(path, clock, failing):
    with ContourWriter(path, make_header(20)) as writer:
        failing.add(10)
        hold(writer, (10, 14))
        clock[0] += 11
        with pytest.raises(ContourFileError, match="cannot write poses 10 to 14: No space left on device"):
            hold(writer, (0, 4))
        assert (writer.committed, writer.missing(), names(path)) == (4, [(4, 10), (14, 20)], [(0, 4)])
        with pytest.raises(ContourFileError, match="cannot write poses 10 to 16"):
            hold(writer, (14, 16))
        with pytest.raises(ContourFileError, match="overlap poses that were written already"):
            hold(writer, (14, 16))
        failing.clear()
        hold(writer, (4, 8))
        assert (writer.committed, names(path)) == (14, [(0, 4), (4, 8), (10, 16)])
        hold(writer, (8, 10), (16, 20))
        writer.seal()
    assert_whole(path, CONTOURS)


@pytest.mark.exhaustive
def test_leaving_on_a_full_disk_is_told_unless_something_else_was_and_lets_the_next_writer_in(path, failing):
    failing.add(0)

    def leave(error=None):
        with ContourWriter(path, make_header(20), mode="resume") as writer:
            hold(writer, (0, 4))
            if error:
                raise error

    with pytest.raises(ContourFileError, match="cannot write poses 0 to 4: No space left"):
        leave()
    with pytest.raises(ZeroDivisionError):
        leave(ZeroDivisionError)
    failing.clear()
    assert finish(path, CONTOURS) == ([(0, 20)], ())


@pytest.mark.exhaustive
def test_a_block_whose_name_was_not_synced_hides_no_later_one(path, monkeypatch):
    """Its name stands when the folder's sync fails, and what was held is committed with more poses later."""
    real = writer_module.write_block

    def unsynced(*args):
        real(*args)
        raise OSError(5, "Input/output error")

    with ContourWriter(path, make_header(20)) as writer:
        hold(writer, (0, 4))
        with monkeypatch.context() as patch:
            patch.setattr(writer_module, "write_block", unsynced)
            with pytest.raises(ContourFileError, match="Input/output"):
                writer.commit()
        assert names(path) == [(0, 4)]
        write_ranges(writer, CONTOURS, [(4, 8)])
        assert names(path) == [(0, 8)]
    assert finish(path, CONTOURS) == ([(8, 20)], ())


@pytest.mark.exhaustive
def test_sealing_what_is_committed_takes_memory_of_a_million_points(path):
    points, part = 4000, 1000
    contours = {
        "points": np.random.default_rng(0).random((part * points, 3), np.float32),
        "kind": np.zeros(part * points, np.uint8),
        "polyline_start": np.arange(part + 1) * points,
        "polyline_patch": np.zeros(part, np.int32),
        "polyline_closed": np.zeros(part, np.uint8),
        "pose_start": np.arange(part + 1),
    }
    metrics = {name: np.zeros(part, np.float32) for name in make_metrics(make_contours(1))}
    metrics["polylines"] = np.ones(part, np.int32)
    with ContourWriter(path, make_header(2 * part)) as writer:
        for first in (0, part):
            writer.write(first, first + part, contours, metrics)
            writer.commit()
        tracemalloc.start()
        writer.seal()
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    million = (1 << 20) * 13  # bytes of points and kinds
    assert most < 4 * million < 2 * part * points * 13
    with ContourFile(path) as file:
        assert file.point_count == 2 * part * points
