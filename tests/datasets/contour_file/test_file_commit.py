"""Poses that are held until they are committed: when that is, and what leaving by whichever way costs of them."""

import tracemalloc

import h5py
import numpy as np
import pytest
from contour_cases import assert_same, cut_contours, make_contours, make_header, make_metrics, write_ranges

from palpate.datasets.contour_file import writer as writer_module
from palpate.datasets.contour_file.blocks import block_files, work_folder
from palpate.datasets.contour_file.check import check_file
from palpate.datasets.contour_file.reader import ContourFile
from palpate.datasets.contour_file.writer import ContourWriter
from palpate.datasets.errors import ContourFileError

pytestmark = pytest.mark.exhaustive


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


def assert_sealed(path, contours=CONTOURS):
    assert check_file(path) == []
    assert not work_folder(path).exists()
    with ContourFile(path) as file:
        assert_same(file.contours(), contours)


@pytest.mark.parametrize("error", [None, ValueError, KeyboardInterrupt, SystemExit, ContourFileError])
def test_leaving_by_whichever_way_commits_what_is_held(path, error):
    def leave():
        with ContourWriter(path, make_header(20)) as writer:
            write_ranges(writer, CONTOURS, [(5, 10), (12, 15), (0, 5)], held=True)
            assert writer.committed == 0
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
        write_ranges(writer, CONTOURS, writer.missing(), held=True)
        writer.seal()
        assert (writer.missing(), writer.committed) == ([], 20)
    assert_sealed(path)


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
            write_ranges(writer, CONTOURS, [poses], held=True)
            assert writer.committed == committed, second
        assert names(path) == [(0, 6), (6, 8), (8, 10), (10, 12)]
        with ContourFile(path) as file:
            assert_same(file.contours(0, 12), cut_contours(CONTOURS, 0, 12))


def test_poses_are_committed_once_they_take_too_much_memory(path, clock, monkeypatch):
    part = cut_contours(CONTOURS, 0, 10)
    size = sum(own.nbytes for own in (*part.values(), *make_metrics(part).values()))
    monkeypatch.setattr(writer_module, "COMMIT_BYTES", size)
    with ContourWriter(path, make_header(20)) as writer:
        write_ranges(writer, CONTOURS, [(0, 10)], held=True)
        assert writer.committed == 0
        write_ranges(writer, CONTOURS, [(10, 11)], held=True)
        assert writer.committed == 11
        write_ranges(writer, CONTOURS, [(11, 12)], held=True)  # it counts from nothing again
        assert writer.committed == 11


def test_arrays_may_be_used_again_and_may_lie_in_memory_as_they_like(path):
    part = {name: np.asfortranarray(own.copy()) for name, own in CONTOURS.items()}
    part["kind"] = np.repeat(part["kind"], 2)[::2]  # not contiguous
    metrics = make_metrics(CONTOURS)
    with ContourWriter(path, make_header(20)) as writer:
        writer.write(0, 20, part, metrics)
        for own in (*part.values(), *metrics.values()):
            own[...] = 0
        writer.seal()
    assert_sealed(path)


def failing_writes(monkeypatch, of):
    """Have the blocks fail whose first pose is given."""
    real = writer_module.write_block

    def write_block(folder, rows, *rest):
        if rows[0].first in of:
            raise OSError(28, "No space left on device")
        real(folder, rows, *rest)

    monkeypatch.setattr(writer_module, "write_block", write_block)


def test_a_commit_that_fails_inside_a_write_takes_nothing_of_it_and_keeps_what_was_held(path, clock, monkeypatch):
    with ContourWriter(path, make_header(20)) as writer:
        write_ranges(writer, CONTOURS, [(0, 4)], held=True)
        failing_writes(monkeypatch, {0})
        clock[0] += 11
        for _ in range(2):
            with pytest.raises(ContourFileError, match="cannot write poses 0 to 8: No space left on device"):
                write_ranges(writer, CONTOURS, [(4, 8)], held=True)
            assert (writer.missing(), writer.committed) == ([(4, 20)], 0)
        monkeypatch.setattr(writer_module, "write_block", writer_module.write_block.__closure__[1].cell_contents)
        write_ranges(writer, CONTOURS, [(4, 8)], held=True)
        assert writer.committed == 8
        write_ranges(writer, CONTOURS, [(8, 20)], held=True)
        writer.seal()
    assert_sealed(path)


def test_a_write_that_is_committed_although_another_run_is_not_is_taken(path, clock, monkeypatch):
    with ContourWriter(path, make_header(20)) as writer:
        write_ranges(writer, CONTOURS, [(10, 14)], held=True)
        with monkeypatch.context() as patch:
            failing_writes(patch, {10})
            clock[0] += 11
            write_ranges(writer, CONTOURS, [(0, 4)], held=True)
            assert (writer.committed, writer.missing()) == (4, [(4, 10), (14, 20)])
            with pytest.raises(ContourFileError, match="cannot write poses 10 to 14"):
                writer.commit()
        write_ranges(writer, CONTOURS, [(4, 10), (14, 20)], held=True)
        writer.seal()
    assert_sealed(path)


