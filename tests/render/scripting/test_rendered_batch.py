"""Batches that know what they are of: the same numbers as by files, and the other libraries' own readings."""

import pickle
import re
from base64 import b64encode

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from palpate.datasets import ContourFile, check_file, read_ptlist, static_pose
from palpate.render import (
    ContourBatch,
    HandMotion,
    ImplicitObject,
    MeshObject,
    Palm,
    Scene,
    exploration,
    flat_hand,
    load_contours,
    load_strategy,
    play_file,
    record,
    render,
    sphere,
    summarise,
    voxelise,
)
from palpate.render.errors import StrategyError
from palpate.render.intersection.batch_rendering import collect
from palpate.render.intersection.job import ContourJob


@pytest.fixture(scope="module")
def tube():
    return MeshObject.load("tube")


@pytest.fixture(scope="module")
def motion(tube):
    return exploration(tube, duration=2.0, seed=1)


@pytest.fixture(scope="module")
def batch(tube, motion):
    return render(tube, Palm(), motion, "cc")


def same(one, other):
    names = set(one.by_name()) | set(other.by_name())
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in names)


def test_names_give_what_objects_give(tube, motion, batch):
    assert same(batch, collect(ContourJob.of(Scene.of(tube, Palm(), load_strategy("cc")), motion))[0])
    assert same(batch, render("Tube", "palm", motion.pose, "Closed"))
    assert same(batch, render(tube.to_trimesh(), "palm", motion, "cc"))


def test_a_file_is_read_as_a_batch(batch, tmp_path):
    found = load_contours(batch.save(tmp_path / "tube.h5"))
    assert same(found, batch)
    assert found.play(clock="virtual", duration=0.5).as_dict() == batch.play(clock="virtual", duration=0.5).as_dict()
    assert found.to_pandas().equals(batch.to_pandas())
    with pytest.raises(StrategyError, match="copy that file"):
        found.save(tmp_path / "again.h5")


def test_speed_and_rate_are_changed_by_the_way(batch):
    faster = batch.sample("stm", speed=3.5, update_rate=20_000.0)
    assert (faster.sampling.speed, faster.update_rate) == (3.5, 20_000.0)
    assert len(faster) == pytest.approx(2 * len(batch.sample("stm")), abs=2)


@pytest.mark.exhaustive
def test_scenes_of_every_kind_can_be_pickled(batch):
    ball = ImplicitObject(sphere(0.06), at=(0, 0, 0.2))
    for solid, hand in (("dog", "skin"), (voxelise("tube", spacing=0.01), "planes"), (ball, "palm")):
        found = render(solid, hand, batch.motion[20:22])
        again = pickle.loads(pickle.dumps(found))
        assert same(render(again.scene.solid, again.scene.hand, again.motion), found)


def test_a_part_of_a_batch_is_what_the_part_of_the_motion_gives(tube, motion, batch):
    part = batch[100:180]
    assert same(part, render(tube, Palm(), HandMotion(motion.time[100:180], motion.pose[100:180]), "cc"))
    assert len(part.sample().time) == pytest.approx(80 / 90 * 10_000, abs=2)


def test_saved_is_what_recording_writes_but_for_its_own_times(tube, motion, batch, tmp_path):
    for strategy in ("cc",):
        found = render(tube, Palm(), motion, strategy)
        saved = found.save(tmp_path / f"{strategy}-saved.h5")
        record(tmp_path / f"{strategy}.h5", tube, Palm(), motion, strategy)
        assert check_file(saved) == []
        with ContourFile(saved) as one, ContourFile(tmp_path / f"{strategy}.h5") as other:
            assert one.recipe == other.recipe
            for read in ("contours", "metrics"):
                mine, theirs = getattr(one, read)(0, len(motion)), getattr(other, read)(0, len(motion))
                assert mine.keys() == theirs.keys()
                exact = (
                    0 if read == "contours" else 1e-7
                )  # lengths are summed in float32 by kernels, float64 on the host
                assert all(np.allclose(mine[name], theirs[name], rtol=0, atol=exact) for name in mine)


def test_played_and_sampled_from_memory_is_what_the_file_gives(batch, tmp_path):
    path = batch.save(tmp_path / "batch.h5")
    options = {"clock": "virtual", "duration": 1.0}
    in_memory, from_file = batch.play(**options), play_file(path, sampling="stm", **options)
    assert in_memory.as_dict() == from_file.as_dict()
    focus = batch.sample("stm", duration=1.0)
    assert focus.count == from_file.count
    assert focus.draw_frequency == in_memory.as_dict()["draw_frequency"]
    points = read_ptlist(focus.save(tmp_path / "batch.ptlist"))
    assert np.allclose(points.position, focus.position, atol=1e-6)
    assert len(focus.to_pandas()) == len(focus) == len(focus.time)


