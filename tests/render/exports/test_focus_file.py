"""Files of focal points hold the bits that sampling gives, as readers that know nothing of palpate read them."""

import csv
import resource
import struct

import numpy as np
import pandas as pd
import pytest
from command_line import FAILED, MISUSED, answer, refused
from export_cases import quiet
from focus_cases import stored_focus
from page_blocks import ROOT, blocks_of

from palpate.datasets import read_ptlist, write_ptlist
from palpate.datasets.errors import ContourFileError
from palpate.render import FocalPoints, exploration, export_file, load_contours, render, static_pose
from palpate.render.exports.focal_points import FOCUS_WRITERS, write_focus
from palpate.render.playback.focal_points import PointSource

pytestmark = pytest.mark.exhaustive

PAGE = ROOT / "docs" / "formats" / "focal-points.md"
TO = "focal-points"


@pytest.fixture(scope="module")
def desk(tmp_path_factory):
    """A folder with 2 s of a motion that begins above the tube, and a static pose's contours."""
    folder = tmp_path_factory.mktemp("desk")
    motion = exploration("tube", duration=6.0, seed=1)[200:380]
    render("tube", "palm", motion, "cc").save(folder / "tube.h5")
    render("cube", "palm", static_pose([0, 0, 0.2]), "cc").save(folder / "cube.h5")
    return folder


@pytest.fixture
def here(desk, monkeypatch):
    monkeypatch.chdir(desk)
    yield desk
    for path in desk.glob("new*"):
        path.unlink()


def read_by_page(path):
    """Rate and points as the reader in the format's page reads them."""
    (block,) = [block for block in blocks_of(PAGE) if block.language == "python"]
    names = {}
    exec(block.text.partition("\n\nrate,")[0], names)
    return names["focal_points"](path)


def test_the_pages_reader_reads_what_sampling_gives_to_the_bit(here):
    told = answer("export", "tube.h5", "-o", "new.bin", "--speed", "5", "--update-rate", "8000")
    wanted = load_contours("tube.h5").sample("stm", speed=5.0, update_rate=8e3)
    rate, points = read_by_page("new.bin")
    assert (told["format"], told["samples"], told["foci"], told["update_rate"]) == (TO, len(points), 1, 8e3)
    assert told["jumps"] == sum(wanted.count.jumps.values())
    assert told["bytes"] == 32 + 16 * told["samples"]
    assert rate == 8e3
    assert (points[..., 3] > 0).any()
    assert (points[..., 3] == 0).any()
    np.testing.assert_array_equal(points[:, 0, :3], wanted.position)
    np.testing.assert_array_equal(points[:, 0, 3], wanted.intensity)


def test_struct_reads_header_and_samples_where_the_page_says(here):
    focus = FocalPoints(np.float32([[0.01, -0.02, 0.2], [0, 1e-9, 0.3]]), np.float32([1, 0.1]))
    write_focus(PointSource(focus, update_rate=40e3 / 3), here, here / "new.bin", ".bin", watch=quiet)
    content = (here / "new.bin").read_bytes()
    assert content[:8] == b"PALPATEF"
    assert struct.unpack_from("<II", content, 8) == (1, 1)
    assert struct.unpack_from("<d", content, 16) == (40e3 / 3,)
    assert struct.unpack_from("<Q", content, 24) == (2,)
    assert content[32:] == struct.pack("<8f", 0.01, -0.02, 0.2, 1, 0, 1e-9, 0.3, 0.1)


@pytest.mark.parametrize(("sampling", "foci"), [("stm", 1), ("multi-focus", 2)])
def test_each_format_holds_the_same_focal_points(sampling, foci, here):
    for suffix in FOCUS_WRITERS:
        export_file("tube.h5", f"new{suffix}", to=TO, seconds="1:1.6", sampling=sampling)
    rate, points = read_by_page("new.bin")
    assert points.shape[1:] == (foci, 4)
    with np.load("new.npz", allow_pickle=False) as arrays:
        assert set(arrays) == {"position", "intensity", "update_rate"}
        assert arrays["update_rate"] == rate == 10e3
        np.testing.assert_array_equal(arrays["position"], points[..., :3])
        np.testing.assert_array_equal(arrays["intensity"], points[..., 3])
    with open("new.csv", newline="") as file:
        header, *rows = csv.reader(file)
    assert header == ["time", *["point"] * (foci > 1), "x", "y", "z", "intensity"]
    numbers = np.array([row[-4:] for row in rows], np.float64).astype(np.float32)
    np.testing.assert_array_equal(numbers.reshape(points.shape), points)
    assert [float(row[0]) for row in rows] == [k / rate for k in range(len(points)) for _ in range(foci)]
    if foci > 1:
        assert [row[1] for row in rows] == ["0", "1"] * len(points)


