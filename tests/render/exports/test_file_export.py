"""`export_file` and `palpate export`: formats, what stands in the way, and files that are whole or not there."""

import resource

import numpy as np
import pandas as pd
import pytest
from command_line import FAILED, MISUSED, answer, refused
from contour_cases import make_header, write_ranges
from export_cases import mostly_empty

from palpate.datasets import ContourFile, ContourWriter, read_ptlist, static_pose
from palpate.datasets.errors import ContourFileError
from palpate.render import exploration, export_file, render
from palpate.render.errors import PalpateWarning
from palpate.render.exports.file_export import FORMATS


@pytest.fixture(scope="module")
def desk(tmp_path_factory):
    """A folder with a motion's contours and a static pose's."""
    folder = tmp_path_factory.mktemp("desk")
    render("tube", "palm", exploration("tube", duration=12.0, seed=1), "cc").save(folder / "tube.h5")
    render("cube", "palm", static_pose([0, 0, 0.2]), "cc").save(folder / "cube.h5")
    return folder


@pytest.fixture
def here(desk, monkeypatch):
    monkeypatch.chdir(desk)
    yield desk
    for path in desk.glob("new*"):
        path.unlink()


@pytest.mark.parametrize("name", ["vtkhdf", "csv", "npz"])
def test_the_suffix_or_the_word_says_which_format(name, here):
    told = answer("export", "tube.h5", "-o", f"new{FORMATS[name]}", "--poses", "400:1000", "--every", "3")
    with ContourFile("tube.h5") as file:
        polylines = file.metrics()["polylines"][400:1000:3].sum()
    assert (told["format"], told["poses"], told["polylines"]) == (name, 200, polylines)
    assert told["bytes"] == (here / f"new{FORMATS[name]}").stat().st_size
    answer("export", "tube.h5", "-o", "new.dat", "--to", name.upper(), "--poses", "400:1000", "--every", "3")
    assert (here / "new.dat").read_bytes() == (here / f"new{FORMATS[name]}").read_bytes()


def test_a_point_list_is_as_before_and_by_range(here):
    told = answer("export", "tube.h5", "-o", "new.ptlist", "--speed", "5", "--update-rate", "500")
    points = read_ptlist("new.ptlist")
    assert told == {
        "points": 6000, "update_rate": 500.0, "jumps": told["jumps"], "format": "ptlist", "path": "new.ptlist"
    }  # fmt: skip
    assert (len(points.intensity), points.update_rate) == (6000, 500.0)
    told = answer("export", "tube.h5", "-o", "new2.ptlist", "--seconds", "2:3.5")
    assert abs(told["points"] - 15_000) <= 112  # a pose lasts 111 samples


def test_python_takes_numbers_and_tells_the_progress(here):
    seen = []
    told = export_file("tube.h5", "new.csv", poses=(None, 700), every=2, watch=lambda *now: seen.append(now))
    assert told["poses"] == 350
    assert seen[-1] == (350, 350)
    assert pd.read_csv("new.csv")["pose"].max() < 700


MISTAKES = {
    "tube.h5 -o new.txt": "end in one of .vtkhdf, .csv, .npz, .ptlist, .bin, or say the format with --to NAME",
    "tube.h5 -o new.csv --to npz": "ends in .csv, but --to npz asks for another format",
    "tube.h5 -o new.x --to vtk": "did you mean 'vtkhdf'?",
    "tube.h5 -o new.csv --poses 5:5": "poses 5:5 are none",
    "tube.h5 -o new.csv --poses 5:9999": "which has poses 0:1080",
    "tube.h5 -o new.csv --poses 5": "--poses must be a range FIRST:STOP",
    "tube.h5 -o new.csv --seconds 50:60": "whose times are 0 to 11.9889 s",
    "tube.h5 -o new.csv --scene": "--scene is for vtkhdf, not for csv",
    "tube.h5 -o new.csv --gzip 3": "--gzip is for vtkhdf and npz, not for csv",
    "tube.h5 -o new.npz --sampling stm": "--sampling is for ptlist and focal-points, not for npz",
    "tube.h5 -o nowhere/new.csv": "there is no folder nowhere",
    "tube.h5 -o cube.h5 --to csv": "cube.h5: exists; --overwrite replaces it",
    "tube.h5 -o tube.h5 --to csv --overwrite": "is the file to read",
    "nosuch.h5 -o new.csv": "nosuch.h5 does not exist",
    "tube -o new.csv": "palpate render tube exploration -o tube.h5 makes one",
}


