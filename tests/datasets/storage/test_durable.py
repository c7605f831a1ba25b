"""Files that come whole or not at all, also where a writer stops in the middle."""

import os
import time

import pytest

from palpate.datasets.storage.durable import ABANDONED_SECONDS, temporary_name, whole_file


def test_a_whole_file_replaces_the_old_one_only_at_the_end(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("old")
    with whole_file(path) as new:
        new.write_text("new")
        assert path.read_text() == "old"
        assert new.parent == tmp_path
    assert path.read_text() == "new"
    assert os.listdir(tmp_path) == ["a.csv"]


@pytest.mark.parametrize("error", [OSError, KeyboardInterrupt, ValueError])
@pytest.mark.parametrize("begun", [False, True])
def test_a_writer_that_raises_leaves_the_old_file_alone(error, begun, tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("old")

    def write():
        with whole_file(path) as new:
            if begun:
                new.write_text("half")
            raise error

    with pytest.raises(error):
        write()
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["a.csv"]


def test_what_a_killed_writer_left_is_removed_once_it_is_old(tmp_path):
    path = tmp_path / "a.csv"
    old, young = temporary_name(path), temporary_name(path)
    for left in (old, young):
        left.write_text("half")
    then = time.time() - ABANDONED_SECONDS - 10
    os.utime(old, (then, then))
    with whole_file(path) as new:
        new.write_text("new")
    assert sorted(tmp_path.iterdir()) == sorted([path, young])