def test_pandas_reads_the_table_that_a_batch_gives(here):
    told = answer("export", "cube.h5", "-o", "new.csv", "--to", TO, "--duration", "0.1")
    table = load_contours("cube.h5").sample("stm", duration=0.1).to_pandas()
    found = pd.read_csv("new.csv")
    assert told["samples"] == len(found) == 1000
    assert list(found) == list(table)
    for name in "x", "y", "z", "intensity":
        np.testing.assert_array_equal(found[name].astype(np.float32), table[name])
    np.testing.assert_allclose(found["time"], table["time"], rtol=1e-15)


@pytest.mark.parametrize("foci", [None, 1, 8])
def test_a_range_of_stored_points_is_a_slice_of_all(foci, here):
    """A file of a sweep, with and without an axis of focal points."""
    position = stored_focus(here / "new.h5", 3000, foci=() if foci is None else (foci,), rate=4000.0)
    for seconds, rows in ((None, slice(None)), ("0.1:0.2", slice(400, 800)), ("0.6:", slice(2400, None))):
        told = answer(*f"export new.h5 -o new.bin --overwrite --seconds {seconds or ':'}".split())
        rate, points = read_by_page("new.bin")
        assert (told["foci"], rate) == (foci or 1, 4000.0)
        assert "jumps" not in told
        np.testing.assert_array_equal(points[..., :3], position[rows].reshape(-1, foci or 1, 3))
        assert (points[..., 3] == 0.5).all()


def test_a_point_list_is_taken_with_its_peak(here):
    write_ptlist("new.ptlist", [[0, 0, 0.2], [0.01, 0, 0.2]], [1, 0.3], 500.0)
    (here / "new.ptlist").write_text((here / "new.ptlist").read_text().replace("2,500,1", "2,500,0.5"))
    answer("export", "new.ptlist", "-o", "new.bin")
    rate, points = read_by_page("new.bin")
    listed = read_ptlist("new.ptlist")
    assert (rate, listed.intensity_peak) == (500.0, 0.5)
    np.testing.assert_array_equal(points[:, 0, 3], np.float32([0.5, np.float32(0.3) * np.float32(0.5)]))


def test_a_duration_is_the_beginning_of_the_whole_and_a_range_is_a_motion_of_its_own(here):
    """A point list of the same range holds the same focal points: it is written and read by other code."""
    wholes = [read_by_page(export_file("tube.h5", "new.bin")["path"])[1]]
    wholes.append(read_by_page(export_file("tube.h5", "new2.bin", duration=1.5)["path"])[1])
    assert len(wholes[1]) == 15_000
    np.testing.assert_array_equal(wholes[1], wholes[0][:15_000])
    for suffix in (".bin", ".ptlist"):
        answer("export", "tube.h5", "-o", f"new3{suffix}", "--poses", "45:150", "--every", "2")
    listed, (_, points) = read_ptlist("new3.ptlist"), read_by_page("new3.bin")
    assert (listed.intensity > 0).any()
    np.testing.assert_array_equal(points[:, 0, :3], listed.position)
    np.testing.assert_array_equal(points[:, 0, 3], listed.intensity)