@pytest.mark.parametrize("line", MISTAKES)
def test_a_mistake_is_answered_by_the_way_out_and_leaves_nothing(line, here):
    before = {path: path.stat().st_mtime_ns for path in here.iterdir()}
    refused(MISUSED, MISTAKES[line], "export", *line.split())
    assert {path: path.stat().st_mtime_ns for path in here.iterdir()} == before


def test_focal_points_are_no_contours(here):
    export_file("tube.h5", "new.ptlist", seconds="4:5")
    refused(MISUSED, "holds focal points and no contours", "export", "new.ptlist", "-o", "new.csv")
    refused(MISUSED, "choose them by seconds", "export", "new.ptlist", "-o", "new.bin", "--every", "2")
    points = read_ptlist("new.ptlist")
    assert answer("export", "new.ptlist", "-o", "new.bin")["samples"] == len(points.intensity)


@pytest.mark.exhaustive
def test_a_point_list_is_listened_to(here):
    export_file("tube.h5", "heard.ptlist", seconds="4:5")
    assert answer("noise", "heard.ptlist")["files"][0]["duration"] == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("suffix", [".vtkhdf", ".csv", ".npz"])
def test_an_export_without_a_contour_is_warned_of(suffix, tmp_path):
    path = render("cube", "palm", static_pose([0, 0, 0.6]), "cc").save(tmp_path / "away.h5")
    with pytest.warns(PalpateWarning, match=rf"away\.h5 holds no contour in the poses that .*{suffix} is of \(1\)"):
        assert export_file(path, tmp_path / f"new{suffix}")["polylines"] == 0


def test_an_unfinished_file_says_what_of_it_can_be_exported(tmp_path):
    with ContourWriter(tmp_path / "a.h5", make_header(40)) as writer:
        write_ranges(writer, mostly_empty(40), [(0, 12)])
    file, out = tmp_path / "a.h5", tmp_path / "a.npz"
    refused(MISUSED, "poses 0:12 are done and can be exported with --poses 0:12", "export", file, "-o", out)
    assert answer("export", file, "-o", out, "--poses", "0:12")["poses"] == 12


@pytest.mark.parametrize("name", list(FORMATS))
def test_a_full_disk_leaves_the_old_file_and_no_part_of_the_new_one(name, here):
    """A limit on the size of files stands for the disk."""
    out = here / f"new{FORMATS[name]}"
    out.write_text("old")
    before = sorted(here.iterdir())
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, limits[1]))
    try:
        with pytest.raises((ContourFileError, ValueError), match=r"cannot be written .*File too large"):
            export_file("tube.h5", out, seconds="3:7", overwrite=True)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert out.read_text() == "old"
    assert sorted(here.iterdir()) == before


def test_a_damaged_file_is_a_failure_and_leaves_nothing(here):
    content = bytearray((here / "tube.h5").read_bytes())
    with ContourFile("tube.h5") as file:
        pose = 360 + int(file.metrics(360, 450)["length"].argmax())  # from 4 to 5 s
        points = np.ascontiguousarray(file.contours(pose, pose + 1)["points"]).tobytes()
    place = content.index(points)
    content[place] ^= 0x10
    (here / "new.h5").write_bytes(content)
    for suffix in (".vtkhdf", ".ptlist"):
        refused(FAILED, "damaged", "export", "new.h5", "-o", f"out{suffix}", "--seconds", "4:5")
        assert not list(here.glob("out*"))


def test_an_interruption_leaves_nothing(here):
    def interrupt(done, total):
        raise KeyboardInterrupt

    for suffix in FORMATS.values():
        with pytest.raises(KeyboardInterrupt):
            export_file("tube.h5", f"out{suffix}", seconds="4:6", watch=interrupt)
        assert not list(here.glob("out*"))
