"""Which files are poses of a palm and which recordings of joints, and what is warned of when poses are loaded."""

import numpy as np
import pytest

from palpate.datasets.errors import RecordingWarning
from palpate.render.intersection.named_inputs import is_recording, load_motion

POSES = "time,x,y,z,qx,qy,qz,qw\n0,0,0,0.2,0.7071068,0,0,0.7071068\n1,0,0,0.2,0.7071068,0,0,0.7071068\n"


def file_of(folder, text, name="m.csv"):
    path = folder / name
    path.write_bytes(text.encode())
    return str(path)


@pytest.mark.parametrize(
    ("text", "recorded"),
    [
        (POSES, False),
        ("\ufeff" + POSES, False),  # "UTF-8 with BOM", as spreadsheets save it
        ("\ufeff\n" + POSES.replace(",", ";"), False),
        ("qw,qx,qy,qz,z,y,x,time\n", False),
        ("time_ns,hand,joint,x,y,z,qx,qy,qz,qw,radius\n", True),
        ("x,y,z,joint,hand,time_ns,qx,qy,qz,qw,radius\n", True),
        ("\ufefftime_ms;hand;landmark;x;y;z;wrist_x;wrist_y;wrist_z\n", True),
        ("timestamp,hand_id,type,palm_position_x,palm_position_y,palm_position_z\n", True),
    ],
)
def test_a_header_of_places_without_joints_is_a_motion_of_poses(tmp_path, text, recorded):
    assert is_recording(file_of(tmp_path, text)) is recorded


def test_a_csv_with_a_byte_order_mark_is_the_motion_that_it_is_without(tmp_path):
    marked = load_motion(file_of(tmp_path, "\ufeff" + POSES), None, {})
    assert (len(marked), marked.time.tolist()) == (2, [0.0, 1.0])
    assert np.array_equal(marked.pose, load_motion(file_of(tmp_path, POSES, "plain.csv"), None, {}).pose)


def test_a_file_of_which_no_pose_faces_the_array_is_warned_of(tmp_path):
    """The same poses with w first under the usual header: the skin looks along -x, past the array below it."""
    wrong = POSES.replace("0.7071068,0,0,0.7071068", "0.7071068,0.7071068,0,0")
    with pytest.warns(RecordingWarning, match=r"m\.csv: no pose faces the array: .*qw,qx,qy,qz"):
        load_motion(file_of(tmp_path, wrong), None, {})
    named = wrong.replace("qx,qy,qz,qw", "qw,qx,qy,qz")
    assert load_motion(file_of(tmp_path, named), None, {}).pose[0, 3] == pytest.approx(2**-0.5)