def test_leaving_on_a_full_disk_is_told_unless_something_else_was(path, monkeypatch):
    failing_writes(monkeypatch, {0})
    with (
        pytest.raises(ContourFileError, match="cannot write poses 0 to 4: No space left"),
        ContourWriter(path, make_header(20)) as writer,
    ):
        write_ranges(writer, CONTOURS, [(0, 4)], held=True)

    def stop():
        with ContourWriter(path, make_header(20), mode="resume") as writer:
            write_ranges(writer, CONTOURS, [(0, 4)], held=True)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        stop()
    with ContourWriter(path, make_header(20), mode="resume") as writer:  # and the lock is free
        assert writer.missing() == [(0, 20)]
        writer.close()
        writer.close()


def test_a_block_whose_name_was_not_synced_hides_no_later_one(path, monkeypatch):
    """Its name stands when the folder's sync fails, and what was held is committed with more poses later."""
    real = writer_module.write_block
    with ContourWriter(path, make_header(20)) as writer:
        write_ranges(writer, CONTOURS, [(0, 4)], held=True)

        def unsynced(*args):
            real(*args)
            raise OSError(5, "Input/output error")

        with monkeypatch.context() as patch:
            patch.setattr(writer_module, "write_block", unsynced)
            with pytest.raises(ContourFileError, match="Input/output"):
                writer.commit()
        assert names(path) == [(0, 4)]
        write_ranges(writer, CONTOURS, [(4, 8)])
        assert names(path) == [(0, 8)]
    with ContourWriter(path, make_header(20), mode="resume") as writer:
        assert (writer.missing(), writer.repairs) == ([(8, 20)], ())


def test_optional_fields_that_some_blocks_lack_are_absent_there(path):
    """1 for an intensity, 0 for a dwell, as docs/formats/file-format.md says."""
    full = make_contours(20, seed=1, intensity=True, dwell=True)
    with ContourWriter(path, make_header(20)) as writer:
        write_ranges(writer, CONTOURS, [(0, 5)])
        write_ranges(writer, full, [(10, 15)])
        write_ranges(writer, CONTOURS, [(5, 8)], held=True)
        write_ranges(writer, full, [(8, 10)], held=True)
        write_ranges(writer, CONTOURS, [(15, 20)])
        writer.seal()
    with ContourFile(path, verify=True) as file:
        got = file.contours()
        for first, stop, part in ((0, 8, CONTOURS), (8, 10, full), (10, 15, full), (15, 20, CONTOURS)):
            want = cut_contours(part, first, stop)
            absent = {"intensity": np.ones_like(want["points"][:, 0]), "dwell": np.zeros_like(want["points"][:, 0])}
            assert_same(cut_contours(got, first, stop), absent | want)


def test_times_stand_in_the_order_of_poses_whatever_was_committed(path):
    seconds = {0: {"raw": 1.0}, 5: {"close": 5.0}, 10: {"raw": 10.0, "sort": 2.0}, 15: {"close": 15.0}}
    with ContourWriter(path, make_header(20)) as writer:
        for first in (15, 0, 10, 5):
            part = cut_contours(CONTOURS, first, first + 5)
            writer.write(first, first + 5, part, make_metrics(part), seconds[first])
            if first in (0, 10):
                writer.commit()
        writer.seal()
    with ContourFile(path) as file:
        timing = file.timing()
    assert timing.first.tolist() == [0, 5, 10, 15]
    assert timing.stop.tolist() == [5, 10, 15, 20]
    assert timing.stages == ["raw", "close", "sort"]
    none = np.nan
    want = [[1, none, none], [none, 5, none], [10, none, 2], [none, 15, none]]
    np.testing.assert_array_equal(timing.seconds, want)


def long_contours(pose_count, points):
    """One open polyline a pose."""
    rng = np.random.default_rng(0)
    return {
        "points": rng.random((pose_count * points, 3), np.float32),
        "kind": np.zeros(pose_count * points, np.uint8),
        "polyline_start": np.arange(pose_count + 1) * points,
        "polyline_patch": np.zeros(pose_count, np.int32),
        "polyline_closed": np.zeros(pose_count, np.uint8),
        "pose_start": np.arange(pose_count + 1),
    }


def test_sealing_what_is_committed_takes_memory_of_a_million_points(path):
    points, part = 4000, 1000
    contours = long_contours(part, points)
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
    with h5py.File(path) as file:
        assert file["/contours/points"].shape == (2 * part * points, 3)
