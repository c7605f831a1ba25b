"""Reading refuses what is no contour file; checking finds each rule that is broken and names where."""

import json
import re

import h5py
import numpy as np
import pytest
from contour_cases import everything, make_contours, make_header, redigest, write_file, write_ranges

from palpate.datasets.contour_file import check
from palpate.datasets.contour_file.check import check_file
from palpate.datasets.contour_file.reader import ContourFile
from palpate.datasets.contour_file.writer import ContourWriter
from palpate.datasets.errors import ContourFileError


@pytest.fixture
def path(tmp_path):
    return tmp_path / "out.h5"


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The bytes of a sealed file."""
    path = tmp_path_factory.mktemp("whole") / "out.h5"
    write_file(path, make_contours(30, intensity=True, dwell=True), chunk=11, **everything(30))
    return path.read_bytes()


@pytest.fixture
def sealed(path, whole):
    path.write_bytes(whole)
    return path


def refused(path, message):
    with pytest.raises(ContourFileError, match=message) as refusal:
        ContourFile(path)
    assert str(path) in str(refusal.value)
    assert check_file(path) == [str(refusal.value)]


def test_what_is_no_contour_file_is_refused(path, tmp_path):
    refused(path, "does not exist")
    refused(tmp_path, "is a folder")
    for content, message in (
        (b"", "is empty"),
        (b"time,x,y,z\n", "not an HDF5 file"),
        (b"\x89HDF\r\n\x1a\n", "truncated|cannot be read"),
        (b"\0" * 5000, "not an HDF5 file"),
        (b"\x89HDF\r\n\x1a\n" * 600, "not an HDF5 file|truncated|cannot be read"),
    ):
        path.write_bytes(content)
        refused(path, message)
    with h5py.File(path, "w") as file:
        file["points"] = np.zeros(3)
    refused(path, "not a contour file")


def test_a_newer_major_version_is_refused(sealed):
    for version in ([2, 0], [3, 7]):
        with h5py.File(sealed, "r+") as file:
            file.attrs["version"] = np.array(version, np.int32)
        refused(sealed, f"version {version[0]}.{version[1]}, newer")


def set_rows(name, row, value):
    def change(file):
        file[name][row] = value

    return change


def set_attribute(name, key, value):
    def change(file):
        file[name].attrs[key] = value

    return change


def retype(name, make, *, fletcher32=True):
    def change(file):
        rows, attributes = file[name][...], dict(file[name].attrs)
        del file[name]
        file.create_dataset(name, data=make(rows), fletcher32=fletcher32).attrs.update(attributes)

    return change


def open_a_loop(file):
    contours = file["contours"]
    sizes = np.diff(contours["polyline_start"])
    loop = int(np.flatnonzero((contours["polyline_closed"][...] == 1) & (sizes > 2))[0])
    end = int(contours["polyline_start"][loop + 1]) - 1
    contours["points"][end] = contours["points"][end] + np.float32(1e-6)


def weaken_a_seam(file):
    contours = file["contours"]
    loop = int(np.flatnonzero(contours["polyline_closed"][...] == 1)[0])
    end = int(contours["polyline_start"][loop + 1]) - 1
    contours["intensity"][end] = contours["intensity"][end] / 2


def end_on_another_kind(file):
    contours = file["contours"]
    line = int(np.flatnonzero(np.diff(contours["polyline_start"]) > 1)[0])
    end = int(contours["polyline_start"][line + 1]) - 1
    contours["kind"][end] = (contours["kind"][end] + 1) % 3


def lengthen(file):
    metric = file["/metrics/length_hand"]
    pose = int(np.argmax(metric[...]))
    metric[pose] = metric[pose] * np.float32(1 + 4e-6)


FIELDS_ALONE = [
    (set_attribute("/contours/points", "units", "mm"), "/contours/points: attribute units is 'mm', expected 'm'"),
    (set_attribute("/motion/pose", "frame", "head"), "/motion/pose: attribute frame is 'head'"),
    (set_rows("/contours/points", 5, np.nan), r"/contours/points: not finite \(1, first 5\)"),
    (set_rows("/contours/kind", slice(7, 9), 3), r"/contours/kind: outside 0 to 2 \(2, first 7\)"),
    (set_rows("/contours/intensity", 4, 1.5), r"/contours/intensity: outside 0 to 1 \(1, first 4\)"),
    (set_rows("/contours/polyline_closed", 2, 2), r"/contours/polyline_closed: outside 0 to 1 \(1, first 2\)"),
    (set_rows("/contours/polyline_patch", 3, -1), r"/contours/polyline_patch: below 0 \(1, first 3\)"),
    (set_rows("/contours/pose_start", 0, 1), "/contours/pose_start: begins with 1, expected 0"),
    (set_rows("/contours/pose_start", 30, 999), "pose_start: ends with 999, but /contours/polyline_closed has"),
    (set_rows("/contours/pose_start", 9, 0), r"/contours/pose_start: below the row before \(1, first 9\)"),
    (set_rows("/contours/polyline_start", 4, 0), r"/contours/polyline_start: not above .* \(1, first 4\)"),
    (set_rows("/metrics/length", 6, np.inf), r"/metrics/length: not finite \(1, first 6\)"),
    (set_rows("/motion/pose", 3, 2.0), r"/motion/pose: quaternion norm not 1 .* \(2, first 3\)"),
    (set_rows("/motion/pose", 5, np.inf), r"/motion/pose: not finite \(1, first 5\)"),
    (set_rows("/motion/time", 3, 0.0), r"/motion/time: not later than the row before \(1, first 3\)"),
    (set_rows("/live/mark", 4, 4), r"/live/mark: outside 0 to 3 \(1, first 4\)"),
    (set_rows("/live/gain", 2, -0.5), r"/live/gain: below 0 \(1, first 2\)"),
    (set_rows("/live/position", (7, 1), np.nan), r"/live/position: not finite \(1, first 7\)"),
    (set_rows("/live/intensity", 3, 1.5), r"/live/intensity: outside 0 to 1 \(1, first 3\)"),
    (set_rows("/live/stamp", 1, np.inf), r"/live/stamp: not finite \(1, first 1\)"),
    (lambda file: file.pop("/timing/seconds"), "/timing/seconds is missing"),
    (retype("/contours/dwell", lambda a: a[:-1]), "/contours/dwell has .* point rows, other fields have"),
    (retype("/metrics/length_made", lambda a: a[:-1]), "length_made has 29 pose rows, other fields have 30"),
    (retype("/metrics/length_hand", lambda a: a.astype("f8")), "length_hand is float64, expected float32"),
    (retype("/object/vertices", lambda a: a[:, :2]), r"/object/vertices has shape \[.*, 2\], expected \[vertex, 3\]"),
    (retype("/metrics/polylines", lambda a: a, fletcher32=False), "/metrics/polylines: has no Fletcher-32 checksums"),
]
FIELDS_TOGETHER = [
    (open_a_loop, "/contours/polyline_closed: poses with a closed polyline that does not repeat"),
    (
        weaken_a_seam,
        r"/contours/intensity: poses with a closed polyline whose last point has another value .* \(1, first",
    ),
    (end_on_another_kind, r"/contours/kind: poses with a polyline whose last kind .* \(1, first"),
    (lengthen, r"/metrics/length_hand: poses whose points have another length \(\d, first"),
    (set_rows("/metrics/polylines", 6, 77), r"/metrics/polylines: poses with another number .* \(1, first 6\)"),
]


@pytest.mark.parametrize("breaks", [FIELDS_ALONE, FIELDS_TOGETHER], ids=["alone", "together"])
def test_each_broken_rule_of_a_file_with_many_is_found_and_named(sealed, breaks):
    assert check_file(sealed) == []
    with h5py.File(sealed, "r+") as file:
        for change, _ in breaks:
            change(file)
    redigest(sealed)  # a writer that breaks a rule gives digests of what it wrote
    problems = check_file(sealed)
    for _, problem in breaks:
        assert any(re.search(problem, found) for found in problems), (problem, problems)


@pytest.mark.exhaustive
def test_each_broken_rule_of_the_header_is_found_and_named(sealed, tmp_path):
    path = tmp_path / "broken.h5"
    for change, problem in (
        (set_rows("/object/faces", 1, 9), "/object/faces points at vertices 0 to 9 of 4"),
        (set_rows("/object/vertices", 1, 0.5), "/object: hash is not of vertices and faces"),
        (set_rows("/motion/pose", (3, 0), 0.5), "/: recipe is not of what the file holds: motion was"),
        (set_attribute("/", "strategy", json.dumps({"raw": "x"})), "/: recipe is not of what .*: strategy was"),
        (set_attribute("/", "strategy", "{"), "attribute strategy of / is not JSON"),
        (set_attribute("/hand", "description", 3), "attribute description of /hand is missing or not text"),
    ):
        path.write_bytes(sealed.read_bytes())
        with h5py.File(path, "r+") as file:
            change(file)
        redigest(path)
        assert any(re.search(problem, found) for found in check_file(path)), (problem, check_file(path))


def test_a_wrong_step_is_found_where_blocks_meet(sealed, monkeypatch):
    monkeypatch.setattr(check, "_BLOCK_ROWS", 10)
    with h5py.File(sealed, "r+") as file:
        file["/motion/time"][10] = file["/motion/time"][9]
    redigest(sealed)
    assert "/motion/time: not later than the row before (1, first 10)" in check_file(sealed)


def test_offsets_that_lead_nowhere_are_refused_by_the_reader(sealed):
    with h5py.File(sealed, "r+") as file:
        file["/contours/pose_start"][4] = 10**9
    redigest(sealed)
    with ContourFile(sealed) as file, pytest.raises(ContourFileError, match="pose_start is damaged"):
        file.contours()


def test_a_file_being_written_says_so_and_what_is_done_is_checked(path):
    contours = make_contours(10)
    with ContourWriter(path, make_header(10)) as writer:
        write_ranges(writer, contours, [(0, 4), (6, 10)])
        assert check_file(path) == [f"{path} is still being written: 8 of 10 poses are done"]
    stopped = f'{path} is not finished, mode="resume" finishes it: 8 of 10 poses are done'
    assert check_file(path) == [stopped]
