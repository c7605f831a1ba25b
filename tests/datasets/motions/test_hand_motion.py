"""Hand motions: what is accepted, what is refused and how; files."""

import dataclasses

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from palpate.datasets.errors import MotionError, RecordingWarning
from palpate.datasets.motions.hand_motion import PALM_DOWN, HandMotion, static_pose
from palpate.render import exploration

BOUNDS = np.array([[-0.065, -0.065, 0.135], [0.065, 0.065, 0.265]])
FLAT = [0.1, -0.2, 0.3, 0.0, 0.0, 0.0, 1.0]
HEADER = "time,x,y,z,qx,qy,qz,qw\n"


def poses(count):
    return np.tile(FLAT, (count, 1))


def changed(row, column, value):
    pose = poses(4)
    pose[row, column] = value
    return pose


def written(path, text):
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def same(a, b):
    assert np.array_equal(a.pose, b.pose)
    assert (a.time is None) == (b.time is None)
    assert a.time is None or np.array_equal(a.time, b.time)
    assert a.offset == b.offset


# --- the value -----------------------------------------------------------------------------------


def test_motion_keeps_float32_poses_and_float64_times_read_only():
    motion = HandMotion([0.0, 0.5, 1.5], poses(3))
    assert (motion.pose.dtype, motion.time.dtype, len(motion)) == (np.float32, np.float64, 3)
    for array in (motion.pose, motion.time):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    with pytest.raises(dataclasses.FrozenInstanceError):
        motion.offset = 1.0


def test_motion_does_not_share_the_caller_s_arrays():
    time, pose = np.array([0.0, 1.0]), poses(2)
    motion = HandMotion(time, pose)
    time += 5
    pose += 5
    assert motion.time.tolist() == [0.0, 1.0]
    assert motion.pose[1].tolist() == np.float32(FLAT).tolist()


def test_time_starts_at_zero_and_keeps_its_offset():
    motion = HandMotion([100.0, 100.25, 101.0], poses(3), offset=7.0)
    assert motion.time.tolist() == [0.0, 0.25, 1.0]
    assert motion.offset == 107.0


def test_a_part_of_a_motion_begins_at_time_0():
    motion = HandMotion([1.0, 1.5, 2.5, 3.0], changed(2, 0, 0.9))
    part = motion[1:3]
    assert (part.time.tolist(), part.offset) == ([0.0, 1.0], 0.0)
    assert part.pose[:, 0].tolist() == motion.pose[1:3, 0].tolist()
    for poses_of in (slice(0, 4, 2), slice(2, 2), slice(3, 1)):
        with pytest.raises(MotionError, match="poses must follow each other"):
            motion[poses_of]


def test_last_pose_lasts_one_median_interval():
    motion = HandMotion([0.0, 0.1, 0.2, 0.5], poses(4))
    assert motion.duration == pytest.approx(0.6)
    assert motion.rate == pytest.approx(10.0)


@pytest.mark.parametrize("motion", [static_pose([0, 0, 0.2]), HandMotion([3.0], poses(1)), HandMotion(None, poses(5))])
def test_without_an_interval_there_is_no_duration_and_no_rate(motion):
    assert (motion.duration is None, motion.rate is None) == (True, True)


def test_quaternion_near_unit_is_normalised_and_a_float32_unit_left_alone():
    loose = HandMotion(None, [[0, 0, 0, 0.6 * 1.0009, 0, 0, 0.8 * 1.0009]])
    assert loose.pose[0, 3:] == pytest.approx([0.6, 0, 0, 0.8], abs=1e-7)
    again = HandMotion(None, loose.pose)
    assert np.array_equal(again.pose, loose.pose)


