"""Recordings and alignments that say what they cannot mean are refused in a sentence; holding does not add up."""

import json
import math

import numpy as np
import pytest
from recording_cases import TIP, content_of, lossy, remade, written

from palpate.datasets.errors import RecordingError
from palpate.datasets.recordings.alignment import alignment_pose
from palpate.datasets.recordings.files import load_recording
from palpate.datasets.recordings.sample import sample_recording, write_sample


def with_joint(content, **fields):
    """An OpenXR recording with fields of one joint in the first frame."""
    content["frames"][0]["hands"][0]["joints"]["index_tip"] |= fields
    return content


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"locationFlags": math.nan}, "frame 0, right hand, index_tip, locationFlags: must be a whole number, got nan"),
        ({"locationFlags": 3.5}, "locationFlags: must be a whole number, got 3.5"),
        ({"locationFlags": "3"}, "locationFlags: must be a number, got '3'"),
        ({"valid": "false"}, "index_tip, valid: must be true or false, got 'false'"),
        ({"valid": 2}, "index_tip, valid: must be true or false, got 2"),
    ],
)
def test_a_joint_s_flags_are_judged(tmp_path, fields, said):
    with pytest.raises(RecordingError, match=said):
        load_recording(written(tmp_path, with_joint(content_of(tmp_path, "openxr"), **fields)))


@pytest.mark.parametrize(("value", "missing"), [(0, 1), (False, 1), (1, 0), (True, 0), (None, 0)])
def test_valid_is_true_or_false_or_a_number_for_it(tmp_path, value, missing):
    found = load_recording(written(tmp_path, with_joint(content_of(tmp_path, "openxr"), valid=value)))
    assert found.counts["missing_joints"] == missing


def test_numbers_of_thousands_of_digits_are_refused_and_large_ones_not_known(tmp_path):
    text = json.dumps(with_joint(content_of(tmp_path, "openxr"), radius="HERE"))
    with pytest.raises(RecordingError, match=r"hand\.json: .*4300 digits"):
        load_recording(written(tmp_path, text.replace('"HERE"', "1" * 5000)))
    assert len(load_recording(written(tmp_path, text.replace('"HERE"', "1" * 400)))) == 6


def test_a_file_s_word_on_mirroring_counts_and_must_be_one(tmp_path):
    content = content_of(tmp_path, "mediapipe")
    plain = load_recording(written(tmp_path, content))
    with pytest.raises(RecordingError, match="image_mirrored: must be true or false, got 'false'"):
        load_recording(written(tmp_path, {**content, "image_mirrored": "false"}))
    for frame in content["frames"]:
        for hand in frame["hands"]:
            hand["world_landmarks"] = [[-x, y, z] for x, y, z in hand["world_landmarks"]]
    mirrored = load_recording(written(tmp_path, {**content, "image_mirrored": True}))
    assert np.allclose(mirrored.joint_pose, plain.joint_pose)


def archive_of(tmp_path, **changed):
    path = write_sample("leap", tmp_path / "leap.npz", frame_count=6)
    with np.load(path) as found:
        arrays = dict(found)
    np.savez(path, **(arrays | changed))
    return path


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"t": np.array(list("abcdef"))}, "array 't' must be numbers, got <U1"),
        ({"joints": np.full((6, 5, 4, 3), "x")}, "array 'joints' must be numbers"),
        ({"palm_normal": np.ones((6, 3), complex)}, "array 'palm_normal' must be numbers, got complex128"),
        ({"is_left": np.array(["right"] * 6)}, "array 'is_left' must be true or false, got <U5 like right"),
        ({"is_left": np.full(6, np.nan)}, "array 'is_left' must be true or false, got float64 like nan"),
        ({"is_left": np.full(6, 2)}, "array 'is_left' must be true or false"),
    ],
)
def test_arrays_of_other_kinds_are_refused_by_name(tmp_path, changed, said):
    with pytest.raises(RecordingError, match=said):
        load_recording(archive_of(tmp_path, **changed))


