"""Focal points and drives that a sweep keeps: read, told of, checked, and played as they are."""

import json
import tracemalloc

import h5py
import numpy as np
import pytest
from command_line import FAILED, MISUSED, answer, refused, run
from contour_cases import first_chunk, flip_bit, put_text, redigest, zero_chunk

from palpate.datasets.errors import ContourFileError
from palpate.datasets.focus_files.frame_file import FrameField, FrameFile
from palpate.datasets.focus_files.frame_reader import FrameReader, check_frames, frame_format
from palpate.device import EmulatorBackend
from palpate.device.clock import VirtualClock
from palpate.device.codec import encode_frames
from palpate.device.registry import array_model
from palpate.render.errors import StrategyError
from palpate.render.playback.drive import Driver
from palpate.render.playback.file_playback import Connection, play_file
from palpate.render.playback.focal_points import BLOCK, stored_points
from palpate.render.sampling.metrics import FocalPoints
from palpate.render.sampling.strategy import SamplingStrategy

RATE, COUNT = 5000.0, 2 * BLOCK + 7
VIRTUAL = Connection(clock="virtual")
RECIPE = {name: {"name": f"my {name}"} for name in ("thing", "hand", "motion", "strategy", "sampling", "array")}


def written(path, fields, group, values, **attributes):
    about = {"format": attributes.pop("format"), "version": np.array([1, 0], np.int32), "recipe": json.dumps(RECIPE)}
    told = {"/": about, group: {"update_rate": RATE}, **attributes}
    with FrameFile(path, fields, len(values[0]), attributes=told) as file:
        file.append({field.path: rows for field, rows in zip(fields, values, strict=True)})
        file.publish()
    return path


def focal_points(path, count=COUNT, foci=()):
    rng = np.random.default_rng(1)
    position = rng.uniform([-0.05, -0.05, 0.15], [0.05, 0.05, 0.25], (count, *foci, 3)).astype(np.float32)
    intensity = rng.uniform(0, 1, (count, *foci)).astype(np.float32)
    fields = [FrameField("/focus/position", (*foci, 3), "m"), FrameField("/focus/intensity", foci, "1")]
    written(path, fields, "/focus", (position, intensity), format="palpate focal points")
    return path, FocalPoints(position, intensity)


def drives(path, count=40):
    fields = [FrameField("/drive/delay", (256,), "turn"), FrameField("/drive/amplitude", (), "1")]
    values = np.full((count, 256), 0.5), np.ones(count)
    array = {"names": '["emulator"]'}
    return written(path, fields, "/drive", values, format="palpate drives", **{"/array": array})


def test_kept_focal_points_are_played_as_they_are_at_their_rate(tmp_path):
    path, focus = focal_points(tmp_path / "a.h5")
    bus = EmulatorBackend(clock=VirtualClock(), record=2 * COUNT)
    playback = play_file(path, connection=Connection(backend=bus))
    expected = Driver(array_model("emulator"), update_rate=RATE).drive(focus)
    wire = encode_frames(expected.delay, expected.amplitude, array="emulator")
    np.testing.assert_array_equal(bus.board().played[: playback.played.frames], wire)
    assert (playback.played.frames, playback.played.update_rate) == (COUNT, RATE)
    assert "jumps" not in playback.as_dict()


def test_they_are_read_block_by_block_and_again(tmp_path):
    path, focus = focal_points(tmp_path / "a.h5", foci=(4,))
    with FrameReader(path) as file:
        source = stored_points(file)
        for _ in range(2):
            blocks = list(source)
            assert [len(block.intensity) for block in blocks] == [BLOCK, BLOCK, 7]
            np.testing.assert_array_equal(np.concatenate([block.position for block in blocks]), focus.position)
        assert file.foci == source.foci == 4
        assert [stored_points(file, end).frame_count for end in (0.0101, 9.0)] == [51, COUNT]
        with pytest.raises(StrategyError, match="duration must be positive"):
            stored_points(file, -1.0)