@pytest.mark.parametrize(
    ("pose", "said"),
    [
        (changed(2, 6, 0.0), r"row 2: zero quaternion"),
        (changed(3, 6, 0.998), r"row 3: quaternion norm 0\.998; it must be 1 within 0\.001"),
        (changed(1, 5, 1.0), r"row 1: quaternion norm 1\.41421"),
        (changed(1, 0, np.nan), r"row 1: pose \[nan.* is not finite"),
        (changed(2, 4, -np.inf), r"row 2: pose .*-inf.* is not finite"),
        (changed(0, 2, 1e39), r"row 0: pose .*1e\+39.* is not finite"),  # infinite as float32
        (changed(3, 1, -1.1e6), r"row 3: position \[0\.1, -1100000\.0, 0\.3\] m must lie within 1e\+06 m of the array"),
        (np.zeros((0, 7)), r"at least one pose"),
        (np.zeros((3, 6)), r"shape \[pose, 7\], got \[3, 6\]"),
        (np.array(FLAT), r"shape \[pose, 7\], got \[7\]"),
        ([FLAT, FLAT[:3]], r"shape \[pose, 7\]"),
        ([["a"] * 7], r"numbers"),
    ],
)
def test_bad_pose_is_refused_with_its_row(pose, said):
    with pytest.raises(MotionError, match=said):
        HandMotion(None, pose)


@pytest.mark.parametrize(
    ("time", "said"),
    [
        ([0, 1, 1, 2], r"row 2: time 1\.0 s repeats 1\.0 s of row 1"),
        ([0, 1, 2, 1.5], r"row 3: time 1\.5 s is not after 2\.0 s of row 2"),
        ([0, np.nan, 2, 3], r"row 1: time nan s is not finite"),
        ([0, 1, 2, np.inf], r"row 3: time inf s is not finite"),
        ([0, 1, 2], r"time must have shape \[4\].*got \[3\]"),
        ([[0], [1], [2], [3]], r"time must have shape \[4\]"),
        (["a", "b", "c", "d"], r"numbers"),
        ([-1e17, 0.0, 1e-3, 2e-3], r"row 2: time 0\.001 s is not after"),  # equal once it starts at 0
    ],
)
def test_bad_time_is_refused_with_its_row(time, said):
    with pytest.raises(MotionError, match=said):
        HandMotion(time, poses(4))


def test_palm_down_faces_the_array_with_fingers_away_from_the_user():
    hand = Rotation.from_quat(PALM_DOWN)
    skin, fingers = hand.apply([0, -1, 0]), hand.apply([0, 0, -1])
    assert skin == pytest.approx([0, 0, -1], abs=1e-15)
    assert fingers == pytest.approx([0, 1, 0], abs=1e-15)
    assert static_pose([0, 0, 0.2]).pose[0, 3:] == pytest.approx(PALM_DOWN, abs=1e-7)


def test_static_pose_refuses_what_is_no_pose():
    with pytest.raises(MotionError, match=r"position must have shape \[3\], got \[2\]"):
        static_pose([0, 0])
    with pytest.raises(MotionError, match=r"quaternion must have shape \[4\]"):
        static_pose([0, 0, 0], [1, 0, 0])
    with pytest.raises(MotionError, match="zero quaternion"):
        static_pose([0, 0, 0], [0, 0, 0, 0])
    with pytest.raises(MotionError, match="offset must be finite, got nan"):
        HandMotion(None, poses(1), offset=float("nan"))


# --- files ---------------------------------------------------------------------------------------

finite = st.floats(-1e3, 1e3, width=32)


@st.composite
def motions(draw):
    count = draw(st.integers(1, 6))
    quaternion = draw(arrays(np.float64, (count, 4), elements=st.floats(0.1, 1.0)))
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    pose = np.hstack([draw(arrays(np.float32, (count, 3), elements=finite)), quaternion])
    if draw(st.booleans()):
        return HandMotion(None, pose)
    clock = draw(st.floats(-1e9, 1e10)) + np.cumsum(draw(arrays(np.float64, count, elements=st.floats(1e-3, 10.0))))
    return HandMotion(clock, pose)


@pytest.mark.exhaustive
@pytest.mark.filterwarnings("ignore:.*(positions reach|looks like milliseconds)")
@pytest.mark.parametrize("suffix", [".csv", ".CSV", ".h5", ".hdf5"])
def test_saved_motion_reads_back_to_the_last_bit(tmp_path_factory, suffix):
    path = tmp_path_factory.mktemp("motion") / f"hand{suffix}"

    @given(motions())
    def round_trip(motion):
        motion.save(path, overwrite=True)
        same(HandMotion.load(path), motion)

    round_trip()


