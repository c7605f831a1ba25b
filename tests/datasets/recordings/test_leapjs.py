"""leapjs recordings: frames of protocol 6, packed by leapjs-playback, and compressed by lz-string.

Outside truths: the packed and compressed text below was written by leapjs-playback's own lz-string 1.3.3 (under Node);
the frames' fields are those of its public recordings, of which four are kept decoded as .npz.
"""

import base64
import json

import numpy as np
import pytest
from recording_cases import content_of, written

from palpate.datasets.errors import RecordingError
from palpate.datasets.hand_model.joints import DIGITS, Joint
from palpate.datasets.recordings.files import load_recording
from palpate.datasets.recordings.leapjs import is_leapjs, leapjs_frames
from palpate.datasets.recordings.sample import write_sample

NAMES = ("thumb", "index", "middle", "ring", "pinky")
STRUCTURE = [
    "id",
    "timestamp",
    {"hands": [["id", "type", "direction", "palmNormal", "palmPosition"]]},
    {"pointables": [["id", "handId", "tool", "mcpPosition", "pipPosition", "dipPosition", "tipPosition", "width"]]},
    {"interactionBox": ["center", "size"]},
]
PACKED = """
N4IgtgpgLghgJjWIBcoBmB7ATmRA1CLAZwEsMA7FAJgBoQoSoAbCFEACQDeALVgXzposMSERQBtcSBJwQdBqNhgADnNDcY5OGOST
ps+QE9lrOnBJYIAYwYU5IZTCZgActlxN7j5wAUMpW0oAXSCBUGUMEnJYACMWHT0Zew0tAEkDegwMTzowK2U/ALJKOmUSAv9GYvtz
CqK7eXLCqoaQAHcZKG4QELDpaMIYG2KAIQwADwkQKwgBrHtSAC9WUKCacQAGGgBGKg39g/XxXbosEgBzbig5TZotgFpttdvHu+eq
bZoPgBYae6oAOwhZ7HPY7WhoJxECDrWh7ACcXyB63+AFYvht0f9nvdvr89gBmP5UABsONRiL2tFxqLWH2eu0+J0hTGhKM+Pz+ePJ
X22v3uAA5vjiAbz+dsNsjxIKxX9dsKdlLdrRmVCYeIPrLcVKwZz7vCnuttpS+XLtgKGSbxQSyYqGVQiarWervhzTbiqM88VqBQSv
SStRKLetvqK9btbdtbaDfk62eISW7+QS/esSWH3SSFeIAVs9QLPesAUS9fDg3yQkc8/s3rCCeiHei+UDK8dwft4YdJCcQGdLtd1l
sHoaXp8Ns8A3rUX7W6CtnH1Y8SxtESPcdWsVRg9LUWGNtTUdn7umdvDEfcAbb6UbNQv2ZP3bmcbrMXKV8+VfCsdsCeOUQ6diFOVv
lTbYlSoFUITVNMtWLZ4Gw2cUoy9U9qT5P9xFjAVPkeVFaTtG9HSg51YQffkSW3KhKVfR4Nm3AkmXha0MIJFUC2A/DkJvWNiPjb4y
L+Cl4LhSU/gFeF4KbM833w8Rd0A89tnNNYKxBash3eesvi05tgVCIAAA
"""  # line breaks do not count


def frames_of(tmp_path):
    """Frames as leapjs has them of a made hand: five fingers, each with its joints' positions."""
    frames = []
    for k, frame in enumerate(content_of(tmp_path, "leap")["frames"]):
        (hand,) = frame["hands"]
        palm, fingers = hand["palm"], []
        for digit, name in enumerate(NAMES):
            bones = hand[name]
            ends = [bones[bone]["next_joint"] for bone in ("metacarpal", "proximal", "intermediate", "distal")]
            keys = ("mcpPosition", "pipPosition", "dipPosition", "tipPosition")
            finger = {"id": 120 + digit, "handId": 12, "tool": False, "type": digit, "width": bones["distal"]["width"]}
            fingers.append({**finger, **dict(zip(keys, ends, strict=True))})
        own = {"palmPosition": palm["position"], "palmNormal": palm["normal"], "direction": palm["direction"]}
        box = {"center": [0, 200, 0], "size": [235, 235, 147]}
        hands = [{"id": 12, "type": hand["type"], **own}]
        head = {"id": k, "timestamp": frame["timestamp"]}
        frames.append({**head, "hands": hands, "pointables": fingers, "interactionBox": box})
    return frames


def packed(structure, value):
    """Values in the order of a structure, as leapjs-playback's wiki describes its format 2."""
    if isinstance(structure[0], list):
        return [packed(structure[0], one) for one in value]
    return [
        value[name] if isinstance(name, str) else packed(*next((below, value[own]) for own, below in name.items()))
        for name in structure
    ]


def test_frames_of_leapjs_are_the_hand_that_its_decoded_arrays_are(tmp_path):
    found = load_recording(written(tmp_path, {"metadata": {"formatVersion": 1}, "frames": frames_of(tmp_path)}))
    decoded = load_recording(write_sample("leap", tmp_path / "hand.npz", frame_count=6))
    np.testing.assert_allclose(found.joint_pose, decoded.joint_pose, atol=5e-5)  # its positions are rounded to 1 um
    np.testing.assert_allclose(found.joint_radius, decoded.joint_radius, atol=5e-4)  # from other bones' widths
    np.testing.assert_allclose(found.time, decoded.time, atol=1e-9)
    assert (found.is_left, found.hand_id, found.derived) == (False, "12", decoded.derived)


