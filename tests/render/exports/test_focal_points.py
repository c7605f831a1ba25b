"""Focal points of a range: those of the same poses rendered alone; and of files that hold them already."""

import numpy as np
import pytest
from export_cases import quiet
from focus_cases import stored_focus

from palpate.datasets import ContourFile, write_ptlist
from palpate.datasets.focus_files.frame_file import FrameField, FrameFile
from palpate.render import HandMotion, MeshObject, Palm, exploration, load_contours, record, render
from palpate.render.errors import StrategyError
from palpate.render.exports.focal_points import (
    FocusFormat,
    SamplingFields,
    holds_focus,
    open_focus,
    read_whole,
    sample_focus,
    watched_blocks,
)
from palpate.render.exports.pose_choice import choose_poses
from palpate.render.sampling.sampler import joined

ANY = FocusFormat("anything", 10**7)
PLAIN = SamplingFields()


@pytest.fixture(scope="module")
def tube(tmp_path_factory):
    """Six seconds of an exploration that begins above the tube."""
    thing = MeshObject.load("tube")
    motion = exploration(thing, duration=14.0, seed=1)[400:940]
    path = tmp_path_factory.mktemp("tube") / "tube.h5"
    record(path, thing, Palm(), HandMotion(motion.time - motion.time[0], motion.pose), "cc")
    return path


def sampled(path, asked=PLAIN, target=ANY, **choice):
    with ContourFile(path) as file:
        return read_whole(sample_focus(file, choose_poses(file, **choice), asked, target), quiet)


def read(path, asked=PLAIN, seconds=None, target=ANY):
    with open_focus(path, asked, seconds, target) as source:
        return read_whole(source, quiet)


def test_a_whole_file_gives_what_its_batch_gives(tube):
    got, wanted = sampled(tube, SamplingFields(speed=5.0)), load_contours(tube).sample("stm", speed=5.0)
    assert (wanted.intensity > 0).any()
    np.testing.assert_array_equal(got.position, wanted.position)
    np.testing.assert_array_equal(got.intensity, wanted.intensity)


@pytest.mark.parametrize(("poses", "every"), [((100, 300), 1), ((101, 540), 9), ((3, 500), 100)])
def test_a_range_gives_what_its_poses_alone_give(poses, every, tube):
    with ContourFile(tube) as file:
        rows = slice(*poses, every)
        motion = HandMotion(file.motion()["time"][rows] - file.motion()["time"][poses[0]], file.motion()["pose"][rows])
    wanted = render("tube", Palm(), motion, "cc").sample("stm")
    got = sampled(tube, poses=poses, every=every)
    np.testing.assert_allclose(got.position, wanted.position, atol=1e-6)
    np.testing.assert_array_equal(got.intensity, wanted.intensity)


def test_more_than_the_format_holds_is_refused_with_what_fits(tube):
    small = FocusFormat("a small one", 3000)
    with pytest.raises(StrategyError, match=r"but a small one holds 3000: choose at most 0\.3 s"):
        sampled(tube, target=small)
    assert len(sampled(tube, SamplingFields(duration=0.3), small).intensity) == 3000


def test_several_focal_points_at_once_are_refused(tube):
    with pytest.raises(StrategyError, match="anything holds one focal point at a time, not foci 2"):
        sampled(tube, SamplingFields("multi-focus"))


@pytest.mark.parametrize(
    ("seconds", "rows"), [(None, slice(None)), ("0.1:0.2", slice(400, 800)), ("0.4:", slice(1600, None))]
)
def test_focal_points_of_a_sweep_and_of_a_point_list_are_taken_as_they_are(seconds, rows, tmp_path):
    position = stored_focus(tmp_path / "a.h5")
    write_ptlist(tmp_path / "a.ptlist", position, np.full(2000, 0.5), 4000.0)
    for name in ("a.h5", "a.ptlist"):
        assert holds_focus(tmp_path / name)
        found = read(tmp_path / name, seconds=seconds)
        np.testing.assert_array_equal(found.position, position[rows])
        assert (found.intensity == 0.5).all()


def test_several_focal_points_at_once_go_where_they_fit(tube, tmp_path):
    several = ANY._replace(foci_most=2)
    wanted = load_contours(tube).sample("multi-focus")
    found = sampled(tube, SamplingFields("multi-focus"), several)
    np.testing.assert_array_equal(found.position, wanted.position)
    position = stored_focus(tmp_path / "two.h5", foci=(2,))
    np.testing.assert_array_equal(read(tmp_path / "two.h5", target=several).position, position)
    stored_focus(tmp_path / "three.h5", foci=(3,))
    with pytest.raises(StrategyError, match="anything holds up to 2 focal points at a time, not foci 3"):
        read(tmp_path / "three.h5", target=several)


def test_progress_is_the_samples_so_far_and_blocks_are_the_whole(tube):
    seen = []
    with ContourFile(tube) as file:
        source = sample_focus(file, choose_poses(file), PLAIN, ANY)
        blocks = list(watched_blocks(source, lambda *now: seen.append(now)))
    assert len(blocks) > 1
    ends = np.cumsum([len(block.intensity) for block in blocks]).tolist()
    assert seen == [(end, ends[-1]) for end in ends]
    np.testing.assert_array_equal(joined(blocks).position, sampled(tube).position)


def test_what_focal_points_of_a_file_cannot_be_asked_for_is_refused(tmp_path):
    stored_focus(tmp_path / "a.h5")
    stored_focus(tmp_path / "two.h5", foci=(2,))
    with pytest.raises(StrategyError, match="at a rate of its own, so speed cannot"):
        read(tmp_path / "a.h5", SamplingFields(speed=3.0))
    with pytest.raises(StrategyError, match=r"hold no focal point of .*, which lasts 0.5 s"):
        read(tmp_path / "a.h5", seconds="3:4")
    with pytest.raises(StrategyError, match="not foci 2"):
        read(tmp_path / "two.h5")
    with pytest.raises(StrategyError, match=r"holds 100: choose at most 0\.025 s"):
        read(tmp_path / "a.h5", seconds="0.25:", target=FocusFormat("it", 100))


def test_drives_are_refused_by_name(tmp_path):
    about = {"format": "palpate drives", "version": np.array([1, 0], np.int32), "recipe": "{}"}
    fields = [FrameField("/drive/delay", (256,), "turn"), FrameField("/drive/amplitude", (), "1")]
    attributes = {"/": about, "/drive": {"update_rate": 4000.0}, "/array": {"names": '["emulator"]'}}
    with FrameFile(tmp_path / "a.h5", fields, 3, attributes=attributes) as file:
        file.append({"/drive/delay": np.zeros((3, 256)), "/drive/amplitude": np.ones(3)})
        file.publish()
    with pytest.raises(StrategyError, match="holds drives of one array, which no other format takes"):
        holds_focus(tmp_path / "a.h5")