def test_what_is_no_archive_is_refused(tmp_path):
    path, other = archive_of(tmp_path), tmp_path / "other.npz"
    np.save(tmp_path / "one.npy", np.zeros(3))
    whole = path.read_bytes()
    torn = bytearray(whole)
    torn[200:2000:7] = bytes(0xFF ^ b for b in torn[200:2000:7])
    for content in ((tmp_path / "one.npy").read_bytes(), b"", b"abc", whole[: len(whole) // 2], bytes(torn)):
        other.write_bytes(content)
        with pytest.raises(RecordingError, match=r"other\.npz: not a NumPy archive of arrays"):
            load_recording(other)
    with pytest.raises(RecordingError, match=r"nowhere\.npz: no such recording"):
        load_recording(tmp_path / "nowhere.npz")


def rewritten(path, change):
    """A CSV whose rows, the header first, are lists that `change` changes."""
    rows = [line.split(",") for line in path.read_text().splitlines()]
    change(rows)
    path.write_text("\n".join(",".join(row) for row in rows))
    return path


def cell(row, column, value):
    def change(rows):
        rows[row][rows[0].index(column)] = value

    return change


def twice(rows):
    for row in rows:
        row.append(row[4])


def one_id(rows):
    for k, row in enumerate(rows):
        row.append("id" if k == 0 else "7")
    cell(2, "hand", "left")(rows)


def invalid(rows):
    for k, row in enumerate(rows):
        row.append("valid" if k == 0 else "-1")


def again(rows):
    rows[3] = list(rows[2])
    rows[2][rows[0].index("radius")] = rows[3][rows[0].index("radius")] = "-1.0"


@pytest.mark.parametrize(
    ("form", "change", "said"),
    [
        ("mediapipe", cell(1, "landmark", "²"), "line 2: unknown landmark '²'"),
        ("mediapipe", cell(1, "landmark", "9" * 5000), "line 2: unknown landmark '999"),
        ("mediapipe", cell(2, "wrist_x", "99"), r"line 3: the wrist is at \[99\.0, .* in a row before"),
        ("mediapipe", one_id, "line 3: hand '7' is said to be left and right"),
        ("openxr", one_id, "line 3: hand '7' is said to be left and right"),
        ("openxr", invalid, "line 2: valid must be 0 or 1, got -1"),
        ("openxr", again, "line 4: wrist is listed twice at this time"),
        ("openxr", twice, "line 1: column y is there twice"),
        ("leap", twice, "line 1: column palm_position_y is there twice"),
        (
            "leap",
            lambda rows: rows.append(rows.pop(1)),
            r"line 7: time 12\.0 s is not after 12\.16666\d+ s of the frame",
        ),
    ],
)
def test_a_table_that_contradicts_itself_is_refused_by_its_line(tmp_path, form, change, said):
    path = rewritten(write_sample(form, tmp_path / "hand.csv", frame_count=6), change)
    with pytest.raises(RecordingError, match=said):
        load_recording(path)


def typed(node):
    """Lists of numbers as JSON.stringify writes a Float32Array: an object of its indices."""
    if isinstance(node, list) and node and all(isinstance(value, float) for value in node):
        return {str(index): value for index, value in enumerate(node)}
    if isinstance(node, list):
        return [typed(value) for value in node]
    return {name: typed(value) for name, value in node.items()} if isinstance(node, dict) else node


def test_typed_arrays_as_browsers_write_them_are_vectors_and_matrices(tmp_path):
    content = content_of(tmp_path, "webxr")
    plain = load_recording(written(tmp_path, content))
    assert np.array_equal(load_recording(written(tmp_path, typed(content))).joint_pose, plain.joint_pose)
    content["frames"][0]["hands"][0]["joints"]["wrist"]["matrix"] = {"0": 1.0, "2": 0.0}
    with pytest.raises(RecordingError, match="frame 0, right hand, wrist, matrix: '1' is missing"):
        load_recording(written(tmp_path, content))


@pytest.mark.parametrize(
    ("form", "key", "word"),
    [("leap", "type", "HandType.Right"), ("leap", "type", "1"), ("openxr", "handedness", "HandEXT.RIGHT")],
)
def test_members_of_libraries_enumerations_name_sides(tmp_path, form, key, word):
    """As Python writes the members of leapc-python-bindings and pyopenxr."""
    content = content_of(tmp_path, form)
    for frame in content["frames"]:
        frame["hands"][0][key] = word
    assert not load_recording(written(tmp_path, content)).is_left


@pytest.mark.parametrize(("form", "clock"), [("leap", "timestamp"), ("openxr", "time"), ("mediapipe", "time")])
def test_frames_that_a_poller_wrote_again_are_one_frame(tmp_path, form, clock):
    content = content_of(tmp_path, form)
    plain = load_recording(written(tmp_path, content))
    frames = content["frames"]
    content["frames"] = [frame for k, frame in enumerate(frames) for _ in range(1 + k % 3)]
    found = load_recording(written(tmp_path, content))
    assert np.array_equal(found.joint_pose, plain.joint_pose)
    assert np.array_equal(found.time, plain.time)
    assert found.counts == plain.counts | {"repeated_frames": 6}
    content["frames"] = [frames[0], {**frames[1], clock: frames[0][clock]}]
    with pytest.raises(RecordingError, match=r"frame 1: time .* is not after .*, and its hands are others"):
        load_recording(written(tmp_path, content))


@pytest.mark.parametrize(("form", "rows"), [("leap", 1), ("openxr", 26), ("webxr", 25), ("mediapipe", 21)])
def test_rows_that_a_poller_wrote_again_are_one_frame(tmp_path, form, rows):
    path = write_sample(form, tmp_path / "hand.csv", frame_count=3)
    plain = load_recording(path)
    head, *lines = path.read_text().splitlines()
    path.write_text("\n".join([head, *lines[:rows], *lines[:rows], *lines[rows:]]))
    found = load_recording(path)
    assert np.array_equal(found.joint_pose, plain.joint_pose)
    assert np.array_equal(found.time, plain.time)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('{"time_unit": "ns"}\n{"time": 1, "hands": [}\n', r"line 2 column 23: neither JSON nor JSON Lines"),
        ('{"time": 1, "hands": []}\n{"time": 2, "hands": []}', "looks like no known recording"),
    ],
)
def test_json_lines_that_break_off_or_lack_hands_are_refused(tmp_path, text, said):
    with pytest.raises(RecordingError, match=said):
        load_recording(written(tmp_path, text))


