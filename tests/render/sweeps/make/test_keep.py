"""What a sweep keeps: contour files as `palpate render` writes them, counts as `palpate play` has them, frames."""

import errno
import os
import signal
import subprocess
import sys

import h5py
import numpy as np
import pytest
from sweep_recipes import explored, random_motion, recipe_of, recorded, sampling_of, task_of

from palpate.datasets import HandMotion
from palpate.datasets.contour_file.check import check_file
from palpate.datasets.contour_file.reader import ContourFile
from palpate.datasets.contour_file.writer import ContourWriter
from palpate.datasets.focus_files.frame_file import FrameField, FrameFile
from palpate.datasets.storage import hdf5_opening
from palpate.datasets.storage.durable import FolderLock
from palpate.datasets.sweeps.shard import read_shard
from palpate.device.registry import array_model
from palpate.render import MeshObject, Palm, Scene, record
from palpate.render.errors import PalpateWarning
from palpate.render.playback.drive import Driver
from palpate.render.playback.file_playback import Connection, play_file
from palpate.render.playback.focal_points import ContourSource
from palpate.render.reports.file_summary import summarise
from palpate.render.sampling.metrics import dwell_map
from palpate.render.sampling.sampler import Sampler, joined, sample_bounds
from palpate.render.strategies.intersection_strategy import load_strategy
from palpate.render.sweeps.make import keep as keep_module
from palpate.render.sweeps.make.rendering import recipe_cache
from palpate.render.sweeps.make.rendering import sampling_of as sampling_strategy
from palpate.render.sweeps.make.work import run_task

ALL = ("contours", "sampling", "keep-contours", "keep-focal-points", "keep-drives")
NOT_THE_SAME = {"created", "device", "digests"}  # digests are of the other two and of /timing, too


def payloads(store, recipes, groups, name="a"):
    """Of each (group, key)."""
    outcome = run_task(task_of(store, recipes, groups, name=name), "cpu", worker="here")
    assert outcome.error is None
    return {(row.group, row.key): row.payload for row in read_shard(store / outcome.shard).rows}


def payload(store, recipe, group, name="a"):
    return payloads(store, [recipe], (group,), name)[group, recipe.key(group)]


def motion_of(recipe):
    return recipe_cache("cpu").rendering(recipe).poses.motion


def contents(path):
    """Everything of an HDF5 file but what time leaves in it."""
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


def test_kept_contours_are_the_file_that_render_writes(tmp_path, rendered):
    recipe, path = rendered
    got = payloads(tmp_path, [recipe], ("contours", "keep-contours"))
    told = got["keep-contours", recipe.key("keep-contours")]
    kept = tmp_path / told["path"]
    assert kept == tmp_path / "contours" / f"{recipe.key('keep-contours')}.h5"
    assert told["bytes"] == kept.stat().st_size
    assert check_file(kept) == []
    assert contents(kept) == contents(path)
    summary, numbers = summarise(kept), got["contours", recipe.key("contours")]
    assert numbers["poses_drawn"] == summary["poses_drawn"]
    for name in ("length", "length_object", "length_hand"):
        count, total = numbers["stat"][name][:2]
        assert total / count == pytest.approx(summary[f"{name}_mean"], rel=1e-12)
    assert numbers["stat"]["length"][1] / numbers["stat"]["length_object"][1] == pytest.approx(summary["r"], rel=1e-12)


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("name", ["stm", "capped", "stp", "lm", "multi-focus", "step"])
def test_sampling_is_counted_as_play_counts_it(tmp_path, rendered, name):
    recipe, path = rendered
    recipe = recipe_of("tube", motion=recipe.motion, sampling=sampling_of(name, update_rate=4000.0))
    strategy = sampling_strategy(recipe.sampling)
    played = play_file(path, sampling=strategy, connection=Connection(clock="virtual")).as_dict()
    got = payload(tmp_path, recipe, "sampling")
    by_cause = played["jumps_by_cause"]
    assert [got[f"jumps_{cause}"] for cause in ("polyline", "order", "pose", "reentry")] == [
        by_cause[cause] for cause in ("polyline", "order", "pose", "re-entry")
    ]
    assert got["silent_share"] == played["silent"] / played["samples"]
    assert got["draw_frequency"] == played["draw_frequency_nominal"]
    assert [got[key] for key in ("jump_length", "step_longest", "revisit_rate", "samples")] == [
        played[key] for key in ("jump_length", "step_longest", "revisit_rate", "samples")
    ]
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