def test_hdf5_keeps_the_seed(tmp_path):
    motion = exploration(BOUNDS, duration=0.5, seed=11)
    motion.save(tmp_path / "m.h5")
    assert HandMotion.load(tmp_path / "m.h5").seed == 11


def test_csv_holds_the_clock_s_own_times(tmp_path):
    HandMotion([10.5, 11.0], poses(2)).save(tmp_path / "m.csv")
    assert (tmp_path / "m.csv").read_text() == (
        HEADER + "10.5,0.1,-0.2,0.3,0.0,0.0,0.0,1.0\n11.0,0.1,-0.2,0.3,0.0,0.0,0.0,1.0\n"
    )


def test_recorded_times_survive_the_csv_to_the_last_bit(tmp_path):
    for start in (-3.7, 1e-3, 0.1, 12.34, 1.7e9):
        motion = HandMotion(start + np.cumsum(np.random.default_rng(1).uniform(1e-3, 2e-2, 500)), poses(500))
        same(HandMotion.load(motion.save(tmp_path / "m.csv", overwrite=True)), motion)


def test_csv_that_cannot_tell_two_times_apart_is_not_written(tmp_path):
    with pytest.raises(MotionError, match=r"row 1: a CSV cannot tell its time .* offset 1e\+17 s"):
        HandMotion([0.0, 1.0], poses(2), offset=1e17).save(tmp_path / "m.csv")
    assert list(tmp_path.iterdir()) == []


def test_columns_beside_a_motion_s_are_left_out_with_a_warning(tmp_path):
    text = 'frame,time,x,y,z,qx,qy,qz,qw,note,\n7,5,1,0,0,0,0,0,1,"start, here",\n8,6,2,0,0,0,0,0,1,,\n'
    with pytest.warns(RecordingWarning, match=r"m\.csv: left out what is no column of a motion: frame, note$"):
        motion = HandMotion.load(written(tmp_path / "m.csv", text))
    assert (motion.offset, motion.time.tolist(), motion.pose[:, 0].tolist()) == (5.0, [0.0, 1.0], [1.0, 2.0])


ROW = "0,0,0,0,0,1\n"


@pytest.mark.parametrize(
    "text",
    [
        HEADER + "5,1," + ROW + "6,2," + ROW,
        "\ufeff" + HEADER + "5,1," + ROW + "6,2," + ROW,
        (HEADER + "5,1," + ROW + "6,2," + ROW).replace("\n", "\r\n"),
        "\n" + HEADER + "\n5,1," + ROW + "  \n6,2," + ROW + "\n\n",
        "time, x, y, z, qx, qy, qz, qw\n5, 1, " + ROW + " 6,2," + ROW.strip(),
    ],
    ids=["plain", "byte order mark", "CRLF", "blank lines", "blanks, no last newline"],
)
def test_csv_in_its_spellings_is_read(tmp_path, text):
    motion = HandMotion.load(written(tmp_path / "m.csv", text))
    assert (motion.offset, motion.time.tolist(), motion.pose[:, 0].tolist()) == (5.0, [0.0, 1.0], [1.0, 2.0])