def test_packed_frames_are_those_that_were_packed(tmp_path):
    frames = frames_of(tmp_path)
    rows = [STRUCTURE, *(packed(STRUCTURE, frame) for frame in frames)]
    plain = load_recording(written(tmp_path, {"frames": frames}))
    found = load_recording(written(tmp_path, {"metadata": {"formatVersion": 2}, "frames": rows}))
    assert np.array_equal(found.joint_pose, plain.joint_pose)  # without `type`, fingers stand in order


def test_a_compressed_recording_is_read(tmp_path):
    path = tmp_path / "made.json.lz"
    path.write_text(PACKED)
    found = load_recording(path)
    assert (len(found), found.is_left, found.time[1]) == (2, False, pytest.approx(0.009))
    tips = found.joint_pose[0, [digit[-1] for digit in DIGITS], :3]
    np.testing.assert_allclose(tips, TIPS, atol=1e-12)


TIPS = np.array([[-59, 202, -45], [-8, 214, -124], [19, 214, -136], [47, 214, -126], [73, 214, -98]]) * 1e-3


def test_a_socket_s_messages_one_a_line_are_read(tmp_path):
    """UltraleapTrackingWebSocket sends its version and its devices before frames."""
    head = [{"version": 6}, {"event": {"type": "deviceEvent", "state": {"attached": True, "id": 1}}}]
    text = "\n".join(map(json.dumps, head + frames_of(tmp_path)))
    plain = load_recording(written(tmp_path, {"frames": frames_of(tmp_path)}))
    for name in ("a.jsonl", "b.ndjson", "c.json"):
        assert np.array_equal(load_recording(written(tmp_path, text, name)).joint_pose, plain.joint_pose)


def test_bases_of_bones_turn_joints_and_a_left_hand_s_have_x_reversed(tmp_path):
    """Bases are the axes of bones; leapjs gives those of a left hand left-handed."""
    frames = frames_of(tmp_path)
    turn = np.array([[0.8, 0.6, 0], [-0.6, 0.8, 0], [0, 0, 1.0]])
    for side, x in (("right", 1.0), ("left", -1.0)):
        for frame in frames:
            frame["hands"][0]["type"] = side
            for finger in frame["pointables"]:
                finger["bases"] = [(turn * [[x], [1], [1]]).tolist()] * 4
        clip = leapjs_frames({"frames": frames})
        wanted = [0, 0, np.sin(np.arctan2(0.6, 0.8) / 2), np.cos(np.arctan2(0.6, 0.8) / 2)]
        for joint in (Joint.THUMB_METACARPAL, Joint.INDEX_METACARPAL, Joint.LITTLE_TIP):
            np.testing.assert_allclose(clip.sightings[0].quaternion[joint], wanted, atol=1e-12)


def changed(frames, where, key, value):
    frames[1][where][0][key] = value
    return {"frames": frames}


@pytest.mark.parametrize(
    ("where", "key", "value", "said"),
    [
        ("hands", "type", "both", "frame 1, hand 12: type 'both' is neither left nor right"),
        ("hands", "palmNormal", [0, 1], "frame 1, hand 12, palmNormal: must have 3 numbers, got 2"),
        ("pointables", "type", 5, "frame 1, hand 12: finger 5 is none of 0 to 4"),
        ("pointables", "type", [0], r"frame 1, hand 12: finger \[0\] is none of 0 to 4"),
        ("pointables", "bases", [1], r"finger 0, bases: must be a list, got 1"),
        (
            "pointables",
            "bases",
            [[[1, 0, 0]] * 3] * 4,
            "finger 0, bases: its axes are not of length 1 and at right angles",
        ),
        ("pointables", "bases", [np.eye(3).tolist()] * 3, "bases: must be 4, one of each bone, got 3"),
    ],
)
def test_what_a_frame_cannot_mean_is_refused_by_its_place(tmp_path, where, key, value, said):
    with pytest.raises(RecordingError, match=said):
        load_recording(written(tmp_path, changed(frames_of(tmp_path), where, key, value)))


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ([["timestamp", {"hands": [["id"]]}], [1]], "frame 0: 1 packed values, 2 names"),
        ([["timestamp", 7], [1, 2]], "packed names: must be an object, got 7"),
        ([["timestamp", {"hands": [[[[[["id"]]]]]]}], [1, [[[[[[1]]]]]]]], "packed names: lists lie more than 4 deep"),
        ([["timestamp", {"hands": [["id"]]}], "row"], "frame 0: must be a list, got 'row'"),
    ],
)
def test_packed_rows_that_their_names_do_not_fit_are_refused(tmp_path, rows, said):
    assert is_leapjs({"frames": rows})
    with pytest.raises(RecordingError, match=said):
        load_recording(written(tmp_path, {"frames": rows}))


@pytest.mark.parametrize(
    ("content", "said"), [(b"!!", "not a text that lz-string packed"), (base64.b64encode(b"{}"), "not JSON|packed")]
)
def test_a_compressed_file_of_something_else_is_refused(tmp_path, content, said):
    (tmp_path / "a.lz").write_bytes(content)
    with pytest.raises(RecordingError, match=rf"a\.lz: .*({said})"):
        load_recording(tmp_path / "a.lz")