@pytest.mark.exhaustive
def test_options_that_mean_nothing_are_refused(tmp_path):
    path, _ = focal_points(tmp_path / "a.h5", count=700)
    assert answer("play", path, "--clock", "virtual", "--duration", "0.01", "--repeats", "2")["frames"] == 100
    for option in (("--sampling", "stm"), ("--speed", "5"), ("--update-rate", "8000")):
        refused(MISUSED, f"so {option[0]} cannot be asked for", "play", path, *option)
    with pytest.raises(StrategyError, match="no sampling strategy changes"):
        play_file(path, sampling=SamplingStrategy(), connection=VIRTUAL)
    many, _ = focal_points(tmp_path / "many.h5", count=10, foci=(9,))
    refused(MISUSED, "foci must be at most 8", "play", many)
    refused(MISUSED, "5000 Hz", "play", path, "--array", "sonicsurface", "--emulate")


def test_info_and_check_tell_what_they_are(tmp_path):
    path, _ = focal_points(tmp_path / "a.h5")
    told = answer("info", path)
    assert (told["holds"], told["frames"], told["update_rate"], told["foci"]) == ("focal points", COUNT, RATE, 1)
    assert (told["object"], told["sampling"]) == ("my thing", "my sampling")
    assert answer("check", path)["whole"] is True
    told = answer("info", drives(tmp_path / "d.h5"))
    assert (told["holds"], told["frames"], told["arrays"]) == ("drives", 40, ["emulator"])
    assert answer("check", tmp_path / "d.h5")["whole"] is True


@pytest.mark.exhaustive
def test_what_cannot_be_done_with_them_names_what_they_are(tmp_path):
    path, _ = focal_points(tmp_path / "a.h5")
    refused(FAILED, "it holds drives of arrays", "play", drives(tmp_path / "d.h5"))
    refused(FAILED, "it holds focal points, which palpate play plays", "figure", path, "-o", tmp_path / "a.png")
    with FrameReader(tmp_path / "d.h5") as file, pytest.raises(ContourFileError, match="holds drives, no focal points"):
        file.focal_points(0, 1)
    assert frame_format(tmp_path / "none.h5") is None


def unlike(file):
    file["focus"].move("intensity", "x")
    file["focus"].create_dataset("intensity", data=np.zeros(5, "f4"))


def test_damage_is_found_and_named(tmp_path):
    whole = focal_points(tmp_path / "whole.h5", count=50)[0].read_bytes()
    path = tmp_path / "a.h5"
    for change, message in (
        (lambda file: file["focus/position"].__setitem__(20, np.nan), "/focus/position: not finite (1, first 20)"),
        (lambda file: file["focus/intensity"].__setitem__(3, 1.5), "/focus/intensity: not in 0..1 (1, first 3)"),
        (lambda file: file["focus/intensity"].__setitem__(4, -0.5), "/focus/intensity: not in 0..1 (1, first 4)"),
        (lambda file: file["focus"].attrs.__setitem__("update_rate", 0.0), "update_rate of /focus must be positive"),
        (lambda file: file.attrs.__setitem__("recipe", "[1, 2]"), "attribute recipe of / is no JSON object"),
        (lambda file: file.attrs.__setitem__("recipe", "{"), "attribute recipe of / is no JSON object"),
        (lambda file: file["focus"].pop("position"), "/focus/position is missing"),
        (lambda file: file.attrs.__setitem__("version", np.array([2, 0])), "version 2, newer than this palpate reads"),
        (unlike, "do not fit"),
    ):
        path.write_bytes(whole)
        with h5py.File(path, "r+") as file:
            change(file)
        redigest(path)  # a writer that does such a thing gives digests of what it wrote
        (problem,) = check_frames(path)
        assert message in problem
    result = run("check", path, "--json")
    assert (result.exit_code, json.loads(result.stdout)["whole"]) == (FAILED, False)
    assert run("play", path, "--clock", "virtual").exit_code == FAILED


def test_a_file_is_published_with_all_its_frames_or_not_at_all(tmp_path):
    path, values = tmp_path / "a.h5", {"/focus/intensity": np.ones(3)}
    with FrameFile(path, [FrameField("/focus/intensity", (), "1")], 5, attributes={"/": {"format": "x"}}) as file:
        file.append(values)
        with pytest.raises(ValueError, match="has 3 frames, 5 were announced"):
            file.publish()
        with pytest.raises(ValueError, match=r"frames up to 6 of .* do not fit 5"):
            file.append(values)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", ["info", "check", "play"])