@pytest.mark.parametrize(
    "text",
    [
        "qz,x,qw,y,time,z,qx,qy\n0.0,0.1,0.8,-0.2,5,0.3,0.6,0.0\n0.0,0.1,0.8,-0.2,6,0.3,0.6,0.0\n",
        "time,x,y,z,qw,qx,qy,qz\n5,0.1,-0.2,0.3,0.8,0.6,0.0,0.0\n6,0.1,-0.2,0.3,0.8,0.6,0.0,0.0\n",
        "time;x;y;z;qw;qx;qy;qz\n5;0,1;-0,2;0,3;0,8;0,6;0,0;0\n6;0,1;-0,2;0,3;0,8;0,6;0,0;0\n",
        "\ufefftime\tx\ty\tz\tqx\tqy\tqz\tqw\n5\t0,1\t-0.2\t0,3\t0,6\t0\t0\t0,8\n6\t0,1\t-0,2\t0,3\t0,6\t0\t0\t0,8\n",
        "sep=;\r\nTIME;X;Y;Z;QX;QY;QZ;QW\r\n5;0,1;-0,2;0,3;0,6;0;0;0,8\r\n6;0,1;-0,2;0,3;0,6;0;0;0,8\r\n",
        '"time","x",y,z,qx,qy,qz,qw\n5,"0,1","-0,2","0,3","0,6",0,0,"0,8"\n6,0.1,-0.2,0.3,0.6,0,0,0.8\n',
        "time,x,y,z,qx,qy,qz,qw,,\n5,0.1,-0.2,0.3,0.6,0,0,0.8,,\n,,,,,,,,,\n6,0.1,-0.2,0.3,0.6,0,0,0.8\n,,,,,,,\n",
        "# made by hand\ntime [s],x [m],y (m),z_m,qx,qy,qz,qw\n5,.1,-.2,.3,.6,0,0,.8\n6,.1,-.2,.3,.6,0,0,.8\n",
    ],
    ids=["any order", "w first", "European spreadsheet", "tabs", "sep=", "quotes", "empty cells", "comments, units"],
)
def test_csv_columns_are_taken_by_their_names_and_decimal_commas_are_read(tmp_path, text):
    """Right values: written here by hand, quaternion (0.6, 0, 0, 0.8) as x y z w."""
    motion = HandMotion.load(written(tmp_path / "m.csv", text))
    assert (motion.offset, motion.time.tolist()) == (5.0, [0.0, 1.0])
    assert motion.pose.tolist() == np.float32([[0.1, -0.2, 0.3, 0.6, 0.0, 0.0, 0.8]] * 2).tolist()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", r"empty file"),
        ("\n \n", r"empty file"),
        (HEADER, r"a motion needs at least one pose"),
        ("0,1," + ROW, r"line 1: header '0,1,0,0,0,0,0,1' is not 'time,x,y,z,qx,qy,qz,qw'"),
        ("t,x,y,z,qw,qx,qy,qz\n", r"line 1: header"),
        (HEADER.replace(",", "|"), r"line 1: header 'time\|x"),
        (HEADER.replace("qx", "x"), r"line 1: header 'time,x,y,z,x,qy,qz,qw' is not .*in any order"),
        (HEADER.replace(",", ";") + "0;1.000,5;0;0;0;0;0;1\n", r"line 2: '1\.000,5' in column x is not a number"),
        (HEADER + "0,1," + ROW + "1,1,0,0,0,0,1\n", r"line 3: 7 columns, the header has 8"),
        (HEADER + "0,1,2," + ROW, r"line 2: 9 columns, the header has 8; decimal commas need semicolons between cells"),
        (HEADER + "0;1;0;0;0;0;0;1\n", r"line 2: 1 columns, the header has 8$"),
        (HEADER + "0,1," + ROW + "\n1,oops," + ROW, r"line 4: 'oops' in column x is not a number"),
        (HEADER + "0,1_0," + ROW, r"line 2: '1_0' in column x is not a number"),
        (HEADER + "0,," + ROW, r"line 2: '' in column x is not a number"),
        (HEADER + "0,nan," + ROW, r"line 2: pose \[nan"),
        (HEADER + "0,1,0,0,0,0,0,0\n", r"line 2: zero quaternion"),
        (HEADER + "\n0,1," + ROW + "\n\n0.5,1,0,0,0,0,0,2\n", r"line 6: quaternion norm 2"),
        (HEADER + "0,1," + ROW + "\n0,1," + ROW, r"line 4: time 0\.0 s repeats 0\.0 s of line 2"),
        (HEADER + "2,1," + ROW + "1,1," + ROW, r"line 3: time 1\.0 s is not after 2\.0 s of line 2"),
        (b"\xff\xfe" + HEADER.encode("utf-16-le"), r"byte 0 is not UTF-8 text, but UTF-16: save it as .*CSV UTF-8"),
        (
            HEADER.replace("time", "time_ms"),
            r"line 1: .*in seconds: divide them by 1000, and name the column time$",
        ),
        (HEADER.replace("time", "time [ms]"), r"line 1: .*divide them by 1000"),
        (HEADER.replace("x,y", "x [mm],y", 1), r"line 1: header 'time,x \[mm\],y,.* is not 'time,x,y,z,qx,qy,qz,qw'"),
        ("note," + HEADER.replace("time,", ""), r"line 1: header 'note,x.*' is not"),
        ("x," + HEADER, r"line 1: header 'x,time,x.*' is not"),
        (HEADER + '0,"1,000",' + ROW, r"line 2: '1,000' in column x .*one of thousands: write decimal points"),
        (HEADER + '0,"1,' + ROW, r"line 2: its quotes are not closed"),
        (HEADER + "0,1,0,0,0.71,0,0,0.71\n", r"line 2: quaternion norm 1.00409; .*rounded to 2 decimals: write six"),
    ],
)
def test_bad_csv_is_refused_with_path_and_line(tmp_path, text, said):
    with pytest.raises(MotionError, match=rf"bad\.csv: {said}"):
        HandMotion.load(written(tmp_path / "bad.csv", text))