def test_json_lines_are_frames_below_what_the_file_says_of_all(tmp_path):
    content = content_of(tmp_path, "openxr")
    plain = load_recording(written(tmp_path, content))
    frames = content.pop("frames")
    lines = "\n\n".join(json.dumps(value) for value in [content, *frames])
    assert np.array_equal(load_recording(written(tmp_path, lines)).joint_pose, plain.joint_pose)
    with pytest.raises(RecordingError, match="'time_unit' is missing"):
        load_recording(written(tmp_path, "\n".join(map(json.dumps, frames)), "hand.jsonl"))


def test_a_european_spreadsheet_s_table_is_the_recording_it_was(tmp_path):
    path = write_sample("openxr", tmp_path / "hand.csv", frame_count=2)
    plain = load_recording(path)
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b",", b";").replace(b".", b","))
    again = load_recording(path)
    assert np.array_equal(again.joint_pose, plain.joint_pose)
    assert np.array_equal(again.time, plain.time)


def test_a_spreadsheet_s_empty_cells_comments_and_separator_line_leave_a_table_as_it_was(tmp_path):
    """Lines are counted with those above the header: the last one is 2 below the sample's own last."""
    path = write_sample("openxr", tmp_path / "hand.csv", frame_count=2)
    plain = load_recording(path)
    lines = path.read_text().splitlines()
    text = "\n".join(["sep=,", "# made by hand", *(f"{line},," for line in lines), "," * 20, ""])
    path.write_text(text)
    assert np.array_equal(load_recording(path).joint_pose, plain.joint_pose)
    path.write_text(text.replace(f"{lines[-1]},,", f"{lines[-1]},,7"))
    with pytest.raises(RecordingError, match=rf"hand\.csv: line {len(lines) + 2}: \d+ columns, the header has"):
        load_recording(path)


