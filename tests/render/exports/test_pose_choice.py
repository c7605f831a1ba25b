"""Which poses are chosen, by arithmetic of Python's own slices; and every refusal names the way out."""

import numpy as np
import pytest
from contour_cases import cut_contours, make_header, write_ranges
from export_cases import export_case, mostly_empty

from palpate.datasets import ContourFile, ContourWriter
from palpate.render.errors import StrategyError
from palpate.render.exports import pose_choice
from palpate.render.exports.pose_choice import choose_poses, chosen_blocks, offsets, ragged

pytestmark = pytest.mark.exhaustive

COUNT = 120


@pytest.fixture
def file(tmp_path):
    with export_case(tmp_path / "a.h5", COUNT) as file:
        yield file


@pytest.mark.parametrize("every", [1, 2, 7, 119, 500])
@pytest.mark.parametrize("ends", [(None, None), (0, 120), (5, 6), (40, None), (None, 9), (119, 120)])
def test_poses_are_chosen_as_a_slice_chooses_them(ends, every, file):
    wanted = list(range(COUNT))[slice(*ends, every)]
    text = ":".join("" if end is None else str(end) for end in ends)
    assert list(choose_poses(file, ends, every=every)) == wanted
    assert list(choose_poses(file, text, every=every)) == wanted


@pytest.mark.parametrize("ends", [(0.5, 1.0), (None, 0.3), (1.2, None), (-1, 0.01), (10 / 90, 20 / 90)])
def test_times_choose_the_poses_from_the_first_up_to_the_last(ends, file):
    low, high = (-np.inf if ends[0] is None else ends[0]), (np.inf if ends[1] is None else ends[1])
    time = file.motion()["time"]
    assert list(choose_poses(file, seconds=ends)) == np.flatnonzero((time >= low) & (time < high)).tolist()


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        ({"poses": "5"}, "FIRST:STOP, as 100:200"),
        ({"poses": "1:2:3"}, "FIRST:STOP"),
        ({"poses": 7}, "FIRST:STOP"),
        ({"poses": "a:b"}, "two numbers"),
        ({"poses": "1.5:3"}, "whole numbers"),
        ({"poses": "nan:3"}, "finite"),
        ({"poses": "-3:3"}, "not all in .*, which has poses 0:120"),
        ({"poses": "100:121"}, "which has poses 0:120"),
        ({"poses": "5:5"}, "are none"),
        ({"poses": "9:5"}, "are none"),
        ({"seconds": "2:3"}, "hold no pose of .*, whose times are 0 to 1.32222 s"),
        ({"seconds": "1:1"}, "hold no pose"),
        ({"seconds": "1:inf"}, "finite"),
        ({"seconds": "0:1", "poses": "0:1"}, "not by both"),
        ({"every": 0}, "at least 1, not 0"),
        ({"every": True}, "at least 1"),
        ({"every": 1.5}, "at least 1"),
    ],
)
def test_a_choice_of_no_pose_is_refused_with_the_bounds(choice, message, file):
    with pytest.raises(StrategyError, match=message):
        choose_poses(file, **choice)


def test_seconds_need_times(tmp_path):
    with export_case(tmp_path / "a.h5", 30, time=None) as file, pytest.raises(StrategyError, match="have no times"):
        choose_poses(file, seconds="0:1")


@pytest.mark.parametrize("every", [1, 3, 64, 100])
def test_blocks_join_to_the_contours_of_each_chosen_pose(every, file, monkeypatch):
    monkeypatch.setattr(pose_choice, "POINTS_A_BLOCK", 100)
    blocks = list(chosen_blocks(file, chosen := choose_poses(file, "10:115", every=every)))
    assert len(blocks) > (1 if every < 64 else 0)
    assert np.concatenate([number for number, _ in blocks]).tolist() == list(chosen)
    for number, contours in blocks:
        for k, pose in enumerate(number):
            own, wanted = cut_contours(contours, k, k + 1), file.contours(int(pose), int(pose) + 1)
            assert all(np.array_equal(own[name], wanted[name]) for name in wanted)


def test_what_is_done_of_an_unfinished_file_can_be_chosen(tmp_path):
    contours = mostly_empty(40)
    with ContourWriter(tmp_path / "a.h5", make_header(40)) as writer:
        write_ranges(writer, contours, [(0, 12), (20, 30)])
        with ContourFile(tmp_path / "a.h5") as file:
            assert list(choose_poses(file, "3:12")) == list(range(3, 12))
            assert list(choose_poses(file, "20:30", every=4)) == [20, 24, 28]
            for poses in (None, "0:13", "12:20", "10:25"):
                with pytest.raises(
                    StrategyError, match=r"poses 0:12, 20:30 are done .* poses=0:12; palpate render --res"
                ):
                    choose_poses(file, poses)
    for block in (tmp_path / "a.h5.partial").glob("poses-*"):
        block.unlink()
    nothing = pytest.raises(StrategyError, match="some are missing; palpate render --resume finishes it")
    with ContourFile(tmp_path / "a.h5") as file, nothing:
        choose_poses(file)


def test_ragged_ranges_are_those_of_a_loop(rng):
    start, count = rng.integers(0, 50, 20), rng.integers(0, 5, 20)
    wanted = [k for a, n in zip(start, count, strict=True) for k in range(a, a + n)]
    assert ragged(start, count).tolist() == wanted
    assert ragged(start[:0], count[:0]).tolist() == []
    assert offsets(np.array([2, 0, 3])).tolist() == [0, 2, 2, 5]