def test_motion_of_a_contour_file_is_read(tmp_path):
    with h5py.File(tmp_path / "contours.h5", "w") as file:
        file.attrs["seed"] = 4
        file["motion/pose"] = poses(2).astype(np.float32)
        file["motion/time"] = [0.0, 0.1]
        file["contours/points"] = np.zeros((5, 3))
    motion = HandMotion.load(tmp_path / "contours.h5")
    assert (len(motion), motion.time.tolist(), motion.seed) == (2, [0.0, 0.1], 4)


def test_bad_hdf5_is_refused(tmp_path):
    with pytest.raises(MotionError, match=r"foreign\.h5: not a readable HDF5 file"):
        HandMotion.load(written(tmp_path / "foreign.h5", b"no HDF5 at all"))
    whole = exploration(BOUNDS, duration=1.0, seed=1).save(tmp_path / "whole.h5").read_bytes()
    for length in range(100, len(whole) - 1, len(whole) // 20):
        with pytest.raises(MotionError, match=r"cut\.h5: "):
            HandMotion.load(written(tmp_path / "cut.h5", whole[:length]))
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["motion/time"] = [0.0]
        file["words/pose"] = "text"
    with pytest.raises(MotionError, match=r"other\.h5: an HDF5 file without /motion/pose"):
        HandMotion.load(tmp_path / "other.h5")
    with h5py.File(tmp_path / "words.h5", "w") as file:
        file["motion/pose"] = "text"
    with pytest.raises(MotionError, match=r"words\.h5: /motion/pose is text, expected numbers"):
        HandMotion.load(tmp_path / "words.h5")
    with h5py.File(tmp_path / "zero.h5", "w") as file:
        file["motion/pose"] = changed(2, 6, 0.0)
    with pytest.raises(MotionError, match=r"zero\.h5: row 2: zero quaternion"):
        HandMotion.load(tmp_path / "zero.h5")


@pytest.mark.parametrize("suffix", [".csv", ".h5"])
def test_missing_file_and_folder_are_refused(tmp_path, suffix):
    with pytest.raises(MotionError, match="no such motion file"):
        HandMotion.load(tmp_path / f"absent{suffix}")
    (tmp_path / f"folder{suffix}").mkdir()
    with pytest.raises(MotionError, match="cannot be read"):
        HandMotion.load(tmp_path / f"folder{suffix}")


def test_unknown_suffix_is_refused_naming_the_known(tmp_path):
    for act in (HandMotion.load, static_pose([0, 0, 0.2]).save):
        with pytest.raises(MotionError, match=r"unknown suffix '\.json'.*\.csv, \.h5, \.hdf5"):
            act(tmp_path / "m.json")


def test_existing_file_is_not_replaced_unasked(tmp_path):
    path = written(tmp_path / "m.h5", "hours of work")
    with pytest.raises(MotionError, match="exists already"):
        static_pose([0, 0, 0.2]).save(path)
    assert path.read_text() == "hours of work"


def test_failed_save_says_so_and_leaves_nothing(tmp_path):
    with pytest.raises(MotionError, match="cannot be written"):
        static_pose([0, 0, 0.2]).save(tmp_path / "absent" / "m.csv")
    assert list(tmp_path.iterdir()) == []