@pytest.mark.parametrize("name", ["hand.csv", "hand.json"])
def test_utf_16_is_named_with_what_a_spreadsheet_calls_utf8(tmp_path, name):
    path = write_sample("openxr", tmp_path / name, frame_count=2)
    path.write_bytes(path.read_text().encode("utf-16"))
    with pytest.raises(RecordingError, match=rf"{name}: byte 0 is not UTF-8 text, but UTF-16: .*CSV UTF-8"):
        load_recording(path)


def test_a_header_of_too_many_names_is_refused(tmp_path):
    path = tmp_path / "hand.csv"
    path.write_text(",".join(map(str, range(10_000))) + "\n")
    with pytest.raises(RecordingError, match=r"hand\.csv: line 1: 10000 columns, at most 4096 can be"):
        load_recording(path)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('{"position": "123", "orientation": [0, 0, 0, 1]}', "alignment, position: must be a list, got '123'"),
        ('{"position": ["1", 0, 0], "orientation": [0, 0, 0, 1]}', "position: must be a number, got '1'"),
        ('{"position": [true, 0, 0], "orientation": [0, 0, 0, 1]}', "position: must be a number, got True"),
        ('{"position": [0, 0], "orientation": [0, 0, 0, 0, 1]}', "lists of 3 and 4 numbers"),
        (f'{{"position": [{"1" * 400}, 0, 0], "orientation": [0, 0, 0, 1]}}', "is not finite"),
        (f'{{"position": [{"1" * 5000}, 0, 0], "orientation": [0, 0, 0, 1]}}', "4300 digits"),
        ('{"matrix": "1"}', "matrix: must be a list, got '1'"),
        ("[" * 200_000, "deep in each other"),
    ],
)
def test_an_alignment_s_file_is_judged(tmp_path, text, said):
    with pytest.raises(RecordingError, match=f"hand.json.*{said}"):
        alignment_pose(written(tmp_path, text))


@pytest.mark.parametrize("alignment", [list("0000001"), [10**400, 0, 0, 0, 0, 0, 1], None, [0, 0, 0j, 0, 0, 0, 1]])
def test_an_alignment_must_be_numbers(alignment):
    with pytest.raises(RecordingError, match="alignment: must be numbers, got"):
        alignment_pose(alignment)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda r: r.resampled("90"), "rate must be greater than 0 and at most 100000 Hz, got '90'"),
        (lambda r: r.resampled(True), "rate must be greater than 0"),
        (lambda r: r.resampled(30.0, "a"), "gap_most must be finite and 0 s or more, got 'a'"),
        (lambda r: r.held(None), "gap_most must be finite"),
        (lambda r: r.held(10**400), "gap_most must be finite"),
        (
            lambda r: remade(r, time=[0.0, 0.1, 1e9]).resampled(90.0),
            r"1e\+09 s at 90 Hz are 9e\+10 frames, 4e\+06 can be",
        ),
        (lambda r: remade(r, joint_radius="a"), r"joint_radius must be numbers of shape \[26\]"),
        (lambda r: remade(r, valid=np.full((3, 26), "false")), "valid must be true or false"),
        (lambda r: remade(r, kept=np.ones(3)), r"kept must have shape \[3, 26\]"),
    ],
)
def test_wrong_types_and_too_much_are_refused_in_a_sentence(call, said):
    with pytest.raises(RecordingError, match=said):
        call(sample_recording(frame_count=3))


def test_holding_again_holds_no_longer():
    _, torn = lossy(range(10, 30))
    once = torn.held(0.1)
    assert np.array_equal(once.held(0.1).known, once.known)
    assert np.array_equal(torn.held(0.05).held(0.1).joint_pose, once.joint_pose, equal_nan=True)
    assert once.kept[:, TIP].tolist() == [10 <= k < 20 for k in range(40)]
    finer = once.resampled(200.0)
    assert np.flatnonzero(finer.kept[:, TIP]).tolist() == list(range(19, 39))
    assert np.array_equal(finer.held(0.1).known, finer.known)