MISTAKES = {
    "tube.h5 -o new.txt --to focal-points": "must end in .bin, .csv, .npz to hold focal points",
    "tube.h5 -o new.bin --to csv": "ends in .bin, but --to csv asks for another format",
    "tube.h5 -o new.bin --gzip 3": "--gzip is for vtkhdf and npz, not for focal-points",
    "tube.h5 -o new.bin --scene": "--scene is for vtkhdf, not for focal-points",
    "tube.h5 -o new.bin --update-rate 0.5": "must lie in 1..40000 Hz, not 0.5",
    "tube.h5 -o new.bin --update-rate 50000": "must lie in 1..40000 Hz, not 50000",
    "cube.h5 -o new.bin": "say how long to play it with --duration SECONDS",
    "cube.h5 -o new.bin --duration 5000": "50000000 samples (5000 s at 10000 Hz), but a file of focal points holds "
    "40000000: choose at most 4000 s",
    "tube.h5 -o new.h5 --to focal-points": "must end in .bin, .csv, .npz",
    "tube.h5 -o newold.bin": "newold.bin: exists; --overwrite replaces it",
    "tube.h5 -o new.bin --sampling newnine.json": "holds up to 8 focal points at a time, not foci 9",
    "newnine.h5 -o new.bin": "holds up to 8 focal points at a time, not foci 9",
    "newfast.h5 -o new.bin": "must lie in 1..40000 Hz, not 50000",
    "newold.bin -o new.bin": "newold.bin is no contour file but focal points as palpate export writes them",
}


@pytest.mark.parametrize("line", MISTAKES)
def test_a_mistake_is_answered_by_the_way_out_and_leaves_nothing(line, here):
    stored_focus(here / "newnine.h5", 10, foci=(9,))
    stored_focus(here / "newfast.h5", 10, rate=50e3)
    (here / "newnine.json").write_text('{"foci": 9}')
    (here / "newold.bin").write_bytes(b"PALPATEF")
    before = {path: path.stat().st_mtime_ns for path in here.iterdir()}
    refused(MISUSED, MISTAKES[line], "export", *line.split())
    assert {path: path.stat().st_mtime_ns for path in here.iterdir()} == before


BAD = {
    "position": ("sample 4500 has a position that is not finite", np.nan),
    "intensity": ("sample 4500 has an intensity outside 0..1", 1.01),
}


@pytest.mark.parametrize("which", BAD)
def test_stored_values_out_of_range_are_named_and_leave_nothing(which, here):
    """A file that another program wrote; sample 4,500 is in the second block."""
    said, value = BAD[which]
    stored_focus(here / "new.h5", 5000, foci=(2,), change={which: (4500, value)})
    before = sorted(here.iterdir())
    for suffix in FOCUS_WRITERS:
        refused(FAILED, f"new.h5: {said}", "export", "new.h5", "-o", f"new{suffix}", "--to", TO)
        assert sorted(here.iterdir()) == before


def test_an_intensity_that_rounding_lifted_is_one(here):
    """The reader of focal points of a sweep lets an intensity of up to 1 + 1e-5 pass; the format does not."""
    stored_focus(here / "new.h5", 3, change={"intensity": (1, 1.000001)})
    export_file("new.h5", "new.bin")
    assert read_by_page("new.bin")[1][:, 0, 3].tolist() == [0.5, 1.0, 0.5]


def test_the_bytes_are_the_same_each_time_and_compress(here):
    contents = []
    for gzip in (0, 0, 6, 6):
        export_file("cube.h5", "new.npz", to=TO, duration=1.0, gzip=gzip, overwrite=True)
        contents.append((here / "new.npz").read_bytes())
        assert np.load("new.npz")["position"].shape == (10_000, 1, 3)
    assert contents[0] == contents[1]
    assert contents[2] == contents[3]
    assert len(contents[2]) < len(contents[0]) / 3  # one contour, again and again


@pytest.mark.parametrize("suffix", FOCUS_WRITERS)
def test_a_full_disk_and_an_interruption_leave_the_old_file_and_no_part_of_the_new_one(suffix, here):
    """A limit on the size of files stands for the disk. The interruption comes in the second block."""

    def interrupt(done, total):
        if done > 4096:
            raise KeyboardInterrupt

    out = here / f"new{suffix}"
    out.write_text("old")
    before = sorted(here.iterdir())
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, limits[1]))
    try:
        with pytest.raises(ContourFileError, match=r"new\.\w+: cannot be written .*File too large"):
            export_file("cube.h5", out, to=TO, duration=1.0, overwrite=True)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    with pytest.raises(KeyboardInterrupt):
        export_file("cube.h5", out, to=TO, duration=1.0, overwrite=True, watch=interrupt)
    assert out.read_text() == "old"
    assert sorted(here.iterdir()) == before
