"""Kept files: contours as `palpate render` writes them, counts as `palpate play` has them, frames as it plays them."""

import h5py
import numpy as np
import pytest
from sweep_recipes import explored, payloads_of, random_motion, recipe_of, sampling_of, unit_of

from palpate.datasets.contour_file.check import check_file
from palpate.datasets.contour_file.reader import ContourFile
from palpate.device.registry import array_model
from palpate.render import MeshObject, Palm, record
from palpate.render.playback.drive import Driver
from palpate.render.playback.file_playback import Connection, play_file
from palpate.render.playback.focal_points import ContourSource
from palpate.render.reports.file_summary import summarise
from palpate.render.sampling.metrics import dwell_map
from palpate.render.sampling.sampler import Sampler, joined, sample_bounds
from palpate.render.strategies.intersection_strategy import load_strategy
from palpate.render.sweeps.make.rendering import recipe_cache
from palpate.render.sweeps.make.rendering import sampling_of as sampling_strategy
from palpate.render.sweeps.make.unit_making import make_unit

NOT_THE_SAME = {"created", "device", "digests"}  # digests are of the other two and of /timing, too


def made(recipe, groups, scratch=""):
    """Payloads by group, and kept files by the folder that they have in the store."""
    result = make_unit(unit_of([recipe], groups, scratch=scratch), "cpu")
    assert result.failed == ()
    payloads = {group: payload for (group, _, _), payload in payloads_of(result).items()}
    assert {name for name, _ in result.files} == {own["path"] for own in payloads.values() if own.get("path")}
    return payloads, {name.partition("/")[0]: content for name, content in result.files}


def motion_of(recipe):
    return recipe_cache("cpu").rendering(recipe).poses.motion


def contents(path):
    """Everything of an HDF5 file but times."""
    out = {}

    def visit(name, item):
        if not name.startswith(("timing", "digests")):
            values = item[...].tobytes() if isinstance(item, h5py.Dataset) else None
            out[name] = values, {key: str(value) for key, value in item.attrs.items()}

    with h5py.File(path) as file:
        file.visititems(visit)
        out["/"] = None, {key: str(value) for key, value in file.attrs.items() if key not in NOT_THE_SAME}
    return out


@pytest.fixture(scope="module")
def rendered(tmp_path_factory):
    """A recipe, and the file that `palpate render` would write of it."""
    recipe = recipe_of("tube", motion=explored(1.5, seed=3))
    path = tmp_path_factory.mktemp("rendered") / "rendered.h5"
    record(path, MeshObject.load("tube"), Palm(), motion_of(recipe), load_strategy("cc"))
    return recipe, path


