"""A writer that is used again after a failure, or whose files somebody has touched, destroys nothing."""

import os

import pytest
from contour_cases import assert_same, make_contours, make_header, small_chunks, write_ranges

from palpate.datasets.contour_file import writer as writer_module
from palpate.datasets.contour_file.check import check_file
from palpate.datasets.contour_file.parts import part_logs, work_folder
from palpate.datasets.contour_file.reader import ContourFile
from palpate.datasets.contour_file.writer import ContourWriter
from palpate.datasets.errors import ContourFileError

RANGES = [(0, 3), (3, 4), (4, 9)]


@pytest.fixture(params=[7, 8192], ids=["chunks", "tails"], autouse=True)
def chunk_rows(request):
    """Rows that are mostly in chunks, and rows that are all in logs."""
    with small_chunks(request.param):
        yield request.param


def rows_of(path):
    """The file of rows of the only part."""
    return part_logs(work_folder(path))[0].with_suffix(".rows")


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("ranges", [RANGES, [(4, 9), (0, 4)]], ids=["one part", "copied"])
def test_sealing_again_after_the_folder_was_not_synced_keeps_the_file(tmp_path, monkeypatch, ranges):
    """The first sync after the new name stands fails, as on a disk that reports an error late."""
    path, contours = tmp_path / "out.h5", make_contours(9)
    failed = []

    def sync(folder):
        if folder == tmp_path and path.exists() and not failed:
            failed.append(folder)
            raise OSError(5, "Input/output error")

    with ContourWriter(path, make_header(9)) as writer:
        write_ranges(writer, contours, ranges)
        monkeypatch.setattr(writer_module, "sync", sync)
        with pytest.raises(ContourFileError, match="cannot seal: Input/output error"):
            writer.seal()
        writer.seal()
    assert failed
    assert check_file(path) == []
    with ContourFile(path) as file:
        assert_same(file.contours(), contours)


@pytest.mark.parametrize("step", ["write", "seal"])
def test_rows_that_somebody_removed_never_come_back_as_zeros(tmp_path, step):
    path, contours = tmp_path / "out.h5", make_contours(9)
    with ContourWriter(path, make_header(9)) as writer:
        write_ranges(writer, contours, RANGES[:2] if step == "write" else RANGES)
        rows = rows_of(path)
        rows.unlink()
        with pytest.raises(ContourFileError):
            writer.seal() if step == "seal" else rewritten(writer, contours)
        assert not rows.exists() or rows.stat().st_size == 0
    assert not path.exists()


@pytest.mark.parametrize("step", ["write", "seal"])
def test_rows_that_somebody_cut_off_are_named_with_both_sizes(tmp_path, step, chunk_rows):
    path, contours = tmp_path / "out.h5", make_contours(9)
    with ContourWriter(path, make_header(9)) as writer:
        write_ranges(writer, contours, RANGES[:2] if step == "write" else RANGES)
        rows = rows_of(path)
        size = rows.stat().st_size
        os.truncate(rows, size - 1)
        with pytest.raises(ContourFileError, match=rf"{size - 1} bytes, of {size} that were written|truncated"):
            writer.seal() if step == "seal" else rewritten(writer, contours)
        assert rows.stat().st_size == size - 1
    assert not path.exists()


def rewritten(writer, contours):
    """The next range, and then all: what is short in the log alone shows when the file is sealed."""
    write_ranges(writer, contours, RANGES[2:])
    writer.seal()