def test_a_format_that_is_no_text_is_another_file(tmp_path, command):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.attrs["format"] = np.array([1, 2])
    result = run(command, tmp_path / "a.h5")
    told = " ".join(result.output.split())
    assert (result.exit_code, "Error:" in told) == (FAILED, False)
    assert "is HDF5, but not a contour file: its root has no format 'palpate contours'" in told


def test_parts_of_a_recipe_that_are_none_are_left_out(tmp_path):
    path, _ = focal_points(tmp_path / "a.h5", count=10)
    with h5py.File(path, "r+") as file:
        file.attrs["recipe"] = json.dumps(RECIPE | {"thing": [1], "hand": 3})
    redigest(path)
    told = answer("info", path)
    assert ("object" in told, "hand" in told, told["motion"]) == (False, False, "my motion")


def test_damage_is_found_when_it_is_said_to_be(tmp_path):
    """As the table at the top of datasets/storage/hdf5.py has it; the reader is that of contour files."""
    path, focus = focal_points(tmp_path / "a.h5", count=50)
    zero_chunk(path, "focus/position")
    with FrameReader(path) as file:
        np.testing.assert_array_equal(file.focal_points(0, 50)[1], focus.intensity)
    assert "/focus/position is damaged: its rows are not what was written" in check_frames(path)[0]
    flip_bit(path, first_chunk(path, "focus/position")[0] + 5)
    with FrameReader(path) as file, pytest.raises(ContourFileError, match="the checksum of a chunk"):
        file.focal_points(0, 1)
    with h5py.File(path, "r+") as file:
        file["focus"].attrs["update_rate"] = RATE * 2
    with pytest.raises(ContourFileError, match="update_rate of /focus is not what was written"):
        FrameReader(path)


def test_digests_of_blocks_prove_nothing_and_wire_frames_are_not_played_without_proof(tmp_path):
    """Files of older palpates have them."""
    old = json.dumps({"block_rows": 8192, "datasets": {"/focus/position": [0, "0" * 32]}, "attributes": {}})
    points, focus = focal_points(tmp_path / "a.h5", count=50)
    fields, array = [FrameField("/wire/frames", (4,), "1", "u1")], {"frame_bytes": np.array([3, 1])}
    wire = np.arange(40, dtype=np.uint8).reshape(10, 4)
    wire_path = written(tmp_path / "w.h5", fields, "/wire", (wire,), format="palpate wire frames", **{"/array": array})
    with FrameReader(wire_path) as file:
        assert file.frame_bytes == [3, 1]
        np.testing.assert_array_equal(file.wire_frames(2, 5)[0], wire[2:5, :3])
    for path in (points, wire_path):
        with h5py.File(path, "r+") as file:
            put_text(file, "digests", old)
    with FrameReader(points) as file:
        np.testing.assert_array_equal(file.focal_points(0, 50)[0], focus.position)
    with pytest.raises(ContourFileError, match="has no digests of its frames, which version"):
        FrameReader(wire_path)


def test_frames_of_this_version_are_refused_without_digests(tmp_path):
    path, _ = focal_points(tmp_path / "a.h5", count=50)
    with h5py.File(path, "r+") as file:
        file.attrs["version"] = np.array([1, 1], np.int32)
    for text in ('{"block_rows": 1}', '{"datasets": {}, "attributes": {}}', '["block_rows"]', '"block_rows"'):
        with h5py.File(path, "r+") as file:
            put_text(file, "digests", text)
        with pytest.raises(ContourFileError, match="digests"):
            FrameReader(path)


@pytest.mark.exhaustive
def test_checking_takes_little_memory_however_long_a_row_is(tmp_path):
    rows, row_bytes = 40, 1 << 21
    fields, array = [FrameField("/wire/frames", (row_bytes,), "1", "u1")], {"frame_bytes": np.array([row_bytes])}
    wire = np.zeros((rows, row_bytes), np.uint8)
    path = written(tmp_path / "w.h5", fields, "/wire", (wire,), format="palpate wire frames", **{"/array": array})
    tracemalloc.start()
    assert check_frames(path) == []
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < wire.nbytes