@pytest.mark.parametrize("is_near", [True, False], ids=["near", "remote"])
def test_kept_contours_are_the_file_that_render_writes(tmp_path, rendered, is_near):
    recipe, path = rendered
    scratch = tmp_path / ("making" if is_near else "of another machine")
    if is_near:
        scratch.mkdir()
    payloads, files = made(recipe, ("contours", "keep-contours"), scratch)
    kept = files["contours"]
    if not is_near:
        assert list(tmp_path.iterdir()) == []
        kept = tmp_path / "kept.h5"
        kept.write_bytes(files["contours"])
    assert payloads["keep-contours"]["path"] == f"contours/{recipe.key('keep-contours')}.h5"
    assert payloads["keep-contours"]["bytes"] == kept.stat().st_size
    assert check_file(kept) == []
    assert contents(kept) == contents(path)
    summary, numbers = summarise(kept), payloads["contours"]
    assert numbers["poses_drawn"] == summary["poses_drawn"]
    for name in ("length", "length_object", "length_hand"):
        count, total = numbers["stat"][name][:2]
        assert total / count == pytest.approx(summary[f"{name}_mean"], rel=1e-12)
    assert numbers["stat"]["length"][1] / numbers["stat"]["length_object"][1] == pytest.approx(summary["r"], rel=1e-12)


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("name", ["stm", "capped", "stp", "lm", "multi-focus", "step"])
def test_sampling_is_counted_as_play_counts_it(rendered, name):
    recipe, path = rendered
    recipe = recipe_of("tube", motion=recipe.motion, sampling=sampling_of(name, update_rate=4000.0))
    strategy = sampling_strategy(recipe.sampling)
    played = play_file(path, sampling=strategy, connection=Connection(clock="virtual")).as_dict()
    got = made(recipe, ("sampling",))[0]["sampling"]
    for cause in ("polyline", "order", "pose", "re-entry"):
        assert got[f"jumps_{cause.replace('-', '')}"] == played["jumps_by_cause"][cause]
    assert got["silent_share"] == played["silent"] / played["samples"]
    assert got["draw_frequency"] == played["draw_frequency"]
    for number in ("jump_length", "step_longest", "revisit_rate", "samples"):
        assert got[number] == played[number]
    seconds = played["samples"] / strategy.update_rate
    for event in ("jumps", "hops"):
        assert got[f"{event}_per_second"] * seconds == pytest.approx(played[event])
    assert name != "step" or played["jumps"] + played["hops"] > 0
    with ContourFile(path) as file:
        source = ContourSource(file, Sampler(strategy))
        motion = file.motion()
        bounds = sample_bounds(motion["time"], source.duration, 4000.0)
        dwell = dwell_map(source, motion["pose"], bounds, 4000.0)
    assert (got["dwell_spread"], got["dwell_area"]) == (dwell.spread, dwell.area)


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("name", ["stm", "multi-focus"])
def test_focal_points_and_drives_are_those_of_playing_the_file(tmp_path, rendered, name):
    recipe, path = rendered
    recipe = recipe_of("tube", motion=recipe.motion, sampling=sampling_of(name, update_rate=1000.0))
    payloads, files = made(recipe, ("keep-focal-points", "keep-drives"), tmp_path)
    assert [bool(own["seconds"]) for own in payloads.values()] == [True, False]  # of one walk, which is counted once
    with ContourFile(path) as file:
        focus = joined(list(ContourSource(file, Sampler(sampling_strategy(recipe.sampling)))))
    model = array_model("emulator")
    drives = Driver(model, update_rate=1000.0).drive(focus)
    with h5py.File(files["focal-points"]) as file:
        np.testing.assert_array_equal(file["focus/position"], focus.position)
        np.testing.assert_array_equal(file["focus/intensity"], focus.intensity)
        assert file["focus"].attrs["update_rate"] == 1000.0
        assert file["focus/position"].attrs["units"] == b"m"
        assert file.attrs["recipe"].decode() == recipe.to_json()
    with h5py.File(files["drives"]) as file:
        np.testing.assert_array_equal(file["drive/delay"], drives.delay)
        np.testing.assert_array_equal(file["drive/amplitude"], drives.amplitude)
        np.testing.assert_array_equal(file["array/position"], model.position)
        assert model.identity() in file["array"].attrs["identities"].decode()
    assert payloads["keep-drives"]["refused"] == drives.refused


@pytest.mark.parametrize(
    ("recipe", "groups", "message", "others"),
    [
        (
            recipe_of("cube", motion=random_motion(10**9)),
            ("keep-contours", "sampling"),
            "1000000000 random poses are too many",
            ["sampling"],
        ),
        (
            recipe_of("cube", sampling=sampling_of("stm", update_rate=7001.0)),
            ("sampling", "keep-focal-points", "keep-drives"),
            "7001",
            ["sampling", "keep-focal-points"],
        ),
    ],
    ids=["too many poses", "a rate that the array cannot play"],
)
def test_a_file_that_cannot_be_made_takes_no_other_group_with_it(tmp_path, recipe, groups, message, others):
    result = make_unit(unit_of([recipe], groups, scratch=tmp_path), "cpu")
    (failed,) = result.failed
    assert message in failed.message
    assert [row.group for row in result.rows] == others
    assert [path.parent.name for _, path in result.files] == [own[5:] for own in others if own.startswith("keep-")]
