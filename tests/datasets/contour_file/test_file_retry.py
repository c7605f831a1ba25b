"""A writer that is used again after a failure, or whose files somebody has touched, destroys nothing."""

import os
import shutil

import pytest
from contour_cases import assert_same, make_contours, make_header, write_ranges

from palpate.datasets.contour_file import writer as writer_module
from palpate.datasets.contour_file.blocks import work_folder
from palpate.datasets.contour_file.check import check_file
from palpate.datasets.contour_file.reader import ContourFile
from palpate.datasets.contour_file.writer import ContourWriter
from palpate.datasets.errors import ContourFileError

pytestmark = pytest.mark.exhaustive

RANGES = [(0, 3), (3, 4), (4, 9)]


@pytest.mark.parametrize("held", [False, True])
def test_sealing_again_after_the_folder_was_not_synced_keeps_the_file(tmp_path, monkeypatch, held):
    """The first sync after the new name stands fails, as on a disk that reports an error late."""
    path, contours = tmp_path / "out.h5", make_contours(9)
    failed = []

    def sync(folder):
        if folder == tmp_path and path.exists() and not failed:
            failed.append(folder)
            raise OSError(5, "Input/output error")

    with ContourWriter(path, make_header(9)) as writer:
        write_ranges(writer, contours, RANGES, held=held)
        monkeypatch.setattr(writer_module, "sync", sync)
        with pytest.raises(ContourFileError, match="cannot seal: Input/output error"):
            writer.seal()
        writer.seal()
    assert failed
    assert check_file(path) == []
    with ContourFile(path) as file:
        assert_same(file.contours(), contours)


@pytest.mark.parametrize("change", ["removed", "cut off", "moved"])
def test_blocks_that_somebody_changed_before_they_are_sealed_are_missed_and_rendered_again(tmp_path, change):
    path, contours = tmp_path / "out.h5", make_contours(9)
    with ContourWriter(path, make_header(9)) as writer:
        write_ranges(writer, contours, RANGES)
        block = work_folder(path) / "poses-000000000003-000000000004.h5"
        if change == "removed":
            block.unlink()
        elif change == "moved":
            block.rename(block.with_name("poses-000000000003-000000000005.h5"))
        else:
            os.truncate(block, block.stat().st_size - 1)
        message = r"1 poses that were committed are not in .*out.h5.partial.*mode=.resume. renders them again"
        with pytest.raises(ContourFileError, match=message):
            writer.seal()
        assert not path.exists()
        assert not list(block.parent.glob("*.tmp"))
    with ContourWriter(path, make_header(9), mode="resume") as writer:
        assert writer.missing() == [(3, 4)]
        write_ranges(writer, contours, writer.missing())
        writer.seal()
    assert check_file(path) == []
    with ContourFile(path) as file:
        assert_same(file.contours(), contours)


def test_a_block_that_nobody_committed_is_not_sealed(tmp_path):
    path, contours = tmp_path / "out.h5", make_contours(9)
    with ContourWriter(path, make_header(9)) as writer:
        write_ranges(writer, contours, RANGES[:2])
        block = work_folder(path) / "poses-000000000003-000000000004.h5"
        shutil.copy(block, block.with_name("poses-000000000004-000000000005.h5"))
        shutil.copy(block, block.with_name("poses-000000000001-000000000002.h5"))
        write_ranges(writer, contours, RANGES[2:], held=True)
        writer.seal()
    assert check_file(path) == []
    with ContourFile(path) as file:
        assert_same(file.contours(), contours)