def test_contours_that_are_kept_are_read_and_not_rendered_again(tmp_path, rendered, monkeypatch):
    recipe, _ = rendered
    rendering = payload(tmp_path, recipe, "sampling")
    payload(tmp_path, recipe, "keep-contours")
    monkeypatch.setattr(Scene, "raw_contours", None)
    kept = payload(tmp_path, recipe, "sampling")
    assert kept | {"seconds": 0} == rendering | {"seconds": 0}
    monkeypatch.setattr(keep_module, "code_version", lambda: "other code")
    with pytest.raises(AssertionError, match="NoneType"):
        payload(tmp_path, recipe, "sampling")


@pytest.mark.exhaustive
@pytest.mark.parametrize("damage", ["cut", "emptied", "overwritten"])
@pytest.mark.parametrize("group", ["sampling", "keep-contours"])
def test_damaged_contours_are_set_aside_and_rendered_again(tmp_path, rendered, group, damage):
    recipe, _ = rendered
    (tmp_path / "other").mkdir()
    expected = payload(tmp_path / "other", recipe, group)
    kept = tmp_path / payload(tmp_path, recipe, "keep-contours")["path"]
    content, whole = kept.read_bytes(), contents(kept)
    spoilt = {"cut": content[: len(content) // 2], "emptied": b"", "overwritten": content[:3000] + bytes(len(content))}
    kept.write_bytes(spoilt[damage])
    with pytest.warns(PalpateWarning, match="is damaged .* rendered again"):
        got = payload(tmp_path, recipe, group, name="b")
    assert got | {"seconds": 0} == expected | {"seconds": 0}
    assert kept.with_name(f"{kept.name}.damaged").read_bytes() == spoilt[damage]
    assert (check_file(kept), contents(kept)) == ([], whole)  # what the table names is there


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("lasts", [False, True])
@pytest.mark.parametrize("number", [errno.EMFILE, errno.EIO, errno.EACCES])
@pytest.mark.parametrize("group", ["sampling", "keep-contours"])
def test_contours_that_the_system_lets_nobody_read_are_no_damage(tmp_path, rendered, monkeypatch, group, number, lasts):
    recipe, _ = rendered
    kept = tmp_path / payload(tmp_path, recipe, "keep-contours")["path"]
    content, read, failures = kept.read_bytes(), hdf5_opening.StrictFile.dataset, []

    def fail(file, name):
        if name == "/contours/points" and (lasts or not failures):
            failures.append(name)
            raise OSError(number, os.strerror(number))
        return read(file, name)

    monkeypatch.setattr(hdf5_opening.StrictFile, "dataset", fail)
    outcome = run_task(task_of(tmp_path, [recipe], (group,), name="b"), "cpu", worker="here")
    assert failures
    assert f"{kept}: /contours/points " in outcome.error
    assert os.strerror(number).lower() in outcome.error.lower()
    assert (kept.read_bytes(), kept.with_name(f"{kept.name}.damaged").exists()) == (content, False)


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("name", ["stm", "multi-focus"])
def test_focal_points_and_drives_are_those_of_playing_the_file(tmp_path, rendered, name):
    recipe, path = rendered
    recipe = recipe_of("tube", motion=recipe.motion, sampling=sampling_of(name, update_rate=1000.0))
    got = payloads(tmp_path, [recipe], ("keep-focal-points", "keep-drives"))
    assert [bool(own["seconds"]) for own in got.values()] == [True, False]  # of one walk, which is counted once
    strategy = sampling_strategy(recipe.sampling)
    with ContourFile(path) as file:
        focus = joined(list(ContourSource(file, Sampler(strategy))))
    model = array_model("emulator")
    drives = Driver(model, update_rate=1000.0).drive(focus)
    with h5py.File(tmp_path / got["keep-focal-points", recipe.key("keep-focal-points")]["path"]) as file:
        np.testing.assert_array_equal(file["focus/position"], focus.position)
        np.testing.assert_array_equal(file["focus/intensity"], focus.intensity)
        assert file["focus"].attrs["update_rate"] == 1000.0
        assert file["focus/position"].attrs["units"] == b"m"
        assert file.attrs["recipe"].decode() == recipe.to_json()
    with h5py.File(tmp_path / got["keep-drives", recipe.key("keep-drives")]["path"]) as file:
        np.testing.assert_array_equal(file["drive/delay"], drives.delay)
        np.testing.assert_array_equal(file["drive/amplitude"], drives.amplitude)
        np.testing.assert_array_equal(file["array/position"], model.position)
        assert model.identity() in file["array"].attrs["identities"].decode()
    assert got["keep-drives", recipe.key("keep-drives")]["refused"] == drives.refused


def test_poses_without_time_have_contours_but_no_focal_points(tmp_path):
    recipe = recipe_of("cube", motion=random_motion(900))
    got = payloads(tmp_path, [recipe], ALL)
    for group in ("sampling", "keep-focal-points", "keep-drives"):
        told = got[group, recipe.key(group)]
        assert told["reason"] == "the poses have no times"
        assert told.get("path") is None
        assert told.get("jump_length") is None
    kept = summarise(tmp_path / got["keep-contours", recipe.key("keep-contours")]["path"])
    numbers = got["contours", recipe.key("contours")]
    assert (kept["poses"], kept["poses_drawn"]) == (900, numbers["poses_drawn"])
    assert kept["length_mean"] * 900 == pytest.approx(numbers["stat"]["length"][1], rel=1e-12)  # the same poses
    HandMotion(np.zeros(1), motion_of(recipe).pose[:1]).save(tmp_path / "one.csv")
    one = recipe_of("cube", motion=recorded(tmp_path / "one.csv"))
    assert payload(tmp_path, one, "sampling")["reason"] == "there is one pose only"


def test_contours_of_too_many_random_poses_are_refused(tmp_path):
    recipe = recipe_of("cube", motion=random_motion(10**9))
    outcome = run_task(task_of(tmp_path, [recipe], ("keep-contours", "sampling")), "cpu", worker="x")
    assert "1000000000 random poses are too many" in outcome.error
    assert [row.group for row in read_shard(tmp_path / outcome.shard).rows] == ["sampling"]


def test_an_array_that_cannot_play_the_rate_is_told_and_takes_nothing_with_it(tmp_path):
    recipe = recipe_of("cube", sampling=sampling_of("stm", update_rate=7001.0))
    outcome = run_task(task_of(tmp_path, [recipe], ("sampling", "keep-focal-points", "keep-drives")), "cpu", worker="x")
    assert outcome.failed[0].place == 0
    assert "keep-drives" in outcome.error
    assert "7001" in outcome.error
    assert {row.group for row in read_shard(tmp_path / outcome.shard).rows} == {"sampling", "keep-focal-points"}
    assert [path.name for path in (tmp_path / "focal-points").iterdir()] == [f"{recipe.key('keep-focal-points')}.h5"]


KILLED = """
import sys
from pathlib import Path
from palpate.datasets.contour_file.writer import ContourWriter
from palpate.render.intersection.batch_rendering import PoseSpans
from palpate.render.sweeps.make.work import run_task
from sweep_recipes import explored, recipe_of, task_of
from palpate.render.sweeps.make import keep as keep_module
keep_module.code_version = lambda: "this code"
PoseSpans.learn = lambda *_: None
write = ContourWriter.write
def told(self, first, stop, *rest):
    write(self, first, stop, *rest)
    self.commit()
    print(first, stop, flush=True)
    sys.stdin.readline()
ContourWriter.write = told
recipe = recipe_of("tube", motion=explored(100.0))
run_task(task_of(sys.argv[1], [recipe], ("keep-contours",)), "cpu", worker="killed")
"""


def worker(code, store, **options):
    command = [sys.executable, "-c", code, str(store)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    return subprocess.Popen(command, **pipes, **options)


@pytest.mark.exhaustive
def test_a_killed_worker_leaves_contours_that_the_next_one_goes_on_with(tmp_path, monkeypatch):
    with worker(KILLED, tmp_path) as process:
        line = next(line for line in process.stdout if line[:1].isdigit())
        first, stop = map(int, line.split())
        recipe = recipe_of("tube", motion=explored(100.0))
        folder = keep_module.contours_at(tmp_path, recipe.key("contours")).with_suffix(".h5.partial")
        assert FolderLock.is_held(folder)
        process.send_signal(signal.SIGKILL)
    written = []
    monkeypatch.setattr(keep_module, "code_version", lambda: "this code")
    write = ContourWriter.write

    def noted(self, first, stop, *rest):
        written.append((first, stop))
        write(self, first, stop, *rest)

    monkeypatch.setattr(ContourWriter, "write", noted)
    told = payload(tmp_path, recipe, "keep-contours")
    assert (first, written[0][0], written[-1][1]) == (0, stop, 9000)
    assert check_file(tmp_path / told["path"]) == []


@pytest.mark.exhaustive
def test_contours_that_another_process_writes_are_waited_for(tmp_path, monkeypatch):
    recipe = recipe_of("tube", motion=explored(100.0))
    slept = []
    with worker(KILLED, tmp_path) as process:
        next(line for line in process.stdout if line[:1].isdigit())

        def let_go(seconds):
            if not slept:
                process.communicate("\n" * 50, timeout=60)
            slept.append(seconds)

        monkeypatch.setattr(keep_module, "sleep", let_go)
        monkeypatch.setattr(keep_module, "code_version", lambda: "this code")
        told = payload(tmp_path, recipe, "keep-contours")
    assert slept
    assert check_file(tmp_path / told["path"]) == []


FIELDS = [FrameField("/a/position", (3,), "m"), FrameField("/a/level", (), "1")]


def frame_file(path, count):
    return FrameFile(path, FIELDS, count, attributes={"/": {"format": "test"}, "/a": {"rate": 7.0}})


def test_room_is_reserved_where_the_file_system_leaves_that_to_the_c_library(tmp_path, monkeypatch):
    def touch_blocks(handle, offset, length):
        """As glibc does: a byte of each block is read and written back."""
        for at in range(offset, offset + length, 4096):
            byte = os.pread(handle, 1, at)
            os.pwrite(handle, byte or b"\0", at)
        os.pwrite(handle, os.pread(handle, 1, offset + length - 1) or b"\0", offset + length - 1)

    monkeypatch.setattr(os, "posix_fallocate", touch_blocks)
    with frame_file(tmp_path / "a.h5", 100) as file:
        file.append({"/a/position": np.ones((100, 3)), "/a/level": np.ones(100)})
        file.publish()
    with h5py.File(tmp_path / "a.h5") as read:
        assert (read["a/position"][...] == 1.0).all()


def test_frames_come_in_any_blocks_and_appear_when_all_are_there(tmp_path, rng):
    rows = rng.normal(size=(1000, 4)).astype(np.float32)
    with frame_file(tmp_path / "a.h5", 1000) as file:
        for first, stop in ((0, 1), (1, 700), (700, 700), (700, 1000)):
            assert not (tmp_path / "a.h5").exists()
            file.append({"/a/position": rows[first:stop, :3], "/a/level": rows[first:stop, 3]})
        with pytest.raises(ValueError, match=r"1001 of .* do not fit 1000"):
            file.append({"/a/position": rows[:1, :3], "/a/level": rows[:1, 3]})
        size = file.publish()
    assert [path.name for path in tmp_path.iterdir()] == ["a.h5"]
    assert size == (tmp_path / "a.h5").stat().st_size < 40_000
    with h5py.File(tmp_path / "a.h5") as read:
        np.testing.assert_array_equal(read["a/position"], rows[:, :3])
        np.testing.assert_array_equal(read["a/level"], rows[:, 3])
        assert (read["a"].attrs["rate"], read["a/level"].attrs["units"]) == (7.0, b"1")


def test_frames_that_are_missing_leave_nothing(tmp_path):
    with pytest.raises(ValueError, match="has 0 frames, 5 were announced"), frame_file(tmp_path / "a.h5", 5) as file:
        file.publish()
    with pytest.raises(OSError, match=r"No space|too large"), frame_file(tmp_path / "a.h5", 1 << 50):
        pass
    assert list(tmp_path.iterdir()) == []