def test_one_draw_frequency(batch, tmp_path):
    told = summarise(batch.save(tmp_path / "batch.h5"))
    played = batch.play(clock="virtual").as_dict()
    assert told["draw_frequency"] == pytest.approx(played["draw_frequency"], rel=5e-3)
    assert batch.facts()["draw_frequency"] == pytest.approx(told["draw_frequency"], rel=1e-6)
    length = batch.length()
    samples = np.ceil(length[length > 0].astype(float) / 7.0 * 10_000 - 1e-3)
    assert told["draw_frequency"] == pytest.approx(np.mean(10_000 / samples))
    assert told["draw_frequency_median"] == pytest.approx(np.median(10_000 / samples))
    assert told["draw_frequency_of_mean_length"] == pytest.approx(7.0 / length[length > 0].mean(), rel=1e-6)


def test_tables_of_pandas_and_xarray(batch, motion):
    poses, points, dataset = batch.to_pandas(), batch.to_pandas("points"), batch.to_xarray()
    assert isinstance(poses, pd.DataFrame)
    assert isinstance(dataset, xr.Dataset)
    assert np.array_equal(poses["length"], batch.length())
    assert np.array_equal(dataset["time"], motion.time)
    assert dataset["length"].attrs == {"units": "m"}
    assert points.groupby("pose").size().reindex(range(len(batch)), fill_value=0).tolist() == poses["points"].tolist()
    assert set(points["kind"]) == {"object", "hand"}
    assert batch.facts()["length_mean"] == pytest.approx(batch.length().mean(), rel=1e-6)
    foci = batch.sample("multi-focus", duration=0.1)
    assert foci.to_pandas()["time"].tolist() == np.repeat(foci.time, 2).tolist()
    with pytest.raises(StrategyError, match="of must be poses or points, not 'lines'"):
        batch.to_pandas("lines")


@pytest.mark.exhaustive
def test_a_notebook_shows_picture_and_facts(batch):
    picture = batch._repr_png_()
    assert picture.startswith(b"\x89PNG")
    page = batch._repr_html_()
    assert b64encode(picture).decode() in page  # notebooks show HTML rather than PNG
    assert "<td>tube" in page
    assert repr(batch) in page
    assert render("cube", Palm(), static_pose([0, 0, 0.9]), "cc")._repr_png_() is None


@pytest.mark.exhaustive
def test_a_notebook_shows_other_moments_from_other_sides(batch, tmp_path):
    longest = float(batch.motion.time[batch.length().argmax()])
    shown = batch.show([longest], view="palm", array=None)
    assert shown._repr_png_().startswith(b"\x89PNG")
    assert shown._repr_png_() != batch.show([longest], view="top", array=None)._repr_png_()
    assert re.fullmatch(r"ShownPicture\(PNG of 1440 x \d+ pixels\)", repr(shown))
    kept = batch.figure(tmp_path / "same.png", times=[longest], view="palm", array=None)
    assert kept.read_bytes() == shown._repr_png_()
    with pytest.raises(StrategyError, match="is outside"):
        batch.show([1e6])


def test_points_in_patches_are_not_taken_for_those_of_the_array(tube, motion, tmp_path):
    found = render(tube, Palm(), motion, "cc", points="patch")
    for wrong in (
        found.sample,
        lambda: found.save(tmp_path / "patch.h5"),
        lambda: found.figure(tmp_path / "patch.png"),
    ):
        with pytest.raises(StrategyError, match='this needs points="array", but the batch has points="patch"'):
            wrong()
    assert list(tmp_path.iterdir()) == []
    assert "<td>tube" in found._repr_html_()
    assert found[0:0]._repr_html_() is found[0:0]._repr_png_() is None


def test_moved_and_articulated_parts(tube):
    poses = np.repeat(static_pose([0, 0, 0.2]).pose, 3, axis=0)
    moved = np.tile(np.array([0, 0, 0.2, 0, 0, 0, 1], np.float32), (3, 1))
    moved[:, 0] = (0.0, 0.02, 0.5)
    batch = render(tube, Palm(), poses, "cc", object_pose=moved)
    assert batch.length()[2] == 0
    part = batch[1:2]
    assert same(part, render(tube, Palm(), poses[1:2], "cc", object_pose=moved[1:2]))
    assert same(part, render(tube, Palm(), part.motion, "cc", object_pose=part.scene.object_pose))
    assert render("tube", flat_hand(), poses, "oc")[0]


def test_a_batch_that_does_not_know_its_motion_says_so(batch):
    plain = ContourBatch.from_arrays(batch.arrays())
    assert not hasattr(plain, "sample")
    with pytest.raises(StrategyError, match=r"a static pose|one static pose"):
        render("cube", Palm(), static_pose([0, 0, 0.2])).sample()
    with pytest.raises(StrategyError, match="does not know its hand's motion"):
        type(batch)(**{name: getattr(batch, name) for name in batch.by_name()}).sample()
